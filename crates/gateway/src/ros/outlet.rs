//! Local topics as topics of ROS: each has a local reader while there are subscribers.

use super::attachment::{Gid, attachment, gid, now_since_1970_ns, plain};
use super::config::Ros2;
use super::marker::Markers;
use super::message;
use super::names::{Entity, Names, token};
use super::types::{DIAGNOSTICS, JOINTS, MARKER, MessageType, POINTS, PRESSURE, WRENCH};
use crate::link::{Link, network};
use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};
use wire::{AnyReader, AnySample, Bus, State, Topic, TopicInfo, TopicKind, Waking, WireError};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};

/// Encodes a sample with actuator and time (ns since 1970) in its header; `None` if there is no message.
type Encode = Box<dyn FnMut(&AnySample, &str, u64) -> Option<Vec<u8>>>;

/// Topics of ROS from one local topic: name after the actuator's, type, encoder.
fn kinds(topic: &Topic, ros: &Ros2) -> Vec<(String, MessageType, Encode)> {
    match topic.kind() {
        TopicKind::State => vec![
            ("wrench".into(), WRENCH, of_state(message::wrench)),
            ("pressure".into(), PRESSURE, of_state(message::pressure)),
            ("inputs".into(), JOINTS, of_state(message::inputs)),
            ("observables".into(), JOINTS, of_state(message::observables)),
        ],
        TopicKind::Field => {
            let set = plain(topic.node_set().unwrap_or("all"));
            let mut kinds = vec![(format!("{set}/points"), POINTS, Box::new(points) as Encode)];
            if let Some(markers) = Markers::of(topic, ros) {
                kinds.push((format!("{set}/marker"), MARKER, marker(markers)));
            }
            kinds
        }
        TopicKind::Valve => vec![
            ("state".into(), JOINTS, Box::new(valve)),
            ("valve".into(), DIAGNOSTICS, Box::new(valve_diagnostics)),
        ],
        TopicKind::Health => vec![("diagnostics".into(), DIAGNOSTICS, Box::new(diagnostics))],
        _ => Vec::new(),
    }
}

fn of_state(encode: fn(&State, &str, u64) -> Option<Vec<u8>>) -> Encode {
    Box::new(move |sample, actuator, time_ns| match sample {
        AnySample::State(state) => encode(state, actuator, time_ns),
        _ => None,
    })
}

fn points(sample: &AnySample, actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let AnySample::Field(field) = sample else { return None };
    message::points(field.header(), field.values(), actuator, time_ns)
}

fn marker(mut markers: Markers) -> Encode {
    Box::new(move |sample, actuator, time_ns| {
        let AnySample::Field(field) = sample else { return None };
        markers.encode(field.header(), field.values(), actuator, time_ns)
    })
}

fn diagnostics(sample: &AnySample, actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let AnySample::Health(health) = sample else { return None };
    Some(message::diagnostics(health, actuator, time_ns))
}

fn valve(sample: &AnySample, actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let AnySample::Valve(valve) = sample else { return None };
    Some(message::valve(valve, actuator, time_ns))
}

fn valve_diagnostics(sample: &AnySample, actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let AnySample::Valve(valve) = sample else { return None };
    Some(message::valve_diagnostics(valve, actuator, time_ns))
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

/// All topics of ROS that come from local ones.
#[derive(Default)]
pub struct Outlets {
    seen: BTreeSet<String>,
    by_name: BTreeMap<String, Outlet>,
}

impl Outlets {
    /// Announces new local topics.
    ///
    /// # Errors
    /// When the session is closed.
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
            for (name, of, encode) in kinds(topic, ros) {
                let name = format!("softtwin/{}/{name}", plain(topic.actuator()));
                if !self.by_name.contains_key(&name) {
                    let number = self.by_name.len() + 1;
                    let outlet = Outlet::declare(link, names, number, topic, &name, of, encode)?;
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

    /// True if any topic is read.
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
        of: MessageType,
        encode: Encode,
    ) -> anyhow::Result<Self> {
        let endpoint = names.endpoint(number, Entity::Publisher, name, of);
        // As in `topic_bridge`: messages wait for slow subscribers; fields are dropped instead and never delay a message.
        let (congestion, priority) = match topic.kind() {
            TopicKind::Field => (CongestionControl::Drop, Priority::DataLow),
            _ => (CongestionControl::Block, Priority::DataHigh),
        };
        let publisher = link.session.declare_publisher(names.key(name, of, of.hash));
        let publisher = network(publisher.congestion_control(congestion).priority(priority).wait())?;
        Ok(Self {
            topic: topic.clone(),
            actuator: plain(topic.actuator()),
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
        let attachment = attachment(self.sent, now_since_1970_ns(), self.gid);
        if let Err(error) = self.publisher.put(message).attachment(attachment).wait() {
            tracing::warn!("{}: not sent: {error}", self.topic);
        }
    }
}
