//! Memory identified from recordings, as lines and as JSON.

use crate::output;
use serde_json::{Value, json};
use train::memory::{BlockReport, Constant, Identified};

/// Prints the blocks with their constants.
pub fn print(found: &Identified) -> anyhow::Result<()> {
    let [without, with] = found.left_out;
    output!(
        "  memory: RMS error on left-out parts {:.1} % without, {:.1} % with it",
        100.0 * without,
        100.0 * with
    )?;
    for BlockReport { block, is_kept, left_out: [before, after], constants } in &found.blocks {
        let outcome = if *is_kept { "kept" } else { "not kept" };
        output!("  {:<11} {outcome:<9} {:>6.2} -> {:.2} %", block.name(), 100.0 * before, 100.0 * after)?;
        for Constant { name, unit, value, interval: [low, high] } in constants {
            output!("    {name} {value:.4} {unit} ({low:.4} .. {high:.4})")?;
        }
    }
    Ok(())
}

/// One JSON object.
pub fn as_json(found: &Identified) -> Value {
    let constant = |Constant { name, unit, value, interval }: &Constant| json!({"name": name, "unit": unit, "value": value, "interval": interval});
    let block = |report: &BlockReport| {
        json!({"block": report.block.name(), "kept": report.is_kept, "left_out": report.left_out,
            "constants": report.constants.iter().map(constant).collect::<Vec<_>>()})
    };
    json!({"left_out": found.left_out, "blocks": found.blocks.iter().map(block).collect::<Vec<_>>()})
}
