//! Continuity at the contact onset.

use super::study::{Study, percent};
use crate::jumps::jumps;

/// Gaps at which both sides of the onset are compared.
pub const GAPS: usize = 100;

/// Gaps of the paper's contact cases, mm.
const PAPER_MM: [f64; 2] = [28.0, 70.0];

pub fn section(study: &Study) -> anyhow::Result<String> {
    let mut text = format!(
        "\n## Contact onset\n\nLargest difference between both sides of the onset pressure over {GAPS} gaps: coordinates, stress (per largest stress of \
         the state), force. Derivatives change at the onset.\n\n\
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
