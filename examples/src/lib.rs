//! What the example programs share: percentiles, the simulated plant, the controller. The programs are in `src/bin/`.
#![forbid(unsafe_code)]

pub mod control;
pub mod plant;
pub mod report;
