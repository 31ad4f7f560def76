//! A reading, its values by place and name, and the trait of a source of readings.

use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};
use wire::layout::{AGES_MAX, MARKERS_MAX, PARAMETERS_MAX, set_slot};
use wire::{SensorSample, now_ns};

/// One reading of an actuator's sensors. The bridge fills `boot_id` and `seq` of its sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Values to be sent.
    pub sample: SensorSample,
    /// Seconds from the start of the source to the time of sending; NaN for a device, which sends on arrival.
    pub due_s: f64,
}

/// Number of values of one reading: pressure, gap, force, x, y, z of each marker, then the named inputs.
pub(super) const SLOTS: usize = NAMED + PARAMETERS_MAX;
/// Slot of the pressure.
pub(super) const PRESSURE: usize = 0;
/// Slot of the gap.
pub(super) const GAP: usize = 1;
/// Slot of the measured force.
pub(super) const FORCE: usize = 2;
/// Slot of the first marker's x.
pub(super) const MARKERS: usize = 3;
/// Slot of the first named input, whose name is defined by the scene ([`InputNames`]).
pub(super) const NAMED: usize = MARKERS + 3 * MARKERS_MAX;

/// Names of the values by slot, as in scenes; those of the markers are also columns of traces.
pub(super) const QUANTITIES: [&str; NAMED] = [
    "pressure_mpa",
    "gap_mm",
    "force_n",
    "marker1_x_mm",
    "marker1_y_mm",
    "marker1_z_mm",
    "marker2_x_mm",
    "marker2_y_mm",
    "marker2_z_mm",
    "marker3_x_mm",
    "marker3_y_mm",
    "marker3_z_mm",
    "marker4_x_mm",
    "marker4_y_mm",
    "marker4_z_mm",
    "marker5_x_mm",
    "marker5_y_mm",
    "marker5_z_mm",
    "marker6_x_mm",
    "marker6_y_mm",
    "marker6_z_mm",
    "marker7_x_mm",
    "marker7_y_mm",
    "marker7_z_mm",
    "marker8_x_mm",
    "marker8_y_mm",
    "marker8_z_mm",
];

/// Slot of a value that every reading has, by name.
pub(super) fn slot(name: &str) -> Option<usize> {
    QUANTITIES.iter().position(|known| *known == name)
}

/// Bit of a value in `stale_values` and `fault_values` ([`wire::layout::value_bits`]); a marker has one bit.
pub(super) fn bit(slot: usize) -> u32 {
    let number = match slot {
        ..MARKERS => slot,
        MARKERS..NAMED => MARKERS + (slot - MARKERS) / 3,
        _ => AGES_MAX + (slot - NAMED).min(PARAMETERS_MAX - 1),
    };
    1 << number
}

pub(crate) fn value_mut(sample: &mut SensorSample, slot: usize) -> Option<&mut f64> {
    match slot {
        PRESSURE => Some(&mut sample.pressure_mpa),
        GAP => Some(&mut sample.gap_mm),
        FORCE => Some(&mut sample.measured_force_n),
        MARKERS..NAMED => {
            let marker = sample.markers_mm.get_mut((slot - MARKERS) / 3)?;
            Some([&mut marker.x, &mut marker.y, &mut marker.z].into_iter().nth((slot - MARKERS) % 3)?)
        }
        _ => sample.inputs.get_mut(slot - NAMED),
    }
}

/// The age of a slot's value, ns; a marker has one age.
pub(super) fn age_mut(sample: &mut SensorSample, slot: usize) -> Option<&mut u64> {
    let ages = &mut sample.ages_ns;
    match slot {
        PRESSURE => Some(&mut ages.pressure),
        GAP => Some(&mut ages.gap),
        FORCE => Some(&mut ages.force),
        MARKERS..NAMED => ages.markers.get_mut((slot - MARKERS) / 3),
        _ => sample.input_ages_ns.get_mut(slot - NAMED),
    }
}

/// Names of the measured model inputs in addition to pressure and gap, then of measured observables, in the order of the readings; at most
/// [`PARAMETERS_MAX`].
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct InputNames {
    names: Vec<String>,
    /// How many are inputs; the others may be missing in a reading.
    inputs: usize,
}

impl InputNames {
    /// The first [`PARAMETERS_MAX`] of `names` (scenes with more are refused).
    pub fn new<'a>(names: impl IntoIterator<Item = &'a str>) -> Self {
        let names: Vec<String> = names.into_iter().take(PARAMETERS_MAX).map(str::to_owned).collect();
        Self { inputs: names.len(), names }
    }

    /// The same with observables behind the inputs.
    #[must_use]
    pub fn with_observables<'a>(mut self, names: impl IntoIterator<Item = &'a str>) -> Self {
        let room = PARAMETERS_MAX - self.names.len();
        self.names.extend(names.into_iter().take(room).map(str::to_owned));
        self
    }

    /// The names in their order.
    pub fn iter(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(String::as_str)
    }

    /// Whether no input is among the names.
    pub fn has_no_input(&self) -> bool {
        self.inputs == 0
    }

    /// Whether the value of a name may be missing.
    pub(super) fn is_optional(&self, input: usize) -> bool {
        input >= self.inputs
    }

    /// Slot of a value by name. A named input precedes a value that every reading has: a model's `force_n` is a load, not the
    /// contact force.
    pub(crate) fn slot(&self, name: &str) -> Option<usize> {
        self.iter().position(|known| known == name).map(|at| NAMED + at).or_else(|| slot(name))
    }

    /// A sample with these names and no values.
    pub(super) fn sample(&self) -> SensorSample {
        let mut sample = SensorSample { input_count: self.names.len() as u32, ..SensorSample::default() };
        self.iter().enumerate().for_each(|(index, name)| set_slot(&mut sample.input_names, index, name));
        sample
    }
}

/// Result of polling a source.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant)] // copied once a reading; a box would allocate in the bridge's loop
pub enum Poll {
    Reading(Reading),
    /// Nothing before this time after the start, s; infinite for a device, which wakes the bridge when it has something.
    Waiting {
        /// Seconds after the start.
        until_s: f64,
    },
    /// Nothing more will come.
    End,
    /// The source failed and cannot go on; with the cause.
    Failed(String),
}

/// The sending side of the bridge's wake-up: capacity 1, a full one means that the bridge is woken already.
pub type BridgeWaker = SyncSender<()>;

/// A source of readings.
///
/// The contract of every source, which a conformance test checks: [`Self::poll`] does not block; readings come in order of
/// `due_s`, beginning at or after 0; after [`Poll::End`] it stays at the end. A source without a device gives the same
/// readings, bit for bit, for the same specification (but for the time stamp).
pub trait Source: Debug + Send {
    /// Starts the source's threads; called once, before the first poll.
    ///
    /// # Errors
    /// A thread cannot be started.
    fn start(&mut self, waker: &BridgeWaker) -> std::io::Result<()> {
        let _none_needed = waker;
        Ok(())
    }

    /// The next reading that is due `elapsed_s` after the start; infinity takes readings ahead of their time.
    fn poll(&mut self, elapsed_s: f64) -> Poll;

    /// The devices behind the source: name of the sensor, empty where the scene names none, and its counters.
    fn devices(&self) -> Vec<(String, Arc<SensorCounters>)> {
        Vec::new()
    }
}

/// A source whose readings are known ahead: sends each when it is due.
#[derive(Debug)]
pub(super) struct Scheduled<I> {
    readings: I,
    next: Option<Reading>,
}

impl<I: Iterator<Item = Reading>> Scheduled<I> {
    pub(super) fn new(mut readings: I) -> Self {
        let next = readings.next();
        Self { readings, next }
    }
}

impl<I: Iterator<Item = Reading> + Debug + Send> Source for Scheduled<I> {
    fn poll(&mut self, elapsed_s: f64) -> Poll {
        let Some(next) = self.next else { return Poll::End };
        if next.due_s > elapsed_s {
            return Poll::Waiting { until_s: next.due_s };
        }
        self.next = self.readings.next();
        let sample = SensorSample { t_sensor_ns: now_ns(), ..next.sample };
        Poll::Reading(Reading { sample, ..next })
    }
}

/// Longest wait of a reader between two polls of its source.
const POLL: Duration = Duration::from_millis(10);

/// Reads a source without a bridge, every reading ahead of its time.
#[derive(Debug)]
pub struct SourceReader {
    source: Box<dyn Source>,
    wakes: Receiver<()>,
}

impl SourceReader {
    /// Starts the source.
    ///
    /// # Errors
    /// A thread cannot be started.
    pub fn start(mut source: Box<dyn Source>) -> std::io::Result<Self> {
        let (waker, wakes) = sync_channel(1);
        source.start(&waker)?;
        Ok(Self { source, wakes })
    }

    /// Values of the next reading; `None` at the end, or when a device sends none within `patience`.
    pub fn next(&mut self, patience: Duration) -> Option<SensorSample> {
        let end = Instant::now() + patience;
        loop {
            match self.source.poll(f64::INFINITY) {
                Poll::Reading(reading) => return Some(reading.sample),
                Poll::Waiting { .. } => {
                    let left = end.saturating_duration_since(Instant::now());
                    // The device's end wakes without a reading; the channel closes with the device. A reading that is due by
                    // a clock causes no event.
                    if self.wakes.recv_timeout(left.min(POLL)).is_err() && Instant::now() >= end {
                        return None;
                    }
                }
                Poll::End | Poll::Failed(_) => return None,
            }
        }
    }

    /// The devices behind the source, see [`Source::devices`].
    pub fn devices(&self) -> Vec<(String, Arc<SensorCounters>)> {
        self.source.devices()
    }
}

/// Counters of a device's answers by outcome.
#[derive(Debug, Default)]
pub struct SensorCounters {
    /// Readings handed to the bridge.
    pub readings: AtomicU64,
    /// Requests without an answer in time.
    pub timeouts: AtomicU64,
    /// Answers with a fault code instead of values (Modbus exceptions).
    pub exceptions: AtomicU64,
    /// Answers that could not be understood.
    pub garbage: AtomicU64,
    /// Connections that broke.
    pub disconnects: AtomicU64,
    /// Connections that could not be made.
    pub refusals: AtomicU64,
    /// Readings discarded because the bridge did not take them.
    pub overflows: AtomicU64,
    /// Readings sent without a value of this sensor because it was too old.
    pub stale: AtomicU64,
}

impl SensorCounters {
    /// Names and values, in a fixed order.
    pub fn all(&self) -> [(&'static str, u64); 8] {
        [
            ("readings", &self.readings),
            ("timeouts", &self.timeouts),
            ("exceptions", &self.exceptions),
            ("garbage", &self.garbage),
            ("disconnects", &self.disconnects),
            ("refusals", &self.refusals),
            ("overflows", &self.overflows),
            ("stale", &self.stale),
        ]
        .map(|(name, counter)| (name, counter.load(Ordering::Relaxed)))
    }

    /// Names and values for people, without the zeros.
    pub fn summary(&self) -> String {
        let counted = self.all().into_iter().filter(|(name, count)| *count > 0 || *name == "readings");
        counted.map(|(name, count)| format!("{count} {name}")).collect::<Vec<_>>().join(", ")
    }
}
