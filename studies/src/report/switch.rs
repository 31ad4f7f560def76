//! Continuity across the switch between the regimes.

use super::study::{Study, percent};
use softtwin::jumps::jumps;

/// Gaps at which both sides of the onset are compared.
pub const GAPS: usize = 100;

/// The gaps the paper's actuator touches at within its pressures.
const PAPER_MM: [f64; 2] = [28.0, 70.0];

pub fn section(study: &Study) -> anyhow::Result<String> {
    let mut text = format!(
        "\n## The switch between the regimes\n\nValues on both sides of the onset pressure, at {GAPS} gaps: the largest \
         jump of any coordinate, of the stress (over the largest stress of its state) and of the force. Beyond the last onset state it was trained on, the contact regime's \
         coefficients are corrected by gap so that it still meets the free one; its states are flagged as outside the domain \
         there. Slopes do change at the onset: the tip is held and the force grows.\n\n\
         | method | gaps mm | largest jump mm | largest jump of stress % | largest jump N |\n| --- | --- | --- | --- | --- |\n"
    );
    for (name, model) in [("paper's method", &study.paper), ("ours", &study.ours)] {
        let Some(onset) = &model.header.onset else { continue };
        for range in [PAPER_MM, [onset.sag_mm(), onset.reach_mm()]] {
            let jumps = jumps(model, range, GAPS)?;
            text += &format!(
                "| {name} | {:.1} - {:.1} | {:.4} | {} | {:.2e} |\n",
                range[0],
                range[1],
                jumps.length_mm,
                percent(jumps.stress_share),
                jumps.force_n
            );
        }
    }
    Ok(text)
}
