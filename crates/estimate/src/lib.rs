//! Estimation of model inputs and sensor biases that are not measured, from readings that the model predicts.
//!
//! | file | what it does |
//! | --- | --- |
//! | `setup.rs` | unknowns with their priors, roles of the model's inputs, measured values, the trait of a model; outcomes and alarms |
//! | `reading.rs` | one reading as a least-squares problem; its solution by steps, rejection of outliers, a bounded number of predictions |
//! | `filter.rs` | the filter over readings: drift, contact or not, consistency |
//! | `batch.rs` | the fit of constants to a whole recording |
//! | `structure.rs` | structure of the residuals over time, of a recording and of the last readings |
//! | `curves.rs` | measured values beside the predictions before and after a fit, and why it explains nothing |
//! | `identify.rs` | identifiability of the unknowns, and the plan of an experiment that identifies them |
//! | `watch.rs` | alarms: persistent contradictions, play and lag of the plant |
//! | `trial.rs` | a drifted gap or bias as the cause of rejections |
//! | `swing.rs` | motion between two readings |
//! | `matrix.rs` | small matrices, distributions |
//!
//! The filter is the iterated extended Kalman filter (Bell and Cathey 1993: its update is the Gauss-Newton iteration for the
//! maximum of the posterior). The noise of a measured input is a state of each reading.
//!
//! Two features are specific to contact. Without contact a reading only excludes gaps below the onset gap: the estimate is then
//! that of the normal distribution truncated at this bound. And each reading is solved with and without contact; the more likely
//! solution is used.

mod batch;
mod curves;
mod filter;
mod identify;
mod matrix;
mod reading;
mod setup;
mod structure;
mod swing;
mod trend;
mod trial;
mod watch;

pub use batch::{Fit, fit};
pub use curves::Curves;
pub use filter::Filter;
pub use identify::{ExpectedFit, choose, expected_fit, information};
pub use matrix::{MAX_STATES, Symmetric};
pub use reading::MAX_PREDICTIONS;
pub use setup::{
    Alarm, Estimate, InputRole, MAX_INPUTS, MAX_ROWS, MeasuredRow, Measurement, Model, MotionEnd,
    MotionState, PASTS, Predicted, Setup, SetupError, Status, Swing, Unknown, Update,
};
pub use structure::{ResidualSeries, Structure};
