//! Training of reduced-order models: a database of snapshots and a configuration in, a model and its data sheet out.
//!
//! Order: sort the training cases into regimes; free model (POD by group, interpolants by leave-one-out); onset pressure
//! over gap from the free model; contact model on touching states plus states on the onset taken from the free
//! model, so that fields are continuous at the onset; half-widths from leave-one-out residuals.
//!
//! ```text
//! Y (n x m snapshots) = mean + Phi A        pod.rs             modes Phi, coefficients A, by thin QR and SVD (Eqs. 3, 5, 6)
//! a(x) = sum_k w_k g(|x - x_k|) + tail(x)   fit.rs             weights w, by one symmetric indefinite system (Eqs. 8-14)
//! kernel, metric, smoothing, modes          select.rs          by leave-one-out in closed form
//! ```
//! Pure functions of data. Files are opened in `trace.rs`, `config.rs` and the modules of databases, models and cards. What a model answers
//! is [`rom`]'s.
//!
//! ```no_run
//! use rom::{inputs::Inputs, model::Selection, model_state::ModelState};
//! use train::{config::TrainConfig, train};
//!
//! # fn read() -> rom::snapshots::Database { unimplemented!() }
//! let database = read(); // from files by the crate `formats`
//! let (model, sheet) = train(&database, &TrainConfig::default(), &mut |_step| {})?;
//! let mut state = ModelState::new(&model, &Selection::default())?;
//! state.update(Inputs::new(0.06, 17.0))?;
//! assert!(state.evaluation().contact_force_n > 0.0 && sheet.regimes.len() == 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![warn(missing_docs)] // the API that programs of others use: every public item says what it is, its units and its errors
#![forbid(unsafe_code)]

pub mod actuation;
mod assemble;
pub mod calibration;
pub mod card;
pub mod comparison;
pub mod config;
pub mod datasheet;
pub mod draws;
mod error;
pub mod evaluate;
#[doc(hidden)] // for tests/numerics.rs and tests/slopes.rs, as pod and select
pub mod fit;
mod force;
mod group;
pub mod inertia;
pub mod measured;
pub mod memory;
mod onset;
#[doc(hidden)]
pub mod pod;
pub mod quality;
pub mod refinement;
mod regime;
#[doc(hidden)]
pub mod select;
mod sort;
pub mod trace;
pub mod unseen_errors;

pub use error::{OnsetError, TrainError};

use crate::config::TrainConfig;
use crate::datasheet::DataSheet;
use rom::model::{BlockKind, Model};
use rom::observable::OnMesh;
use rom::snapshots::Database;

/// Trains a model on the training split. `progress` receives the name of each step.
///
/// Cost: `O(n m^2)` for the decompositions, `O(candidates m^3)` for the choice (n entries of a group, m cases).
///
/// # Errors
/// [`TrainError`]: every problem of database or configuration at once, or the step that failed.
pub fn train(
    database: &Database,
    config: &TrainConfig,
    progress: &mut dyn FnMut(&str),
) -> Result<(Model, DataSheet), TrainError> {
    let problems = config.problems();
    if !problems.is_empty() {
        return Err(TrainError::Config(problems));
    }
    progress("checking the database");
    let problems = database.problems();
    if !problems.is_empty() {
        return Err(TrainError::Database(problems));
    }
    let mut sorted = sort::sort(database, config)?;
    assemble::check_spread(database, &sorted)?;
    let plan = group::Plan::new(database, config);
    let mut parts = Vec::new();
    let mut onset = None;
    if !sorted.free.is_empty() {
        progress("free regime: decomposing and choosing kernels");
        parts.push(regime::free(database, config, &plan, &sorted)?);
    }
    if !sorted.contact.is_empty() {
        let free = parts.first();
        if let Some(free) = free {
            progress("onset pressure from the free model");
            let derived = onset::derive(database, config, &plan, free, &sorted)?;
            sorted.remarks.extend(derived.remarks());
            onset = Some(derived);
        }
        progress("contact regime: decomposing and choosing kernels");
        let contact = regime::contact(database, config, &plan, &sorted, free.zip(onset.as_ref()))?;
        parts.push(contact);
    }
    progress("assembling the model");
    sorted.remarks.extend(assemble::remarks(database, &parts));
    let (mut model, sheet) =
        assemble::assemble(database, config, &plan, &parts, onset, std::mem::take(&mut sorted.remarks));
    if !config.observables.is_empty() {
        progress("half-widths of the observables");
        let on_mesh = OnMesh::new(&model, &config.observables).map_err(TrainError::Config)?;
        let ratios = calibration::observable_ratios(database, &plan, &parts, &sorted, &model, &on_mesh)?;
        let observables = on_mesh.reduced(&model, &ratios, config.coverage).map_err(TrainError::Config)?;
        let put = model.set_record(BlockKind::Observables, &observables);
        put.map_err(|error| TrainError::Config(vec![error.to_string()]))?;
    }
    Ok((model, sheet))
}
