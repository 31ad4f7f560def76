//! The reduced-order model of a soft pneumatic actuator: POD of finite-element snapshots, interpolated over pressure
//! and gap.
//!
//! Snapshots come in as a [`snapshots::Database`], a [`config::TrainConfig`] says how to reduce them, training makes a
//! [`model::Model`], and a predictor answers queries from it without allocating. Pure functions of data: no clock, no
//! threads, no files.

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
pub mod stability;
pub mod train;
mod validate;
