//! End to end: `softtwind bridge` and `softtwind twin` as processes, this process as the reader.

mod scene;

use super::measure::{Quantiles, Series};
use crate::daemon::{self, Daemon};
use crate::progress::Progress;
use crate::testbed::Testbed;
use rom::model::Model;
use scene::{Payload, Scenes, WakeUp};
use serde::Serialize;
use std::time::{Duration, Instant};
use wire::{Bus, FieldReader, StateReader, Topic, Wake, WakeSet, Wakeable, now_ns};

/// One row of the table: quantiles in microseconds, from the reading's stamp to the reader's hands.
#[derive(Debug, Clone, Serialize)]
pub struct EndToEnd {
    /// Readings a second.
    pub rate_hz: f64,
    /// What is read.
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
}

/// A row with its distribution, or why it could not be measured.
pub type Measured = Result<(EndToEnd, Series), String>;

const RATES_HZ: [f64; 3] = [100.0, 1000.0, 4000.0];
const PAYLOADS: [Payload; 4] = [Payload::StateOnly, Payload::Tip, Payload::Surface, Payload::All];
const WAKES: [WakeUp; 3] = [WakeUp::Event, WakeUp::EventAwake, WakeUp::BusyPoll];
/// Samples left out at the start of a row: the daemons' first turns touch cold memory.
const WARM_UP: Duration = Duration::from_millis(300);
/// How long the first sample may take.
const PATIENCE: Duration = Duration::from_secs(20);

/// Measures all rows, `seconds` each.
pub fn run(model: &Model, seconds: f64, progress: &mut Progress) -> anyhow::Result<Vec<Measured>> {
    if let Err(error) = daemon::program("softtwind") {
        return Ok(vec![Err(format!("end to end: {error:#}"))]);
    }
    let testbed = Testbed::new("bench")?;
    let scenes = Scenes::new(&testbed, model)?;
    let mut rows = Vec::new();
    for wake in WAKES {
        for rate_hz in RATES_HZ {
            for payload in PAYLOADS {
                let name = format!("{rate_hz} Hz, {payload:?}, {wake:?}");
                progress.step(&format!("end to end: {name}"));
                let settings = scene::Row { rate_hz, payload, wake };
                let row = row(&testbed, &scenes, settings, seconds);
                rows.push(row.map_err(|error| format!("end to end, {name}: {error:#}")));
            }
        }
    }
    Ok(rows)
}

fn row(
    testbed: &Testbed,
    scenes: &Scenes<'_>,
    settings: scene::Row,
    seconds: f64,
) -> anyhow::Result<(EndToEnd, Series)> {
    let (scene, twin_settings) = scenes.write(settings)?;
    let bus = testbed.bus()?;
    let port = Port::attach(&bus, settings.payload)?;
    let twin = testbed.daemon("twin", &scene, &["--config".as_ref(), twin_settings.as_ref()])?;
    let bridge = testbed.daemon("bridge", &scene, &[])?;
    let series = Series::new(format!("{} Hz {:?} {:?}", settings.rate_hz, settings.payload, settings.wake));
    let mut daemons = [bridge, twin];
    let listener = Listener { port, series, first: None, last: 0 }.listen(settings, seconds, &mut daemons)?;
    daemons.iter_mut().try_for_each(Daemon::stop)?;
    let (first, last) = (listener.first.unwrap_or(0), listener.last);
    let row = EndToEnd {
        rate_hz: settings.rate_hz,
        payload: settings.payload,
        wake: settings.wake,
        latency_us: listener.series.quantiles(),
        received: listener.series.len(),
        lost: (last - first + 1).saturating_sub(listener.series.len()),
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

/// Reads until the time is over.
struct Listener {
    port: Port,
    series: Series,
    first: Option<u64>,
    last: u64,
}

impl Listener {
    fn listen(mut self, row: scene::Row, seconds: f64, daemons: &mut [Daemon]) -> anyhow::Result<Self> {
        let mut wakes = WakeSet::new([self.port.wakeable()]);
        let started = Instant::now();
        let mut begin: Option<Instant> = None;
        loop {
            if row.wake != WakeUp::BusyPoll {
                let wake = wakes.wait(Duration::from_millis(100))?;
                anyhow::ensure!(wake != Wake::Signal, "interrupted");
            }
            while let Some((seq, t_sensor_ns)) = self.port.next()? {
                let latency_ns = now_ns().saturating_sub(t_sensor_ns);
                let begin = *begin.get_or_insert_with(|| Instant::now() + WARM_UP);
                if Instant::now() >= begin {
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
        anyhow::ensure!(!self.series.is_empty(), "nothing received after the warm-up");
        Ok(self)
    }
}
