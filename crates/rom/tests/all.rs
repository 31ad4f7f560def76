//! The reduced-order model: its answers, gradients, files. One program: linked once, and its tests run beside each other.

mod budget;
mod dense;
mod footprint;
mod goal;
mod kernel;
mod model_file;
mod predict;
mod probe;
mod rng;
mod stress_peak;
