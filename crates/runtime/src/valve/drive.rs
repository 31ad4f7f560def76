//! The thread of a valve: at each setpoint or override, and at least at a fixed rate, it takes setpoint, override and state, decides, writes, and
//! publishes what it did.

use super::decide::{Decision, Governor, Trip};
use super::device::Device;
use super::spec::ValveSpec;
use crate::source::{Devices, ModbusConnection, ModbusPath};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::{Duration, Instant};
use wire::layout::{valve_interlock, valve_reason};
use wire::thread_group::{StopFlag, ThreadGroup};
use wire::{
    Bus, Domain, Setpoint, SetpointReader, State, StateReader, Topic, Valve, ValveWriter, Wake, WakeSet,
    Wakeable, Waking, WireError, boot_id, now_ns,
};

/// Counters of a valve; readable from other threads.
#[derive(Debug, Default)]
pub struct ValveCounters {
    /// Writes that the device has confirmed.
    pub writes: AtomicU64,
    /// Writes that have failed.
    pub failures: AtomicU64,
    /// Times that the setpoint was not renewed in its time.
    pub timeouts: AtomicU64,
    /// Times that an interlock has closed.
    pub interlocks: AtomicU64,
    /// Why it has its value: one of `wire::layout::valve_reason`.
    pub reason: AtomicU32,
}

impl ValveCounters {
    /// All counts with their names.
    pub fn all(&self) -> [(&'static str, u64); 4] {
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        [
            ("write", count(&self.writes)),
            ("failure", count(&self.failures)),
            ("timeout", count(&self.timeouts)),
            ("interlock", count(&self.interlocks)),
        ]
    }
}

/// Why the valves cannot be driven.
#[derive(Debug, thiserror::Error)]
pub enum ValveError {
    #[error(transparent)]
    Wire(#[from] WireError),
    /// The system refuses a thread, or what its device needs.
    #[error("no thread for {valve}: {cause}")]
    Thread { valve: Topic, cause: std::io::Error },
}

/// Valves by their topics.
pub type Valves = Vec<(Topic, Arc<ValveCounters>)>;

/// A valve with its way to the device.
#[derive(Debug)]
pub struct OpenValve {
    topic: Topic,
    spec: ValveSpec,
    /// Where the device is on Modbus.
    modbus: Option<ModbusConnection>,
}

/// Takes the connections of valves on Modbus among the device paths of a scene, before any of them starts.
///
/// # Errors
/// Messages about a path that a sensor or another valve uses otherwise.
pub fn open(topic: &Topic, spec: &ValveSpec, devices: &Devices) -> Result<OpenValve, Vec<String>> {
    let path = spec.modbus.as_ref();
    let path = path.and_then(|modbus| ModbusPath::new(modbus.tcp.as_deref(), modbus.serial.as_ref()));
    let modbus = path.map(|path| devices.modbus(&path)).transpose();
    let modbus =
        modbus.map_err(|problem| vec![format!("{}.modbus: {problem}", ValveSpec::key(topic.cavity()))])?;
    Ok(OpenValve { topic: topic.clone(), spec: spec.clone(), modbus })
}

/// Starts a thread for each valve and returns when all have their topics. A thread that is asked to end writes the safe value.
///
/// # Errors
/// [`WireError::AlreadyPublished`] when another bridge drives one of them, other refusals of the wire, [`ValveError::Thread`].
pub fn start(group: &mut ThreadGroup, domain: &Domain, valves: Vec<OpenValve>) -> Result<Valves, ValveError> {
    let mut started = Valves::new();
    let mut trips: BTreeMap<String, Arc<Trip>> = BTreeMap::new();
    for OpenValve { topic, spec, modbus } in valves {
        let counters = Arc::<ValveCounters>::default();
        let (opened, result) = sync_channel(1);
        let trip = trips.entry(topic.actuator().to_owned()).or_default().clone();
        let (valve, counted, domain) = (topic.clone(), counters.clone(), domain.clone());
        let open =
            move || Drive::open(&valve, &spec, modbus, &domain, trip).map(|drive| (drive, spec.write_hz));
        group
            .start("valve", move |end| run(open, &counted, opened, end))
            .map_err(|cause| ValveError::Thread { valve: topic.clone(), cause })?;
        // A thread that panics drops its end: the group names it.
        result.recv().unwrap_or(Ok(()))?;
        started.push((topic, counters));
    }
    Ok(started)
}

fn run(
    open: impl FnOnce() -> Result<(Drive, f64), ValveError>,
    counters: &ValveCounters,
    opened: SyncSender<Result<(), ValveError>>,
    end: &StopFlag,
) -> wire::thread_group::ThreadResult {
    let (mut drive, write_hz) = match open() {
        Ok(opened) => opened,
        Err(error) => {
            // The starter gets the error and ends the group.
            let _starter_is_gone = opened.send(Err(error));
            end.pause(Duration::MAX);
            return Ok(());
        }
    };
    let _starter_is_gone = opened.send(Ok(()));
    let period = Duration::from_secs_f64(1.0 / write_hz);
    let mut wake = WakeSet::new([&drive.setpoints as &dyn Wakeable, &drive.overrides]);
    let mut answered = Instant::now();
    while !end.is_set() {
        drive.turn(counters)?;
        // A slow device is written to as fast as it answers; missed writes are not made up for.
        let due = Instant::now() + period;
        while !end.is_set() {
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            if wake.wait(left.min(END_POLL))? == Wake::Event {
                end.pause((answered + period / 2).saturating_duration_since(Instant::now()));
                answered = Instant::now();
                break;
            }
        }
    }
    drive.close(counters)
}

/// Longest delay of the end of a valve's thread.
const END_POLL: Duration = Duration::from_millis(100);

/// State of one valve's thread.
struct Drive {
    topic: Topic,
    safe_mpa: f64,
    device: Option<Device>,
    governor: Governor,
    setpoints: SetpointReader,
    overrides: SetpointReader,
    states: StateReader,
    output: ValveWriter,
    setpoint: Option<Setpoint>,
    operator: Option<Setpoint>,
    state: Option<State>,
    sample: Valve,
    error: Option<String>,
}

impl Drive {
    fn open(
        topic: &Topic,
        spec: &ValveSpec,
        modbus: Option<ModbusConnection>,
        domain: &Domain,
        trip: Arc<Trip>,
    ) -> Result<Self, ValveError> {
        let bus = Bus::open(domain)?;
        // First: a second bridge is refused before it writes anything.
        let output = ValveWriter::create(&bus, topic)?;
        let refused = |cause| ValveError::Thread { valve: topic.clone(), cause };
        let (actuator, cavity) = (topic.actuator(), topic.cavity());
        Ok(Self {
            topic: topic.clone(),
            safe_mpa: spec.safe_mpa,
            device: Device::new(spec, modbus).map_err(refused)?,
            governor: Governor::new(spec, now_ns(), trip),
            setpoints: SetpointReader::attach(&bus, &Topic::setpoint(actuator)?.of_cavity(cavity)?)?,
            overrides: SetpointReader::attach(&bus, &Topic::operator(actuator)?.of_cavity(cavity)?)?,
            states: StateReader::attach_as(&bus, &Topic::state(actuator)?, Waking::Never)?,
            output,
            setpoint: None,
            operator: None,
            state: None,
            sample: Valve { boot_id: boot_id(), safe_mpa: spec.safe_mpa, ..Valve::default() },
            error: None,
        })
    }

    fn turn(&mut self, counters: &ValveCounters) -> wire::thread_group::ThreadResult {
        self.setpoint = self.setpoints.newest()?.or(self.setpoint);
        self.operator = self.overrides.newest()?.or(self.operator);
        self.state = self.states.newest()?.or(self.state);
        let (setpoint, operator, state) =
            (self.setpoint.as_ref(), self.operator.as_ref(), self.state.as_ref());
        let decision = self.governor.decide(now_ns(), setpoint, operator, state);
        self.write(decision, counters)
    }

    /// The safe value, whatever the device says to it.
    fn close(&mut self, counters: &ValveCounters) -> wire::thread_group::ThreadResult {
        let (reason, wanted_mpa) = (valve_reason::NO_SETPOINT, f64::NAN);
        let pressure_mpa = self.safe_mpa;
        self.write(Decision { pressure_mpa, wanted_mpa, reason, interlock: 0, limit: 0 }, counters)
    }

    fn write(&mut self, decision: Decision, counters: &ValveCounters) -> wire::thread_group::ThreadResult {
        let written = self.device.as_mut().map_or(Ok(()), |device| device.write(decision.pressure_mpa));
        let before = (self.sample.valve_reason, self.sample.valve_interlock);
        let reason = if written.is_ok() { decision.reason } else { valve_reason::DEVICE_ERROR };
        let owner = match decision.reason {
            valve_reason::OVERRIDE => self.operator,
            _ => self.setpoint,
        };
        let owner = owner.unwrap_or_default();
        let sample = &mut self.sample;
        sample.seq += 1;
        (sample.t_sensor_ns, sample.t_publish_ns) = (owner.t_sensor_ns, now_ns());
        (sample.pressure_mpa, sample.wanted_mpa) = (decision.pressure_mpa, decision.wanted_mpa);
        (sample.valve_reason, sample.valve_interlock) = (reason, decision.interlock);
        sample.valve_limit = decision.limit;
        (sample.setpoint_boot_id, sample.setpoint_seq) = (owner.boot_id, owner.seq);
        sample.owner = owner.owner;
        if written.is_ok() {
            sample.t_written_ns = sample.t_publish_ns;
            sample.writes += 1;
        } else {
            self.governor.failed(sample.t_publish_ns);
            sample.failures += 1;
        }
        let begins = |cause: u32| u64::from(reason == cause && before.0 != cause);
        sample.timeouts += begins(valve_reason::TIMEOUT);
        sample.interlocks += u64::from(decision.interlock & !before.1 != 0);
        counters.writes.store(sample.writes, Ordering::Relaxed);
        counters.failures.store(sample.failures, Ordering::Relaxed);
        counters.timeouts.store(sample.timeouts, Ordering::Relaxed);
        counters.interlocks.store(sample.interlocks, Ordering::Relaxed);
        counters.reason.store(reason, Ordering::Relaxed);
        let sample = *sample;
        self.output.publish(sample)?;
        self.log(before, &sample, written.err());
        Ok(())
    }

    /// One line for each change.
    fn log(&mut self, before: (u32, u32), now: &Valve, error: Option<String>) {
        let valve = &self.topic;
        if error.is_some() && error != self.error {
            tracing::warn!("{valve}: {}", error.as_deref().unwrap_or_default());
        }
        self.error = error;
        if before != (now.valve_reason, now.valve_interlock) {
            let interlocks: Vec<&str> = valve_interlock::names(now.valve_interlock).collect();
            let names =
                if interlocks.is_empty() { String::new() } else { format!(" ({})", interlocks.join(", ")) };
            let reason = valve_reason::as_str(now.valve_reason);
            tracing::info!("{valve}: {reason}{names}, {} MPa", now.pressure_mpa);
        }
    }
}
