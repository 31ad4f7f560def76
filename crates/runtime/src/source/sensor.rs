//! From the raw numbers of a device to measured values: unit, calibration, filter, and the queue to the bridge.

use super::log_limit::LimitedLog;
use super::reading::{
    BridgeWaker, FORCE, GAP, InputNames, MARKERS, NAMED, PRESSURE, QUANTITIES, SensorCounters,
};
use crate::problems::Problems;
use formats::unit;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, VecDeque};
use std::fmt::Debug;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use wire::now_ns;

/// Kind of a measured quantity; each has a base unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SensorQuantity {
    /// MPa.
    Pressure,
    /// mm.
    Gap,
    /// N.
    Force,
}

impl SensorQuantity {
    fn kind(self) -> unit::Dimension {
        match self {
            Self::Pressure => unit::Dimension::Pressure,
            Self::Gap => unit::Dimension::Length,
            Self::Force => unit::Dimension::Force,
        }
    }

    /// Size of `unit` in the base unit; the base unit itself when none is named.
    pub fn factor(self, unit: Option<&str>) -> Option<f64> {
        let Some(unit) = unit else { return Some(1.0) };
        unit::unit(unit).filter(|(kind, _)| *kind == self.kind()).map(|(_, factor)| factor)
    }

    /// Adds a problem if `unit` is not one of this quantity.
    pub fn check_unit(self, unit: Option<&str>, problems: &mut Problems) {
        let (fits, found) = (self.factor(unit).is_some(), format!("`{}`", unit.unwrap_or_default()));
        problems.expect(fits, "unit", &format!("one of {}", unit::known_of(self.kind())), found);
    }
}

/// One value of a sensor as written in a scene file; `P` says where the device has it.
///
/// value = (raw x `scale` + `offset`), or `points` at raw, in `unit`; then filtered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValueSpec<P> {
    /// Where the device has it.
    pub from: P,
    /// Factor on the raw number.
    #[serde(default = "one")]
    pub scale: f64,
    /// Added after the factor, in `unit`.
    #[serde(default)]
    pub offset: f64,
    /// In place of factor and offset: raw numbers, rising, each with its value in `unit`; straight lines between them.
    #[serde(default)]
    pub points: Vec<[f64; 2]>,
    /// Raw numbers by which the device says that it has no value, such as 65535 or -9999; they become NaN.
    #[serde(default)]
    pub no_value: Vec<f64>,
    /// Unit of the result: Pa, kPa, MPa, mbar, bar, psi; um, mm, m; mN, N, gf, kgf. Default: MPa, mm or N; for a model input that
    /// is no pressure, length or force the unit at the end of its name, and no other.
    #[serde(default)]
    pub unit: Option<String>,
    #[serde(default)]
    pub filter: FilterSpec,
    /// Standard deviation of its noise, MPa, mm or N; default: that of the actuator's `sigma`.
    #[serde(default)]
    pub sigma: Option<f64>,
}

/// The values of a sensor by name: `pressure_mpa`, `gap_mm`, `force_n`, `marker1_x_mm`, ..., and measured model inputs.
pub type Values<P> = BTreeMap<String, ValueSpec<P>>;

fn one() -> f64 {
    1.0
}

/// Quantity of a value of a reading; `None` for an input other than pressure, length or force.
fn quantity(slot: usize, name: &str) -> Option<SensorQuantity> {
    match slot {
        PRESSURE => Some(SensorQuantity::Pressure),
        FORCE => Some(SensorQuantity::Force),
        GAP | MARKERS..NAMED => Some(SensorQuantity::Gap), // lengths
        _ if name.contains("_per_") => None,
        _ => match name.rsplit_once('_')?.1 {
            "mpa" => Some(SensorQuantity::Pressure),
            "mm" => Some(SensorQuantity::Gap),
            "n" => Some(SensorQuantity::Force),
            _ => None,
        },
    }
}

/// Size of `unit` in the unit of a value; `None` where it is no unit of it.
fn factor(quantity: Option<SensorQuantity>, unit: Option<&str>) -> Option<f64> {
    match (quantity, unit) {
        (Some(quantity), unit) => quantity.factor(unit),
        (None, None) => Some(1.0),
        (None, Some(_)) => None,
    }
}

/// All errors in the values of a sensor; `place` checks their places in the device.
pub(super) fn problems<P>(
    values: &Values<P>,
    inputs: &InputNames,
    problems: &mut Problems,
    mut place: impl FnMut(&P, &mut Problems),
) {
    problems.expect(!values.is_empty(), "values", "at least one value, such as pressure_mpa", "none");
    for (name, value) in values {
        let mut problems = problems.part(format_args!("values.{name}"));
        let unit = value.unit.as_deref();
        match inputs.slot(name).map(|slot| quantity(slot, name)) {
            Some(Some(quantity)) => quantity.check_unit(unit, &mut problems),
            Some(None) => {
                let found = format!("`{}`; use scale", unit.unwrap_or_default());
                problems.expect(unit.is_none(), "unit", "none, the value is in the unit of its name", found);
            }
            None => {
                let known = QUANTITIES.into_iter().chain(inputs.iter());
                let near = known.max_by(|a, b| similar(a, name).total_cmp(&similar(b, name)));
                let near = near.unwrap_or_default();
                problems.add(format_args!(
                    "expected pressure_mpa, gap_mm, force_n, marker1_x_mm to marker8_z_mm or an input that \
                     [actuator.inputs] calls measured, found `{name}`; did you mean `{near}`?"
                ));
            }
        }
        place(&value.from, &mut problems.part("from"));
        value.problems(&mut problems);
    }
}

/// How many characters two names have in common at their beginning, by their length.
fn similar(a: &str, b: &str) -> f64 {
    let same = a.chars().zip(b.chars()).take_while(|(a, b)| a == b).count();
    same as f64 / a.len().max(b.len()).max(1) as f64
}

impl<P> ValueSpec<P> {
    pub(crate) fn problems(&self, problems: &mut Problems) {
        let fits = self.scale.is_finite() && self.scale != 0.0;
        problems.expect(fits, "scale", "a finite number other than 0", self.scale);
        problems.finite("offset", self.offset);
        if !self.points.is_empty() {
            let finite = self.points.iter().flatten().all(|number| number.is_finite());
            let rising = self.points.windows(2).all(|pair| matches!(pair, [a, b] if a[0] < b[0]));
            let fits = self.points.len() >= 2 && finite && rising;
            let expected = "at least two pairs [raw, value] of finite numbers, raw rising";
            problems.expect(fits, "points", expected, format_args!("{:?}", self.points));
            let is_alone = self.scale == 1.0 && self.offset == 0.0;
            let found = "both; put the points' own scale into them";
            problems.expect(is_alone, "points", "either points or scale and offset", found);
        }
        let sigma = self.sigma.unwrap_or(1.0);
        problems.expect(sigma.is_finite() && sigma > 0.0, "sigma", "a number above 0", sigma);
        match self.filter {
            FilterSpec::Off => {}
            FilterSpec::Median(count) => {
                let fits = count % 2 == 1 && (3..=99).contains(&count);
                problems.expect(fits, "filter.median", "an odd number of readings, 3-99", count);
            }
            FilterSpec::LowPassHz(corner) => {
                let fits = corner.is_finite() && corner > 0.0;
                problems.expect(fits, "filter.low-pass-hz", "a finite frequency above 0", corner);
            }
        }
    }

    /// Conversion of the raw number to a value; `None` for an invalid name or unit.
    pub(super) fn channel(&self, name: &str, inputs: &InputNames) -> Option<Channel> {
        let slot = inputs.slot(name)?;
        let factor = factor(quantity(slot, name), self.unit.as_deref())?;
        let calibration = Calibration {
            scale: self.scale,
            offset: self.offset,
            points: self.points.clone(),
            no_value: self.no_value.clone(),
            factor,
        };
        Some(Channel { slot, calibration, filter: Filter::new(self.filter) })
    }
}

/// Raw numbers to base units.
#[derive(Debug, Clone)]
pub(super) struct Calibration {
    pub(super) scale: f64,
    pub(super) offset: f64,
    pub(super) points: Vec<[f64; 2]>,
    pub(super) no_value: Vec<f64>,
    /// Size of the unit in the base unit.
    pub(super) factor: f64,
}

impl Calibration {
    /// The value in its base unit; `None` outside the table. What is not finite stays so.
    pub(super) fn apply(&self, raw: f64) -> Option<f64> {
        if !raw.is_finite() {
            return Some(raw);
        }
        if self.no_value.contains(&raw) {
            return Some(f64::NAN);
        }
        if self.points.is_empty() {
            return Some((raw * self.scale + self.offset) * self.factor);
        }
        let between = self.points.windows(2).find_map(|pair| match pair {
            [[x0, y0], [x1, y1]] if (*x0..=*x1).contains(&raw) => {
                Some(y0 + (y1 - y0) * (raw - x0) / (x1 - x0))
            }
            _ => None,
        });
        between.map(|value| value * self.factor)
    }
}

/// One value of a sensor on its way from the device to the reading.
#[derive(Debug)]
pub(super) struct Channel {
    /// Its place in the reading.
    pub(super) slot: usize,
    pub(super) calibration: Calibration,
    pub(super) filter: Filter,
}

#[cfg(test)]
impl Channel {
    /// A value in base units after multiplication by `factor`, not filtered.
    pub(super) fn plain(slot: usize, factor: f64) -> Self {
        let calibration =
            Calibration { scale: 1.0, offset: 0.0, points: Vec::new(), no_value: Vec::new(), factor };
        Self { slot, calibration, filter: Filter::Off }
    }
}

/// A filter as written in a scene file.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FilterSpec {
    /// No filter.
    #[default]
    Off,
    /// Median of the last readings; odd, 3-99. Delays by half of them.
    Median(usize),
    /// First-order low-pass with this corner frequency, Hz.
    LowPassHz(f64),
}

/// A filter with its memory.
///
/// Numbers that are not finite pass through without effect on the memory: the twin counts them, and one NaN must not remain in
/// a low-pass.
#[derive(Debug)]
pub enum Filter {
    /// Nothing to remember.
    Off,
    /// The newest readings.
    Median {
        count: usize,
        /// Oldest first.
        recent: VecDeque<f64>,
    },
    LowPass {
        /// Time constant, s.
        tau_s: f64,
        /// When, ns, and what.
        last: Option<(u64, f64)>,
    },
}

impl Filter {
    pub fn new(spec: FilterSpec) -> Self {
        match spec {
            FilterSpec::Off => Self::Off,
            FilterSpec::Median(count) => Self::Median { count, recent: VecDeque::with_capacity(count) },
            FilterSpec::LowPassHz(corner) => {
                Self::LowPass { tau_s: 1.0 / (std::f64::consts::TAU * corner), last: None }
            }
        }
    }

    /// The filtered value of a reading taken at `t_ns`.
    pub fn apply(&mut self, t_ns: u64, value: f64) -> f64 {
        if !value.is_finite() {
            return value;
        }
        match self {
            Self::Off => value,
            Self::Median { count, recent } => {
                if recent.len() >= *count {
                    recent.pop_front();
                }
                recent.push_back(value);
                let mut sorted: Vec<f64> = recent.iter().copied().collect();
                sorted.sort_by(f64::total_cmp);
                sorted.get(sorted.len() / 2).copied().unwrap_or(value)
            }
            Self::LowPass { tau_s, last } => {
                let smooth = match *last {
                    None => value,
                    Some((before_ns, before)) => {
                        let step_s = t_ns.saturating_sub(before_ns) as f64 * 1e-9;
                        before + (value - before) * (1.0 - (-step_s / *tau_s).exp())
                    }
                };
                *last = Some((t_ns, smooth));
                smooth
            }
        }
    }
}

/// One measured value, in its base unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    /// Position among the values of a reading, see [`InputNames::slot`].
    pub(super) slot: usize,
    /// NaN with a fault.
    pub(super) value: f64,
    /// Time of the device's answer, ns.
    pub(super) t_ns: u64,
    /// Fault code as in [`wire::SensorSample::status`]; 0: none.
    pub(super) fault: u32,
}

/// The values of one answer of a device.
pub(super) type Answer = Vec<Measured>;

/// Most answers that wait for the bridge. A full queue means that the bridge hangs.
const QUEUE: usize = 1024;
/// Fault code of a value outside its calibration, see [`wire::SensorSample::status`].
const OUTSIDE_CALIBRATION: u32 = 257;

/// How the thread of a device ended: nothing yet, as it should be, or a panic with its text.
pub(super) type Ended = Arc<OnceLock<Option<String>>>;

/// The device's end of the way.
#[derive(Debug)]
pub(super) struct Feed {
    /// Text for the log: the sensor's name, the address.
    place: String,
    channels: Vec<Channel>,
    queue: SyncSender<Answer>,
    waker: Arc<OnceLock<BridgeWaker>>,
    counters: Arc<SensorCounters>,
    stop: Arc<AtomicBool>,
    error: Option<String>,
    log: Box<LimitedLog>,
}

/// The bridge's end of the way. Dropping it stops the sensor.
#[derive(Debug)]
pub(super) struct Inbox {
    pub(super) queue: Receiver<Answer>,
    pub(super) counters: Arc<SensorCounters>,
    /// The slots of its values.
    pub(super) slots: Vec<usize>,
    pub(super) ended: Ended,
    stop: Arc<AtomicBool>,
    /// Keeps the device path open for others that join, as long as this sensor lives.
    pub(super) path: Option<Box<dyn Debug + Send>>,
}

impl Drop for Inbox {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// Both ends for a sensor at `place` that delivers these values.
pub(super) fn connect(
    place: String,
    channels: Vec<Channel>,
    waker: Arc<OnceLock<BridgeWaker>>,
    ended: Ended,
) -> (Feed, Inbox) {
    let (sender, queue) = sync_channel(QUEUE);
    let (counters, stop) = (Arc::<SensorCounters>::default(), Arc::<AtomicBool>::default());
    let slots = channels.iter().map(|channel| channel.slot).collect();
    let inbox = Inbox { queue, counters: counters.clone(), slots, ended, stop: stop.clone(), path: None };
    let log = Box::new(LimitedLog::new(place.clone()));
    (Feed { place, channels, queue: sender, waker, counters, stop, error: None, log }, inbox)
}

impl Feed {
    pub(super) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Calibrates, filters and hands over raw numbers, each with the position of its value, taken at `t_ns`.
    pub(super) fn send(&mut self, t_ns: u64, raw: impl IntoIterator<Item = (usize, f64)>) {
        let (mut answer, mut outside) = (Answer::new(), None);
        for (position, raw) in raw {
            let Some(channel) = self.channels.get_mut(position) else { continue };
            let value = channel.calibration.apply(raw).map(|value| channel.filter.apply(t_ns, value));
            if value.is_none() {
                outside = Some(raw);
            }
            let fault = if value.is_none() { OUTSIDE_CALIBRATION } else { 0 };
            answer.push(Measured { slot: channel.slot, value: value.unwrap_or(f64::NAN), t_ns, fault });
        }
        match outside {
            None => self.recovered(),
            Some(raw) => {
                self.failed(|c| &c.garbage, &format!("{raw} lies outside the points of its calibration"))
            }
        }
        self.hand_over(answer);
    }

    /// Hands over the fault code of a device that cannot measure.
    pub(super) fn fault(&mut self, code: u32) {
        let (t_ns, fault) = (now_ns(), code.max(1));
        let faulty = |channel: &Channel| Measured { slot: channel.slot, value: f64::NAN, t_ns, fault };
        self.hand_over(self.channels.iter().map(faulty).collect());
    }

    fn hand_over(&self, answer: Answer) {
        match self.queue.try_send(answer) {
            Ok(()) => count(&self.counters.readings),
            Err(TrySendError::Full(_)) => count(&self.counters.overflows),
            // The bridge has ended.
            Err(TrySendError::Disconnected(_)) => self.stop.store(true, Ordering::Relaxed),
        }
        self.wake();
    }

    fn wake(&self) {
        if let Some(waker) = self.waker.get() {
            let _woken_already = waker.try_send(());
        }
    }

    /// Counts a failure; logs it when it is not the same as before.
    pub(super) fn failed(&mut self, counter: impl Fn(&SensorCounters) -> &AtomicU64, what: &str) {
        count(counter(self.counters.as_ref()));
        let what = format!("{}: {what}", self.place);
        if self.error.as_ref() != Some(&what) {
            if self.log.admits(&what) {
                tracing::warn!("{what}");
            }
            self.error = Some(what);
        }
    }

    /// Logs the end of the failures.
    pub(super) fn recovered(&mut self) {
        self.log.flush();
        if let Some(before) = self.error.take() {
            let line = format!("the sensor answers again (before: {before})");
            if self.log.admits(&line) {
                tracing::info!("{line}");
            }
        }
    }
}

fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// Waits longer after each failure, up to a limit; begins with the first pause again after a success.
#[derive(Debug)]
pub(super) struct Backoff {
    next: Duration,
    max: Duration,
}

/// First pause after a failure; longer than the silence that ends a serial frame at any usual speed.
const FIRST_PAUSE: Duration = Duration::from_millis(20);
/// Longest wait between two checks of the stop flag.
pub(super) const STOP_CHECK: Duration = Duration::from_millis(50);

impl Backoff {
    pub(super) fn new(max: Duration) -> Self {
        Self { next: FIRST_PAUSE, max: max.max(FIRST_PAUSE) }
    }

    pub(super) fn reset(&mut self) {
        self.next = FIRST_PAUSE;
    }

    /// The pause after this failure; the next is twice as long.
    pub(super) fn take(&mut self) -> Duration {
        let pause = self.next.min(self.max);
        self.next = (pause * 2).min(self.max);
        pause
    }

    /// Longest pause.
    pub(super) fn max(&self) -> Duration {
        self.max
    }
}

#[cfg(test)]
#[path = "../../tests/unit/source_sensor.rs"]
mod tests;
