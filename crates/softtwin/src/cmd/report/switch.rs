//! Continuity across the switch between the regimes.

use super::study::Study;
use rom::evaluation::Input;
use rom::model::Model;
use rom::predict::{Predictor, Selection};
use rom::regime::RegimeSwitch;
use rom::snapshots::FieldKind;

/// Gaps at which both sides of the onset are compared.
const GAPS: usize = 100;

pub fn section(study: &Study) -> anyhow::Result<String> {
    let mut text = format!(
        "\n## The switch between the regimes\n\nValues on both sides of the onset pressure, at {GAPS} gaps from the sag to \
         the reach: the largest jump of any coordinate and of the force. Slopes do change: beyond the onset the tip is \
         held and the force grows.\n\n| method | sag mm | reach mm | largest jump mm | largest jump N |\n| --- | --- | --- | --- | --- |\n"
    );
    for (name, model) in [("paper's method", &study.paper), ("ours", &study.ours)] {
        let Some(onset) = &model.header.onset else { continue };
        let (length, force) = jumps(model, onset)?;
        text += &format!(
            "| {name} | {:.2} | {:.2} | {length:.4} | {force:.2e} |\n",
            onset.sag_mm(),
            onset.reach_mm()
        );
    }
    Ok(text)
}

fn jumps(model: &Model, onset: &rom::regime::OnsetTable) -> anyhow::Result<(f64, f64)> {
    let mut predictor = Predictor::new(model, &Selection::default())?;
    let (mut below, mut above) = (predictor.evaluation(), predictor.evaluation());
    let mut fields = [vec![0.0; predictor.entries()], vec![0.0; predictor.entries()]];
    let (mut length, mut force) = (0.0_f64, 0.0_f64);
    for i in 1..GAPS {
        let share = i as f64 / GAPS as f64;
        let gap_mm = onset.sag_mm() + share * (onset.reach_mm() - onset.sag_mm());
        let Some(pressure_mpa) = onset.onset(gap_mm).pressure_mpa() else { continue };
        let just_below = pressure_mpa * (1.0 - 1e-9) - 1e-12;
        predictor.evaluate(
            Input { pressure_mpa: just_below, gap_mm },
            &mut RegimeSwitch::default(),
            &mut below,
        );
        predictor.evaluate(Input { pressure_mpa, gap_mm }, &mut RegimeSwitch::default(), &mut above);
        predictor.reconstruct_into(&below, &mut fields[0])?;
        predictor.reconstruct_into(&above, &mut fields[1])?;
        let nodes = model.header.node_count;
        for (f, field) in model.header.fields.iter().enumerate() {
            if matches!(field.spec.kind, FieldKind::Coordinate(_)) {
                let pairs = fields[0].iter().zip(&fields[1]).skip(f * nodes).take(nodes);
                length = pairs.fold(length, |m, (a, b)| m.max(f64::from((a - b).abs())));
            }
        }
        force = force.max((above.contact_force_n - below.contact_force_n).abs());
    }
    Ok((length, force))
}
