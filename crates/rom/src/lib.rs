//! The reduced-order model of a soft pneumatic actuator: POD of finite-element snapshots, interpolated over pressure,
//! gap and, where a model has them, further inputs.
//!
//! Snapshots come in as a [`snapshots::Database`], a [`config::TrainConfig`] says how to reduce them, [`train::train`]
//! makes a [`model::Model`]. An [`evaluator::Evaluator`] gives force, gradients, half-widths and modal coefficients at a
//! state, a [`reconstructor::Reconstructor`] the fields of these coefficients, both without allocating. Pure functions of
//! data: no clock, no threads, no files.
//!
//! ```text
//! Y (n x m snapshots) = mean + Phi A        pod.rs             modes Phi, coefficients A, by thin QR and SVD
//! a(x) = sum_k w_k g(|x - x_k|) + tail(x)   fit.rs, sums.rs    inputs x = (P) free, (P, gap) in contact, scaled to [0, 1]
//! P_c(gap)                                  regime.rs          onset pressure, read off the free model
//! P_c(gap, parameters)                      clearance.rs       the same, solved from the free model
//! F = (P - P_c(gap)) h(P, gap)              evaluator.rs       contact force, 0 on the onset exactly
//! y = mean + Phi a                          reconstructor.rs   fields, straight into the caller's memory
//! ```
//!
//! ```
//! use rom::{config::TrainConfig, evaluator::Evaluator, inputs::Inputs, model::Selection};
//! use rom::{reconstructor::Reconstructor, train::train};
//!
//! let database = rom::synthetic::plate(); // an actuator made of formulas
//! let (model, sheet) = train(&database, &TrainConfig::default(), &mut |_step| {})?;
//! let evaluator = Evaluator::new(&model.header)?;
//! let reconstructor = Reconstructor::new(&model, &Selection::default())?;
//! let mut evaluation = evaluator.evaluation();
//! let mut fields = vec![0.0; reconstructor.entries()];
//! evaluator.evaluate(Inputs::new(0.06, 17.0), &mut evaluation);
//! let peaks = reconstructor.reconstruct_into(&evaluation, &mut fields)?;
//! assert!(evaluation.contact_force_n > 0.0 && peaks.stress_mpa.is_some() && sheet.regimes.len() == 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![deny(unsafe_code)] // the reconstruction kernel alone may allow it

mod accepted;
mod border;
pub mod calibration;
mod clearance;
pub mod config;
mod contract;
pub mod datasheet;
pub mod evaluate;
pub mod evaluation;
pub mod evaluator;
mod fit;
mod give;
pub mod goal;
mod gp;
pub mod halfwidths;
pub mod hull;
pub mod hysteresis;
pub mod inputs;
pub mod interpolant;
// Intrinsics and writes into loaned memory; each with its SAFETY line.
#[allow(unsafe_code)]
pub mod kernel;
pub mod model;
pub mod model_state;
pub mod names;
mod pod;
pub mod probe;
mod radial;
pub mod reconstructor;
pub mod regime;
pub mod rng;
mod select;
pub mod snapshots;
pub mod stress_peak;
mod sums;
pub mod synthetic;
pub mod train;
mod validate;

/// Tests of what is not public, kept beside the others.
#[cfg(test)]
#[path = "../tests/unit/numerics.rs"]
mod numerics;
#[cfg(test)]
#[path = "../tests/unit/slopes.rs"]
mod slopes;
