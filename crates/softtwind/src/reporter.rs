//! Thread that logs the events of the twin's loop and feeds the watchdog.

use runtime::service::Watchdog;
use runtime::thread_group::StopFlag;
use runtime::twin::{Event, EventKind};
use runtime::wire::{Outcome, background_thread, layout};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;

/// Interval of the reporter.
const INTERVAL: Duration = Duration::from_millis(50);
/// Largest number of lines per interval; further events are counted in one line, so that a flickering sensor cannot fill the disk.
const LINES_MAX: usize = 20;

/// Reports until `end`, including events that wait then.
pub fn run(events: &Receiver<Event>, names: &[String], progress: &AtomicU64, end: &StopFlag) {
    background_thread();
    let mut watchdog = Watchdog::from_env();
    loop {
        let last = end.is_set();
        let mut unwritten = 0;
        let mut written = 0;
        for event in events.try_iter() {
            let name = names.get(event.actuator as usize).map_or("?", String::as_str);
            if written < LINES_MAX {
                write(name, &event);
                written += 1;
            } else {
                unwritten += 1;
            }
        }
        if unwritten > 0 {
            tracing::warn!("{unwritten} more events within {} ms are not shown", INTERVAL.as_millis());
        }
        watchdog.feed(progress.load(Ordering::Relaxed));
        if last {
            return;
        }
        end.pause(INTERVAL);
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
