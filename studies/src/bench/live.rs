//! End to end: `softtwind bridge` and `softtwind twin` as processes, this process as the reader.

mod scene;

use super::measure::{Durations, Quantiles};
use crate::testbed::Testbed;
use rom::model::Model;
pub use scene::Payload;
use scene::{Scenes, WakeUp};
use serde::Serialize;
use softtwin::daemon::{self, Daemon};
use softtwin::progress::Progress;
use softtwin::resources::cpu_s;
use std::time::{Duration, Instant};
use wire::{Bus, FieldReader, StateReader, Topic, Wake, WakeSet, Wakeable, now_ns};

/// One row of the table: quantiles in microseconds, from the reading's stamp to the reader's hands.
#[derive(Debug, Clone, Serialize)]
pub struct EndToEnd {
    /// Readings a second.
    pub rate_hz: f64,
    /// Topic that is read.
    pub payload: Payload,
    /// How twin and reader wait.
    pub wake: WakeUp,
    /// Quantiles, us.
    #[serde(flatten)]
    pub latency_us: Quantiles,
    /// Samples received.
    pub received: u64,
    /// Readings between the first and the last sample that no sample answered.
    pub lost: u64,
    /// Processor time of the twin's process over the time of the row, % of a core.
    pub twin_core_percent: f64,
    /// The same of the reader.
    pub reader_core_percent: f64,
}

/// Which rows are measured.
#[derive(Debug, Clone, clap::Args)]
pub struct Rows {
    /// Seconds of each end-to-end row (0.5 to 3600).
    #[arg(long, value_name = "S", default_value_t = 4.0, value_parser = softtwin::range::number(0.5, 3600.0), help_heading = "Selection")]
    seconds: f64,
    /// Leave the end-to-end rows out.
    #[arg(long)]
    pub no_live: bool,
    /// End-to-end rows at these readings a second only.
    #[arg(long, value_name = "HZ", value_delimiter = ',', default_values_t = RATES_HZ, value_parser = softtwin::range::number(1.0, 10_000.0), help_heading = "Selection")]
    rates_hz: Vec<f64>,
    /// End-to-end rows of these payloads only.
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = PAYLOADS, help_heading = "Selection")]
    payloads: Vec<Payload>,
}

/// A row with its distribution, or why it could not be measured.
pub type Measured = Result<(EndToEnd, Durations), String>;

const RATES_HZ: [f64; 3] = [100.0, 1000.0, 4000.0];
const PAYLOADS: [Payload; 4] = [Payload::StateOnly, Payload::Tip, Payload::Surface, Payload::All];
const WAKES: [WakeUp; 3] = [WakeUp::Event, WakeUp::EventAwake, WakeUp::BusyPoll];
/// Samples left out at the start of a row: the daemons' first turns touch cold memory.
const WARM_UP: Duration = Duration::from_millis(300);
/// How long the first sample may take.
const PATIENCE: Duration = Duration::from_secs(20);

/// Measures the rows, those of one rate and payload one after the other.
pub fn run(model: &Model, rows: &Rows, progress: &mut Progress) -> anyhow::Result<Vec<Measured>> {
    if let Err(error) = daemon::program("softtwind") {
        return Ok(vec![Err(format!("end to end: {error:#}"))]);
    }
    let testbed = Testbed::new("bench")?;
    let scenes = Scenes::new(&testbed, model)?;
    let mut measured = Vec::new();
    for (&rate_hz, &payload) in
        rows.rates_hz.iter().flat_map(|rate| rows.payloads.iter().map(move |p| (rate, p)))
    {
        for wake in WAKES {
            let name = format!("{rate_hz} Hz, {payload:?}, {wake:?}");
            progress.step(&format!("end to end: {name}"));
            let row = row(&testbed, &scenes, scene::Row { rate_hz, payload, wake }, rows.seconds);
            measured.push(row.map_err(|error| format!("end to end, {name}: {error:#}")));
        }
    }
    Ok(measured)
}

fn row(
    testbed: &Testbed,
    scenes: &Scenes<'_>,
    settings: scene::Row,
    seconds: f64,
) -> anyhow::Result<(EndToEnd, Durations)> {
    let (scene, twin_settings) = scenes.write(settings)?;
    let bus = testbed.bus()?;
    let port = Port::attach(&bus, settings.payload)?;
    let twin = testbed.daemon("twin", &scene, &["--config".as_ref(), twin_settings.as_ref()])?;
    let bridge = testbed.daemon("bridge", &scene, &[])?;
    let series =
        Durations::new(format!("{} Hz {:?} {:?}", settings.rate_hz, settings.payload, settings.wake));
    let mut daemons = [bridge, twin];
    let listener = Listener { port, series, first: None, last: 0, used: [0.0; 2] };
    let listener = listener.listen(settings, seconds, &mut daemons)?;
    daemons.iter_mut().try_for_each(Daemon::stop)?;
    let (first, last) = (listener.first.unwrap_or(0), listener.last);
    let row = EndToEnd {
        rate_hz: settings.rate_hz,
        payload: settings.payload,
        wake: settings.wake,
        latency_us: listener.series.quantiles(),
        received: listener.series.len(),
        lost: (last - first + 1).saturating_sub(listener.series.len()),
        twin_core_percent: 100.0 * listener.used[0],
        reader_core_percent: 100.0 * listener.used[1],
    };
    Ok((row, listener.series))
}

/// The topic that is read.
enum Port {
    State(StateReader),
    Field(FieldReader),
}

impl Port {
    fn attach(bus: &Bus, payload: Payload) -> anyhow::Result<Self> {
        let field =
            |set| anyhow::Ok(Self::Field(FieldReader::attach(bus, &Topic::field(scene::ACTUATOR, set)?)?));
        match payload {
            Payload::StateOnly => Ok(Self::State(StateReader::attach(bus, &Topic::state(scene::ACTUATOR)?)?)),
            Payload::Tip => field(Some(scene::TIP)),
            Payload::Surface => field(Some(scene::SURFACE)),
            Payload::All => field(None),
        }
    }

    fn wakeable(&self) -> &dyn Wakeable {
        match self {
            Self::State(reader) => reader,
            Self::Field(reader) => reader,
        }
    }

    /// Sensor number and stamp of the next sample.
    fn next(&self) -> anyhow::Result<Option<(u64, u64)>> {
        Ok(match self {
            Self::State(reader) => reader.next()?.map(|state| (state.sensor_seq, state.t_sensor_ns)),
            Self::Field(reader) => {
                reader.next()?.map(|field| (field.header().sensor_seq, field.header().t_sensor_ns))
            }
        })
    }
}

/// Processor time of a process from a moment on.
struct Meter {
    process: String,
    begin_s: Option<f64>,
    since: Instant,
}

impl Meter {
    fn new(process: String) -> Self {
        let begin_s = cpu_s(&process);
        Self { process, begin_s, since: Instant::now() }
    }

    /// Fraction of a core since then; NaN if unknown.
    fn share(&self) -> f64 {
        let used_s = self.begin_s.and_then(|begin_s| Some(cpu_s(&self.process)? - begin_s));
        used_s.map_or(f64::NAN, |used_s| used_s / self.since.elapsed().as_secs_f64())
    }
}

/// Reads until the time is over.
struct Listener {
    port: Port,
    series: Durations,
    first: Option<u64>,
    last: u64,
    /// Fraction of a core that twin and reader used.
    used: [f64; 2],
}

impl Listener {
    /// `daemons`: the bridge, the twin.
    fn listen(mut self, row: scene::Row, seconds: f64, daemons: &mut [Daemon; 2]) -> anyhow::Result<Self> {
        let mut wait = WakeSet::new([self.port.wakeable()]);
        let started = Instant::now();
        let mut begin: Option<Instant> = None;
        let mut meters: Option<[Meter; 2]> = None;
        loop {
            if row.wake != WakeUp::BusyPoll {
                let wake = wait.wait(Duration::from_millis(100))?;
                anyhow::ensure!(wake != Wake::Signal, "interrupted");
            }
            while let Some((seq, t_sensor_ns)) = self.port.next()? {
                let latency_ns = now_ns().saturating_sub(t_sensor_ns);
                let begin = *begin.get_or_insert_with(|| Instant::now() + WARM_UP);
                if Instant::now() >= begin {
                    meters.get_or_insert_with(|| {
                        [daemons[1].id().to_string(), "self".to_owned()].map(Meter::new)
                    });
                    self.first.get_or_insert(seq);
                    self.last = seq;
                    self.series.push(latency_ns);
                }
            }
            match begin {
                Some(begin) if Instant::now() >= begin + Duration::from_secs_f64(seconds) => break,
                Some(_) => {}
                None => {
                    daemons.iter_mut().try_for_each(Daemon::check)?;
                    anyhow::ensure!(started.elapsed() < PATIENCE, "nothing received in {PATIENCE:?}");
                }
            }
        }
        let meters = meters.ok_or_else(|| anyhow::anyhow!("nothing received after the warm-up"))?;
        self.used = meters.map(|meter| meter.share());
        Ok(self)
    }
}
