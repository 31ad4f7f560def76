//! Hours of running programs in one domain: a steady twin that nothing disturbs, another that is killed, stopped, reloaded and
//! starved, a recorder of both, readers that verify every sample, and readers that come and go.

pub mod cycles;
mod faults;
mod observe;
mod reader;
mod summary;

use crate::testbed::{Sine, Testbed};
use crate::verify::Counts;
use anyhow::Context;
use faults::Disturbed;
use observe::{DISTURBED, Row, STEADY, echo};
use serde_json::Value;
use softtwin::daemon::{Daemon, program};
use softtwin::failure::configuration;
use softtwin::{files, output};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::PathBuf;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const EXAMPLES: &str = "\
Examples:
    cargo build --release --workspace --bins
    target/release/softtwin-studies soak --seconds 3600 --report soak.json
    target/release/softtwin-studies soak --seconds 60 --model FILE --rate-hz 1000 --no-faults";

const NOTES: &str = "\
Reports memory, files, latency drift, lost and wrong samples as one JSON object; ends with 1 when something was lost, wrong
or grew.";

/// Run twins, a recorder and readers for hours under faults, and verify every sample.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    /// Model of both twins; it is copied, so that the file may change meanwhile.
    #[arg(long, value_name = "FILE.twin", default_value = "models/pneunet/pneunet.twin")]
    model: PathBuf,
    /// Seconds.
    #[arg(long, value_name = "S", default_value_t = 60, value_parser = clap::value_parser!(u64).range(10..=1_000_000))]
    seconds: u64,
    /// Readings a second of the steady twin.
    #[arg(long, value_name = "HZ", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rate_hz: u32,
    /// Leave the second twin undisturbed as well.
    #[arg(long)]
    no_faults: bool,
    /// Write the result to this file too.
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
}

/// The recorder looks for topics once in a while; what is sent before it has found them is not lost.
const FOUND_BY_THE_RECORDER: Duration = Duration::from_secs(1);
/// Between two faults the programs run undisturbed for this long.
const PAUSE: Duration = Duration::from_secs(5);
/// How long a reader that comes and goes stays.
const STAY: Duration = Duration::from_millis(500);

impl Args {
    /// Runs, verifies, reports.
    pub fn run(self) -> anyhow::Result<()> {
        let model = std::fs::read(&self.model)
            .with_context(|| format!("cannot read {}", self.model.display()))
            .map_err(configuration)?;
        let testbed = Testbed::new("soak")?;
        let mut soak = Soak::start(&testbed, &model, self.rate_hz)?;
        let end = Instant::now() + Duration::from_secs(self.seconds);
        let readers: Vec<_> = [STEADY, DISTURBED].map(|name| verifying(&testbed, &model, name, end)).into();
        let mut turn = 0;
        while Instant::now() < end {
            soak.rows.push(Row::observe(&testbed, [&soak.twin, &soak.bridge, &soak.recorder])?);
            soak.reader_comes_and_goes(turn)?;
            if !self.no_faults {
                soak.disturbed.disturb(&testbed, &model, turn)?;
            }
            turn += 1;
            std::thread::sleep(PAUSE);
        }
        soak.rows.push(Row::observe(&testbed, [&soak.twin, &soak.bridge, &soak.recorder])?);
        let mut verified = BTreeMap::new();
        for (name, reader) in [STEADY, DISTURBED].iter().zip(readers) {
            let counts = reader.join().map_err(|_| anyhow::anyhow!("the reader of {name} panicked"))?;
            verified.insert(*name, counts?);
        }
        let (faults, rows, record) = soak.stop(&testbed)?;
        let summary = summary::Summary::new(&rows, &record, verified, faults, turn)?;
        if let Some(path) = &self.report {
            files::save(path, serde_json::to_string_pretty(&summary)?.as_bytes())?;
        }
        output::json(&summary)?;
        anyhow::ensure!(summary.wrong.is_empty(), "{}", summary.wrong.join("; "));
        Ok(())
    }
}

fn verifying(
    testbed: &Testbed,
    model: &[u8],
    name: &'static str,
    end: Instant,
) -> JoinHandle<anyhow::Result<Counts>> {
    let (model, domain) = (model.to_vec(), testbed.domain());
    std::thread::spawn(move || reader::verify(&model, &domain, name, end))
}

/// The running programs.
struct Soak<'a> {
    testbed: &'a Testbed,
    twin: Daemon,
    bridge: Daemon,
    recorder: Daemon,
    disturbed: Disturbed,
    rows: Vec<Row>,
}

impl<'a> Soak<'a> {
    fn start(testbed: &'a Testbed, model: &[u8], rate_hz: u32) -> anyhow::Result<Self> {
        let scene = |name: &str, rate_hz: f64| {
            let file = format!("{name}.twin");
            testbed.write(&file, model)?;
            let readings = Sine::through_the_onset(rate_hz, 40.0);
            let text = readings.scene(
                name,
                file.as_ref(),
                "state = { coefficients = true }",
                &["nodes = \"all\"".into()],
            );
            testbed.write(&format!("{name}.toml"), text)
        };
        let (steady, disturbed) = (scene(STEADY, rate_hz.into())?, scene(DISTURBED, 200.0)?);
        let twin = testbed.daemon("twin", &steady, &[])?;
        let mut disturbed = Disturbed::start_twin(testbed, disturbed)?;
        let recorder = record(testbed)?;
        std::thread::sleep(FOUND_BY_THE_RECORDER);
        let bridge = testbed.daemon("bridge", &steady, &[])?;
        disturbed.start_bridge(testbed)?;
        Ok(Self { testbed, twin, bridge, recorder, disturbed, rows: Vec::new() })
    }

    /// A reader that takes a few states and ends; every third one is killed.
    fn reader_comes_and_goes(&self, turn: usize) -> anyhow::Result<()> {
        let mut reader = echo(self.testbed, "softtwin/*/state")?;
        std::thread::sleep(STAY);
        // A reader that has not installed its handler yet ends by the signal, which is no exit code 0.
        if turn.is_multiple_of(3) || reader.stop().is_err() {
            reader.kill()?;
        }
        Ok(())
    }

    /// Stops everything; returns the faults, the observations and the recorder's report.
    fn stop(mut self, testbed: &Testbed) -> anyhow::Result<(BTreeMap<&'static str, u64>, Vec<Row>, Value)> {
        self.recorder.signal(libc::SIGINT)?;
        self.recorder.wait()?;
        let record = serde_json::from_reader(File::open(testbed.path("record.json"))?)?;
        let faults = self.disturbed.stop()?;
        self.bridge.stop()?;
        self.twin.stop()?;
        Ok((faults, self.rows, record))
    }
}

fn record(testbed: &Testbed) -> anyhow::Result<Daemon> {
    let mut command = testbed.command(&program("softtwin")?);
    command.args(["record", "--rotate-mb", "256", "--keep", "4", "--json", "--out"]);
    command.arg(testbed.path("run.mcap")).stdout(File::create(testbed.path("record.json"))?);
    Daemon::start("recorder", &mut command)
}
