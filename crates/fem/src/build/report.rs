//! What a build is told, what it tells meanwhile and at its end.

use crate::actuator::GridError;
use crate::plan::PlanError;
use crate::problem::ProblemError;
use crate::run::{Event, RunError};
use formats::FormatError;
use rom::model::ModelFileError;
use serde::Serialize;
use std::path::PathBuf;
use train::TrainError;
use train::evaluate::{EvaluateError, EvaluationReport};
use train::quality::Quality;

/// How a twin is built.
#[derive(Clone, Copy, Debug)]
pub struct BuildSettings {
    /// True for a first look: fewer states.
    pub quick: bool,
    /// Longest edge of an element, mm; by default that of the actuator's file.
    pub size_mm: Option<f64>,
    /// States solved at the same time, about 1 GB each on a fine mesh.
    pub threads: usize,
}

/// What a build is doing, for progress lines.
#[derive(Debug)]
pub enum BuildNotice<'a> {
    /// A step has a result.
    Done {
        /// Such as `mesh`.
        step: &'a str,
        /// What it found.
        text: &'a str,
    },
    /// Work that takes a while begins.
    Begins(&'a str),
    /// A list of this many states is solved from here on.
    Solving(usize),
    /// One of them.
    State(Event<'a>),
    /// The list ends.
    Solved,
}

/// Who is told; from any thread.
pub type Notify<'a> = &'a (dyn Fn(BuildNotice<'_>) + Sync);

/// Why there is no twin.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// A setting does not suit the actuator.
    #[error("{0}")]
    Argument(String),
    /// The mesh cannot be made.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The mesh cannot be computed with.
    #[error(transparent)]
    Problem(#[from] ProblemError),
    /// States cannot be chosen or solved.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A file could not be read or written.
    #[error(transparent)]
    Files(#[from] FormatError),
    /// The states cannot be trained on.
    #[error("training on {database}")]
    Train {
        /// Folder of the states.
        database: PathBuf,
        /// What keeps them from being trained on.
        source: TrainError,
    },
    /// The model cannot be written.
    #[error(transparent)]
    Model(#[from] ModelFileError),
    /// The model cannot be measured.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// The training configuration cannot be written.
    #[error(transparent)]
    Config(#[from] toml::ser::Error),
}

impl From<RunError> for BuildError {
    fn from(error: RunError) -> Self {
        Self::Plan(error.into())
    }
}

/// A twin with its errors; `Q` is how they are told.
#[derive(Debug, Serialize)]
pub struct Built<R, Q = Quality> {
    /// What was built.
    #[serde(flatten)]
    pub report: R,
    /// How good the model is.
    pub quality: Q,
    /// Errors on the held-out states, by state, if there are such states.
    #[serde(skip)]
    pub held_out: Option<EvaluationReport>,
    /// What to do next.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
}

/// What was built.
#[derive(Debug, Serialize)]
pub struct BuildReport {
    /// The model.
    pub model: PathBuf,
    /// The scene, with readings by formula until it has a sensor.
    pub scene: PathBuf,
    /// What the training found.
    pub notes: Vec<String>,
    /// States of the plan.
    pub states: usize,
    /// States that could not be solved.
    pub failed: usize,
    /// States of an earlier run.
    pub reused: usize,
    /// Largest pressure, MPa.
    pub pressure_mpa: f64,
    /// Why it ends there.
    pub pressure_reason: String,
    /// Over the interval of a shear modulus that was not measured.
    pub pressure_interval_mpa: Option<[f64; 2]>,
    /// Largest stretch of the elastomer.
    pub largest_stretch: f64,
    /// Largest displacement, mm.
    pub displacement_mm: f64,
    /// Rotation of the end, degrees.
    pub angle_deg: f64,
    /// Largest pressure of the contact states, MPa.
    pub contact_pressure_mpa: f64,
    /// Smallest and largest gap; `None` without an obstacle.
    pub gap_mm: Option<[f64; 2]>,
    /// Time that it took.
    pub seconds: f64,
    /// Processor time of the process.
    pub cpu_seconds: Option<f64>,
    /// Names of the cavities besides the first.
    #[serde(skip)]
    pub cavities: Vec<String>,
}
