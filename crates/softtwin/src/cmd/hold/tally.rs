//! What a run of `hold` reports, while it runs and at its end.

use super::goal::Goal;
use crate::live::Latencies;
use control::held::Held;
use control::law::Cycle;
use recording::Thinned;
use rom::statistics::mean;
use serde_json::{Value, json};
use std::io::Write;
use wire::{State, now_ns};

/// Larger jumps of the number of a reading are another beginning of the sender's count.
const MOST_MISSED: u64 = 1 << 32;
/// Values of a run of any length, in bounded memory.
const MOST_VALUES: usize = 1 << 15;

/// Counts, delays and values of a run.
pub(super) struct Tally {
    /// From readings to setpoints, and to what the device confirmed.
    latencies: Latencies,
    pub(super) written: Latencies,
    /// The last reading that was answered, and how many had no own setpoint.
    last_seq: u64,
    missed: u64,
    fallbacks: u64,
    measured: Thinned<f64>,
    predicted: Thinned<f64>,
    /// Whether a low supply and an oscillation were said.
    said: [bool; 2],
}

impl Tally {
    pub(super) fn new() -> Self {
        Self {
            latencies: Latencies::new(),
            written: Latencies::new(),
            last_seq: 0,
            missed: 0,
            fallbacks: 0,
            measured: Thinned::new(MOST_VALUES),
            predicted: Thinned::new(MOST_VALUES),
            said: [false; 2],
        }
    }

    /// Whether a sensor has measured the held quantity.
    pub(super) fn is_measured(&self) -> bool {
        !self.measured.is_empty()
    }

    /// Takes a control cycle with what a sensor measured before it; NaN: none did.
    pub(super) fn take_cycle(&mut self, cycle: &Cycle, measured: f64) {
        self.fallbacks += u64::from(cycle.is_fallback);
        if measured.is_finite() {
            self.measured.offer(|| Some(measured));
        }
        self.predicted.offer(|| Some(cycle.followed));
    }

    /// Says once each time that the supply is low, and that the commands oscillate; the loop goes on.
    pub(super) fn say_what_is_new(&mut self, cycle: &Cycle, held: &Held) {
        let Cycle { limited, is_oscillating, target, .. } = *cycle;
        let before = std::mem::replace(&mut self.said, [limited.by_supply, is_oscillating]);
        let (name, unit) = (&held.name, held.unit);
        let texts = [
            format!(
                "supply: the gauge stays below the setpoint; {name} {target:.4} {unit} is held, which it still gives"
            ),
            "oscillation: the setpoints swing while the target does not; run `softtwin tune` again"
                .to_owned(),
        ];
        for ((text, is_so), was_so) in texts.iter().zip(self.said).zip(before) {
            if is_so && !was_so {
                // A closed error stream is no reason to let go of the valve.
                let _ = writeln!(std::io::stderr(), "{text}");
            }
        }
    }

    /// Takes a state whose setpoint has just been sent.
    pub(super) fn take_answered(&mut self, state: &State) {
        if self.last_seq > 0 {
            // Of a new run of the bridge none is counted.
            let missed = state.sensor_seq.saturating_sub(self.last_seq + 1);
            self.missed += if missed <= MOST_MISSED { missed } else { 0 };
        }
        self.last_seq = state.sensor_seq;
        self.latencies.record_ns(now_ns().saturating_sub(state.t_sensor_ns));
    }

    /// The report, with the goal and the cycle at the end of the run; `sensor` measures the held quantity, if anything does.
    pub(super) fn report(
        &self,
        held: &Held,
        goal: &Goal,
        cycle: &Cycle,
        sensor: &str,
        setpoints: u64,
    ) -> Value {
        let (values, by) = match self.is_measured() {
            true => (&self.measured, Some(sensor)),
            false => (&self.predicted, None),
        };
        let followed = last_quarter(values);
        json!({
            "held": held.name,
            "target": goal.last(),
            "unit": held.unit,
            "followed": followed,
            "measured_by": by,
            "final_error": followed.map(|followed| followed - goal.last()),
            "is_limited": cycle.limited.is_limited(),
            "is_rate_limited": cycle.limited.by_rate,
            "is_supply_low": cycle.limited.by_supply,
            "is_oscillating": cycle.is_oscillating,
            "fallbacks": self.fallbacks,
            "fault": cycle.fault,
            "setpoints": setpoints,
            "missed_readings": self.missed,
            "reading_to_setpoint_us": self.latencies.percentiles_us(),
            "reading_to_written_us": (!self.written.is_empty()).then(|| self.written.percentiles_us()),
        })
    }
}

/// Mean over the last quarter.
fn last_quarter(values: &[f64]) -> Option<f64> {
    let tail = &values[values.len() * 3 / 4..];
    (!tail.is_empty()).then(|| mean(tail.iter().copied()))
}

#[cfg(test)]
#[path = "../../../tests/unit/cmd_hold_tally.rs"]
mod tests;
