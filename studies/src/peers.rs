//! One full-field prediction and one training beside numpy, EZyRB and the paper's own way.

use crate::python;
use crate::stats::median;
use crate::testbed::Testbed;
use anyhow::Context;
use serde::Deserialize;
use serde_json::Value;
use softtwin::daemon::program;
use softtwin::failure::usage;
use softtwin::output;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Instant;

const EXAMPLES: &str = "\
Examples:
    cargo build --release -p softtwin -p softtwind -p studies
    target/release/softtwin-studies peers
    target/release/softtwin-studies peers --modes 31 --model models/pneunet/pneunet.twin
    target/release/softtwin-studies peers --database fresh --rounds 10";

const NOTES: &str = "\
All on the same contact states and with one thread, measured in turn in one run. Run it in the repository's folder.
Python packages go into build/peers-venv; EZyRB is installed without PyTorch, which its POD and RBF do not use.";

/// Time a prediction and a training beside numpy, EZyRB, a Gaussian process and the paper's own way, with the errors of each on the same
/// held-back states.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    /// Database in our layout; packed snapshots are unpacked first.
    #[arg(long, value_name = "DIR", default_value = "models/pneunet/database")]
    database: PathBuf,
    /// Rounds over all of them; the median is printed.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: u16,
    /// Modes of every peer, and of softtwin where no --model is given.
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = clap::value_parser!(u16).range(1..=100))]
    modes: u16,
    /// A trained model instead of one with --modes per field.
    #[arg(long, value_name = "FILE.twin")]
    model: Option<PathBuf>,
}

const PACKAGES: [&str; 5] = ["numpy==2.2.6", "scipy==1.15.3", "scikit-learn", "matplotlib", "future"];
/// The peers know one number of modes for all fields, so softtwin gets the same here.
fn training(modes: u16) -> String {
    format!("[free]\nmodes = {{ fixed = {modes} }}\n[contact]\nmodes = {{ fixed = {modes} }}\n")
}
/// One thread: a twin has one core, and numpy's pool would take them all.
const THREADS: [&str; 3] = ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"];
/// Rows from `softtwin-studies bench --json`; the last one is compared.
const OURS: [(&str, &str); 3] = [
    ("softtwin, kernel, all modes in f32", "/kernel/f32/warm_us_p50"),
    ("softtwin, kernel", "/kernel/default/warm_us_p50"),
    ("softtwin, input to field", "/predict_us_p50"),
];

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        if !self.database.join("database.toml").exists() {
            let found = self.database.display();
            return Err(usage(format!("--database: expected a folder with database.toml, found {found}")));
        }
        let python = python::environment("peers", &PACKAGES)?;
        python::install(&python, &["--no-deps", "ezyrb==1.3.3"])?;
        let testbed = Testbed::new("peers")?;
        let database = unpacked(&self.database, &testbed)?;
        let (model, training) = self.trained(&database, &testbed)?;
        let mut peers = Peers::start(&python, &database, self.modes, &model, &testbed)?;
        let mut ours = [const { Vec::new() }; OURS.len()];
        let mut theirs = vec![Vec::new(); peers.hello.peers.len()];
        for _ in 0..self.rounds {
            for (times, us) in theirs.iter_mut().zip(peers.round()?) {
                times.push(us);
            }
            let bench = testbed.run(
                "softtwin-studies",
                &["bench", "--model", &model, "--no-live", "--samples", "500", "--json"],
            )?;
            let bench: Value = serde_json::from_str(&bench)?;
            for (times, (_, key)) in ours.iter_mut().zip(OURS) {
                times.push(bench.pointer(key).and_then(Value::as_f64).context("bench reports no time")?);
            }
        }
        let [.., input_to_field] = ours.each_ref().map(|times| median(times.iter().copied()));
        let Hello { entries, modes, states, held_back, own_errors_percent, .. } = peers.hello;
        output!(
            "{entries} entries, {modes} modes, {states} contact states, one thread; median of {} rounds. Errors at {held_back} held-back states, mean / 95th percentile\n",
            self.rounds
        )?;
        output!(
            "| one full field | us | softtwin is faster by | training, s | displacement, % | stress, % |"
        )?;
        output!("| --- | ---: | ---: | ---: | ---: | ---: |")?;
        let errors = |[displacement, stress]: [[f64; 2]; 2]| {
            let cell = |[mean, p95]: [f64; 2]| format!("{mean:.4} / {p95:.4}");
            format!("{} | {}", cell(displacement), cell(stress))
        };
        for (peer, times) in peers.hello.peers.iter().zip(theirs) {
            let us = median(times.into_iter());
            let Peer { name, training_s, errors_percent } = peer;
            let faster = us / input_to_field;
            output!("| {name} | {us:.0} | {faster:.1} | {training_s:.2} | {} |", errors(*errors_percent))?;
        }
        for ((name, _), times) in OURS.iter().zip(ours) {
            let us = median(times.into_iter());
            let own = errors(own_errors_percent);
            output!("| {name} | {us:.1} | {:.2} | {training} | {own} |", us / input_to_field)?;
        }
        Ok(())
    }

    /// The model that is measured, and how long its training took.
    fn trained(&self, database: &Path, testbed: &Testbed) -> anyhow::Result<(String, String)> {
        if let Some(model) = &self.model {
            return Ok((model.display().to_string(), "-".into()));
        }
        let model = testbed.path("peers.twin").display().to_string();
        let config = testbed.write("train.toml", training(self.modes))?.display().to_string();
        let (database, started) = (database.display().to_string(), Instant::now());
        testbed.run("softtwin", &["train", "--database", &database, "--config", &config, "--out", &model])?;
        Ok((model, format!("{:.2} (both regimes)", started.elapsed().as_secs_f64())))
    }
}

/// The database with plain snapshots.
fn unpacked(database: &Path, testbed: &Testbed) -> anyhow::Result<PathBuf> {
    if database.join("snapshots.npy").exists() {
        return Ok(database.to_owned());
    }
    let out = testbed.path("database");
    let paths = [database, &out].map(|path| path.display().to_string());
    testbed.run("softtwin", &["pack", "--unpack", "--database", &paths[0], "--out", &paths[1]])?;
    Ok(out)
}

/// First line of the peers' program.
#[derive(Deserialize)]
struct Hello {
    entries: usize,
    modes: usize,
    states: usize,
    held_back: usize,
    peers: Vec<Peer>,
    /// As of the peers.
    own_errors_percent: [[f64; 2]; 2],
}

#[derive(Deserialize)]
struct Peer {
    name: String,
    training_s: f64,
    /// Of displacement and stress: mean and 95th percentile over the held-back states.
    errors_percent: [[f64; 2]; 2],
}

/// The running Python program: a line in, the times of a round out.
struct Peers {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    hello: Hello,
}

impl Peers {
    fn start(
        python: &Path,
        database: &Path,
        modes: u16,
        model: &str,
        testbed: &Testbed,
    ) -> anyhow::Result<Self> {
        let mut command = Command::new(python);
        command.arg("studies/python/peers.py").arg(database).arg(testbed.path("modes.csv"));
        command.arg(modes.to_string()).arg(program("softtwin")?).arg(model);
        command.envs(THREADS.map(|name| (name, "1"))).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().context("cannot start the peers")?;
        let input = child.stdin.take().context("no standard input")?;
        let mut output = BufReader::new(child.stdout.take().context("no standard output")?);
        let hello = serde_json::from_str(&line(&mut output)?)?;
        Ok(Self { child, input, output, hello })
    }

    /// One time a peer, us.
    fn round(&mut self) -> anyhow::Result<Vec<f64>> {
        writeln!(self.input, "round")?;
        Ok(serde_json::from_str(&line(&mut self.output)?)?)
    }
}

fn line(output: &mut BufReader<ChildStdout>) -> anyhow::Result<String> {
    let mut line = String::new();
    output.read_line(&mut line)?;
    anyhow::ensure!(!line.is_empty(), "the peers' program ended; its error is above");
    Ok(line)
}

impl Drop for Peers {
    fn drop(&mut self) {
        // Ended already is fine.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
