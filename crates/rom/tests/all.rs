//! The reduced-order model: its answers, gradients, files. One program: linked once, and its tests run in parallel.

mod branch;
mod dense;
mod footprint;
mod goal;
mod inertia;
mod inertia_across;
mod kernel;
mod learned;
mod memory;
mod model_file;
mod observable;
mod predict;
mod probe;
mod rng;
#[allow(dead_code, reason = "shared by several test programs")]
#[path = "../../../tests/src/synthetic/mod.rs"]
mod synthetic;
