//! The shared-memory bus: the same domains, rights, locks and waiting as of the programs.

use crate::errors::{AlreadyPublished, SofttwinError, TwinAbsent, TwinSilent, VersionMismatch};
use crate::layout::parsed;
use crate::refused;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::mem::ManuallyDrop;
use std::os::fd::{AsRawFd, OwnedFd};
use std::sync::Arc;
use std::time::{Duration, Instant};
use wire::layout::{Payload, TARGET_VALUES_MAX, pack_name, target_kind};
use wire::{
    AnswerSample, AnyReader, AnySample, Arrival, Arrivals, Command, CommandWriter, Domain, FieldSample,
    Query, QueryClient, SensorSample, SensorWriter, Setpoint, SetpointWriter, Target, TargetWriter, Topic,
    TopicKind, WakeSet, Waking, WireError, boot_id,
};

/// Longest single wait, so that a signal's handler runs also where another thread took the signal.
const LONGEST_WAIT: Duration = Duration::from_millis(200);
/// Longest name of an owner or an input, bytes.
const NAME_BYTES: usize = 31;

/// The wire's clock: ns of the machine's monotonic clock, the same in every process.
#[pyfunction]
pub fn now_ns() -> u64 {
    wire::now_ns()
}

fn failed(error: WireError) -> PyErr {
    let text = error.to_string();
    match error {
        WireError::NoSuchTopic { .. } | WireError::NobodyAnswers { .. } => TwinAbsent::new_err(text),
        WireError::Incompatible { .. } => VersionMismatch::new_err(text),
        WireError::AlreadyPublished { .. } => AlreadyPublished::new_err(text),
        WireError::NoAnswer { .. } => TwinSilent::new_err(text),
        WireError::BadName { .. } | WireError::BadDomain { .. } | WireError::LongDomain { .. } => {
            refused(text)
        }
        _ => SofttwinError::new_err(text),
    }
}

/// What a process opened in the shared memory. After a fork it stays the parent's: the child can neither use nor close it.
struct Opened<T> {
    inner: ManuallyDrop<T>,
    process: u32,
}

// SAFETY: `T` may not be used by two threads at the same time. It is reached through `get` and `get_mut` and dropped, all of which a
// thread does while it is attached to the interpreter; this module is built for interpreters with one lock (abi3), which one thread
// holds at a time, and no function lets go of the lock while it holds a reference that `get` or `get_mut` gave.
unsafe impl<T> Send for Opened<T> {}
// SAFETY: as above.
unsafe impl<T> Sync for Opened<T> {}

impl<T> Opened<T> {
    fn new(inner: T) -> Self {
        Self { inner: ManuallyDrop::new(inner), process: std::process::id() }
    }

    fn check(&self) -> PyResult<()> {
        if self.process == std::process::id() {
            return Ok(());
        }
        let text = format!("opened by process {}, before a fork; open it in this process", self.process);
        Err(SofttwinError::new_err(text))
    }

    fn get(&self, _attached: Python<'_>) -> PyResult<&T> {
        self.check()?;
        Ok(&self.inner)
    }

    fn get_mut(&mut self, _attached: Python<'_>) -> PyResult<&mut T> {
        self.check()?;
        Ok(&mut self.inner)
    }
}

impl<T> Drop for Opened<T> {
    fn drop(&mut self) {
        if self.process == std::process::id() {
            // SAFETY: dropped once, and not used afterwards.
            unsafe { ManuallyDrop::drop(&mut self.inner) }
        }
    }
}

/// Sleeps, without the interpreter's lock, until the descriptor is readable, a signal came or the time is over.
fn sleep(py: Python<'_>, descriptor: &OwnedFd, limit: Duration) -> PyResult<()> {
    let mut poll = libc::pollfd { fd: descriptor.as_raw_fd(), events: libc::POLLIN, revents: 0 };
    let limit_ms = limit.min(LONGEST_WAIT).as_micros().div_ceil(1000) as i32;
    // SAFETY: one structure of ours that lives across the call; an early end is a wake-up without a sample.
    py.detach(|| unsafe { libc::poll(&mut poll, 1, limit_ms) });
    py.check_signals()
}

/// A program's place in a shared-memory domain.
#[pyclass(module = "softtwin._native")]
pub struct Bus {
    bus: Opened<wire::Bus>,
}

#[pymethods]
impl Bus {
    /// Joins a domain: its name and folder, by default those of the environment.
    #[new]
    fn new(domain: Option<&str>, root: Option<&str>) -> PyResult<Self> {
        let bus = wire::Bus::open(&Domain::given(domain, root)).map_err(failed)?;
        Ok(Self { bus: Opened::new(bus) })
    }

    /// Folder of the management files.
    #[getter]
    fn folder(&self, py: Python<'_>) -> PyResult<std::path::PathBuf> {
        Ok(self.bus.get(py)?.folder())
    }

    /// A reader of a topic, which need not exist yet if `wait_for_twin`.
    fn reader(&self, py: Python<'_>, topic: &str, wait_for_twin: bool) -> PyResult<Reader> {
        let (bus, topic) = (self.bus.get(py)?, parsed(topic)?);
        let reader = match wait_for_twin {
            true => AnyReader::attach_as(bus, &topic, Waking::ByEvent),
            false => AnyReader::open(bus, &topic),
        };
        let reader = reader.map_err(failed)?;
        let wake = WakeSet::new([&reader as &dyn wire::Wakeable]);
        let descriptor = Arc::new(wake.descriptor().map_err(failed)?);
        let port = Opened::new((reader, wake));
        Ok(Reader { port, descriptor, arrivals: None, lost: 0, restarts: 0 })
    }

    /// The one writer of a topic: readings and commands, and under the owner's name setpoints and targets.
    fn writer(&self, py: Python<'_>, topic: &str, owner: &str) -> PyResult<Writer> {
        let (bus, topic) = (self.bus.get(py)?, parsed(topic)?);
        let is_name = (1..=NAME_BYTES).contains(&owner.len()) && !owner.contains(char::is_control);
        if !is_name && matches!(topic.kind(), TopicKind::Setpoint | TopicKind::Target) {
            return Err(refused(format!(
                "expected an owner's name of 1 to {NAME_BYTES} bytes, such as `my-controller`, found {owner:?}"
            )));
        }
        let port = match topic.kind() {
            TopicKind::Sensor => SensorWriter::create(bus, &topic).map(Port::Sensor),
            TopicKind::Command => CommandWriter::create(bus, &topic).map(Port::Command),
            TopicKind::Setpoint => SetpointWriter::create_named(bus, &topic, owner).map(Port::Setpoint),
            TopicKind::Target => TargetWriter::create_named(bus, &topic, owner).map(Port::Target),
            _ => return Err(refused(format!("{topic} is the twin's own"))),
        };
        let port = Opened::new(port.map_err(failed)?);
        Ok(Writer { port, owner: pack_name(owner), boot_id: boot_id(), seq: 0 })
    }

    /// One that asks the twin of an actuator.
    fn client(&self, py: Python<'_>, actuator: &str) -> PyResult<Client> {
        let client = QueryClient::open(self.bus.get(py)?, actuator).map_err(failed)?;
        let descriptor = client.descriptor().map_err(failed)?;
        Ok(Client { client: Opened::new(client), descriptor })
    }

    /// Names of the domain's topics.
    fn topics(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let everything = wire::KeyExpr::new("**").map_err(refused)?;
        let topics = self.bus.get(py)?.names(&everything).map_err(failed)?;
        Ok(topics.iter().map(|topic: &Topic| topic.name().to_owned()).collect())
    }
}

/// A field in shared memory, unchanged while this lives. numpy reads `__array_interface__` and keeps the object.
#[pyclass(frozen, module = "softtwin._native")]
pub struct Sample {
    held: Opened<Held>,
    shape: (usize, usize),
}

enum Held {
    Field(FieldSample),
    Answer(AnswerSample),
}

impl Sample {
    fn of_field(field: FieldSample) -> Self {
        let shape = (field.header().field_count as usize, field.header().node_count as usize);
        Self { held: Opened::new(Held::Field(field)), shape }
    }

    fn of_answer(answer: AnswerSample) -> Self {
        let header = answer.answer();
        let shape = (header.field_count as usize, header.node_count as usize);
        let shape = if answer.values().is_empty() { (0, 0) } else { shape };
        Self { held: Opened::new(Held::Answer(answer)), shape }
    }
}

#[pymethods]
impl Sample {
    #[getter]
    fn __array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let values = match self.held.get(py)? {
            Held::Field(field) => field.values(),
            Held::Answer(answer) => answer.values(),
        };
        let interface = PyDict::new(py);
        interface.set_item("version", 3)?;
        interface.set_item("typestr", "<f4")?;
        interface.set_item("shape", self.shape)?;
        // Read-only: the pages are mapped so.
        interface.set_item("data", (values.as_ptr() as usize, true))?;
        Ok(interface)
    }
}

/// The bytes of a payload or of a field's header, the field, and whether the sender has restarted.
type Received<'py> = (Bound<'py, PyBytes>, Option<Sample>, bool);

/// A reader of one topic.
#[pyclass(module = "softtwin._native")]
pub struct Reader {
    port: Opened<(AnyReader, WakeSet)>,
    descriptor: Arc<OwnedFd>,
    /// The run of the sender and its numbers that came.
    arrivals: Option<(u64, Arrivals)>,
    #[pyo3(get)]
    lost: i64,
    #[pyo3(get)]
    restarts: u64,
}

impl Reader {
    /// Notes a sample; true if its sender has restarted.
    fn count(&mut self, sample: &AnySample) -> bool {
        let stamp = sample.stamp();
        let restarted = match &mut self.arrivals {
            Some((run, arrivals)) if *run == stamp.boot_id => {
                let arrival: Arrival = arrivals.take(stamp.seq);
                self.lost = self.lost.saturating_add(arrival.lost());
                return false;
            }
            arrivals => arrivals.replace((stamp.boot_id, Arrivals::new(stamp.seq))).is_some(),
        };
        self.restarts += u64::from(restarted);
        restarted
    }
}

#[pymethods]
impl Reader {
    /// The oldest waiting sample, or `None`. Never waits.
    fn try_next<'py>(&mut self, py: Python<'py>) -> PyResult<Option<Received<'py>>> {
        let Some(sample) = self.port.get(py)?.0.next().map_err(failed)? else { return Ok(None) };
        let restarted = self.count(&sample);
        let bytes = PyBytes::new(py, sample.view().bytes);
        let field = match sample {
            AnySample::Field(field) => Some(Sample::of_field(field)),
            _ => None,
        };
        Ok(Some((bytes, field, restarted)))
    }

    /// Waits for an event, at most `limit_s` and at most a fifth of a second; handlers of signals run before it returns.
    fn wait(slf: &Bound<'_, Self>, limit_s: f64) -> PyResult<()> {
        let py = slf.py();
        slf.borrow().port.check()?;
        let descriptor = slf.borrow().descriptor.clone();
        sleep(py, &descriptor, Duration::try_from_secs_f64(limit_s).unwrap_or_default())?;
        slf.borrow_mut().port.get_mut(py)?.1.wait(Duration::ZERO).map_err(failed)?;
        Ok(())
    }
}

enum Port {
    Sensor(SensorWriter),
    Command(CommandWriter),
    Setpoint(SetpointWriter),
    Target(TargetWriter),
}

/// The port of a kind, if the writer is of that kind.
macro_rules! port {
    ($kind:ident) => {
        |port| match port {
            Port::$kind(writer) => Some(writer),
            _ => None,
        }
    };
}

/// The one writer of a topic.
#[pyclass(module = "softtwin._native")]
pub struct Writer {
    port: Opened<Port>,
    owner: [u8; 32],
    boot_id: u64,
    seq: u64,
}

impl Writer {
    /// Sends what `payload` makes of the writer's run and the next number, which it returns.
    fn send<P>(
        &mut self,
        py: Python<'_>,
        port: fn(&mut Port) -> Option<&mut wire::Writer<P>>,
        payload: impl FnOnce(u64, u64, [u8; 32]) -> P,
    ) -> PyResult<u64>
    where
        P: Payload,
    {
        let port = port(self.port.get_mut(py)?);
        let port = port.ok_or_else(|| refused("this writer is one of another kind of topic"))?;
        let seq = self.seq + 1;
        port.publish(payload(self.boot_id, seq, self.owner)).map_err(failed)?;
        self.seq = seq;
        Ok(seq)
    }
}

#[pymethods]
impl Writer {
    /// Sends a reading, stamped now if `t_sensor_ns` is `None`.
    fn send_reading(
        &mut self,
        py: Python<'_>,
        values: [f64; 3],
        inputs: Vec<(String, f64)>,
        status: u32,
        t_sensor_ns: Option<u64>,
    ) -> PyResult<u64> {
        let [pressure_mpa, gap_mm, measured_force_n] = values;
        let t_sensor_ns = t_sensor_ns.unwrap_or_else(wire::now_ns);
        let mut sample = SensorSample {
            pressure_mpa,
            gap_mm,
            measured_force_n,
            status,
            t_sensor_ns,
            ..SensorSample::default()
        };
        for (name, value) in &inputs {
            if !sample.add_input(name, *value) {
                let most = sample.inputs.len();
                return Err(refused(format!("inputs: expected at most {most}, found {}", inputs.len())));
            }
        }
        self.send(py, port!(Sensor), move |boot_id, seq, _| {
            (sample.boot_id, sample.seq) = (boot_id, seq);
            sample
        })
    }

    /// Sends a pressure command.
    fn send_command(&mut self, py: Python<'_>, pressure_mpa: f64, t_sensor_ns: u64) -> PyResult<u64> {
        let t_publish_ns = wire::now_ns();
        self.send(py, port!(Command), |boot_id, seq, _| Command {
            boot_id,
            seq,
            t_sensor_ns,
            t_publish_ns,
            pressure_mpa,
        })
    }

    /// Sends a setpoint that is valid for `valid_for_s`; NaN lets the valve go.
    fn send_setpoint(
        &mut self,
        py: Python<'_>,
        pressure_mpa: f64,
        valid_for_s: f64,
        t_sensor_ns: u64,
    ) -> PyResult<u64> {
        if !(valid_for_s > 0.0 && valid_for_s.is_finite()) {
            return Err(refused(format!("valid_for_s: expected more than 0 seconds, found {valid_for_s}")));
        }
        let (t_publish_ns, valid_for_ns) = (wire::now_ns(), (valid_for_s * 1e9) as u64);
        self.send(py, port!(Setpoint), |boot_id, seq, owner| Setpoint {
            boot_id,
            seq,
            t_sensor_ns,
            t_publish_ns,
            valid_for_ns,
            pressure_mpa,
            owner,
        })
    }

    /// Sends a target: a step, a ramp with its rate, or a series with its interval.
    fn send_target(
        &mut self,
        py: Python<'_>,
        values: Vec<f64>,
        rate_per_s: Option<f64>,
        interval_s: Option<f64>,
    ) -> PyResult<u64> {
        let most = if interval_s.is_some() { TARGET_VALUES_MAX } else { 1 };
        if !(1..=most).contains(&values.len()) || values.iter().any(|value| !value.is_finite()) {
            return Err(refused(format!("expected 1 to {most} finite values, found {values:?}")));
        }
        for (name, value) in [("rate", rate_per_s), ("interval_s", interval_s)] {
            if value.is_some_and(|value| !(value > 0.0 && value.is_finite())) {
                return Err(refused(format!(
                    "{name}: expected more than 0, found {}",
                    value.unwrap_or(f64::NAN)
                )));
            }
        }
        let kind = match (rate_per_s, interval_s) {
            (_, Some(_)) => target_kind::SERIES,
            (Some(_), None) => target_kind::RAMP,
            (None, None) => target_kind::STEP,
        };
        let mut target = Target { target_kind: kind, value_count: values.len() as u32, ..Target::default() };
        target.rate_per_s = rate_per_s.unwrap_or(target.rate_per_s);
        target.interval_s = interval_s.unwrap_or(target.interval_s);
        target.values.iter_mut().zip(values).for_each(|(to, value)| *to = value);
        target.t_publish_ns = wire::now_ns();
        self.send(py, port!(Target), move |boot_id, seq, owner| {
            (target.boot_id, target.seq, target.owner) = (boot_id, seq, owner);
            target
        })
    }
}

/// One that asks a twin.
#[pyclass(module = "softtwin._native")]
pub struct Client {
    client: Opened<QueryClient>,
    descriptor: OwnedFd,
}

#[pymethods]
impl Client {
    /// Asks and waits for the answer, at most `timeout_s`: its bytes, the field, and why there is no answer.
    fn ask<'py>(
        &mut self,
        py: Python<'py>,
        kind: u32,
        given: [f64; 4],
        inputs: Vec<(String, f64)>,
        node_set: Option<&str>,
        timeout_s: f64,
    ) -> PyResult<(Bound<'py, PyBytes>, Sample, Option<String>)> {
        let [pressure_mpa, gap_mm, force_n, force_halfwidth_n] = given;
        let mut query = Query { kind, pressure_mpa, gap_mm, force_n, force_halfwidth_n, ..Query::default() };
        if let Some(set) = node_set {
            if set.len() > NAME_BYTES {
                return Err(refused(format!(
                    "`{set}` has {} bytes; expected at most {NAME_BYTES}",
                    set.len()
                )));
            }
            (query.want_field, query.node_set) = (1, pack_name(set));
        }
        for (name, value) in &inputs {
            if !query.set_parameter(name, *value) {
                let most = query.parameters.len();
                return Err(refused(format!("inputs: expected at most {most}, found {}", inputs.len())));
            }
        }
        let timeout = Duration::try_from_secs_f64(timeout_s).map_err(refused)?;
        let end = Instant::now() + timeout;
        let mut asked = self.client.get(py)?.send(&query).map_err(failed)?;
        let sample = loop {
            if let Some(sample) = self.client.get(py)?.answer(&mut asked).map_err(failed)? {
                break sample;
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(failed(self.client.get(py)?.silent(timeout)));
            }
            sleep(py, &self.descriptor, left)?;
            self.client.get_mut(py)?.wait(Duration::ZERO).map_err(failed)?;
        };
        let bytes = PyBytes::new(py, sample.answer().view().bytes);
        let refusal = sample.answer().refusal();
        Ok((bytes, Sample::of_answer(sample), refusal))
    }
}
