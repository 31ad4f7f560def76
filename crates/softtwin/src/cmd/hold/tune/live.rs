//! The experiment on the valve.

use super::super::live::{Silence, VALID, WAITS, first, state_gap_mm};
use super::super::sensors::Sensors;
use super::experiment::Experiment;
use crate::live::Owner;
use anyhow::{Context, bail, ensure};
use control::held::Held;
use control::law::LONGEST_S;
use runtime::config::ActuatorSpec;
use std::sync::atomic::Ordering;
use train::actuation::ActuationCycle;
use wire::layout::valve_reason;
use wire::{Bus, StateReader, Topic, ValveReader, WakeSet, Wakeable, Waking};

/// The owner's name.
const OWNER: &str = "softtwin-tune";
/// Time after which the valve has to follow, s.
const FOLLOWS_S: f64 = 1.0;

/// Cycles of the experiment, and the gap; whatever ends it lets go of the valve.
pub(super) fn run(
    bus: &Bus,
    given_gap_mm: Option<f64>,
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
    let mut owner = Owner::new(bus, &Topic::setpoint(&spec.name)?.of_cavity(cavity)?, OWNER, VALID)?;
    let mut rows = Vec::new();
    let mut drive = || -> anyhow::Result<()> {
        let (mut begin_ns, mut time_s) = (None, 0.0);
        let mut silence = Silence::begin();
        while time_s < experiment.end_s() {
            ensure!(!stop.load(Ordering::Relaxed), "interrupted: the valve is let go, nothing is written");
            let Some(state) = states.newest()? else {
                silence.wait(&mut wake)?;
                continue;
            };
            if !silence.has_reading(&state)? || !sensors.take(&state)? {
                continue;
            }
            let before_s = time_s;
            time_s =
                state.t_sensor_ns.saturating_sub(*begin_ns.get_or_insert(state.t_sensor_ns)) as f64 * 1e-9;
            ensure!(
                time_s - before_s <= LONGEST_S,
                "no reading for {:.2} s: the valve may have closed meanwhile; let go, nothing is written",
                time_s - before_s
            );
            if let Some(valve) = valves.newest()?.filter(|_| time_s > FOLLOWS_S) {
                let reason = valve.valve_reason;
                if WAITS.contains(&reason) || reason == valve_reason::NO_SETPOINT {
                    bail!(
                        "the valve does not follow ({}): let go, nothing is written",
                        valve_reason::as_str(reason)
                    );
                }
            }
            let command_mpa = experiment.at(time_s);
            owner.send(command_mpa, state.t_sensor_ns)?;
            let (gauge_mpa, measured) = (sensors.pressure_mpa(&state), sensors.measured(&state));
            rows.push(ActuationCycle { time_s, command_mpa, gauge_mpa, measured });
        }
        Ok(())
    };
    let ended = drive();
    let released = owner.send(f64::NAN, 0);
    ended.and(released)?;
    Ok((rows, experiment, gap_mm))
}
