//! Continuity across the switch between the regimes.

use super::study::Study;
use rom::inputs::Inputs;
use rom::model::Model;
use rom::model::Selection;
use rom::model_state::ModelState;
use rom::snapshots::FieldKind;

/// Gaps at which both sides of the onset are compared.
const GAPS: usize = 100;

/// The gaps the paper's actuator touches at within its pressures.
const PAPER_MM: [f64; 2] = [28.0, 70.0];

pub fn section(study: &Study) -> anyhow::Result<String> {
    let mut text = format!(
        "\n## The switch between the regimes\n\nValues on both sides of the onset pressure, at {GAPS} gaps: the largest \
         jump of any coordinate and of the force. Beyond the last onset state it was trained on, the contact regime's \
         coefficients are corrected by gap so that it still meets the free one; its states are flagged as outside the domain \
         there. Slopes do change at the onset: the tip is held and the force grows.\n\n\
         | method | gaps mm | largest jump mm | largest jump N |\n| --- | --- | --- | --- |\n"
    );
    for (name, model) in [("paper's method", &study.paper), ("ours", &study.ours)] {
        let Some(onset) = &model.header.onset else { continue };
        for range in [PAPER_MM, [onset.sag_mm(), onset.reach_mm()]] {
            let (length, force) = jumps(model, range)?;
            text += &format!("| {name} | {:.1} - {:.1} | {length:.4} | {force:.2e} |\n", range[0], range[1]);
        }
    }
    Ok(text)
}

/// Largest jump of a coordinate in mm and of the force in N over a range of gaps; 0 for a model of one regime.
pub fn jumps(model: &Model, range: [f64; 2]) -> anyhow::Result<(f64, f64)> {
    let Some(onset) = &model.header.onset else { return Ok((0.0, 0.0)) };
    let state = ModelState::new(model, &Selection::default())?;
    let (mut below, mut above) = (state.clone(), state);
    let (mut length, mut force) = (0.0_f64, 0.0_f64);
    for i in 0..GAPS {
        let share = i as f64 / (GAPS - 1) as f64;
        let gap_mm = range[0] + share * (range[1] - range[0]);
        let Some(pressure_mpa) = onset.onset(gap_mm).pressure_mpa() else { continue };
        let just_below = pressure_mpa * (1.0 - 1e-9) - 1e-12;
        below.update(Inputs::new(just_below, gap_mm))?;
        above.update(Inputs::new(pressure_mpa, gap_mm))?;
        let nodes = model.header.node_count;
        for (f, field) in model.header.fields.iter().enumerate() {
            if matches!(field.spec.kind, FieldKind::Coordinate(_)) {
                let pairs = below.fields().iter().zip(above.fields()).skip(f * nodes).take(nodes);
                length = pairs.fold(length, |m, (a, b)| m.max(f64::from((a - b).abs())));
            }
        }
        let [above_n, below_n] = [&above, &below].map(|state| state.evaluation().contact_force_n);
        force = force.max((above_n - below_n).abs());
    }
    Ok((length, force))
}
