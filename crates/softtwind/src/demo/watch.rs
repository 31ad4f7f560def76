//! The demonstration's subscriber: an ordinary reader of the field and sensor topics.

use crate::latency::{Latencies, PercentilesUs};
use crate::{output, text};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};
use wire::layout::regime;
use wire::{Bus, FieldHeader, FieldReader, SensorReader, Topic, WakeSet, Wakeable, now_ns};

/// Pause between two live lines.
const LINE_INTERVAL: Duration = Duration::from_millis(200);
/// Time without fields after the end of the bridge from which all have arrived.
const SILENCE: Duration = Duration::from_millis(300);

/// Readers and what they have received.
#[derive(Debug)]
pub(super) struct DemoWatch {
    fields: FieldReader,
    sensor: SensorReader,
    wake: WakeSet,
    live: bool,
    last_line: Instant,
    latencies: Latencies,
    summary: Summary,
}

/// The numbers of the whole demonstration.
#[derive(Debug, Serialize)]
pub(super) struct Summary {
    readings: u64,
    fields_received: u64,
    lost: u64,
    entries: u64,
    /// Fields in each regime, by its name.
    regimes: BTreeMap<&'static str, u64>,
    max_force_n: f64,
    /// From the reading's stamp until the reader has received the field.
    latency_us: PercentilesUs,
    /// Cargo profile of this build, on which the latency depends.
    build: &'static str,
    exit: &'static str,
}

const BUILD: &str = if cfg!(debug_assertions) { "dev" } else { "release" };

impl DemoWatch {
    /// Subscribes. The twin must be running, the bridge not yet.
    pub(super) fn open(bus: &Bus, actuator: &str, live: bool) -> anyhow::Result<Self> {
        let fields = FieldReader::open(bus, &Topic::field(actuator, None)?)?;
        let sensor = SensorReader::attach(bus, &Topic::sensor(actuator)?)?;
        let latencies = Latencies::new();
        let summary = Summary {
            readings: 0,
            fields_received: 0,
            lost: 0,
            entries: 0,
            regimes: BTreeMap::new(),
            max_force_n: 0.0,
            latency_us: latencies.percentiles_us(),
            build: BUILD,
            exit: "",
        };
        let wake = WakeSet::new([&fields as &dyn Wakeable]);
        Ok(Self { fields, sensor, wake, live, last_line: Instant::now(), latencies, summary })
    }

    /// Waits at most `at_most` for a field and receives all that are there. Returns how many.
    pub(super) fn receive(&mut self, at_most: Duration) -> anyhow::Result<u64> {
        self.wake.wait(at_most)?;
        let before = self.summary.fields_received;
        while let Some(sample) = self.fields.next()? {
            let latency_ns = now_ns().saturating_sub(sample.header().t_sensor_ns);
            self.record(sample.header(), latency_ns);
        }
        // The bridge numbers its readings from 1, so the newest number is their count.
        while let Some(reading) = self.sensor.next()? {
            self.summary.readings = self.summary.readings.max(reading.seq);
        }
        Ok(self.summary.fields_received - before)
    }

    /// Receives what is still under way after the bridge's end.
    pub(super) fn drain(&mut self) -> anyhow::Result<()> {
        while self.receive(SILENCE)? > 0 {}
        if self.live && std::io::stderr().is_terminal() {
            writeln!(std::io::stderr())?; // ends the live line
        }
        Ok(())
    }

    fn record(&mut self, header: &FieldHeader, latency_ns: u64) {
        let summary = &mut self.summary;
        summary.fields_received += 1;
        summary.entries = header.entries();
        *summary.regimes.entry(regime::as_str(header.regime)).or_default() += 1;
        summary.max_force_n = summary.max_force_n.max(header.contact_force_n);
        self.latencies.record_ns(latency_ns);
        if self.live && self.last_line.elapsed() >= LINE_INTERVAL {
            self.last_line = Instant::now();
            show_line(header, latency_ns);
        }
    }

    /// The numbers of the whole run.
    pub(super) fn summary(self, exit: &'static str) -> Summary {
        let lost = self.summary.readings.saturating_sub(self.summary.fields_received);
        Summary { lost, latency_us: self.latencies.percentiles_us(), exit, ..self.summary }
    }
}

/// One line to standard error, on a terminal always the same line.
fn show_line(header: &FieldHeader, latency_ns: u64) {
    let (begin, end) = if std::io::stderr().is_terminal() { ("\r", "  ") } else { ("", "\n") };
    // A closed standard error must not end the demonstration.
    let _ = write!(
        std::io::stderr(),
        "{begin}{}  max stress {:.3} MPa  {} entries  {:6.0} us{end}",
        text::field_header(header),
        header.max_von_mises_mpa,
        header.entries(),
        latency_ns as f64 / 1000.0,
    );
}

impl Summary {
    /// The summary in lines of text.
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
        let PercentilesUs { p50, p99, max } = self.latency_us;
        output!(
            "sensor stamp to received field, {BUILD} build: p50 {p50:.0} us, p99 {p99:.0} us, max {max:.0} us"
        )?;
        Ok(())
    }
}
