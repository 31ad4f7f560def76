//! Where readings come from. One file a source, one variant of [`Source`]; a conformance test runs over all variants.

pub mod live;
mod recorded;
mod replay;
mod rng;
mod simulate;
mod trace;

pub use replay::{Replay, ReplaySpec};
pub use simulate::{Profile, Simulate, SimulateSpec};
pub use trace::{Trace, TraceError, TraceRow};

use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// One reading and when it is due.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Seconds after the source's start at which the reading is to be sent.
    pub due_s: f64,
    /// Time in the source's own trace, s; NaN when it has none.
    pub t_trace_s: f64,
    /// Gauge pressure, MPa. May be anything a gauge can say, NaN too: judging it is the twin's business.
    pub pressure_mpa: f64,
    /// Gap, mm; NaN when the source does not measure it.
    pub gap_mm: f64,
    /// Measured contact force, N; NaN when there is no load cell.
    pub measured_force_n: f64,
    /// 0: good; anything else is the sensor's own fault code.
    pub status: u32,
}

/// A source as written in a scene file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum SourceSpec {
    /// A recorded trace.
    Replay(ReplaySpec),
    /// A formula.
    Simulate(SimulateSpec),
    /// Modbus sensors, over TCP or a serial line.
    Modbus(live::ModbusSpec),
    /// Lines of text, from a serial line or standard input.
    Lines(live::LinesSpec),
}

/// An opened source.
///
/// The contract that every scheduled variant keeps (and the conformance test checks): readings come in order of `due_s`, beginning at
/// or after 0; the same specification gives the same readings, bit for bit; `next` does not block; after `None` it stays
/// `None`.
#[derive(Debug)]
pub enum Source {
    /// A recorded trace.
    Replay(Replay),
    /// A formula.
    Simulate(Simulate),
    /// A sensor, not yet started: the bridge starts it and is woken by its readings.
    Live(live::LiveSpec),
}

impl Source {
    /// The next scheduled reading; `None` at the end, and always for a sensor.
    pub fn next_reading(&mut self) -> Option<Reading> {
        match self {
            Self::Replay(source) => source.next_reading(),
            Self::Simulate(source) => source.next_reading(),
            Self::Live(_) => None,
        }
    }
}

impl SourceSpec {
    /// Opens the source. Relative paths are taken from `folder` (the scene file's).
    ///
    /// # Errors
    /// Every problem of the specification and of the trace it names, as text for the user.
    pub fn open(&self, folder: &Path) -> Result<Source, Vec<String>> {
        match self {
            Self::Replay(spec) => Replay::open(spec, folder).map(Source::Replay),
            Self::Simulate(spec) => Simulate::new(spec).map(Source::Simulate),
            Self::Modbus(spec) => live(spec.problems(), || live::LiveSpec::Modbus(spec.clone())),
            Self::Lines(spec) => live(spec.problems(), || live::LiveSpec::Lines(spec.clone())),
        }
    }

    /// The source that replays `trace` as it was recorded.
    pub fn replay_of(trace: PathBuf) -> Self {
        Self::Replay(ReplaySpec { trace, ..ReplaySpec::default() })
    }
}

fn live(problems: Vec<String>, spec: impl FnOnce() -> live::LiveSpec) -> Result<Source, Vec<String>> {
    if problems.is_empty() { Ok(Source::Live(spec())) } else { Err(problems) }
}

/// Notes a problem when `value` is not a finite number above `above`.
fn require_above(problems: &mut Vec<String>, key: &str, value: f64, above: f64) {
    if !(value.is_finite() && value > above) {
        problems.push(format!("source.{key}: expected a finite number above {above}, found {value}"));
    }
}
