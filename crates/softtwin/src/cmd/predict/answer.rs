//! What a model says about one state, as a report.

use rom::evaluation::Evaluation;
use rom::halfwidths::HalfWidths;
use rom::hull::DomainStatus;
use rom::inputs::MAX_INPUTS;
use rom::model::{Model, ModelHeader};
use rom::model_state::ModelState;
use rom::observable::Observables;
use rom::reconstructor::Peaks;
use serde::Serialize;
use serde_json::{Map, Value, json};

/// Outputs of a measured model with their half-widths.
pub fn measured(model: &Model, state: &ModelState) -> Value {
    let outputs = train::measured::outputs(model).into_iter().map(|output| {
        let value = state.fields()[output.field * model.header.node_count + output.node];
        let half_width = output.half_width_of(state.evaluation());
        (output.name, json!({ "value": value, "half_width": half_width }))
    });
    outputs.collect::<Map<_, _>>().into()
}

/// One number for each input that the model has, by its key; `None` if it is not finite.
pub fn by_input(header: &ModelHeader, values: &[f64; MAX_INPUTS]) -> Map<String, Value> {
    let finite = |v: f64| json!(Some(v).filter(|v| v.is_finite()));
    header.taken_inputs().map(|(index, spec)| (spec.key(), finite(values[index]))).collect()
}

/// Value, half-width and measured part of each observable, by its name.
fn observed(observables: &Observables, evaluation: &Evaluation) -> Map<String, Value> {
    let row = |(index, name): (usize, &str)| {
        let found = observables.value(index, evaluation);
        let all = json!({ "value": found.value, "half_width": found.halfwidth, "offset": found.offset });
        (name.to_owned(), all)
    };
    observables.names().enumerate().map(row).collect()
}

/// What a model says about one state; a number is `None` where it is unknown.
#[derive(Serialize)]
pub struct Prediction {
    regime: &'static str,
    pub pressure_mpa: Option<f64>,
    gap_mm: Option<f64>,
    contact_force_n: Option<f64>,
    force_by_pressure_n_per_mpa: Option<f64>,
    force_by_gap_n_per_mm: Option<f64>,
    force_clamped: bool,
    onset_pressure_mpa: Option<f64>,
    max_displacement_mm: Option<f32>,
    max_displacement_node: Option<u32>,
    max_von_mises_mpa: Option<f32>,
    max_von_mises_node: Option<u32>,
    in_domain: bool,
    domain: DomainStatus,
    domain_distance: f64,
    half_widths: HalfWidths,
    /// By the keys of the inputs.
    inputs: Map<String, Value>,
    /// Derivative of the contact force by each input, N per unit.
    dforce: Map<String, Value>,
    observables: Map<String, Value>,
    /// Of a model of measurements.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outputs: Option<Value>,
}

impl Prediction {
    pub fn new(
        header: &ModelHeader,
        evaluation: &Evaluation,
        peaks: &Peaks,
        observables: &Observables,
    ) -> Self {
        let needs = header.needs();
        let finite = |value: f64| Some(value).filter(|value| value.is_finite());
        Self {
            regime: evaluation.regime.name(),
            pressure_mpa: finite(evaluation.inputs.pressure_mpa()),
            gap_mm: finite(evaluation.inputs.gap_mm()),
            contact_force_n: finite(evaluation.contact_force_n),
            force_by_pressure_n_per_mpa: finite(evaluation.force_by_pressure_n_per_mpa())
                .filter(|_| needs.pressure),
            force_by_gap_n_per_mm: finite(evaluation.force_by_gap_n_per_mm()).filter(|_| needs.gap),
            force_clamped: evaluation.flags.force_clamped,
            onset_pressure_mpa: evaluation.onset_pressure_mpa,
            max_displacement_mm: peaks.displacement_mm.map(|peak| peak.value),
            max_displacement_node: peaks.displacement_mm.map(|peak| peak.node),
            max_von_mises_mpa: peaks.stress_mpa.map(|peak| peak.value),
            max_von_mises_node: peaks.stress_mpa.map(|peak| peak.node),
            in_domain: evaluation.domain == DomainStatus::Inside,
            domain: evaluation.domain,
            domain_distance: evaluation.domain_distance,
            half_widths: evaluation.halfwidths,
            inputs: by_input(header, evaluation.inputs.values()),
            dforce: by_input(header, &evaluation.force_gradient),
            observables: observed(observables, evaluation),
            outputs: None,
        }
    }
}
