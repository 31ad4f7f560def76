//! The studies on small data. One program, which is linked once and runs its tests in parallel.

mod hard_cases;
mod report;
mod sweep;
mod trace;
