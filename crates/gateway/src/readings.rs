//! Readings from the network, into the sensor topics that the configuration names. Their time stamps are of another machine's clock and are
//! converted to the local one.

use crate::link::{LastError, Link, count, network};
use crate::ros::{self, Ros2};
use recording::message::decode_reading;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};
use wire::{Bus, SensorSample, SensorWriter, Topic, now_ns};
use zenoh::Wait;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Locality, Sample, SampleKind};

/// Largest number of waiting readings: one second at 1 kHz.
const READINGS: usize = 1024;
/// Largest message accepted as a reading.
const MAX_BYTES: usize = 4096;
/// Interval of retries for a topic that another program writes.
const RETRY: Duration = Duration::from_secs(1);
const TICK: Duration = Duration::from_millis(100);

/// One message as it arrived.
struct ArrivedReading {
    inlet: usize,
    t_arrival_ns: u64,
    reading: Result<SensorSample, String>,
}

/// Moves readings until the gateway ends.
pub fn run(link: &Link, topics: &[Topic], ros2: Option<&Ros2>) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let (sender, receiver) = sync_channel(READINGS);
    let mut subscribers = Vec::new();
    let mut tokens = Vec::new();
    for (inlet, topic) in topics.iter().enumerate() {
        subscribers.push(subscribe(link, link.key(topic.name()), inlet, &sender, reading)?);
        if let Some(ros2) = ros2 {
            let (key, token) = ros::announce_readings(link, ros2, inlet, topic)?;
            subscribers.push(subscribe(link, key, inlet, &sender, ros::reading)?);
            tokens.push(token);
        }
    }
    let mut inlets: Vec<Inlet> = topics.iter().map(Inlet::new).collect();
    for inlet in &mut inlets {
        inlet.open(&bus);
    }
    serve(link, &bus, &receiver, &mut inlets);
    Ok(())
}

fn serve(link: &Link, bus: &Bus, receiver: &Receiver<ArrivedReading>, inlets: &mut [Inlet]) {
    while link.is_running() {
        match receiver.recv_timeout(TICK) {
            Ok(arrived) => {
                let Some(inlet) = inlets.get_mut(arrived.inlet) else { continue };
                let is_published = inlet.publish(bus, arrived);
                count(if is_published { &link.counters.readings } else { &link.counters.bad_readings });
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

/// The reading in a message of the network.
fn reading(sample: &Sample) -> Result<SensorSample, String> {
    match sample.kind() {
        SampleKind::Put => decode_reading(&sample.payload().to_bytes()).map_err(|error| error.to_string()),
        SampleKind::Delete => Err("expected a put, found a delete".into()),
    }
}

/// Queues the readings that `read` finds in the messages of a key.
fn subscribe(
    link: &Link,
    key: String,
    inlet: usize,
    sender: &SyncSender<ArrivedReading>,
    read: fn(&Sample) -> Result<SensorSample, String>,
) -> anyhow::Result<Subscriber<()>> {
    let (counters, sender) = (link.counters.clone(), sender.clone());
    let take = move |sample: Sample| {
        let t_arrival_ns = now_ns();
        let reading = match sample.payload().len() {
            length if length > MAX_BYTES => {
                Err(format!("expected at most {MAX_BYTES} bytes, found {length}"))
            }
            _ => read(&sample),
        };
        if sender.try_send(ArrivedReading { inlet, t_arrival_ns, reading }).is_err() {
            count(&counters.bad_readings);
        }
    };
    let subscriber = link.session.declare_subscriber(key).callback(take);
    network(subscriber.allowed_origin(Locality::Remote).wait())
}

struct Inlet {
    topic: Topic,
    writer: Option<SensorWriter>,
    retry_at: Instant,
    clock: SenderClock,
    error: LastError,
}

impl Inlet {
    fn new(topic: &Topic) -> Self {
        Self {
            topic: topic.clone(),
            writer: None,
            retry_at: Instant::now(),
            clock: SenderClock::default(),
            error: LastError::default(),
        }
    }

    fn open(&mut self, bus: &Bus) {
        self.retry_at = Instant::now() + RETRY;
        match SensorWriter::create(bus, &self.topic) {
            Ok(writer) => self.writer = Some(writer),
            Err(error) => self.error.log(format!("readings from the network cannot be published: {error}")),
        }
    }

    /// Publishes a reading, whose values the twin checks; false if it is malformed or cannot be published.
    fn publish(&mut self, bus: &Bus, arrived: ArrivedReading) -> bool {
        let sample = match arrived.reading {
            Ok(sample) => sample,
            Err(error) => {
                self.error.log(format!("{}: expected a reading from the network: {error}", self.topic));
                return false;
            }
        };
        let t_sensor_ns = self.clock.local_ns(sample.boot_id, sample.t_sensor_ns, arrived.t_arrival_ns);
        if self.writer.is_none() && Instant::now() >= self.retry_at {
            self.open(bus);
        }
        let Some(writer) = &mut self.writer else { return false };
        match writer.publish(SensorSample { t_sensor_ns, ..sample }) {
            Ok(()) => {
                self.error.clear();
                true
            }
            Err(error) => {
                self.writer = None;
                self.error.log(error.to_string());
                false
            }
        }
    }
}

/// Length of one window of smallest delays, ns: two clocks drift by less than 2 ms meanwhile (50 ppm).
const WINDOW_NS: u64 = 30_000_000_000;

/// Brings a sender's monotonic stamps onto the local clock: `t = t_sender + min(arrival - t_sender)` over the last 30 to 60
/// seconds. The smallest delay estimates the distance of the clocks: the fastest reading is stamped with its arrival, a later one
/// with its delay. No stamp is after the arrival, and stamps keep the sender's order when the estimate changes.
#[derive(Debug, Default)]
pub struct SenderClock {
    boot_id: u64,
    newest_sender_ns: u64,
    newest_local_ns: u64,
    window_ends_ns: u64,
    previous: Option<i128>,
    current: Option<i128>,
}

impl SenderClock {
    /// The local time of a stamp, ns. `O(1)`.
    pub fn local_ns(&mut self, boot_id: u64, t_sender_ns: u64, t_arrival_ns: u64) -> u64 {
        if boot_id != self.boot_id || self.current.is_none() {
            *self = Self { boot_id, ..Self::default() };
            self.window_ends_ns = t_arrival_ns.saturating_add(WINDOW_NS);
        }
        if t_arrival_ns >= self.window_ends_ns {
            (self.previous, self.current) = (self.current, None);
            self.window_ends_ns = t_arrival_ns.saturating_add(WINDOW_NS);
        }
        let distance = i128::from(t_arrival_ns) - i128::from(t_sender_ns);
        let current = self.current.map_or(distance, |smallest| smallest.min(distance));
        self.current = Some(current);
        let smallest = self.previous.map_or(current, |previous| previous.min(current));
        let local_ns = u64::try_from(i128::from(t_sender_ns) + smallest).unwrap_or(0);
        self.in_order(t_sender_ns, local_ns)
    }

    fn in_order(&mut self, t_sender_ns: u64, local_ns: u64) -> u64 {
        if t_sender_ns < self.newest_sender_ns {
            return local_ns.min(self.newest_local_ns.saturating_sub(1));
        }
        self.newest_sender_ns = t_sender_ns;
        self.newest_local_ns = self.newest_local_ns.max(local_ns);
        self.newest_local_ns
    }
}

#[cfg(test)]
#[path = "../tests/unit/clock.rs"]
mod tests;
