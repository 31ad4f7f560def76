//! Differences of a model's two regimes at the onset of contact.

use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use rom::snapshots::FieldKind;

/// Largest differences between both sides of the onset.
#[derive(Debug, Clone, Copy, Default)]
pub struct Jumps {
    /// Largest jump of a coordinate, mm.
    pub length_mm: f64,
    /// Largest jump of a stress, over the largest stress of its state. A body at rest may have none: what rounding leaves there is no
    /// stress, so states below [`STRESSED`] do not count.
    pub stress_share: f64,
    /// Largest jump of the force, N.
    pub force_n: f64,
}

/// Smallest stress of a state of which a share is taken, as a fraction of the largest stress on the onset.
const STRESSED: f64 = 1e-6;

/// The largest jumps at the onset over `count` gaps of a range; 0 for a model of one regime.
///
/// # Errors
/// The model cannot be reconstructed.
pub fn jumps(model: &Model, range: [f64; 2], count: usize) -> anyhow::Result<Jumps> {
    let mut jumps = Jumps::default();
    let Some(onset) = &model.header.onset else { return Ok(jumps) };
    let state = ModelState::new(model, &Selection::default())?;
    let (mut below, mut above) = (state.clone(), state);
    // Jump and largest value of each stress at each gap.
    let mut stresses: Vec<[f64; 2]> = Vec::new();
    for i in 0..count {
        let share = i as f64 / (count - 1).max(1) as f64;
        let gap_mm = range[0] + share * (range[1] - range[0]);
        let Some(pressure_mpa) = onset.onset(gap_mm).pressure_mpa() else { continue };
        let just_below = pressure_mpa * (1.0 - 1e-9) - 1e-12;
        below.update(Inputs::new(just_below, gap_mm))?;
        above.update(Inputs::new(pressure_mpa, gap_mm))?;
        let nodes = model.header.node_count;
        for (f, field) in model.header.fields.iter().enumerate() {
            let pairs = below.fields().iter().zip(above.fields()).skip(f * nodes).take(nodes);
            let [jump, largest] = pairs.fold([0.0_f32; 2], |[jump, largest], (a, b)| {
                [jump.max((a - b).abs()), largest.max(b.abs())]
            });
            match field.spec.kind {
                FieldKind::Coordinate(_) => jumps.length_mm = jumps.length_mm.max(jump.into()),
                FieldKind::Stress => stresses.push([jump.into(), largest.into()]),
                _ => {}
            }
        }
        let [above_n, below_n] = [&above, &below].map(|state| state.evaluation().contact_force_n);
        jumps.force_n = jumps.force_n.max((above_n - below_n).abs());
    }
    let least = STRESSED * stresses.iter().fold(0.0, |most: f64, [_, largest]| most.max(*largest));
    let shares =
        stresses.iter().filter(|[_, largest]| *largest > least).map(|[jump, largest]| jump / largest);
    jumps.stress_share = shares.fold(0.0, f64::max);
    Ok(jumps)
}
