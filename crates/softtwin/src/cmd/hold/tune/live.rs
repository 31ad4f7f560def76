//! The experiment on the valve. Readings that come late, and the time-out that follows, are made up for by repeating the part; whatever else keeps
//! the valve from following ends it.

use super::super::sensors::Sensors;
use super::super::states::{Silence, first, state_gap_mm};
use crate::live::Owner;
use anyhow::{Context, bail, ensure};
use control::experiment::{Experiment, MOST_REPEATS, Progress};
use control::held::Held;
use control::law::LONGEST_S;
use runtime::config::ActuatorSpec;
use std::io::Write;
use std::sync::atomic::Ordering;
use std::time::Duration;
use train::actuation::ActuationCycle;
use wire::layout::{valve_interlock, valve_reason};
use wire::{Bus, StateReader, Topic, Valve, ValveReader, WakeSet, Wakeable, Waking};

/// The owner's name.
const OWNER: &str = "softtwin-tune";
/// Time after which the valve has to follow, also after a repeat, s.
const FOLLOWS_S: f64 = 1.0;

/// What keeps the valve from following.
enum Hindrance {
    /// A reading or a setpoint came late: the part is repeated.
    Late(String),
    /// Somebody or something closed the valve: why, and what to do.
    Closed(String),
}

/// Why a valve does not follow; `None` if it does.
fn hindrance(valve: &Valve) -> Option<Hindrance> {
    let names = || valve_interlock::names(valve.valve_interlock).collect::<Vec<_>>().join(", ");
    let late = valve_interlock::STALE | valve_interlock::NO_STATE;
    match valve.valve_reason {
        valve_reason::TIMEOUT => Some(Hindrance::Late("a setpoint came later than its validity".into())),
        valve_reason::INTERLOCK if valve.valve_interlock & !late == 0 => {
            Some(Hindrance::Late(format!("interlock {}: a state came late", names())))
        }
        valve_reason::INTERLOCK => Some(Hindrance::Closed(format!(
            "interlock {}; end its cause (docs/control.md#driving-a-valve; after `force`: `softtwin setpoint ACTUATOR --release`), then begin again",
            names()
        ))),
        valve_reason::OVERRIDE => Some(Hindrance::Closed(
            "an operator's override; end it with `softtwin setpoint ACTUATOR --release`, then begin again"
                .into(),
        )),
        valve_reason::DEVICE_ERROR => Some(Hindrance::Closed(
            "the device does not confirm what is written; `softtwin doctor` and the bridge's output say why"
                .into(),
        )),
        valve_reason::NO_SETPOINT => Some(Hindrance::Closed(
            "the bridge has no setpoint; is another domain or actuator driven?".into(),
        )),
        _ => None,
    }
}

/// The first hindrance since the last cycle. It takes all samples: a time-out may last for one only.
fn first_hindrance(valves: &ValveReader) -> anyhow::Result<Option<Hindrance>> {
    let mut found = None;
    while let Some(valve) = valves.next()? {
        found = found.or_else(|| hindrance(&valve));
    }
    Ok(found)
}

/// Why the step has to be repeated, if it has: the valve was late, or there was no reading for `silent_s`.
fn lateness(found: Option<Hindrance>, at_s: f64, silent_s: f64) -> anyhow::Result<Option<String>> {
    Ok(match found {
        Some(Hindrance::Closed(why)) => bail!(
            "{at_s:.1} s into the experiment the valve does not follow: {why}. It is let go, nothing is written"
        ),
        Some(Hindrance::Late(why)) => Some(why),
        None if silent_s > LONGEST_S => Some(format!("no reading for {silent_s:.2} s")),
        None => None,
    })
}

/// Cycles of the experiment, and the gap; whatever ends it lets go of the valve.
pub(super) fn run(
    bus: &Bus,
    given_gap_mm: Option<f64>,
    valid: Duration,
    spec: &ActuatorSpec,
    held: &Held,
    consent: impl FnOnce(&Experiment) -> anyhow::Result<()>,
) -> anyhow::Result<(Vec<ActuationCycle>, Experiment, f64)> {
    let states = StateReader::open(bus, &Topic::state(&spec.name)?)?;
    let mut wake = WakeSet::new([&states as &dyn Wakeable]);
    let begin = first(&states, &mut wake)?;
    let gap_mm = state_gap_mm(&begin, given_gap_mm, held).context(
        "the gap is unknown: the twin's states have none; give it to the scene (gap_mm), or --gap",
    )?;
    let mut model = held.model()?;
    model.set_inputs(&begin.inputs);
    let experiment = Experiment::of(held, &mut model, gap_mm);
    consent(&experiment)?;
    let stop = runtime::service::stop_flag().context("cannot listen for signals")?;
    let cavity = held.settings.cavity.as_deref();
    let valves = ValveReader::attach_as(bus, &Topic::valve(&spec.name)?.of_cavity(cavity)?, Waking::Never)?;
    let mut sensors = Sensors::open(bus, spec, held)?;
    let mut owner = Owner::new(bus, &Topic::setpoint(&spec.name)?.of_cavity(cavity)?, OWNER, valid)?;
    let mut rows: Vec<ActuationCycle> = Vec::new();
    let mut drive = || -> anyhow::Result<()> {
        let (mut begin_ns, mut elapsed_s, mut since_s) = (None, 0.0, 0.0);
        let mut progress = Progress::begin();
        let mut silence = Silence::begin();
        while progress.time_s(elapsed_s) < experiment.end_s() {
            ensure!(!stop.load(Ordering::Relaxed), "interrupted: the valve is let go, nothing is written");
            let Some(state) = states.newest()? else {
                silence.wait(&mut wake)?;
                continue;
            };
            if !silence.has_reading(&state)? || !sensors.take(&state)? {
                continue;
            }
            let before_s = elapsed_s;
            let begin_ns = *begin_ns.get_or_insert(state.t_sensor_ns);
            elapsed_s = state.t_sensor_ns.saturating_sub(begin_ns) as f64 * 1e-9;
            let at_s = progress.time_s(elapsed_s);
            let found = first_hindrance(&valves)?.filter(|_| elapsed_s - since_s > FOLLOWS_S);
            if let Some(why) = lateness(found, at_s, elapsed_s - before_s)? {
                let Some(from_s) = progress.repeat(&experiment, elapsed_s) else {
                    bail!(
                        "{at_s:.1} s into the experiment: {why}, after {MOST_REPEATS} repeats. The valve is let go, nothing is written. Give twin, bridge and \
                         this program a priority (`chrt -f 50`), or setpoints more time: --valid-ms, now {:.0}",
                        1e3 * valid.as_secs_f64()
                    );
                };
                // A closed error stream is no reason to let go of the valve.
                let _ = writeln!(std::io::stderr(), "{at_s:.1} s: {why}; the step is repeated");
                rows.retain(|row| row.time_s < from_s);
                since_s = elapsed_s;
            }
            let time_s = progress.time_s(elapsed_s);
            let command_mpa = experiment.at(time_s);
            owner.send(command_mpa, state.t_sensor_ns)?;
            let (gauge_mpa, measured) = (sensors.pressure_mpa(&state), sensors.measured(&state));
            if progress.counts(time_s) {
                rows.push(ActuationCycle { time_s, command_mpa, gauge_mpa, measured });
            }
        }
        Ok(())
    };
    let ended = drive();
    let released = owner.send(f64::NAN, 0);
    ended.and(released)?;
    Ok((rows, experiment, gap_mm))
}
