//! The reduced-order model of a soft pneumatic actuator: POD of finite-element snapshots, interpolated over pressure,
//! gap and, where a model has them, further inputs.
//!
//! A [`model::Model`] comes out of a file, or from the crate `train`, which makes it of a [`snapshots::Database`]. An
//! [`evaluator::Evaluator`] gives force, gradients, half-widths and modal coefficients at a state, a
//! [`reconstructor::Reconstructor`] the fields of these coefficients, both without allocating. Pure functions of
//! data, without a clock or threads; files are opened in `load.rs` alone.
//!
//! ```text
//! a(x) = sum_k w_k g(|x - x_k|) + tail(x)   sums.rs            inputs x = (P) free, (P, gap) in contact, scaled to [0, 1]
//! P_c(gap)                                  regime.rs          onset pressure, read off the free model
//! P_c(gap, parameters)                      clearance.rs       the same, solved from the free model
//! P -> line -> play -> creep                memory           inputs over time, where a model has memory
//! y(u over time)                            learned.rs        a model of measurements alone: ridge maps of filtered inputs
//! P -> V                                    branch.rs        volume on the present branch, for a model over volumes
//! F = (P - P_c(gap)) h(P, gap)              evaluator.rs       contact force, 0 on the onset exactly
//! y = mean + Phi a                          reconstructor.rs   fields, straight into the caller's memory
//! ```
//!
//! ```
//! use rom::{evaluator::Evaluator, inputs::Inputs, model::{Model, Selection}, reconstructor::Reconstructor};
//!
//! # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/pneunet/pneunet.twin");
//! let (model, _) = Model::read(path)?; // `softtwin train` writes such a file
//! let evaluator = Evaluator::new(&model.header)?;
//! let reconstructor = Reconstructor::new(&model, &Selection::default())?;
//! let mut evaluation = evaluator.evaluation();
//! let mut fields = vec![0.0; reconstructor.entries()];
//! evaluator.evaluate(Inputs::new(0.06, 17.0), &mut evaluation);
//! let peaks = reconstructor.reconstruct_into(&evaluation, &mut fields)?;
//! assert!(evaluation.contact_force_n > 0.0 && peaks.stress_mpa.is_some());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![warn(missing_docs)] // the API that programs of others use: every public item says what it is, its units and its errors
#![deny(unsafe_code)] // the reconstruction kernel alone may allow it

mod affine;
pub mod body;
pub mod branch;
pub mod clearance;
mod contract;
pub mod cubic;
pub mod dense;
pub mod difference;
pub mod evaluation;
pub mod evaluator;
pub mod goal;
pub mod halfwidths;
pub mod hull;
pub mod inertia;
pub mod inputs;
pub mod interpolant;
mod parameters;
// Intrinsics and writes into loaned memory; each with its SAFETY line.
#[allow(unsafe_code)]
pub mod kernel;
pub mod learned;
pub mod least_squares;
pub mod line;
mod load;
pub mod memory;
pub mod model;
pub mod model_state;
pub mod observable;
pub mod parts;
pub mod probe;
pub mod radial;
pub mod reconstructor;
pub mod regime;
pub mod rng;
pub mod session;
pub mod snapshots;
pub mod statistics;
pub mod vector;
