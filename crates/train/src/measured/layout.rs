//! Fields and nodes of measured outputs: markers `NAME_x_mm` are coordinates of the node NAME, other outputs are scalars.

use rom::evaluation::Evaluation;
use rom::model::{BlockKind, Model, ModelHeader};
use rom::snapshots::{AXES, FieldKind, FieldSpec, marker_axis};

/// Name of the model's pressure.
pub(super) const PRESSURE_NAME: &str = "pressure_mpa";

/// Field and nodes of the outputs.
pub(super) struct Layout {
    /// Markers, one node each.
    pub nodes: Vec<String>,
    /// Field, and the output at each node.
    pub fields: Vec<(FieldSpec, Vec<Option<usize>>)>,
}

impl Layout {
    pub(super) fn of(outputs: &[&str]) -> Self {
        let mut nodes: Vec<String> = Vec::new();
        for (marker, _) in outputs.iter().filter_map(|name| marker_axis(name)) {
            if !nodes.iter().any(|node| node == marker) {
                nodes.push(marker.to_owned());
            }
        }
        let mut fields = Vec::new();
        for (k, axis) in AXES.iter().enumerate() {
            let output = |node: &String| outputs.iter().position(|name| marker_axis(name) == Some((node, k)));
            let places: Vec<Option<usize>> = nodes.iter().map(output).collect();
            if places.iter().any(Option::is_some) {
                let kind = FieldKind::Coordinate(k as u8);
                fields.push((FieldSpec { name: (*axis).into(), unit: "mm".into(), kind }, places));
            }
        }
        for (index, name) in outputs.iter().enumerate().filter(|(_, name)| marker_axis(name).is_none()) {
            let spec = FieldSpec { name: (*name).into(), unit: unit_of(name), kind: FieldKind::Other };
            fields.push((spec, vec![Some(index); nodes.len().max(1)]));
        }
        Self { nodes, fields }
    }

    /// Number of nodes of the model.
    pub(super) fn node_count(&self) -> usize {
        self.nodes.len().max(1)
    }
}

/// Unit at the end of a name as it is written: `mpa` is `MPa`.
pub(super) fn unit_of(name: &str) -> String {
    match name.rsplit('_').next().unwrap_or_default() {
        "mpa" => "MPa".into(),
        "kpa" => "kPa".into(),
        "n" => "N".into(),
        "v" => "V".into(),
        other => other.into(),
    }
}

/// Place of an output in a model: field and node. `tip_x_mm` is the field `x` at the first node of the set `tip`, a scalar the field of
/// its name.
#[must_use]
pub fn place(header: &ModelHeader, output: &str) -> Option<(usize, usize)> {
    let field = |name: &str| header.fields.iter().position(|field| field.spec.name == name);
    if let Some(at) = field(output) {
        return Some((at, 0));
    }
    let (marker, axis) = marker_axis(output)?;
    let node = *header.node_sets.iter().find(|set| set.name == marker)?.nodes.first()?;
    Some((header.coordinate_field(axis as u8)?, node as usize))
}

/// Output of a measured model.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredOutput {
    /// Name with its unit.
    pub name: String,
    /// Position of the field in the model.
    pub field: usize,
    /// Number of the node.
    pub node: usize,
    /// Half-width in the output's unit, typical of the training.
    pub half_width: f64,
    /// Coefficient that it is.
    coefficient: usize,
}

impl MeasuredOutput {
    /// The value at an evaluated state; NaN of a model that has no answer.
    #[must_use]
    pub fn value_of(&self, evaluation: &Evaluation) -> f64 {
        evaluation.coefficients.get(self.coefficient).copied().unwrap_or(f64::NAN)
    }

    /// The half-width at an evaluated state; NaN where nothing is known.
    #[must_use]
    pub fn half_width_of(&self, evaluation: &Evaluation) -> f64 {
        evaluation.output_half_widths.get(self.coefficient).copied().unwrap_or(f64::NAN)
    }
}

/// Outputs of a model that was learned from measurements; empty for other models.
#[must_use]
pub fn outputs(model: &Model) -> Vec<MeasuredOutput> {
    let mut found = Vec::new();
    for (field, output) in model.header.fields.iter().enumerate() {
        let Some(widths) = model.f32_block(BlockKind::HalfWidth { field: field as u32 }) else { continue };
        let mut push = |name: String, node: usize| {
            // A coordinate that was not measured has none.
            let half_width = widths.get(node).copied().map(f64::from).filter(|width| *width > 0.0);
            let found_at = half_width.zip(model.learned_output(field, node));
            found.extend(found_at.map(|(half_width, coefficient)| MeasuredOutput {
                name,
                field,
                node,
                half_width,
                coefficient,
            }));
        };
        match output.spec.kind {
            FieldKind::Coordinate(axis) => {
                for set in &model.header.node_sets {
                    let name = format!("{}_{}_mm", set.name, AXES[usize::from(axis).min(2)]);
                    set.nodes.iter().for_each(|node| push(name.clone(), *node as usize));
                }
            }
            _ => push(output.spec.name.clone(), 0),
        }
    }
    found
}
