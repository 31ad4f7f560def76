//! Thread that logs the events of the twin's loop and feeds the watchdog.

use runtime::service::Watchdog;
use runtime::thread_group::StopFlag;
use runtime::twin::{Event, EventKind};
use runtime::wire::{Outcome, background_thread, layout, now_ns};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;

/// Interval of the reporter.
const INTERVAL: Duration = Duration::from_millis(50);
/// Time in which a kind of event has one line: a flickering sensor cannot fill the disk, and hides nothing of another kind.
const PERIOD_NS: u64 = 1_000_000_000;

/// Reports until `end`, including events that wait then.
pub fn run(events: &Receiver<Event>, names: &[String], progress: &AtomicU64, end: &StopFlag) {
    background_thread();
    let mut watchdog = Watchdog::from_env();
    let mut summary = Summary::default();
    let show = |(event, more): (Event, u64)| {
        let name = names.get(event.actuator as usize).map_or("?", String::as_str);
        write(name, &event);
        if more > 0 {
            tracing::info!(
                "{name}: the line above stands for {more} more events of its kind in the last second"
            );
        }
    };
    loop {
        let last = end.is_set();
        events.try_iter().filter_map(|event| summary.take(event)).for_each(show);
        summary.due(if last { u64::MAX } else { now_ns() }).for_each(show);
        watchdog.feed(progress.load(Ordering::Relaxed));
        if last {
            return;
        }
        end.pause(INTERVAL);
    }
}

/// What makes events one kind: that what happened is the same, to the same actuator. Counts and durations are no part of it.
type Kind = (u32, EventKind, u64);

fn kind_of(event: &Event) -> Kind {
    let is_what = match event.kind {
        EventKind::Outcome
        | EventKind::Regime
        | EventKind::ForceMismatch
        | EventKind::MarkerMismatch
        | EventKind::ObservableMismatch
        | EventKind::EstimateAlarm
        | EventKind::Snapped => event.value,
        _ => 0,
    };
    (event.actuator, event.kind, is_what)
}

/// Events of each kind since its last line.
#[derive(Debug, Default)]
struct Summary {
    kinds: BTreeMap<Kind, Counted>,
}

#[derive(Debug)]
struct Counted {
    shown_ns: u64,
    /// The last event that was not shown, and how many there were.
    last: Option<Event>,
    hidden: u64,
}

impl Summary {
    /// The event, if its kind has had no line for a period; otherwise it is counted. Numbers of lost readings are added up.
    fn take(&mut self, event: Event) -> Option<(Event, u64)> {
        let kind = self.kinds.entry(kind_of(&event));
        if let Entry::Vacant(free) = kind {
            free.insert(Counted { shown_ns: event.t_ns, last: None, hidden: 0 });
            return Some((event, 0));
        }
        kind.and_modify(|counted| {
            let before = counted.last.map_or(0, |last| last.value);
            let value = match event.kind {
                EventKind::Missed => event.value.saturating_add(before),
                _ => event.value,
            };
            counted.last = Some(Event { value, ..event });
            counted.hidden += 1;
        });
        None
    }

    /// Of each kind whose period is over, the last event and how many more there were. A kind without any is forgotten.
    fn due(&mut self, now_ns: u64) -> impl Iterator<Item = (Event, u64)> {
        let mut due = Vec::new();
        self.kinds.retain(|_, counted| {
            if now_ns.saturating_sub(counted.shown_ns) < PERIOD_NS {
                return true;
            }
            let Some(last) = counted.last.take() else { return false };
            due.push((last, std::mem::take(&mut counted.hidden) - 1));
            counted.shown_ns = now_ns;
            true
        });
        due.sort_by_key(|(event, _)| event.t_ns);
        due.into_iter()
    }
}

fn write(name: &str, event: &Event) {
    let ms = event.value as f64 / 1e6;
    match event.kind {
        EventKind::Outcome => match Outcome::from_code(event.value as u32) {
            Some(Outcome::Published) => tracing::info!("{name}: readings are published"),
            Some(outcome) => tracing::warn!("{name}: reading {outcome}"),
            None => tracing::warn!("{name}: reading ended with the unknown outcome {}", event.value),
        },
        EventKind::Regime => tracing::info!("{name}: regime {}", layout::regime::as_str(event.value as u32)),
        EventKind::Stale => tracing::warn!("{name}: stale, no good reading for {ms:.0} ms"),
        EventKind::Fresh => tracing::info!("{name}: fresh again after {ms:.0} ms"),
        EventKind::SensorStarted => tracing::info!("{name}: bridge started (run {:016x})", event.value),
        EventKind::Missed => tracing::warn!("{name}: {} readings never arrived", event.value),
        EventKind::ForceMismatch if event.value != 0 => {
            tracing::warn!(
                "{name}: MEASURED FORCE DIFFERS from the predicted one: a leak, a wrong gap, a torn chamber?"
            );
        }
        EventKind::ForceMismatch => tracing::info!("{name}: measured and predicted force agree again"),
        EventKind::MarkerMismatch if event.value != 0 => {
            tracing::warn!(
                "{name}: MEASURED MARKER DIFFERS from its predicted position: a wrong gap, a marker that slipped, a camera that moved?"
            );
        }
        EventKind::MarkerMismatch => tracing::info!("{name}: markers and predicted positions agree again"),
        EventKind::ObservableMismatch if event.value != 0 => {
            tracing::warn!(
                "{name}: MEASURED OBSERVABLE DIFFERS from its predicted value: a wrong gap, a sensor that slipped, its zero?"
            );
        }
        EventKind::ObservableMismatch => {
            tracing::info!("{name}: measured observables and predicted values agree again");
        }
        EventKind::EstimateAlarm if event.value != 0 => {
            tracing::warn!(
                "{name}: ESTIMATE ALARM: model and estimated quantities do not explain the readings; softtwin/{name}/estimate names the suspects"
            );
        }
        EventKind::EstimateAlarm => tracing::info!("{name}: the estimate explains the readings again"),
        EventKind::Snapped if event.value != 0 => {
            tracing::warn!("{name}: the pressure has passed a limit: the state is behind it");
        }
        EventKind::Snapped => {
            tracing::info!("{name}: the pressure has passed a limit: the state is on the first branch again")
        }
        EventKind::Outside => {
            let (by, input) = (f64::from_bits(event.value), layout::unpack_name(&event.input));
            let side = if by < 0.0 { "below the smallest" } else { "above the largest" };
            let what = match input.as_str() {
                "" => format!("the inputs together are {:.1} % of their range away", 100.0 * by),
                input => format!("{input} is {:.3e} {side} trained value", by.abs()),
            };
            tracing::warn!("{name}: outside the training range, without half-widths: {what}");
        }
        EventKind::Inside => tracing::info!("{name}: inside the training range again"),
        EventKind::ReceiveFailed => {
            tracing::error!(
                "{name}: reading the sensor topic failed {} times; see `softtwin doctor`",
                event.value
            );
        }
        EventKind::SendFailed => {
            tracing::error!(
                "{name}: shared memory refused {} times; `softtwin list --long` shows the programs that hold it",
                event.value
            );
        }
        EventKind::ReconstructionFailed => {
            tracing::error!(
                "{name}: the model gave no field {} times; the state is sent without it; `softtwin inspect` the model",
                event.value
            );
        }
        EventKind::WaitFailed => {
            tracing::error!("{name}: the wait for readings failed {} times", event.value)
        }
    }
}

#[cfg(test)]
#[path = "../tests/unit/reporter.rs"]
mod tests;
