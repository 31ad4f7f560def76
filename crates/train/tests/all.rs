//! Training, from a database to a model and what it answers. One program: linked once, and its tests run in parallel.

mod accuracy;
mod calibration;
mod cavities;
mod database;
mod inertia;
mod measured;
mod memory;
mod numerics;
mod parameters;
mod shipped_design;
mod slopes;
#[allow(dead_code, reason = "shared by several test programs")]
#[path = "../../../tests/src/synthetic/mod.rs"]
mod synthetic;
