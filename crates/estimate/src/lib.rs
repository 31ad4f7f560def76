//! Estimation of what is not measured: inputs of a model and biases of sensors, from readings that the model predicts.
//!
//! | file | what it does |
//! | --- | --- |
//! | `setup.rs` | unknowns with their priors, roles of the model's inputs, measured values, the trait of a model |
//! | `reading.rs` | one reading as a least-squares problem |
//! | `search.rs` | its solution: steps, rejection of outliers, a bounded number of predictions |
//! | `outcome.rs` | what the filter says of a reading and of the unknowns |
//! | `filter.rs` | the filter over readings: drift, contact or not, consistency |
//! | `batch.rs` | the fit of constants to a whole recording |
//! | `identify.rs` | which unknowns the readings tell |
//! | `watch.rs` | alarms: what does not fit, lasting |
//! | `trend.rs` | a measured input by all its readings, where it changes steadily |
//! | `rewind.rs` | estimates from before a contact that was noticed late |
//! | `plan.rs` | which readings would tell the unknowns apart |
//!
//! The filter is the iterated extended Kalman filter (Bell and Cathey 1993: its update is the Gauss-Newton iteration for the
//! maximum of the posterior). Measured inputs carry noise of their own, which is a state of each reading alone.
//!
//! Two things are particular to contact. While nothing touches, a reading says about the gap only that it is larger than the
//! one at which contact would begin: that bound is kept beside the normal distribution, whose estimate is then that of its
//! part beyond the bound. And contact or not is a question of its own at every reading: both are solved, the likelier counts.

mod batch;
mod filter;
mod identify;
mod matrix;
mod normal;
mod outcome;
mod plan;
mod reading;
mod rewind;
mod search;
mod setup;
mod trend;
mod watch;

pub use batch::{Fit, fit};
pub use filter::Filter;
pub use matrix::{MAX_STATES, Symmetric};
pub use outcome::{Alarm, Estimate, Status, Update};
pub use plan::{ExpectedFit, choose, expected_fit, information};
pub use search::MAX_PREDICTIONS;
pub use setup::{
    InputRole, MAX_INPUTS, MAX_ROWS, Measurement, Model, Predicted, Row, Setup, SetupError, Unknown,
};
