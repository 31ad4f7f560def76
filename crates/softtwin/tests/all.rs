//! The tool, started as its users start it. One program: linked once, and its tests run at the same time.

#[path = "../../fem/tests/common/actuators.rs"]
mod actuators;
mod bench;
mod card;
#[path = "../../formats/tests/common/mod.rs"]
mod common;
mod import_pneunets;
mod import_results;
mod material;
mod motion;
mod offline;
mod parameters;
mod program;
mod ranges;
mod recording;
mod recording_memory;
mod simulate;
mod simulate_motion;
mod step;
#[allow(dead_code, reason = "shared by several test programs")]
#[path = "../../../tests/src/synthetic/mod.rs"]
mod synthetic;
mod volume;
