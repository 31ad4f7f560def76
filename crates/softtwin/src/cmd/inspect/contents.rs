//! What `inspect` prints of a model.

use rom::halfwidths::HalfWidths;
use rom::hull::TrainingRange;
use rom::inputs::{InputAxis, InputSpec};
use rom::model::{Model, ModelHeader, OutputField, PressureLimit, RegimeModel};
use rom::radial::KernelKind;
use rom::regime::OnsetTable;
use serde::Serialize;
use std::collections::BTreeMap;
use wire::layout::hex;

/// What a model file holds.
#[derive(Serialize)]
pub struct Contents<'a> {
    actuator: &'a str,
    source: &'static str,
    node_count: usize,
    bytes: usize,
    database_hash: String,
    hysteresis_mpa: f64,
    /// Largest gap at which the body touches by its weight, and smallest at which it never touches.
    sag_mm: Option<f64>,
    reach_mm: Option<f64>,
    pressure_limit: Option<&'a PressureLimit>,
    inputs: Vec<ContentsInput<'a>>,
    fields: Vec<ContentsField<'a>>,
    node_sets: BTreeMap<&'a str, usize>,
    regimes: BTreeMap<&'static str, ContentsRegime<'a>>,
    outputs: BTreeMap<String, ContentsOutput>,
}

#[derive(Serialize)]
struct ContentsInput<'a> {
    name: String,
    unit: &'a str,
    min: Option<f64>,
    max: Option<f64>,
    nominal: Option<f64>,
}

#[derive(Serialize)]
struct ContentsField<'a> {
    name: &'a str,
    unit: &'a str,
    /// Computed from the coordinates, without modes of its own.
    derived: bool,
}

/// The maps of a regime, by group of fields.
#[derive(Serialize)]
struct ContentsRegime<'a> {
    inputs: Vec<RegimeInput>,
    /// What counts as inside the training range.
    domain: String,
    modes: BTreeMap<&'a str, usize>,
    centres: BTreeMap<&'a str, usize>,
    kernels: BTreeMap<&'a str, KernelKind>,
    force: Option<KernelKind>,
    half_widths: HalfWidths,
    measured_difference: Option<ContentsDifference>,
}

#[derive(Serialize)]
struct RegimeInput {
    name: String,
    min: f64,
    max: f64,
}

/// What measurements added to the finite elements.
#[derive(Serialize)]
struct ContentsDifference {
    modes: usize,
    centres: usize,
    half_width_mm: f64,
    half_width_elsewhere_mm: f64,
}

#[derive(Serialize)]
struct ContentsOutput {
    half_width: f64,
}

impl<'a> Contents<'a> {
    pub fn of(model: &'a Model) -> Self {
        let header = &model.header;
        let input = |(_, input): (usize, &'a InputSpec)| ContentsInput {
            name: input.key(),
            unit: &input.unit,
            min: finite(input.range[0]),
            max: finite(input.range[1]),
            nominal: input.value,
        };
        let field = |field: &'a OutputField| ContentsField {
            name: &field.spec.name,
            unit: &field.spec.unit,
            derived: field.magnitude_of.is_some(),
        };
        let outputs = train::measured::outputs(model).into_iter();
        Self {
            actuator: &header.actuator,
            source: if model.is_measured() { "measured" } else { "finite elements" },
            node_count: header.node_count,
            bytes: model.blocks.iter().map(|(_, block)| block.byte_count()).sum(),
            database_hash: hex(&header.database_hash),
            hysteresis_mpa: header.hysteresis_mpa,
            sag_mm: header.onset.as_ref().map(OnsetTable::sag_mm),
            reach_mm: header.onset.as_ref().map(OnsetTable::reach_mm),
            pressure_limit: header.limit.as_ref(),
            inputs: header.taken_inputs().map(input).collect(),
            fields: header.fields.iter().map(field).collect(),
            node_sets: header.node_sets.iter().map(|set| (set.name.as_str(), set.nodes.len())).collect(),
            regimes: header
                .regimes
                .iter()
                .map(|regime| (regime.kind.name(), contents_regime(header, regime)))
                .collect(),
            outputs: outputs
                .map(|output| (output.name, ContentsOutput { half_width: output.half_width }))
                .collect(),
        }
    }
}

fn finite(value: f64) -> Option<f64> {
    Some(value).filter(|value| value.is_finite())
}

fn contents_regime<'a>(header: &ModelHeader, regime: &'a RegimeModel) -> ContentsRegime<'a> {
    let groups = || regime.groups.iter().map(|group| (group.name.as_str(), group));
    let axis = |axis: &InputAxis| RegimeInput {
        name: header.inputs[axis.input].key(),
        min: axis.min,
        max: axis.max,
    };
    ContentsRegime {
        inputs: regime.inputs.axes.iter().map(axis).collect(),
        domain: domain(regime),
        modes: groups().map(|(name, group)| (name, group.coefficients.len())).collect(),
        centres: groups().map(|(name, group)| (name, group.surrogate.centre_count())).collect(),
        kernels: groups().map(|(name, group)| (name, group.surrogate.kernel)).collect(),
        force: regime.force.as_ref().map(|force| force.surrogate.kernel),
        half_widths: header.known_halfwidths(regime.halfwidths),
        measured_difference: regime.difference.as_ref().map(|difference| ContentsDifference {
            modes: difference.coefficients.len(),
            centres: difference.centres.len(),
            half_width_mm: difference.residual_mm,
            half_width_elsewhere_mm: difference.difference_mm,
        }),
    }
}

fn domain(regime: &RegimeModel) -> String {
    match &regime.domain {
        TrainingRange::Interval(_) => "the interval of its samples".into(),
        TrainingRange::Product { reach, .. } if regime.inputs.operating() == 0 => {
            format!("the ranges of its inputs, within {reach:.2} of a sample")
        }
        TrainingRange::Product { reach, .. } => format!(
            "the hull of its samples over pressure and gap, the ranges of the parameters, within {reach:.2} of a sample"
        ),
        hull => format!("the convex hull of its samples, {} vertices", hull.vertex_count()),
    }
}
