//! The twins as a node of ROS 2, on the wire of `rmw_zenoh` (docs/ros2.md): tokens make node and topics appear in the graph, keys hold
//! type and hash, messages are CDR with an attachment of number, time and sender.

mod cdr;
mod message;

use crate::link::{Link, network};
use cdr::fluid_pressure;
use message::{DIAGNOSTICS, MessageType, POINTS, PRESSURE, WRENCH};
use recording::message::Recorded;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use wire::{AnyReader, AnySample, Bus, KeyExpr, Payload, SensorSample, Topic, TopicKind, Waking, WireError};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::sample::Sample;

/// How often the domain is scanned, and how often it is checked who subscribes.
const SCAN: Duration = Duration::from_millis(250);
/// How often open topics are emptied.
const PACE: Duration = Duration::from_millis(2);
/// Reliable, volatile, the last 10: what ROS takes unless told otherwise.
const QOS: &str = "::,10:,:,:,,";

/// The table `[ros2]` of the configuration.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ros2 {
    /// `ROS_DOMAIN_ID` of the nodes that are to see the twins.
    pub domain_id: u32,
    /// Name of the node.
    pub node: String,
}

impl Default for Ros2 {
    fn default() -> Self {
        Self { domain_id: 0, node: "softtwin".into() }
    }
}

impl Ros2 {
    /// Adds what is wrong.
    pub fn check(&self, problems: &mut Vec<String>) {
        if self.domain_id > 232 {
            problems.push(format!("ros2.domain_id: expected 0 to 232, found {}", self.domain_id));
        }
        let is_name =
            self.node.starts_with(|c: char| c.is_ascii_alphabetic()) && self.node == plain(&self.node);
        if !is_name {
            problems.push(format!(
                "ros2.node: expected a letter, then letters, digits, `_`, found {:?}",
                self.node
            ));
        }
    }
}

/// A name of ours as ROS allows it.
fn plain(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

/// Makes the keys of an endpoint.
struct Names<'a> {
    ros: &'a Ros2,
    session_id: String,
}

impl Names<'_> {
    fn new<'a>(ros: &'a Ros2, link: &Link) -> Names<'a> {
        Names { ros, session_id: link.session.zid().to_string() }
    }

    /// Where the messages of a topic go.
    fn key(&self, topic: &str, kind: MessageType, hash: &str) -> String {
        format!("{}/{topic}/{}/{hash}", self.ros.domain_id, kind.name)
    }

    /// The token of the node.
    fn node(&self) -> String {
        self.entity(0, "NN")
    }

    fn entity(&self, number: usize, kind: &str) -> String {
        let (domain, session, node) = (self.ros.domain_id, &self.session_id, &self.ros.node);
        format!("@ros2_lv/{domain}/{session}/0/{number}/{kind}/%/%/{node}")
    }

    /// The token of a publisher (`MP`) or a subscription (`MS`).
    fn endpoint(&self, number: usize, kind: &str, topic: &str, of: MessageType) -> String {
        let mangled = topic.replace('/', "%");
        format!("{}/%{mangled}/{}/{}/{QOS}", self.entity(number, kind), of.name, of.hash)
    }
}

fn token(link: &Link, key: String) -> anyhow::Result<LivelinessToken> {
    network(link.session.liveliness().declare_token(key).wait())
}

/// What a local topic becomes.
type Encode = fn(&AnySample, &str, u64) -> Option<Vec<u8>>;

/// Topics of ROS from one local topic: name behind the actuator's, type, encoder.
fn outlets(topic: &Topic) -> Vec<(String, MessageType, Encode)> {
    match topic.kind() {
        TopicKind::State => vec![
            ("wrench".into(), WRENCH, |sample, name, time_ns| match sample {
                AnySample::State(state) => Some(message::wrench(state, name, time_ns)),
                _ => None,
            }),
            ("pressure".into(), PRESSURE, |sample, name, time_ns| match sample {
                AnySample::State(state) => Some(message::pressure(state, name, time_ns)),
                _ => None,
            }),
        ],
        TopicKind::Field => {
            let set = plain(topic.node_set().unwrap_or("all"));
            vec![(format!("{set}/points"), POINTS, |sample, name, time_ns| match sample {
                AnySample::Field(field) => message::points(field.header(), field.values(), name, time_ns),
                _ => None,
            })]
        }
        TopicKind::Health => {
            vec![("diagnostics".into(), DIAGNOSTICS, |sample, name, time_ns| match sample {
                AnySample::Health(health) => Some(message::diagnostics(health, name, time_ns)),
                _ => None,
            })]
        }
        _ => Vec::new(),
    }
}

/// One topic of ROS with its local reader, which exists while somebody subscribes.
struct Outlet {
    topic: Topic,
    actuator: String,
    publisher: Publisher<'static>,
    _token: LivelinessToken,
    gid: [u8; 16],
    encode: Encode,
    reader: Option<AnyReader>,
    sent: i64,
    due: Instant,
}

/// Moves samples until the gateway ends; fields at most every `period`.
///
/// # Errors
/// When the domain cannot be joined or the session is closed.
pub fn run(link: &Link, ros: &Ros2, keys: &[KeyExpr], period: Duration) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let names = Names::new(ros, link);
    let _node = token(link, names.node())?;
    let offset_ns = recording::wall_offset_ns();
    let mut outlets: BTreeMap<String, Outlet> = BTreeMap::new();
    let mut scan_at = Instant::now();
    while link.goes_on() {
        let now = Instant::now();
        if now >= scan_at {
            scan_at = now + SCAN;
            announce(link, &bus, &names, keys, &mut outlets)?;
            for outlet in outlets.values_mut() {
                outlet.adjust(&bus);
            }
        }
        for outlet in outlets.values_mut() {
            if let Err(error) = outlet.pump(offset_ns, now, period) {
                tracing::warn!("{error}; opening the topic again");
                outlet.reader = None;
            }
        }
        thread::sleep(if outlets.values().any(|outlet| outlet.reader.is_some()) { PACE } else { SCAN / 5 });
    }
    Ok(())
}

/// Announces the local topics that are new.
fn announce(
    link: &Link,
    bus: &Bus,
    names: &Names,
    keys: &[KeyExpr],
    known: &mut BTreeMap<String, Outlet>,
) -> anyhow::Result<()> {
    for key in keys {
        for topic in bus.names(key)? {
            for (name, kind, encode) in outlets(&topic) {
                let actuator = plain(topic.actuator());
                let name = format!("softtwin/{actuator}/{name}");
                if known.contains_key(&name) {
                    continue;
                }
                let endpoint = names.endpoint(known.len() + 1, "MP", &name, kind);
                let publisher = link.session.declare_publisher(names.key(&name, kind, kind.hash));
                let is_field = topic.kind() == TopicKind::Field;
                let congestion = if is_field { CongestionControl::Drop } else { CongestionControl::Block };
                let publisher = network(publisher.congestion_control(congestion).wait())?;
                let (gid, token) = (gid(&endpoint), token(link, endpoint)?);
                let topic = topic.clone();
                let due = Instant::now();
                let made = Outlet {
                    topic,
                    actuator,
                    publisher,
                    _token: token,
                    gid,
                    encode,
                    reader: None,
                    sent: 0,
                    due,
                };
                known.insert(name, made);
            }
        }
    }
    Ok(())
}

impl Outlet {
    /// Opens the reader when somebody subscribes, and closes it when nobody does any more.
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
            tracing::warn!("{}: cannot be sent: {error}", self.topic);
        }
    }
}

/// Number, time and sender of a message, as Zenoh's serializer writes them.
fn attachment(number: i64, time_ns: i64, gid: [u8; 16]) -> Vec<u8> {
    [&number.to_le_bytes()[..], &time_ns.to_le_bytes(), &[gid.len() as u8], &gid].concat()
}

/// The sender's number: two FNV-1a hashes of its token, from two beginnings.
fn gid(token: &str) -> [u8; 16] {
    let hash = |begin: u64| {
        token.bytes().fold(begin, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
    };
    let mut gid = [0; 16];
    gid[..8].copy_from_slice(&hash(0xcbf2_9ce4_8422_2325).to_le_bytes());
    gid[8..].copy_from_slice(&hash(0x8422_2325_cbf2_9ce4).to_le_bytes());
    gid
}

fn now_since_1970_ns() -> i64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(now.as_nanos()).unwrap_or(i64::MAX)
}

/// Pressures from ROS for one actuator: `softtwin/<actuator>/pressure_measured`.
pub struct Inlet {
    /// The key to subscribe to: any hash, so that another one can be named.
    pub key: String,
    _token: LivelinessToken,
}

impl Inlet {
    /// Announces the subscription.
    ///
    /// # Errors
    /// When the session is closed.
    pub fn declare(link: &Link, ros: &Ros2, number: usize, topic: &Topic) -> anyhow::Result<Self> {
        let names = Names::new(ros, link);
        let name = format!("softtwin/{}/pressure_measured", plain(topic.actuator()));
        let token = token(link, names.endpoint(10_000 + number, "MS", &name, PRESSURE))?;
        Ok(Self { key: names.key(&name, PRESSURE, "*"), _token: token })
    }
}

/// A `FluidPressure` as the JSON of a reading; number and run are the sender's.
///
/// # Errors
/// What is wrong with the message.
pub fn reading(sample: &Sample) -> Result<Vec<u8>, String> {
    let key = sample.key_expr().as_str();
    if !key.ends_with(PRESSURE.hash) {
        return Err(format!(
            "{key}: expected type hash {}; build the sender with ROS 2 Iron or later",
            PRESSURE.hash
        ));
    }
    let expected =
        || format!("{key}: expected a sensor_msgs/FluidPressure in little-endian CDR with its attachment");
    let (t_sensor_ns, pressure_pa) = fluid_pressure(&sample.payload().to_bytes()).ok_or_else(expected)?;
    let attachment = sample.attachment().ok_or_else(expected)?.to_bytes();
    let number = |at: usize| Some(u64::from_le_bytes(attachment.get(at..at + 8)?.try_into().ok()?));
    let (seq, boot_id) = (number(0).ok_or_else(expected)?, number(17).ok_or_else(expected)?);
    let mut bytes = Vec::new();
    let pressure_mpa = pressure_pa / message::PA_PER_MPA;
    let found =
        SensorSample { boot_id: boot_id.max(1), seq, t_sensor_ns, pressure_mpa, ..SensorSample::default() };
    found.view().encode(&mut bytes);
    Ok(bytes)
}
