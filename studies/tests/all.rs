//! The studies, on data that is small enough for every day. One program: linked once, and its tests run beside each other.

mod hard_cases;
mod report;
mod sweep;
mod trace;
