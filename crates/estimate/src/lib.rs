//! Estimation of model inputs and sensor biases that are not measured, from readings that the model predicts.
//!
//! | file | what it does |
//! | --- | --- |
//! | `setup.rs` | unknowns with their priors, roles of the model's inputs, measured values, the trait of a model |
//! | `reading.rs` | one reading as a least-squares problem |
//! | `search.rs` | its solution: steps, rejection of outliers, a bounded number of predictions |
//! | `outcome.rs` | outcome of a reading, estimates, alarms |
//! | `filter.rs` | the filter over readings: drift, contact or not, consistency |
//! | `batch.rs` | the fit of constants to a whole recording |
//! | `identify.rs` | identifiability of the unknowns |
//! | `watch.rs` | alarms: persistent contradictions |
//! | `swing.rs` | motion between two readings |
//! | `memory.rs` | play and lag of the plant: amplitude, and effect on the intervals |
//! | `trend.rs` | measured input that changes steadily, from all its readings |
//! | `rewind.rs` | estimates from before a contact that was detected late |
//! | `plan.rs` | plan of an experiment that identifies the unknowns |
//!
//! The filter is the iterated extended Kalman filter (Bell and Cathey 1993: its update is the Gauss-Newton iteration for the
//! maximum of the posterior). The noise of a measured input is a state of each reading.
//!
//! Two features are specific to contact. Without contact a reading only excludes gaps below the onset gap: the estimate is then
//! that of the normal distribution truncated at this bound. And each reading is solved with and without contact; the more likely
//! solution is used.

mod batch;
mod filter;
mod identify;
mod matrix;
mod memory;
mod normal;
mod outcome;
mod plan;
mod reading;
mod rewind;
mod search;
mod setup;
mod structure;
mod swing;
mod trend;
mod watch;

pub use batch::{Fit, fit};
pub use filter::Filter;
pub use matrix::{MAX_STATES, Symmetric};
pub use outcome::{Alarm, Estimate, Status, Update};
pub use plan::{ExpectedFit, choose, expected_fit, information};
pub use search::MAX_PREDICTIONS;
pub use setup::{
    Arrived, InputRole, MAX_INPUTS, MAX_ROWS, Measurement, Model, Moving, PASTS, Predicted, Row, Setup,
    SetupError, Swing, Unknown,
};
pub use structure::{Series as ResidualSeries, Structure};
