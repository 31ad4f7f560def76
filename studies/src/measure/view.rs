//! Frames a second of `softtwin view`, and the twin's latency with and without viewers.

use super::twin::{Twin, model, print};
use crate::testbed::Testbed;
use anyhow::Context;
use serde_json::{Value, json};
use softtwin::daemon::{Daemon, program};
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::Path;
use std::process::{ChildStdout, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use tungstenite::Message;

/// Frames a second of `softtwin view` at the full surface, and the twin's latency with and without viewers.
#[derive(clap::Args)]
pub struct Args {
    /// Seconds of each measurement.
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = softtwin::range::seconds)]
    seconds: f64,
}

/// Situations: no viewer, or one with browsers that draw each frame for the given time.
const SITUATIONS: [(&str, Option<&[Duration]>); 4] = [
    ("no viewer", None),
    ("a viewer without pages", Some(&[])),
    ("three pages", Some(&[Duration::ZERO; 3])),
    ("one page that draws for 200 ms", Some(&[Duration::from_millis(200)])),
];
const SCENE: &str = "config/scenes/finger.toml";

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        SITUATIONS.iter().try_for_each(|(name, pages)| self.measure(name, *pages))
    }

    fn measure(&self, name: &str, pages: Option<&[Duration]>) -> anyhow::Result<()> {
        let twin = Twin::start(Testbed::new("view")?, Path::new(SCENE), &[], &["--loop".as_ref()])?;
        let mut viewer = pages.map(|pages| Viewer::start(&twin.testbed, pages)).transpose()?;
        std::thread::sleep(Duration::from_secs_f64(self.seconds));
        let health = twin.health(1)?.pop().unwrap_or_default();
        let us = |key: &str| health[key].as_f64().map(|ns| ns / 1e3);
        let pages = viewer.as_mut().map(|viewer| viewer.stop(self.seconds)).transpose()?;
        print(
            name,
            json!({
                "latency_p50_us": us("latency_p50_ns"),
                "latency_p99_us": us("latency_p99_ns"),
                "latency_max_us": us("latency_max_ns"),
                "received": health["received"],
                "missed": health["missed"],
                "pages": pages.unwrap_or_default(),
            }),
        )?;
        twin.stop()
    }
}

/// `softtwin view` and its pages.
struct Viewer {
    program: Daemon,
    /// A viewer whose output is closed ends.
    _output: BufReader<ChildStdout>,
    stop: Arc<AtomicBool>,
    pages: Vec<JoinHandle<anyhow::Result<Page>>>,
}

/// Counts of one browser.
#[derive(Default)]
struct Page {
    frames: u64,
    bytes: usize,
    first_seq: u64,
    last_seq: u64,
}

impl Viewer {
    fn start(testbed: &Testbed, drawing: &[Duration]) -> anyhow::Result<Self> {
        let mut command = testbed.command(&program("softtwin")?);
        command.args(["view", "--port", "0", "--model"]).arg(model()?).stdout(Stdio::piped());
        let mut program = Daemon::start("view", &mut command)?;
        let output = program.stdout().context("the viewer's output was not captured")?;
        let mut output = BufReader::new(output);
        let address = address(&mut output)?;
        let stop = Arc::new(AtomicBool::new(false));
        let page = |drawing: &Duration| {
            let (address, drawing, stop) = (address.clone(), *drawing, Arc::clone(&stop));
            std::thread::spawn(move || look(&address, drawing, &stop))
        };
        let pages = drawing.iter().map(page).collect();
        Ok(Self { program, stop, pages, _output: output })
    }

    fn stop(&mut self, seconds: f64) -> anyhow::Result<Vec<Value>> {
        self.stop.store(true, Ordering::Relaxed);
        let mut found = Vec::new();
        for page in self.pages.drain(..) {
            let page = page.join().map_err(|_| anyhow::anyhow!("a page's thread panicked"))??;
            found.push(json!({
                "frames_per_s": page.frames as f64 / seconds,
                "frame_bytes": page.bytes,
                "fields_skipped": (page.last_seq - page.first_seq + 1).saturating_sub(page.frames),
            }));
        }
        self.program.stop()?;
        Ok(found)
    }
}

/// `HOST:PORT/` from the line in which the viewer prints its address.
fn address(output: &mut BufReader<ChildStdout>) -> anyhow::Result<String> {
    let mut line = String::new();
    while output.read_line(&mut line)? > 0 {
        if let Some((_, address)) = line.split_once("http://") {
            return Ok(address.trim().to_owned());
        }
        line.clear();
    }
    anyhow::bail!("the viewer did not print its address")
}

/// Browser without a picture: takes a frame, waits for `drawing`, asks for the next.
fn look(address: &str, drawing: Duration, stop: &AtomicBool) -> anyhow::Result<Page> {
    let stream = TcpStream::connect(address.trim_end_matches('/'))?;
    stream.set_read_timeout(Some(Duration::from_secs(60)))?;
    let (mut socket, _) = tungstenite::client(format!("ws://{address}ws"), stream)
        .map_err(|error| anyhow::anyhow!("the viewer refused the connection: {error}"))?;
    let mut page = Page::default();
    socket.send(Message::text(r#"{"type":"ready"}"#))?;
    while !stop.load(Ordering::Relaxed) {
        let Message::Binary(data) = socket.read()? else { continue };
        let Some((length, rest)) = data.split_first_chunk::<4>() else { continue };
        let head = rest.get(..u32::from_le_bytes(*length) as usize).unwrap_or_default();
        let head: Value = serde_json::from_slice(head)?;
        if head["kind"] != "frame" || head["count"] == 0 {
            continue;
        }
        let seq = head["seq"].as_u64().unwrap_or(0);
        if page.frames == 0 {
            page.first_seq = seq;
        }
        (page.frames, page.bytes, page.last_seq) = (page.frames + 1, data.len(), seq);
        std::thread::sleep(drawing);
        socket.send(Message::text(r#"{"type":"ready"}"#))?;
    }
    Ok(page)
}
