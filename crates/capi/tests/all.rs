//! Tests of the C API: its header, and programs that are compiled against it.

mod header;
mod live;
mod motion;
mod stepping;
#[allow(dead_code, reason = "shared by several test programs")]
#[path = "../../../tests/src/synthetic/mod.rs"]
mod synthetic;
