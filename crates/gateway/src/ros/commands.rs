//! Targets from nodes of ROS 2: `std_msgs/Float64MultiArray` with one value, as the forward controllers of `ros2_control` take them.

use super::attachment::plain;
use super::cdr::Reader;
use super::config::Ros2;
use super::names::{Entity, Names, token};
use super::types::COMMANDS;
use crate::link::{Link, count, network};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};
use wire::layout::{pack_name, target_kind};
use wire::{Bus, Target, TargetWriter, Topic, WireError, boot_id, now_ns};
use zenoh::Wait;
use zenoh::sample::{Locality, Sample};

/// First entity number of these subscriptions, above those of readings.
const FIRST: usize = 20_000;
/// Largest number of waiting commands.
const WAITING: usize = 64;
/// Time without a command after which the right to send targets is given back.
const IDLE: Duration = Duration::from_secs(2);
/// Longest sleep.
const TICK: Duration = Duration::from_millis(100);

/// One actuator whose targets come from ROS.
struct Inlet {
    topic: Topic,
    writer: Option<TargetWriter>,
    last: Instant,
    boot_id: u64,
    seq: u64,
    /// The last error; it is logged once.
    error: Option<String>,
}

/// Passes targets on until the gateway ends.
///
/// # Errors
/// When the shared memory cannot be opened or the session is closed.
pub fn run(link: &Link, ros: &Ros2, topics: &[Topic]) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let names = Names::new(ros, link);
    let (sender, receiver) = sync_channel(WAITING);
    let (mut subscribers, mut tokens) = (Vec::new(), Vec::new());
    for (at, topic) in topics.iter().enumerate() {
        let name = format!("softtwin/{}/commands", plain(topic.actuator()));
        let (sender, counters) = (sender.clone(), link.counters.clone());
        let take = move |sample: Sample| {
            if sender.try_send((at, command(&sample))).is_err() {
                count(&counters.bad_readings);
            }
        };
        let subscriber = link.session.declare_subscriber(names.key(&name, COMMANDS, "*")).callback(take);
        subscribers.push(network(subscriber.allowed_origin(Locality::Remote).wait())?);
        tokens.push(token(link, names.endpoint(FIRST + at, Entity::Subscription, &name, COMMANDS))?);
    }
    let mut inlets: Vec<Inlet> = topics.iter().map(Inlet::new).collect();
    while link.is_running() {
        match receiver.recv_timeout(TICK) {
            Ok((at, command)) => {
                let Some(inlet) = inlets.get_mut(at) else { continue };
                if let Err(error) = command.and_then(|value| inlet.send(&bus, ros, value)) {
                    count(&link.counters.bad_readings);
                    inlet.log_once(error);
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
    let mut reader = Reader::new(bytes)?;
    let dimensions = reader.word().filter(|count| *count as usize <= MOST)?;
    for _ in 0..dimensions {
        reader.string()?;
        reader.word()?;
        reader.word()?;
    }
    reader.word()?;
    reader.doubles(MOST)
}

impl Inlet {
    fn new(topic: &Topic) -> Self {
        let (topic, boot_id) = (topic.clone(), boot_id());
        Self { topic, writer: None, last: Instant::now(), boot_id, seq: 0, error: None }
    }

    /// Sends a step to the controller; the first one takes the right to.
    fn send(&mut self, bus: &Bus, ros: &Ros2, value: f64) -> Result<(), String> {
        let owner: String = ros.node.chars().take(31).collect();
        let said = |error: WireError| error.to_string();
        let mut writer = match self.writer.take() {
            Some(writer) => writer,
            None => TargetWriter::create_named(bus, &self.topic, &owner).map_err(said)?,
        };
        (self.seq, self.last) = (self.seq + 1, Instant::now());
        let mut target = Target { boot_id: self.boot_id, seq: self.seq, ..Target::default() };
        (target.target_kind, target.value_count, target.values[0]) = (target_kind::STEP, 1, value);
        writer
            .publish(Target { t_publish_ns: now_ns(), owner: pack_name(&owner), ..target })
            .map_err(said)?;
        (self.writer, self.error) = (Some(writer), None);
        Ok(())
    }

    fn log_once(&mut self, error: String) {
        if self.error.as_ref() != Some(&error) {
            tracing::warn!("{error}");
            self.error = Some(error);
        }
    }
}
