//! Time to join a shared-memory domain with many topics.

use crate::stats::median;
use crate::testbed::{Sine, Testbed};
use anyhow::Context;
use serde_json::json;
use softtwin::daemon::program;
use softtwin::output;
use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, Stdio};
use std::time::Instant;
use wire::{Bus, Domain, HealthWriter, Topic, WireError};

/// Time until a bridge is ready and until `softtwin list` has ended, in a shared-memory domain with many topics of many programs.
#[derive(clap::Args)]
pub struct Args {
    /// Topics.
    #[arg(long, value_name = "N", default_value_t = wire::qos::MAX_TOPICS - 8)]
    topics: usize,
    /// Topics per program.
    #[arg(long, value_name = "N", default_value_t = 8)]
    each: usize,
    /// Starts of each program.
    #[arg(long, value_name = "N", default_value_t = 5)]
    rounds: usize,
    /// One of these programs: writes topics from this number on until its input ends.
    #[arg(long, value_name = "N", hide = true)]
    from: Option<usize>,
}

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        if let Some(from) = self.from {
            return self.write_topics(from);
        }
        let testbed = Testbed::new("topics")?;
        let model = std::path::absolute("models/pneunet/pneunet.twin")?;
        let scene = Sine::through_the_onset(100.0, 40.0).scene("finger", &model, "", &[]);
        let scene = testbed.write("scene.toml", scene)?;
        let mut writers = Vec::new();
        for from in (0..self.topics).step_by(self.each) {
            let count = self.each.min(self.topics - from).to_string();
            let mut command = testbed.command(&program("softtwin-studies")?);
            command.args(["measure", "topics", "--topics", &count, "--from", &from.to_string()]);
            writers.push(started(command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?)?);
        }
        let (mut ready_s, mut list_s) = (Vec::new(), Vec::new());
        for _ in 0..self.rounds {
            let begin = Instant::now();
            let mut bridge = testbed.daemon("bridge", &scene, &[])?;
            ready_s.push(begin.elapsed().as_secs_f64());
            let begin = Instant::now();
            testbed.run("softtwin", &["list"])?;
            list_s.push(begin.elapsed().as_secs_f64());
            bridge.stop()?;
        }
        let programs = writers.len();
        for mut writer in writers {
            drop(writer.stdin.take());
            writer.wait()?;
        }
        output::json(&json!({
            "topics": self.topics,
            "programs": programs,
            "bridge_ready_s": median(ready_s.into_iter()),
            "list_s": median(list_s.into_iter()),
        }))
    }

    fn write_topics(&self, from: usize) -> anyhow::Result<()> {
        let bus = Bus::open(&Domain::from_env())?;
        let topics = (from..from + self.topics).map(|number| Topic::health(&format!("a{number}")));
        let writers: Result<Vec<HealthWriter>, WireError> =
            topics.map(|topic| HealthWriter::create(&bus, &topic?)).collect();
        let _writers = writers?;
        writeln!(std::io::stdout(), "ready")?;
        std::io::stdin().read_to_end(&mut Vec::new())?;
        Ok(())
    }
}

/// The program when its topics exist.
fn started(mut program: Child) -> anyhow::Result<Child> {
    let output = program.stdout.take().context("its output is a pipe")?;
    let mut line = String::new();
    BufReader::new(output).read_line(&mut line)?;
    anyhow::ensure!(line == "ready\n", "a writer of topics did not start");
    Ok(program)
}
