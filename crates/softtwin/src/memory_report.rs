//! Memory identified from recordings, in reports.

use serde_json::{Value, json};
use train::memory::{BlockReport, Constant, Identified};

/// One JSON object.
pub fn as_json(found: &Identified) -> Value {
    let constant = |Constant { name, unit, value, interval }: &Constant| json!({"name": name, "unit": unit, "value": value, "interval": interval});
    let block = |report: &BlockReport| {
        json!({"block": report.block.name(), "kept": report.is_kept, "left_out": report.left_out,
            "constants": report.constants.iter().map(constant).collect::<Vec<_>>()})
    };
    json!({"left_out": found.left_out, "blocks": found.blocks.iter().map(block).collect::<Vec<_>>()})
}
