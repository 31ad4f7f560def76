//! Topics of ROS 2: local topics that are published there while they have subscribers, and pressures and commands that come from there.

use super::config::{Ros2, ros_name};
use super::message::{self, Markers, PA_PER_MPA, fluid_pressure};
use super::wire_format::{
    COMMANDS, CdrReader, DIAGNOSTICS, Entity, Gid, JOINTS, MARKER, MessageType, Names, POINTS, PRESSURE,
    WRENCH, attachment_of, gid, now_since_1970_ns, parse_attachment, token,
};
use crate::link::{LastError, Link, count, network};
use crate::topics::delivery;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};
use wire::layout::{pack_name, target_kind};
use wire::{
    AnyReader, AnySample, Bus, SensorSample, Target, TargetWriter, Topic, TopicInfo, TopicKind, Waking,
    WireError, boot_id, now_ns,
};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::sample::{Locality, Sample};

/// Encodes a sample with actuator and time (ns since 1970) in its header; `None` if there is no message.
type Encode = Box<dyn FnMut(&AnySample, &str, u64) -> Option<Vec<u8>>>;

/// The encoder of one kind of sample by a function that makes its message.
macro_rules! encoder {
    ($kind:ident, $message:path) => {
        Box::new(|sample: &AnySample, actuator: &str, time_ns: u64| match sample {
            AnySample::$kind(sample) => $message(sample, actuator, time_ns),
            _ => None,
        }) as Encode
    };
}

/// Topics of ROS from one local topic: name after the actuator's, type, encoder.
fn kinds(topic: &Topic, ros: &Ros2) -> Vec<(String, MessageType, Encode)> {
    match topic.kind() {
        TopicKind::State => vec![
            ("wrench".into(), WRENCH, encoder!(State, message::wrench)),
            ("pressure".into(), PRESSURE, encoder!(State, message::pressure)),
            ("inputs".into(), JOINTS, encoder!(State, message::inputs)),
            ("observables".into(), JOINTS, encoder!(State, message::observables)),
        ],
        TopicKind::Field => {
            let set = ros_name(topic.node_set().unwrap_or("all"));
            let mut kinds = vec![(format!("{set}/points"), POINTS, encoder!(Field, message::points))];
            if let Some(mut markers) = Markers::for_topic(topic, ros) {
                let encode = move |sample: &AnySample, actuator: &str, time_ns: u64| match sample {
                    AnySample::Field(field) => {
                        markers.encode(field.header(), field.values(), actuator, time_ns)
                    }
                    _ => None,
                };
                kinds.push((format!("{set}/marker"), MARKER, Box::new(encode)));
            }
            kinds
        }
        TopicKind::Valve => vec![
            ("state".into(), JOINTS, encoder!(Valve, message::valve)),
            ("valve".into(), DIAGNOSTICS, encoder!(Valve, message::valve_diagnostics)),
        ],
        TopicKind::Health => {
            vec![("diagnostics".into(), DIAGNOSTICS, encoder!(Health, message::diagnostics))]
        }
        _ => Vec::new(),
    }
}

/// One topic of ROS with its local reader, which exists while there are subscribers.
pub struct Outlet {
    topic: Topic,
    actuator: String,
    publisher: Publisher<'static>,
    _token: LivelinessToken,
    gid: Gid,
    encode: Encode,
    reader: Option<AnyReader>,
    sent: i64,
    due: Instant,
}

#[derive(Default)]
pub struct Outlets {
    seen: BTreeSet<String>,
    by_name: BTreeMap<String, Outlet>,
}

impl Outlets {
    /// Announces new local topics.
    pub fn announce(
        &mut self,
        link: &Link,
        names: &Names,
        ros: &Ros2,
        found: &[TopicInfo],
    ) -> anyhow::Result<()> {
        for topic in found.iter().map(|info| &info.topic) {
            if !self.seen.insert(topic.name().to_owned()) {
                continue;
            }
            for (name, kind, encode) in kinds(topic, ros) {
                let name = format!("softtwin/{}/{name}", ros_name(topic.actuator()));
                if !self.by_name.contains_key(&name) {
                    let number = self.by_name.len() + 1;
                    let outlet = Outlet::declare(link, names, number, topic, &name, kind, encode)?;
                    self.by_name.insert(name, outlet);
                }
            }
        }
        Ok(())
    }

    /// Opens the readers of topics with subscribers, and closes the others.
    pub fn adjust(&mut self, bus: &Bus) {
        self.by_name.values_mut().for_each(|outlet| outlet.adjust(bus));
    }

    /// Sends waiting samples; fields at most every `period`.
    pub fn pump(&mut self, offset_ns: u64, now: Instant, period: Duration) {
        for outlet in self.by_name.values_mut() {
            if let Err(error) = outlet.pump(offset_ns, now, period) {
                tracing::warn!("{error}; opening the topic again");
                outlet.reader = None;
            }
        }
    }

    pub fn is_read(&self) -> bool {
        self.by_name.values().any(|outlet| outlet.reader.is_some())
    }
}

impl Outlet {
    fn declare(
        link: &Link,
        names: &Names,
        number: usize,
        topic: &Topic,
        name: &str,
        kind: MessageType,
        encode: Encode,
    ) -> anyhow::Result<Self> {
        let endpoint = names.endpoint(number, Entity::Publisher, name, kind);
        let (congestion, priority) = delivery(topic.kind());
        let publisher = link.session.declare_publisher(names.key(name, kind, kind.hash));
        let publisher = network(publisher.congestion_control(congestion).priority(priority).wait())?;
        Ok(Self {
            topic: topic.clone(),
            actuator: ros_name(topic.actuator()),
            publisher,
            gid: gid(&endpoint),
            _token: token(link, endpoint)?,
            encode,
            reader: None,
            sent: 0,
            due: Instant::now(),
        })
    }

    /// Opens or closes the reader, by whether there are subscribers.
    fn adjust(&mut self, bus: &Bus) {
        let is_wanted = self.publisher.matching_status().wait().is_ok_and(|status| status.matching());
        if !is_wanted {
            self.reader = None;
        } else if self.reader.is_none() {
            let opened = AnyReader::attach_as(bus, &self.topic, Waking::Never);
            self.reader = opened.inspect_err(|error| tracing::warn!("{error}; trying again")).ok();
        }
    }

    fn pump(&mut self, offset_ns: u64, now: Instant, period: Duration) -> Result<(), WireError> {
        let Some(reader) = &self.reader else { return Ok(()) };
        if self.topic.kind() == TopicKind::Field {
            if now < self.due {
                return Ok(());
            }
            if let Some(sample) = reader.newest()? {
                self.due = now + period;
                self.send(&sample, offset_ns);
            }
            return Ok(());
        }
        let waiting: Vec<AnySample> =
            std::iter::from_fn(|| reader.next().transpose()).collect::<Result<_, _>>()?;
        waiting.iter().for_each(|sample| self.send(sample, offset_ns));
        Ok(())
    }

    fn send(&mut self, sample: &AnySample, offset_ns: u64) {
        let stamp = sample.stamp();
        let taken_ns = if stamp.t_sensor_ns > 0 { stamp.t_sensor_ns } else { stamp.t_publish_ns };
        let Some(message) = (self.encode)(sample, &self.actuator, taken_ns.saturating_add(offset_ns)) else {
            return;
        };
        self.sent += 1;
        let attachment = attachment_of(self.sent, now_since_1970_ns(), self.gid);
        if let Err(error) = self.publisher.put(message).attachment(attachment).wait() {
            tracing::warn!("{}: not sent: {error}", self.topic);
        }
    }
}

// ---- readings and commands from ROS ----

/// First entity number of the subscriptions to readings, above those of publishers.
const FIRST_READING: usize = 10_000;

/// Announces the subscription to `softtwin/<actuator>/pressure_measured`: its key, with any hash so that a wrong one is reported, and its
/// token in the graph.
pub fn announce_readings(
    link: &Link,
    ros: &Ros2,
    number: usize,
    topic: &Topic,
) -> anyhow::Result<(String, LivelinessToken)> {
    let names = Names::new(ros, link);
    let name = format!("softtwin/{}/pressure_measured", ros_name(topic.actuator()));
    let endpoint = names.endpoint(FIRST_READING + number, Entity::Subscription, &name, PRESSURE);
    Ok((names.key(&name, PRESSURE, "*"), token(link, endpoint)?))
}

/// The reading in a `FluidPressure`, with number and run of the sender.
pub fn reading(sample: &Sample) -> Result<SensorSample, String> {
    let key = sample.key_expr().as_str();
    PRESSURE.check_hash(key)?;
    let expected =
        || format!("{key}: expected a sensor_msgs/FluidPressure in little-endian CDR with its attachment");
    let (t_sensor_ns, pressure_pa) = fluid_pressure(&sample.payload().to_bytes()).ok_or_else(expected)?;
    let bytes = sample.attachment().ok_or_else(expected)?.to_bytes();
    let (number, gid) = parse_attachment(&bytes).ok_or_else(expected)?;
    let boot_id = gid.first_chunk().map_or(0, |half| u64::from_le_bytes(*half)).max(1);
    let pressure_mpa = pressure_pa / PA_PER_MPA;
    Ok(SensorSample { boot_id, seq: number as u64, t_sensor_ns, pressure_mpa, ..SensorSample::default() })
}

/// First entity number of the subscriptions to commands, above those of readings.
const FIRST_COMMAND: usize = 20_000;
/// Largest number of waiting commands.
const COMMANDS_MAX: usize = 64;
/// Time without a command after which the right to send targets is given back.
const IDLE: Duration = Duration::from_secs(2);
/// Longest sleep of the thread for commands.
const COMMAND_TICK: Duration = Duration::from_millis(100);

/// One actuator whose targets come from ROS.
struct CommandInlet {
    topic: Topic,
    writer: Option<TargetWriter>,
    last: Instant,
    boot_id: u64,
    seq: u64,
    error: LastError,
}

/// Passes commands from nodes of ROS 2 on as targets until the gateway ends. They are `std_msgs/Float64MultiArray` with one value, as
/// the forward controllers of `ros2_control` take them.
pub fn run_commands(link: &Link, ros: &Ros2, topics: &[Topic]) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let names = Names::new(ros, link);
    let (sender, receiver) = sync_channel(COMMANDS_MAX);
    let (mut subscribers, mut tokens) = (Vec::new(), Vec::new());
    for (index, topic) in topics.iter().enumerate() {
        let name = format!("softtwin/{}/commands", ros_name(topic.actuator()));
        let (sender, counters) = (sender.clone(), link.counters.clone());
        let take = move |sample: Sample| {
            if sender.try_send((index, command(&sample))).is_err() {
                count(&counters.bad_readings);
            }
        };
        let subscriber = link.session.declare_subscriber(names.key(&name, COMMANDS, "*")).callback(take);
        subscribers.push(network(subscriber.allowed_origin(Locality::Remote).wait())?);
        tokens
            .push(token(link, names.endpoint(FIRST_COMMAND + index, Entity::Subscription, &name, COMMANDS))?);
    }
    let mut inlets: Vec<CommandInlet> = topics.iter().map(CommandInlet::new).collect();
    while link.is_running() {
        match receiver.recv_timeout(COMMAND_TICK) {
            Ok((at, command)) => {
                let Some(inlet) = inlets.get_mut(at) else { continue };
                if let Err(error) = command.and_then(|value| inlet.send(&bus, ros, value)) {
                    count(&link.counters.bad_readings);
                    inlet.error.log(error);
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        inlets.iter_mut().filter(|inlet| inlet.last.elapsed() > IDLE).for_each(|inlet| inlet.writer = None);
    }
    Ok(())
}

/// The value of a command.
fn command(sample: &Sample) -> Result<f64, String> {
    let key = sample.key_expr().as_str();
    COMMANDS.check_hash(key)?;
    let bytes = sample.payload().to_bytes();
    let values = float_array(&bytes).unwrap_or_default();
    match values[..] {
        [value] if value.is_finite() => Ok(value),
        _ => Err(format!(
            "{key}: expected a std_msgs/Float64MultiArray with one finite value, found {values:?}"
        )),
    }
}

/// The values of a `std_msgs/Float64MultiArray` without dimensions or with some; `None` for other messages.
fn float_array(bytes: &[u8]) -> Option<Vec<f64>> {
    const MOST: usize = 16;
    let mut reader = CdrReader::new(bytes)?;
    let dimensions = reader.word().filter(|count| *count as usize <= MOST)?;
    for _ in 0..dimensions {
        reader.string()?;
        reader.word()?;
        reader.word()?;
    }
    reader.word()?;
    reader.doubles(MOST)
}

impl CommandInlet {
    fn new(topic: &Topic) -> Self {
        let (topic, boot_id) = (topic.clone(), boot_id());
        Self { topic, writer: None, last: Instant::now(), boot_id, seq: 0, error: LastError::default() }
    }

    /// Sends a step to the controller; the first one takes the right to.
    fn send(&mut self, bus: &Bus, ros: &Ros2, value: f64) -> Result<(), String> {
        let owner: String = ros.node.chars().take(31).collect();
        let mut writer = match self.writer.take() {
            Some(writer) => writer,
            None => {
                TargetWriter::create_named(bus, &self.topic, &owner).map_err(|error| error.to_string())?
            }
        };
        (self.seq, self.last) = (self.seq + 1, Instant::now());
        let mut target = Target { boot_id: self.boot_id, seq: self.seq, ..Target::default() };
        (target.target_kind, target.value_count, target.values[0]) = (target_kind::STEP, 1, value);
        writer
            .publish(Target { t_publish_ns: now_ns(), owner: pack_name(&owner), ..target })
            .map_err(|error| error.to_string())?;
        self.writer = Some(writer);
        self.error.clear();
        Ok(())
    }
}
