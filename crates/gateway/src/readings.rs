//! Readings from the network, into the sensor topics that the configuration names.

use crate::clock::SenderClock;
use crate::link::{Link, count, network};
use crate::ros::{self, Ros2};
use recording::message::decode_reading;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};
use wire::{Bus, SensorSample, SensorWriter, Topic, now_ns};
use zenoh::Wait;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Locality, Sample, SampleKind};

/// Readings that may wait: a second at 1 kHz.
const READINGS: usize = 1024;
/// A reading is a few hundred bytes; more is none.
const MAX_BYTES: usize = 4096;
/// How often a topic is tried again that another program writes.
const RETRY: Duration = Duration::from_secs(1);
/// Longest sleep.
const TICK: Duration = Duration::from_millis(100);

/// One message as it arrived.
struct Arrived {
    inlet: usize,
    t_arrival_ns: u64,
    bytes: Vec<u8>,
}

/// Moves readings until the gateway ends.
///
/// # Errors
/// When the domain cannot be joined or the session is closed.
pub fn run(link: &Link, topics: &[Topic], ros2: Option<&Ros2>) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let (sender, receiver) = sync_channel(READINGS);
    let subscribe = |(inlet, topic): (usize, &Topic)| subscribe(link, topic, inlet, sender.clone());
    let _subscribers = topics.iter().enumerate().map(subscribe).collect::<anyhow::Result<Vec<_>>>()?;
    let from_ros = |ros2: &Ros2| {
        let inlets = topics.iter().enumerate();
        let subscribed = inlets.map(|(inlet, topic)| subscribe_ros(link, ros2, topic, inlet, sender.clone()));
        subscribed.collect::<anyhow::Result<Vec<_>>>()
    };
    let _from_ros = ros2.map(from_ros).transpose()?;
    let mut inlets: Vec<Inlet> = topics.iter().map(Inlet::new).collect();
    for inlet in &mut inlets {
        inlet.open(&bus);
    }
    serve(link, &bus, &receiver, &mut inlets);
    Ok(())
}

fn serve(link: &Link, bus: &Bus, receiver: &Receiver<Arrived>, inlets: &mut [Inlet]) {
    while link.goes_on() {
        match receiver.recv_timeout(TICK) {
            Ok(arrived) => {
                let Some(inlet) = inlets.get_mut(arrived.inlet) else { continue };
                let is_passed_on = inlet.pass_on(bus, &arrived);
                count(if is_passed_on { &link.counters.readings } else { &link.counters.bad_readings });
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

fn subscribe(
    link: &Link,
    topic: &Topic,
    inlet: usize,
    sender: SyncSender<Arrived>,
) -> anyhow::Result<Subscriber<()>> {
    let counters = link.counters.clone();
    let take = move |sample: Sample| {
        let is_reading = sample.kind() == SampleKind::Put && sample.payload().len() <= MAX_BYTES;
        let arrived = Arrived {
            inlet,
            t_arrival_ns: now_ns(),
            bytes: if is_reading { sample.payload().to_bytes().into_owned() } else { Vec::new() },
        };
        if sender.try_send(arrived).is_err() {
            count(&counters.bad_readings);
        }
    };
    let subscriber = link.session.declare_subscriber(link.key(topic.name())).callback(take);
    network(subscriber.allowed_origin(Locality::Remote).wait())
}

/// Pressures from a node of ROS 2, as readings.
fn subscribe_ros(
    link: &Link,
    ros2: &Ros2,
    topic: &Topic,
    inlet: usize,
    sender: SyncSender<Arrived>,
) -> anyhow::Result<(ros::Inlet, Subscriber<()>)> {
    let declared = ros::Inlet::declare(link, ros2, inlet, topic)?;
    let counters = link.counters.clone();
    let is_logged = AtomicBool::new(false);
    let take = move |sample: Sample| {
        let t_arrival_ns = now_ns();
        let bytes =
            if sample.payload().len() <= MAX_BYTES { ros::reading(&sample) } else { Err("too long".into()) };
        let passed = bytes.map(|bytes| sender.try_send(Arrived { inlet, t_arrival_ns, bytes }).is_ok());
        if !passed.as_ref().is_ok_and(|is_queued| *is_queued) {
            count(&counters.bad_readings);
        }
        if let Err(error) = passed
            && !is_logged.swap(true, Ordering::Relaxed)
        {
            tracing::warn!("a message from ROS is no reading (logged once): {error}");
        }
    };
    let subscriber = link.session.declare_subscriber(declared.key.clone()).callback(take);
    Ok((declared, network(subscriber.allowed_origin(Locality::Remote).wait())?))
}

/// One sensor topic.
struct Inlet {
    topic: Topic,
    writer: Option<SensorWriter>,
    retry_at: Instant,
    clock: SenderClock,
    /// The last trouble; it is logged once.
    trouble: Option<String>,
}

impl Inlet {
    fn new(topic: &Topic) -> Self {
        Self {
            topic: topic.clone(),
            writer: None,
            retry_at: Instant::now(),
            clock: SenderClock::default(),
            trouble: None,
        }
    }

    fn open(&mut self, bus: &Bus) {
        self.retry_at = Instant::now() + RETRY;
        match SensorWriter::create(bus, &self.topic) {
            Ok(writer) => self.writer = Some(writer),
            Err(error) => self.log_once(format!("readings from the network cannot be passed on: {error}")),
        }
    }

    /// Passes a reading on; the twin checks its values. False when it is none, or cannot be passed on.
    fn pass_on(&mut self, bus: &Bus, arrived: &Arrived) -> bool {
        let sample = match decode_reading(&arrived.bytes) {
            Ok(sample) => sample,
            Err(error) => {
                self.log_once(format!("{}: a message from the network is no reading: {error}", self.topic));
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
                self.trouble = None;
                true
            }
            Err(error) => {
                self.writer = None;
                self.log_once(error.to_string());
                false
            }
        }
    }

    fn log_once(&mut self, trouble: String) {
        if self.trouble.as_ref() != Some(&trouble) {
            tracing::warn!("{trouble}");
            self.trouble = Some(trouble);
        }
    }
}
