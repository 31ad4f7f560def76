//! The demonstration's subscriber: an ordinary reader of the field and sensor topics.

use crate::output;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};
use wire::layout::regime;
use wire::{Bus, FieldReader, FieldSample, SensorReader, Topic, WakeSet, Wakeable, WireError, now_ns};

/// Pause between two live lines.
const LINE_EVERY: Duration = Duration::from_millis(200);
/// After the bridge's end: silence of this length means that everything has come.
const SILENCE: Duration = Duration::from_millis(300);

/// Readers and what they have seen.
#[derive(Debug)]
pub(super) struct Watch {
    fields: FieldReader,
    sensor: SensorReader,
    wake: WakeSet,
    live: bool,
    last_line: Instant,
    readings: u64,
    fields_received: u64,
    entries: u64,
    regimes: BTreeMap<&'static str, u64>,
    max_force_n: f64,
    latency_us: Vec<f64>,
}

/// The end of the demonstration.
#[derive(Debug, Serialize)]
pub(super) struct Summary {
    readings: u64,
    fields_received: u64,
    lost: u64,
    entries: u64,
    regimes: BTreeMap<&'static str, u64>,
    max_force_n: f64,
    latency_us: Latency,
    exit: &'static str,
}

/// Microseconds from the reading's stamp to the field in the reader's hands.
#[derive(Debug, Serialize)]
struct Latency {
    p50: f64,
    p99: f64,
    max: f64,
}

impl Watch {
    /// Subscribes. The twin must be running, the bridge not yet.
    pub(super) fn open(bus: &Bus, actuator: &str, live: bool) -> Result<Self, WireError> {
        let fields = FieldReader::open(bus, &Topic::field(actuator, None)?)?;
        let sensor = SensorReader::attach(bus, &Topic::sensor(actuator)?)?;
        Ok(Self {
            wake: WakeSet::new([&fields as &dyn Wakeable]),
            fields,
            sensor,
            live,
            last_line: Instant::now(),
            readings: 0,
            fields_received: 0,
            entries: 0,
            regimes: BTreeMap::new(),
            max_force_n: 0.0,
            latency_us: Vec::new(),
        })
    }

    /// Waits at most `at_most` for a field and takes all that are there. Returns how many.
    pub(super) fn take(&mut self, at_most: Duration) -> anyhow::Result<u64> {
        self.wake.wait([&self.fields as &dyn Wakeable], at_most)?;
        let before = self.fields_received;
        while let Some(sample) = self.fields.next()? {
            let latency_ns = now_ns().saturating_sub(sample.header().t_sensor_ns);
            self.note(&sample, latency_ns);
        }
        // The bridge numbers its readings from 1, so the newest number is their count.
        while let Some(reading) = self.sensor.next()? {
            self.readings = self.readings.max(reading.seq);
        }
        Ok(self.fields_received - before)
    }

    /// Takes what is still on its way after the bridge's end.
    pub(super) fn drain(&mut self) -> anyhow::Result<()> {
        while self.take(SILENCE)? > 0 {}
        if self.live && std::io::stderr().is_terminal() {
            writeln!(std::io::stderr())?; // leave the live line
        }
        Ok(())
    }

    fn note(&mut self, sample: &FieldSample, latency_ns: u64) {
        let header = sample.header();
        self.fields_received += 1;
        self.entries = header.entries();
        *self.regimes.entry(regime::as_str(header.regime)).or_default() += 1;
        self.max_force_n = self.max_force_n.max(header.contact_force_n);
        self.latency_us.push(latency_ns as f64 / 1000.0);
        if self.live && self.last_line.elapsed() >= LINE_EVERY {
            self.last_line = Instant::now();
            let on_terminal = std::io::stderr().is_terminal();
            let (begin, end) = if on_terminal { ("\r", "  ") } else { ("", "\n") };
            // A closed standard error must not end the demonstration.
            let _ = write!(
                std::io::stderr(),
                "{begin}reading {:5}  P {:.4} MPa  gap {:.1} mm  {:7}  F {:.3} N  max stress {:.3} MPa  {} entries  {:6.0} us{end}",
                header.sensor_seq,
                header.pressure_mpa,
                header.gap_mm,
                regime::as_str(header.regime),
                header.contact_force_n,
                header.max_von_mises_mpa,
                header.entries(),
                latency_ns as f64 / 1000.0,
            );
        }
    }

    /// The numbers of the whole run.
    pub(super) fn summary(mut self, exit: &'static str) -> Summary {
        self.latency_us.sort_by(f64::total_cmp);
        let quantile = |share: f64| {
            let rank = (self.latency_us.len() as f64 * share).ceil() as usize;
            self.latency_us.get(rank.max(1) - 1).copied().unwrap_or(0.0)
        };
        Summary {
            readings: self.readings,
            fields_received: self.fields_received,
            lost: self.readings.saturating_sub(self.fields_received),
            entries: self.entries,
            latency_us: Latency { p50: quantile(0.5), p99: quantile(0.99), max: quantile(1.0) },
            regimes: self.regimes,
            max_force_n: self.max_force_n,
            exit,
        }
    }
}

impl Summary {
    /// The same in words.
    pub(super) fn print(&self) -> anyhow::Result<()> {
        let regimes: Vec<String> =
            self.regimes.iter().map(|(name, count)| format!("{count} {name}")).collect();
        output!(
            "{} readings, {} fields received, {} lost ({})",
            self.readings,
            self.fields_received,
            self.lost,
            self.exit
        )?;
        output!("{} entries a field; regimes: {}", self.entries, regimes.join(", "))?;
        output!("largest contact force {:.3} N", self.max_force_n)?;
        let latency = &self.latency_us;
        output!(
            "sensor stamp to field in hand: p50 {:.0} us, p99 {:.0} us, max {:.0} us",
            latency.p50,
            latency.p99,
            latency.max
        )?;
        Ok(())
    }
}
