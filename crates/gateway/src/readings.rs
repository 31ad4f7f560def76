//! Readings from the network, into the sensor topics that the configuration names.

use crate::clock::SenderClock;
use crate::link::{Link, count, network};
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
/// Longest sleep.
const TICK: Duration = Duration::from_millis(100);

/// One message as it arrived.
struct Arrived {
    inlet: usize,
    t_arrival_ns: u64,
    reading: Result<SensorSample, String>,
}

/// Moves readings until the gateway ends.
///
/// # Errors
/// When the shared memory cannot be opened or the session is closed.
pub fn run(link: &Link, topics: &[Topic], ros2: Option<&Ros2>) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let (sender, receiver) = sync_channel(READINGS);
    let mut subscribers = Vec::new();
    let mut tokens = Vec::new();
    for (inlet, topic) in topics.iter().enumerate() {
        subscribers.push(subscribe(link, link.key(topic.name()), inlet, &sender, reading)?);
        if let Some(ros2) = ros2 {
            let declared = ros::Inlet::declare(link, ros2, inlet, topic)?;
            subscribers.push(subscribe(link, declared.key.clone(), inlet, &sender, ros::reading)?);
            tokens.push(declared);
        }
    }
    let mut inlets: Vec<Inlet> = topics.iter().map(Inlet::new).collect();
    for inlet in &mut inlets {
        inlet.open(&bus);
    }
    serve(link, &bus, &receiver, &mut inlets);
    Ok(())
}

fn serve(link: &Link, bus: &Bus, receiver: &Receiver<Arrived>, inlets: &mut [Inlet]) {
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
    sender: &SyncSender<Arrived>,
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
        if sender.try_send(Arrived { inlet, t_arrival_ns, reading }).is_err() {
            count(&counters.bad_readings);
        }
    };
    let subscriber = link.session.declare_subscriber(key).callback(take);
    network(subscriber.allowed_origin(Locality::Remote).wait())
}

/// One sensor topic.
struct Inlet {
    topic: Topic,
    writer: Option<SensorWriter>,
    retry_at: Instant,
    clock: SenderClock,
    /// The last error; it is logged once.
    error: Option<String>,
}

impl Inlet {
    fn new(topic: &Topic) -> Self {
        Self {
            topic: topic.clone(),
            writer: None,
            retry_at: Instant::now(),
            clock: SenderClock::default(),
            error: None,
        }
    }

    fn open(&mut self, bus: &Bus) {
        self.retry_at = Instant::now() + RETRY;
        match SensorWriter::create(bus, &self.topic) {
            Ok(writer) => self.writer = Some(writer),
            Err(error) => self.log_once(format!("readings from the network cannot be published: {error}")),
        }
    }

    /// Publishes a reading, whose values the twin checks; false if it is malformed or cannot be published.
    fn publish(&mut self, bus: &Bus, arrived: Arrived) -> bool {
        let sample = match arrived.reading {
            Ok(sample) => sample,
            Err(error) => {
                self.log_once(format!("{}: expected a reading from the network: {error}", self.topic));
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
                self.error = None;
                true
            }
            Err(error) => {
                self.writer = None;
                self.log_once(error.to_string());
                false
            }
        }
    }

    fn log_once(&mut self, error: String) {
        if self.error.as_ref() != Some(&error) {
            tracing::warn!("{error}");
            self.error = Some(error);
        }
    }
}
