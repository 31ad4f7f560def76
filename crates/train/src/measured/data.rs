//! Measured runs, and what is learned from them.

use formats::log::{LogColumn, Recording};
use rom::inputs::Inputs;
use rom::model::{Model, ModelFileError};
use rom::snapshots::RegimeKind;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;

/// Fewest states of a measured difference.
pub(super) const MIN_STATES: usize = 12;
/// Largest RMS on left-out segments, as a fraction of that without offset, at which an offset is kept.
pub(super) const MOST_LEFT: f64 = 0.9;
/// Radii tried for an offset, in units of the root of the number of inputs. Beyond its radius from the measured states an offset is exactly 0.
pub(super) const REACHES: [f64; 3] = [0.2, 0.4, 0.8];
/// Smoothings (`lambda`) that are tried.
pub(super) const SMOOTHINGS: [f64; 6] = [1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0];

/// States of a run and the values measured there, by output; a row without all inputs has no state.
#[derive(Clone, Debug, Default)]
pub struct MeasuredStates {
    /// Inputs of the model.
    pub states: Vec<Option<Inputs>>,
    /// Values by output, then row; NaN if missing.
    pub outputs: Vec<Vec<f64>>,
}

/// Gap of a recording: a multiple of the median interval, at least some time.
const GAP_INTERVALS: f64 = 20.0;
const SHORTEST_GAP_S: f64 = 1.0;

/// Longest time between two rows, s, that is a step and not a gap of the recording.
pub(crate) fn max_gap_s(interval_s: f64) -> f64 {
    (GAP_INTERVALS * interval_s).max(SHORTEST_GAP_S)
}

/// Measured inputs and outputs of one or several runs.
#[derive(Clone, Debug, Default)]
pub struct Measured {
    /// Names of the inputs, with units (`pressure_mpa`).
    pub inputs: Vec<String>,
    /// Names of the outputs, with units (`tip_x_mm`).
    pub outputs: Vec<String>,
    /// Each recording is a run: nothing is known of the time between two.
    pub runs: Vec<Run>,
}

/// One run: columns of equal length, in order of time; NaN where a value is missing.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// Time, s.
    pub time_s: Vec<f64>,
    /// Values by input, then row.
    pub inputs: Vec<Vec<f64>>,
    /// Values by output, then row.
    pub outputs: Vec<Vec<f64>>,
}

impl Measured {
    /// Recordings of one bench: the last one names inputs and outputs.
    #[must_use]
    pub fn of(recordings: Vec<Recording>) -> Self {
        let names = |all: &[LogColumn]| all.iter().map(|series| series.name.clone()).collect();
        let values = |all: Vec<LogColumn>| all.into_iter().map(|series| series.values).collect();
        let (inputs, outputs) =
            recordings.last().map(|last| (names(&last.inputs), names(&last.outputs))).unwrap_or_default();
        let run = |recording: Recording| Run {
            time_s: recording.time_s,
            inputs: values(recording.inputs),
            outputs: values(recording.outputs),
        };
        Self { inputs, outputs, runs: recordings.into_iter().map(run).collect() }
    }
}

/// Writes a regime as people and files call it.
pub(super) fn regime_name<S: Serializer>(regime: &RegimeKind, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(regime.name())
}

/// Figures of an output.
#[derive(Clone, Debug, Serialize)]
pub struct OutputReport {
    /// Name.
    #[serde(skip)]
    pub name: String,
    /// Largest minus smallest value.
    pub range: f64,
    /// Standard deviation of the noise from row to row.
    pub noise: f64,
    /// RMS error on segments that were left out.
    pub rms: f64,
    /// Half-width.
    pub half_width: f64,
    /// Mean difference of rising and falling at equal predicted values, as a fraction of the range.
    pub loop_share: f64,
    /// Fraction of the variance on left-out segments that the inputs explain.
    pub explained: f64,
}

/// Result of [`learn`](super::learn) and [`fit`](super::fit).
#[derive(Clone, Debug)]
pub struct Learned {
    /// The model.
    pub model: Model,
    /// Inputs of the model.
    pub inputs: Vec<String>,
    /// Outputs of the model.
    pub outputs: Vec<OutputReport>,
    /// What was noticed and does not prevent learning.
    pub remarks: Vec<String>,
    /// Times of filling and emptying of the best lag common to all inputs, s; `None`: the inputs as they are.
    pub lag_s: Option<[f64; 2]>,
    /// Shares of polynomials, kernel maps and reservoirs in the answer.
    pub shares: [f64; 3],
    /// Changes between rising and falling inputs.
    pub turns: usize,
    /// Rows of the fit.
    pub rows: usize,
    /// RMS error on left-out segments over all outputs, as a fraction of the length of their ranges.
    pub error_share: f64,
    /// The same of a linear map without lags.
    pub memoryless_share: f64,
}

/// What a program tells of a learned model.
#[derive(Clone, Debug, Serialize)]
pub struct LearningReport {
    source: &'static str,
    rows: usize,
    inputs: Vec<String>,
    /// Error on left-out parts as a fraction of the length of the outputs' range: of a linear map without lags, and of the model.
    memoryless_share: f64,
    error_share: f64,
    /// Best lag common to all inputs; none where there is no lag.
    filling_s: Option<f64>,
    emptying_s: Option<f64>,
    polynomial_share: f64,
    kernel_share: f64,
    reservoir_share: f64,
    turns: usize,
    outputs: BTreeMap<String, OutputReport>,
    remarks: Vec<String>,
}

impl LearningReport {
    /// That of a model.
    pub fn of(learned: &Learned) -> Self {
        Self {
            source: "measured",
            rows: learned.rows,
            inputs: learned.inputs.clone(),
            memoryless_share: learned.memoryless_share,
            error_share: learned.error_share,
            filling_s: learned.lag_s.map(|[filling, _]| filling),
            emptying_s: learned.lag_s.map(|[_, emptying]| emptying),
            polynomial_share: learned.shares[0],
            kernel_share: learned.shares[1],
            reservoir_share: learned.shares[2],
            turns: learned.turns,
            outputs: learned.outputs.iter().map(|output| (output.name.clone(), output.clone())).collect(),
            remarks: learned.remarks.clone(),
        }
    }
}

/// Reason why nothing can be learned.
#[derive(Debug, thiserror::Error)]
pub enum MeasuredError {
    /// No input moves.
    #[error(
        "no input moves beyond its noise: the recording teaches nothing; record a run in which the pressures change, or check \
         the input columns of the mapping"
    )]
    Still,
    /// No output moves.
    #[error(
        "no output moves beyond its noise, or the mapping has none: the recording teaches nothing; check `[[output]]` of the mapping"
    )]
    NoOutput,
    /// The outputs do not follow the inputs.
    #[error(
        "the inputs explain {explained:.0} % of the outputs' variance on parts that were left out, expected at least {least:.0} %: \
         no input moves beyond its noise, or the columns belong to something else; check the mapping"
    )]
    Unrelated {
        /// Explained variance of the best output, %.
        explained: f64,
        /// Smallest that is accepted, %.
        least: f64,
    },
    /// Few rows.
    #[error(
        "expected at least {expected} rows without missing values, found {found}; leave out columns that are mostly empty"
    )]
    Few {
        /// Fewest rows.
        expected: usize,
        /// Rows there are.
        found: usize,
    },
    /// More inputs move than a model has.
    #[error(
        "expected at most {expected} inputs that move, found {found}; leave out some of them in the mapping"
    )]
    Many {
        /// Most inputs.
        expected: usize,
        /// Inputs that move.
        found: usize,
    },
    /// The least-squares system has no solution.
    #[error("the least-squares system of the measured rows has no finite solution")]
    Singular,
    /// The model has none of the outputs.
    #[error(
        "expected observables or node sets of the model as outputs, found {found}; the model has {known}"
    )]
    NoSuchOutput {
        /// Outputs of the recordings.
        found: String,
        /// Observables and node sets of the model.
        known: String,
    },
    /// No measured difference is smooth over the inputs.
    #[error(
        "no difference from the model is a smooth function of the inputs: {reasons}; the model is unchanged"
    )]
    NoDifference {
        /// Reason by output.
        reasons: String,
    },
    /// The record cannot be written.
    #[error(transparent)]
    File(#[from] ModelFileError),
}

/// Fewest rows: settled states of one sweep.
pub(super) const MIN_ROWS: usize = 8;
/// Smallest explained variance.
pub(super) const MIN_EXPLAINED: f64 = 0.2;
/// Nominal coverage of the half-widths.
pub(super) const COVERAGE: f64 = 0.9;

/// Unit of each output's error: length of the ranges of all outputs with its unit.
pub(super) fn scales(names: &[String], runs: &[Run]) -> Vec<f64> {
    let unit = |index: usize| names[index].rsplit('_').next().unwrap_or_default();
    let range = |index: usize| rom::statistics::range(runs.iter().flat_map(|run| run.outputs[index].iter()));
    let scale = |index: usize| {
        let same = (0..names.len()).filter(|other| unit(*other) == unit(index));
        same.map(|other| range(other).powi(2)).sum::<f64>().sqrt()
    };
    (0..names.len()).map(scale).collect()
}
