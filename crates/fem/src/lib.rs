#![doc = include_str!("../README.md")]
#![warn(missing_docs)] // the API that programs of others use: every public item says what it is, its units and its errors
#![forbid(unsafe_code)]

pub mod actuator;
mod algebra;
mod bending;
pub mod build;
pub mod cases;
mod config;
mod contact;
mod dynamics;
mod element;
mod energy;
mod family;
pub mod inertia;
mod krylov;
mod linear;
mod mass;
pub mod material;
mod mesh;
mod newton;
mod output;
mod path;
pub mod plan;
mod problem;
mod recovery;
pub mod run;
pub mod sample;
mod sensitivity;
mod solver;
mod state;
mod system;
mod tangent;
mod transfer;
pub mod transient;
mod vibration;

pub use bending::{Bending, observables};
pub use config::{
    ContactSettings, GRAVITY_ALONG_MM_S2, GRAVITY_DOWN_MM_S2, Load, MM3_PER_MG, NewtonSettings, ProblemConfig,
};
pub use contact::{Obstacle, Round, RoundShape};
pub use dynamics::{Dynamics, PronyTerm};
pub use element::cavity::CavityLoad;
pub use family::{Family, Variant, VariantError};
pub use linear::LinearError;
pub use mesh::{BodyReport, EndFace, Hollow, Measures, Mesh, Slot, Wall, four_digits};
pub use newton::NewtonError;
pub use output::{MAX_RESIDUAL, Output};
pub use path::{Limit, LimitKind, Path, PathPoint, PathSettings, limits};
pub use problem::{Problem, ProblemError};
pub use recovery::StressRecovery;
pub use sensitivity::{Change, Sensitivity};
pub use solver::{Bodies, FORMULATION, NotConverged, SolveError, SolveReport, Solver};
pub use state::{State, Stretches};
pub use transfer::{ElementPoint, Locator};
pub use vibration::{BodyMass, Vibration, VibrationError};

#[cfg(test)]
#[path = "../tests/unit/mod.rs"]
mod unit_tests;
