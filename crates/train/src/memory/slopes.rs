//! Slopes of a model's answers, by which an unknown past widens its half-widths.

use rom::inputs::Inputs;
use rom::memory::Slopes;
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use rom::snapshots::FieldKind;

/// Step of the difference quotient as a fraction of the input's range.
const STEP: f64 = 0.05;

/// Largest change of a node's position and stress, and of the contact force, per unit of an input at these states; 0 where the model has
/// none.
#[must_use]
pub fn slopes(model: &Model, states: &[Inputs], input: usize, range: [f64; 2]) -> Slopes {
    let mut slopes = Slopes::default();
    let Ok(mut state) = ModelState::new(model, &Selection::default()) else { return slopes };
    let nodes = model.header.node_count;
    let of_kind = |wanted: &dyn Fn(FieldKind) -> bool| -> Vec<usize> {
        let fields = model.header.fields.iter().enumerate();
        fields.filter(|(_, field)| wanted(field.spec.kind)).map(|(index, _)| index).collect()
    };
    let axes = of_kind(&|kind| matches!(kind, FieldKind::Coordinate(_)));
    let stresses = of_kind(&|kind| kind == FieldKind::Stress);
    let step = STEP * (range[1] - range[0]);
    for inputs in states {
        let value = inputs.values()[input];
        let moved = inputs.with(input, if value + step > range[1] { value - step } else { value + step });
        let mut answer = |inputs: Inputs| {
            state.update(inputs).ok()?;
            Some((state.fields().to_vec(), state.evaluation().contact_force_n))
        };
        let (Some(from), Some(to)) = (answer(*inputs), answer(moved)) else { continue };
        let length = |fields: &[usize], node: usize| {
            let square =
                |field: &usize| f64::from(to.0[field * nodes + node] - from.0[field * nodes + node]).powi(2);
            fields.iter().map(square).sum::<f64>().sqrt() / step
        };
        for node in 0..nodes {
            slopes.displacement_mm = slopes.displacement_mm.max(length(&axes, node));
            slopes.stress_mpa = slopes.stress_mpa.max(length(&stresses, node));
        }
        // NaN without forces, which `max` leaves out.
        slopes.force_n = slopes.force_n.max((to.1 - from.1).abs() / step);
    }
    slopes
}
