//! Decision on a valve's pressure: from setpoint, override and the twin's state to one value with its reason. Pure, without
//! allocation.

use super::spec::ValveSpec;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use wire::layout::{domain_status, flags, valve_interlock, valve_limit, valve_reason};
use wire::{Setpoint, State};

/// A setpoint that is stamped later than now by more than this is not one of this machine's clock (ns).
const AHEAD_NS: u64 = 100_000_000;
/// A release that is older than this was meant for a state that the operator no longer sees (ns).
const RELEASE_MAX_AGE_NS: u64 = 1_000_000_000;

/// Value to be written, with its reason.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decision {
    /// The value, MPa; within the range.
    pub pressure_mpa: f64,
    /// Pressure of setpoint or override, MPa; NaN without both.
    pub wanted_mpa: f64,
    /// One of `wire::layout::valve_reason`.
    pub reason: u32,
    /// Bits of `wire::layout::valve_interlock` that are closed, also where the reason is another.
    pub interlock: u32,
    /// Bits of `wire::layout::valve_limit`.
    pub limit: u32,
}

/// Decides, with the memory that rate and latch need.
#[derive(Debug)]
pub struct Governor {
    safe_mpa: f64,
    range_mpa: [f64; 2],
    rate_mpa_per_s: f64,
    valid_max_ns: u64,
    max_age_ns: u64,
    stop_outside_domain: bool,
    force_max_n: f64,
    needs_force: bool,
    stop_on_mismatch: bool,
    /// Last known pressure of the device, and its time.
    last_mpa: f64,
    last_ns: u64,
    /// After a longer pause the device may have closed by its own time-out.
    silence_max_ns: u64,
    trip: Arc<Trip>,
    /// Run, number and stamp of the last release: each counts once, when it is first seen.
    released: (u64, u64, u64),
}

/// The latch of the force interlock, one for all valves of an actuator.
#[derive(Debug, Default)]
pub struct Trip {
    /// Time from which an operator's release opens the valves again; 0: the force was not beyond its limit.
    ns: AtomicU64,
}

impl Governor {
    /// Governor of a device at its safe value.
    pub fn new(spec: &ValveSpec, now_ns: u64, trip: Arc<Trip>) -> Self {
        let ns = |ms: f64| (ms * 1e6) as u64;
        Self {
            safe_mpa: spec.safe_mpa,
            range_mpa: spec.range_mpa,
            rate_mpa_per_s: spec.rate_mpa_per_s,
            valid_max_ns: ns(spec.valid_max_ms),
            max_age_ns: ns(spec.state_max_age_ms),
            stop_outside_domain: spec.stop_outside_domain,
            force_max_n: spec.force_max_n,
            needs_force: spec.needs_force,
            stop_on_mismatch: spec.stop_on_mismatch,
            last_mpa: spec.safe_mpa,
            last_ns: now_ns,
            silence_max_ns: ns(spec.silence_max_ms()),
            trip,
            released: (0, 0, 0),
        }
    }

    /// The value for now. The operator wins over everything but range and rate; then setpoint missing, setpoint too old,
    /// interlock, setpoint.
    pub fn decide(
        &mut self,
        now_ns: u64,
        setpoint: Option<&Setpoint>,
        operator: Option<&Setpoint>,
        state: Option<&State>,
    ) -> Decision {
        let was_silent = self.forget_after_silence(now_ns);
        let setpoint = setpoint.filter(|setpoint| is_wanted(setpoint, now_ns));
        let interlock = self.interlocks(now_ns, operator, state);
        let operator = operator.filter(|operator| {
            is_wanted(operator, now_ns)
                && (operator.valid_for_ns == 0 || age_ns(operator, now_ns) <= operator.valid_for_ns)
        });
        let (wanted_mpa, reason) = match (operator, setpoint) {
            (Some(operator), _) => (operator.pressure_mpa, valve_reason::OVERRIDE),
            (None, None) => (f64::NAN, valve_reason::NO_SETPOINT),
            (None, Some(setpoint)) => {
                let valid_ns = setpoint.valid_for_ns.min(self.valid_max_ns);
                // After a pause even a new setpoint waits for one turn, so that its controller sees that the valve has closed.
                let is_late = was_silent || age_ns(setpoint, now_ns) > valid_ns;
                let reason = match (is_late, interlock != 0) {
                    (true, _) => valve_reason::TIMEOUT,
                    (false, true) => valve_reason::INTERLOCK,
                    (false, false) => valve_reason::FOLLOWING,
                };
                (setpoint.pressure_mpa, reason)
            }
        };
        let (pressure_mpa, limit) = match reason {
            valve_reason::FOLLOWING | valve_reason::OVERRIDE => self.towards(wanted_mpa, now_ns),
            _ => (self.safe_mpa, 0),
        };
        (self.last_mpa, self.last_ns) = (pressure_mpa, now_ns);
        Decision { pressure_mpa, wanted_mpa, reason, interlock, limit }
    }

    /// After a pause (a stopped or starved bridge) the device may be at its safe value. The way up begins there, and the pause itself grants
    /// no step.
    fn forget_after_silence(&mut self, now_ns: u64) -> bool {
        let was_silent = now_ns.saturating_sub(self.last_ns) > self.silence_max_ns;
        if was_silent {
            (self.last_mpa, self.last_ns) = (self.safe_mpa, now_ns);
        }
        was_silent
    }

    /// The device did not confirm until now: its own time-out closes it, so the way up begins at the safe value, and the wait grants no step.
    pub fn failed(&mut self, now_ns: u64) {
        (self.last_mpa, self.last_ns) = (self.safe_mpa, now_ns);
    }

    fn towards(&self, wanted_mpa: f64, now_ns: u64) -> (f64, u32) {
        let [low, high] = self.range_mpa;
        let within = wanted_mpa.clamp(low, high);
        let range = if within == wanted_mpa { 0 } else { valve_limit::RANGE };
        let dt_s = now_ns.saturating_sub(self.last_ns) as f64 * 1e-9;
        // No time is no change, with an infinite rate too.
        let step = if dt_s > 0.0 { self.rate_mpa_per_s * dt_s } else { 0.0 };
        let reached = within.clamp(self.last_mpa - step, self.last_mpa + step);
        (reached, range | if reached == within { 0 } else { valve_limit::RATE })
    }

    fn interlocks(&mut self, now_ns: u64, operator: Option<&Setpoint>, state: Option<&State>) -> u32 {
        self.release_trip(now_ns, operator);
        let Some(state) = state.filter(|state| state.flags & flags::NO_DATA == 0) else {
            return valve_interlock::NO_STATE | self.latched();
        };
        // A measured or predicted force that is not a number is no force beyond a limit; `needs_force` asks for one.
        let force_n = state.measured_force_n.max(state.contact_force_n);
        if force_n > self.force_max_n {
            self.trip.ns.fetch_max(now_ns, Ordering::Relaxed);
        }
        let bit = |is_set: bool, bit: u32| if is_set { bit } else { 0 };
        let outside = state.domain_status == domain_status::OUTSIDE;
        let contradicts = |flag: u32| self.stop_on_mismatch && state.flags & flag != 0;
        self.latched()
            | bit(now_ns.saturating_sub(state.t_sensor_ns) > self.max_age_ns, valve_interlock::STALE)
            | bit(self.stop_outside_domain && outside, valve_interlock::OUTSIDE_DOMAIN)
            | bit(self.needs_force && !state.measured_force_n.is_finite(), valve_interlock::NO_FORCE)
            | bit(contradicts(flags::FORCE_MISMATCH), valve_interlock::FORCE_MISMATCH)
            | bit(contradicts(flags::MARKER_MISMATCH), valve_interlock::MARKER_MISMATCH)
            | bit(contradicts(flags::OBSERVABLE_MISMATCH), valve_interlock::OBSERVABLE_MISMATCH)
            | bit(contradicts(flags::ESTIMATE_ALARM), valve_interlock::ESTIMATE_ALARM)
    }

    fn latched(&self) -> u32 {
        if self.trip.ns.load(Ordering::Relaxed) != 0 { valve_interlock::FORCE } else { 0 }
    }

    /// A release that the operator has sent after the trip and just now. A stamp in the future is of another clock, and would be later than every
    /// trip to come.
    fn release_trip(&mut self, now_ns: u64, operator: Option<&Setpoint>) {
        let Some(operator) = operator.filter(|operator| operator.pressure_mpa.is_nan()) else { return };
        let release = (operator.boot_id, operator.seq, operator.t_publish_ns);
        if std::mem::replace(&mut self.released, release) == release {
            return;
        }
        let is_of_now = operator.t_publish_ns <= now_ns && age_ns(operator, now_ns) <= RELEASE_MAX_AGE_NS;
        let tripped_ns = self.trip.ns.load(Ordering::Relaxed);
        if is_of_now && operator.t_publish_ns > tripped_ns {
            // A trip by another valve in between stays.
            let _stays = self.trip.ns.compare_exchange(tripped_ns, 0, Ordering::Relaxed, Ordering::Relaxed);
        }
    }
}

fn age_ns(setpoint: &Setpoint, now_ns: u64) -> u64 {
    now_ns.saturating_sub(setpoint.t_publish_ns)
}

/// A pressure is wanted, and the stamp is one of this machine's clock.
fn is_wanted(setpoint: &Setpoint, now_ns: u64) -> bool {
    setpoint.pressure_mpa.is_finite() && setpoint.t_publish_ns <= now_ns.saturating_add(AHEAD_NS)
}

#[cfg(test)]
#[path = "../../tests/unit/valve_decide.rs"]
mod tests;
