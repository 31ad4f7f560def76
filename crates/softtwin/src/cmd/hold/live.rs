//! The loop on the actuator: a setpoint for each state of the twin.

use super::args::Args;
use super::goal::Goal;
use super::held::refuse_out_of_reach;
use super::sensors::{Sensors, driven_mpa};
use super::states::{Silence, first, state_gap_mm};
use super::tally::Tally;
use crate::live::Owner;
use crate::report;
use anyhow::{Context, bail, ensure};
use control::held::Held;
use control::inverse::Model;
use control::law::{Controller, Cycle, Reading};
use control::twin_model::{OUT_OF_REACH_MM, TwinModel};
use runtime::config::ActuatorSpec;
use serde_json::Value;
use std::io::Write;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use wire::layout::{flags, unpack_name, valve_interlock, valve_reason};
use wire::{Bus, State, StateReader, TargetReader, Topic, Valve, ValveReader, WakeSet, Wakeable, Waking};

/// Validity of each setpoint.
pub(super) const VALID: Duration = Duration::from_millis(50);
/// Most states that are answered before the newest is taken.
const MOST_IN_A_ROW: u32 = 16;
/// Reasons for which the valve does not follow, and the controller waits.
pub(super) const WAITS: [u32; 4] =
    [valve_reason::OVERRIDE, valve_reason::INTERLOCK, valve_reason::TIMEOUT, valve_reason::DEVICE_ERROR];

/// Holds until the time is over, a signal comes or a fault ends it; then the valve is let go.
pub(super) fn run(args: &Args, spec: &ActuatorSpec, held: Held, goal: Option<Goal>) -> anyhow::Result<()> {
    let bus = args.domain.join()?;
    let states = StateReader::open(&bus, &Topic::state(&spec.name)?)?;
    let mut wake = WakeSet::new([&states as &dyn Wakeable]);
    let first = first(&states, &mut wake)?;
    let mut model = held.model()?;
    model.set_inputs(&first.inputs);
    let gap_mm = state_gap_mm(&first, args.gap_mm, &held).context(
        "the gap is unknown: the twin's states have none; give it to the scene (gap_mm), or --gap",
    )?;
    let pressure_mpa = driven_mpa(&first, &held);
    let present = held.quantity.of(&model.at(pressure_mpa, gap_mm), pressure_mpa).0;
    let goal = goal.unwrap_or_else(|| Goal::step(present));
    refuse_out_of_reach(&held, &mut model, goal.values(), gap_mm)?;
    let mut held_loop = Loop::new(&bus, args, spec, held, model, goal)?;
    let ended = held_loop.run(&states, &mut wake);
    let released = held_loop.owner.send(f64::NAN, 0);
    report::print(&held_loop.report(), args.json)?;
    ended.and(released)
}

/// State of the loop.
struct Loop<'a> {
    args: &'a Args,
    actuator: &'a str,
    held: Held,
    controller: Controller<TwinModel>,
    sensors: Sensors,
    valves: ValveReader,
    targets: TargetReader,
    goal: Goal,
    /// Model for what is in reach, and the gap of the last state.
    reach: (TwinModel, f64),
    owner: Owner,
    valve: Option<Valve>,
    /// The valve did not follow at some time since the last cycle.
    has_closed: bool,
    last_ns: Option<u64>,
    cycle: Cycle,
    /// The last setpoint that the device confirmed.
    written_seq: u64,
    tally: Tally,
}

impl<'a> Loop<'a> {
    fn new(
        bus: &Bus,
        args: &'a Args,
        spec: &'a ActuatorSpec,
        held: Held,
        model: TwinModel,
        goal: Goal,
    ) -> anyhow::Result<Self> {
        let cavity = held.settings.cavity.as_deref();
        Ok(Self {
            args,
            actuator: &spec.name,
            controller: Controller::new(model, held.quantity, held.settings.clone(), held.limits),
            targets: TargetReader::attach_as(bus, &Topic::target(&spec.name)?, Waking::Never)?,
            goal,
            reach: (held.model()?, OUT_OF_REACH_MM),
            sensors: Sensors::open(bus, spec, &held)?,
            valves: ValveReader::attach_as(
                bus,
                &Topic::valve(&spec.name)?.of_cavity(cavity)?,
                Waking::Never,
            )?,
            owner: Owner::new(bus, &Topic::setpoint(&spec.name)?.of_cavity(cavity)?, &args.owner, VALID)?,
            held,
            valve: None,
            has_closed: false,
            last_ns: None,
            cycle: Cycle::default(),
            written_seq: 0,
            tally: Tally::new(),
        })
    }

    fn run(&mut self, states: &StateReader, wake: &mut WakeSet) -> anyhow::Result<()> {
        let stop = runtime::service::stop_flag().context("cannot listen for signals")?;
        let (begin, seconds) = (Instant::now(), self.args.seconds(&self.goal));
        let (mut waiting, mut in_a_row) = (None, 0);
        let mut silence = Silence::begin();
        while begin.elapsed().as_secs_f64() < seconds && !stop.load(Ordering::Relaxed) {
            let Some(state) = waiting.take().map_or_else(|| states.next(), |state| Ok(Some(state)))? else {
                silence.wait(wake)?;
                continue;
            };
            waiting = states.next()?;
            if !silence.has_reading(&state)? {
                // The setpoint expires.
                continue;
            }
            self.refuse_tripped()?;
            self.refuse_alarm(&state)?;
            let is_answered = self.answer(&state, begin.elapsed().as_secs_f64())?;
            // Each state has its control cycle, and the valve gets the command of the newest one. A loop slower than its states leaves
            // some out.
            in_a_row += 1;
            if waiting.is_none() || in_a_row == MOST_IN_A_ROW {
                if is_answered {
                    self.send(&state)?;
                }
                in_a_row = 0;
                waiting = states.newest()?.or(waiting);
            }
        }
        Ok(())
    }

    /// The bridge has closed because of the force: it stays closed until it is released by name.
    fn refuse_tripped(&mut self) -> anyhow::Result<()> {
        // All samples: the first that confirms a setpoint counts, not its renewals.
        while let Some(status) = self.valves.next()? {
            if status.setpoint_boot_id == self.owner.boot_id && status.setpoint_seq > self.written_seq {
                self.written_seq = status.setpoint_seq;
                self.tally.written.record_ns(status.t_written_ns.saturating_sub(status.t_sensor_ns));
            }
            self.has_closed |= WAITS.contains(&status.valve_reason);
            self.valve = Some(status);
        }
        let status = self.valve.unwrap_or_default();
        ensure!(
            status.valve_interlock & valve_interlock::FORCE == 0,
            "the valve has closed: the force was beyond its limit; find out why, then release it with `softtwin setpoint {} --release`",
            self.actuator
        );
        Ok(())
    }

    /// Without a sensor of the quantity the twin is what is controlled: it has to explain its readings.
    fn refuse_alarm(&self, state: &State) -> anyhow::Result<()> {
        ensure!(
            state.flags & flags::ESTIMATE_ALARM == 0 || self.tally.is_measured(),
            "estimate-alarm: the twin does not explain its readings, and no sensor measures the quantity; `softtwin echo {}` names the suspects",
            Topic::estimate(self.actuator)?
        );
        Ok(())
    }

    /// One control cycle; false without the gap or the reading behind the state: the setpoint expires.
    fn answer(&mut self, state: &State, since_s: f64) -> anyhow::Result<bool> {
        let elapsed_ns = self.last_ns.map_or(0, |before| state.t_sensor_ns.saturating_sub(before));
        self.last_ns = Some(state.t_sensor_ns);
        let has_reading = self.sensors.take(state)?;
        let Some(gap_mm) = state_gap_mm(state, self.args.gap_mm, &self.held).filter(|_| has_reading) else {
            return Ok(false);
        };
        let seen = self.sensors.measured(state);
        let status = self.valve.unwrap_or_default();
        let reading = Reading {
            pressure_mpa: self.sensors.pressure_mpa(state),
            gap_mm,
            measured: seen,
            written_mpa: if status.valve_limit == 0 { f64::NAN } else { status.pressure_mpa },
        };
        self.controller.model_mut().set_inputs(&state.inputs);
        if std::mem::replace(&mut self.has_closed, WAITS.contains(&status.valve_reason)) {
            self.controller.start(reading);
        }
        let dt_s = elapsed_ns as f64 * 1e-9;
        self.reach.0.set_inputs(&state.inputs);
        self.reach.1 = gap_mm;
        self.take_target(since_s)?;
        let goal = &self.goal;
        self.cycle = self.controller.update(&|ahead_s| goal.at(since_s + ahead_s), reading, dt_s);
        if let Some(fault) = self.cycle.fault {
            bail!("{}: {}", fault.name(), fault.advice());
        }
        self.tally.say_what_is_new(&self.cycle, &self.held);
        self.tally.take_cycle(&self.cycle, seen);
        Ok(true)
    }

    /// The command of the cycle of this state as a setpoint.
    fn send(&mut self, state: &State) -> anyhow::Result<()> {
        self.owner.send(self.cycle.pressure_mpa, state.t_sensor_ns)?;
        self.tally.take_answered(state);
        Ok(())
    }

    /// The newest target of the bus; one that is not valid or out of reach is refused, and the one before stays.
    fn take_target(&mut self, since_s: f64) -> anyhow::Result<()> {
        let Some(sample) = self.targets.newest()? else { return Ok(()) };
        let present = self.goal.at(since_s).value;
        let (model, gap_mm) = &mut self.reach;
        let taken = Goal::of_sample(&sample, since_s, present).and_then(|goal| {
            let reach = refuse_out_of_reach(&self.held, model, goal.values(), *gap_mm);
            reach.map(|()| goal).map_err(|error| error.to_string())
        });
        match taken {
            Ok(goal) => self.goal = goal,
            Err(reason) => {
                let owner = unpack_name(&sample.owner);
                // A closed error stream is no reason to let go of the valve.
                let _ = writeln!(std::io::stderr(), "target {} of `{owner}` refused: {reason}", sample.seq);
            }
        }
        Ok(())
    }

    fn report(&self) -> Value {
        self.tally.report(&self.held, &self.goal, &self.cycle, &self.sensors.name, self.owner.seq)
    }
}
