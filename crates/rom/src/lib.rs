//! The reduced-order model of a soft pneumatic actuator: POD of finite-element snapshots, interpolated over pressure
//! and gap.
//!
//! Snapshots come in as a [`snapshots::Database`], a [`config::TrainConfig`] says how to reduce them, [`train::train`]
//! makes a [`model::Model`], and a [`predict::Predictor`] answers queries from it without allocating. Pure functions of
//! data: no clock, no threads, no files.
//!
//! ```text
//! Y (n x m snapshots) = mean + Phi A        pod.rs        modes Phi, coefficients A, by thin QR and SVD
//! a(x) = sum_k w_k g(|x - x_k|) + tail(x)   fit.rs        inputs x = (P) free, (P, gap) in contact, scaled to [0, 1]
//! P_c(gap)                                  regime.rs     onset pressure, read off the free model
//! F = (P - P_c(gap)) h(P, gap)              predict.rs    contact force, 0 on the onset exactly
//! y = mean + Phi a                          kernel/       fields, straight into the caller's memory
//! ```
//!
//! ```
//! use rom::{config::TrainConfig, evaluation::Input, predict::*, regime::RegimeSwitch, train::train};
//!
//! let database = rom::synthetic::plate(); // an actuator made of formulas
//! let (model, sheet) = train(&database, &TrainConfig::default(), &mut |_step| {})?;
//! let mut predictor = Predictor::new(&model, &Selection::default())?;
//! let (mut evaluation, mut switch) = (predictor.evaluation(), RegimeSwitch::default());
//! let mut fields = vec![0.0; predictor.entries()];
//! predictor.evaluate(Input { pressure_mpa: 0.06, gap_mm: 17.0 }, &mut switch, &mut evaluation);
//! let peaks = predictor.reconstruct_into(&evaluation, &mut fields)?;
//! assert!(evaluation.contact_force_n > 0.0 && peaks.stress_mpa.is_some() && sheet.regimes.len() == 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![deny(unsafe_code)] // the reconstruction kernel alone may allow it

pub mod config;
pub mod conformal;
pub mod datasheet;
pub mod evaluate;
pub mod evaluation;
pub mod fit;
pub mod gp;
pub mod hull;
pub mod interpolant;
// Intrinsics and writes into loaned memory; each with its SAFETY line.
#[allow(unsafe_code)]
pub mod kernel;
pub mod model;
pub mod pod;
pub mod predict;
mod radial;
pub mod regime;
pub mod select;
pub mod snapshots;
pub mod synthetic;
pub mod train;
mod validate;
