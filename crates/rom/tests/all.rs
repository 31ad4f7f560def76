//! The reduced-order model: its answers, gradients, files. One program: linked once, and its tests run beside each other.

mod budget;
mod dense;
mod goal;
mod model_file;
mod predict;
mod probe;
mod stress_peak;
