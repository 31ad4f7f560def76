//! The studies on small data. One program, which is linked once and runs its tests in parallel.

mod hard_cases;
mod random_shapes;
mod report;
mod sweep;
mod trace;
