//! What a run that drives a valve takes from the twin's states: the first reading, the gap, and how long there was none.

use anyhow::ensure;
use control::held::Held;
use control::inverse::Quantity;
use control::twin_model::OUT_OF_REACH_MM;
use std::time::{Duration, Instant};
use wire::layout::{Outcome, flags};
use wire::{State, StateReader, WakeSet};

/// Without a reading for this time the valve is let go.
const SILENCE: Duration = Duration::from_secs(1);
/// Longest wait for the first state with a reading.
const FIRST: Duration = Duration::from_secs(10);
/// Substituted readings are not used.
pub(super) const NOT_A_READING: u32 = flags::NO_DATA | flags::STALE | flags::HELD;

/// The first state with a reading: its gap and inputs decide what is in reach.
pub(super) fn first(states: &StateReader, wake: &mut WakeSet) -> anyhow::Result<State> {
    let end = Instant::now() + FIRST;
    let mut outcome = None;
    loop {
        if let Some(state) = states.newest()? {
            if state.flags & NOT_A_READING == 0 {
                return Ok(state);
            }
            outcome = Outcome::from_code(state.outcome);
        }
        let left = end.saturating_duration_since(Instant::now());
        ensure!(
            !left.is_zero(),
            "the twin has had no good reading for {} s; the last one: {}",
            FIRST.as_secs(),
            outcome.map_or("none, start the bridge".into(), |outcome| outcome.to_string())
        );
        wake.wait(left)?;
    }
}

/// Gap of a state: measured, given or estimated; the option's if it has none. What moves freely needs none.
pub(super) fn state_gap_mm(state: &State, given_mm: Option<f64>, held: &Held) -> Option<f64> {
    let free_mm = (held.quantity != Quantity::Force).then_some(OUT_OF_REACH_MM);
    Some(state.gap_mm).filter(|gap_mm| gap_mm.is_finite()).or(given_mm).or(free_mm)
}

/// Ends a run that drives a valve when no good reading has come for [`SILENCE`]. States alone do not count: a twin goes on without its bridge.
pub(super) struct Silence {
    since: Instant,
    state: bool,
}

impl Silence {
    pub(super) fn begin() -> Self {
        Self { since: Instant::now(), state: false }
    }

    /// Whether a state has a reading of its own.
    pub(super) fn has_reading(&mut self, state: &State) -> anyhow::Result<bool> {
        if state.flags & NOT_A_READING == 0 {
            *self = Self::begin();
            return Ok(true);
        }
        self.state = true;
        self.left()?;
        Ok(false)
    }

    /// Waits for a state, no longer than silence may last.
    pub(super) fn wait(&self, wake: &mut WakeSet) -> anyhow::Result<()> {
        wake.wait(self.left()?)?;
        Ok(())
    }

    fn left(&self) -> anyhow::Result<Duration> {
        let left = SILENCE.saturating_sub(self.since.elapsed());
        let who = if self.state { "the twin has had no good reading" } else { "the twin has been silent" };
        ensure!(!left.is_zero(), "{who} for {} s; is the bridge running?", SILENCE.as_secs());
        Ok(left)
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/cmd_hold_states.rs"]
mod tests;
