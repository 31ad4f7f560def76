//! Settings of the twin's process: limits on readings, deadlines, real time. One file (`config/twin.toml`), all optional.

use super::error::{ConfigError, read};
use crate::problems::Problems;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Settings of a twin process.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Limits of a valid reading.
    pub limits: Limits,
    pub realtime: Realtime,
}

/// Limits of a valid reading; others are held with the reason.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Lower than this is absurd, MPa (a gauge at rest shows small negative values).
    pub pressure_min_mpa: f64,
    /// Higher than this is absurd, MPa.
    pub pressure_max_mpa: f64,
    /// Higher than this is absurd, mm; below 0 always is.
    pub gap_max_mm: f64,
    /// Time without a good reading after which the state is stale, ms; `None`: it follows the source's rate
    /// ([`Deadline`](crate::twin::Deadline)).
    pub deadline_ms: Option<f64>,
    /// A reading older than this on arrival is held, ms.
    pub max_age_ms: f64,
    /// A reading stamped later than now by more than this is held, ms.
    pub max_ahead_ms: f64,
    /// A reading sent later than this after its stamp is counted and flagged late, ms.
    pub late_ms: f64,
    /// Time for which a measured force or marker must differ from the predicted one by more than half-width and noise to raise the
    /// alarm, ms: each reading, or the mean of readings that stay alike.
    pub mismatch_ms: f64,
    /// Policy for readings outside the model's training range.
    pub outside_domain: OutsideDomain,
}

/// Policy for readings outside the model's training range, where results are extrapolated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OutsideDomain {
    /// It is answered; domain status, distance and a flag show it.
    #[default]
    Answer,
    /// The last good state stands, with the reason.
    Hold,
    /// Nothing is sent; the reading is counted as dropped.
    Refuse,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            pressure_min_mpa: -0.005,
            pressure_max_mpa: 1.0,
            gap_max_mm: 1000.0,
            deadline_ms: None,
            max_age_ms: 1000.0,
            max_ahead_ms: 100.0,
            late_ms: 5.0,
            mismatch_ms: 500.0,
            outside_domain: OutsideDomain::default(),
        }
    }
}

/// Milliseconds to nanoseconds; what does not fit saturates.
pub(crate) fn ms_to_ns(ms: f64) -> u64 {
    (ms * 1e6) as u64
}

/// Real-time behaviour; what needs rights is off unless asked for.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Realtime {
    /// Lock all memory (`mlockall`), so that nothing is paged out.
    pub lock_memory: bool,
    /// Map all pages of the samples at start, so that no page fault falls into the loop.
    pub prefault: bool,
    /// Priority under SCHED_FIFO, 1-99; 0: the ordinary scheduler.
    pub fifo_priority: u8,
    /// Cores the loop may run on; empty: any.
    pub cores: Vec<usize>,
    /// Spin instead of sleeping: one core at 100 % for a shorter wake-up. Only on a dedicated core.
    pub busy_poll: bool,
    /// Keep idle cores from sleeping (all of the machine, while the twin runs): wake-ups in a few microseconds instead of
    /// tens, at the power of a spin, but other programs still get the cores.
    pub stay_awake: bool,
    /// Reaction to missing rights for these settings.
    pub on_missing_rights: OnMissingRights,
}

/// Reaction to missing rights for real-time settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OnMissingRights {
    /// Say so once, loudly, and go on.
    #[default]
    Warn,
    /// Do not start.
    Stop,
}

impl Settings {
    /// Reads and checks a settings file.
    ///
    /// # Errors
    /// All problems at once.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let settings: Self = read(path)?;
        ConfigError::unless(path, settings.problems())?;
        Ok(settings)
    }

    /// All errors in the settings.
    pub fn problems(&self) -> Vec<String> {
        let mut list = Vec::new();
        let mut problems = Problems::new(&mut list, "");
        let limits = &self.limits;
        let (min, max) = (limits.pressure_min_mpa, limits.pressure_max_mpa);
        let found = format!("{min} and {max}");
        let keys = "limits.pressure_min_mpa, pressure_max_mpa";
        problems.expect(min.is_finite() && min < max, keys, "min < max", found);
        problems.part("limits").above_0("gap_max_mm", limits.gap_max_mm);
        for (key, value) in [
            ("deadline_ms", limits.deadline_ms.unwrap_or(1.0)),
            ("max_age_ms", limits.max_age_ms),
            ("max_ahead_ms", limits.max_ahead_ms),
            ("late_ms", limits.late_ms),
            ("mismatch_ms", limits.mismatch_ms),
        ] {
            problems.part("limits").milliseconds(key, value);
        }
        let Realtime { fifo_priority, cores, .. } = &self.realtime;
        let mut realtime = problems.part("realtime");
        realtime.expect(*fifo_priority <= 99, "fifo_priority", "1-99, or 0 for off", fifo_priority);
        for core in cores.iter().filter(|core| **core >= 1024).take(1) {
            realtime.expect(false, "cores", "core numbers below 1024", core);
        }
        list
    }
}
