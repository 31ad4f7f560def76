//! The reduced-order model, from training to answers. One program: linked once, and its tests run beside each other.

mod accuracy;
mod budget;
mod calibration;
mod database;
mod goal;
mod model_file;
mod parameters;
mod predict;
mod probe;
mod regimes;
mod shipped_design;
mod stress_peak;
