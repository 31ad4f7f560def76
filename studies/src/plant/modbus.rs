//! `softtwin-studies rig`: simulated hardware behind Modbus TCP: gauge, gap sensor, load cell and valve of an actuator that is not the twin's model.

use super::Truth;
use super::report::step_response;
use super::rig::Rig;
use super::table::PlantTable;
use control::plant::{Plant, PlantSpec};
use std::future::ready;
use std::io::{BufRead, Write};
use std::net::SocketAddr;
use std::time::{Duration, Instant};

/// Simulated hardware: sensors and a valve behind Modbus TCP.
#[derive(clap::Args)]
#[command(
    before_help = "Example, four terminals:\n  \
softtwin-studies rig --listen 127.0.0.1:5020\n  softtwind twin --scene config/scenes/rig.toml\n  \
softtwind bridge --scene config/scenes/rig.toml\n  softtwin hold --scene config/scenes/rig.toml --force-n 0.3",
    after_help = "It says `driven T` and `safe written T` or `safe watchdog T` (T: ns of the monotonic clock) when the valve opens and \
closes, and takes lines from standard input: `pull gauge|gap|cell`, `plug gauge|gap|cell`, `report`.\n\n\
Its registers and units: studies/src/plant/rig.rs."
)]
pub struct Args {
    /// Address; port 0: any, it says which.
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:5020")]
    listen: SocketAddr,
    /// The gap that really is there, mm.
    #[arg(long, value_name = "MM", default_value_t = 37.0)]
    true_gap_mm: f64,
    /// The gap that the sensor shows, mm.
    #[arg(long, value_name = "MM", default_value_t = 40.0)]
    shown_gap_mm: f64,
    /// Stiffness of the body, by that of the second mesh.
    #[arg(long, default_value_t = 1.1)]
    stiffness: f64,
    /// The force that a controller is to hold, N: only for the report.
    #[arg(long, value_name = "N", default_value_t = 0.3)]
    target_n: f64,
}

/// Step of the plant.
const STEP: Duration = Duration::from_millis(1);

impl Args {
    /// Serves the registers until the process is ended.
    pub fn run(self) -> anyhow::Result<()> {
        let Self { true_gap_mm, stiffness, .. } = self;
        let spec = PlantSpec { true_gap_mm, stiffness, ..PlantSpec::default() };
        let rig = Rig::new(Plant::new(spec, Truth::Table(PlantTable::shipped()?)), self.shown_gap_mm);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let listener = runtime.block_on(tokio::net::TcpListener::bind(self.listen))?;
        say(&format!("ready: rig at {}", listener.local_addr()?))?;
        let served = rig.clone();
        std::thread::spawn(move || {
            runtime.block_on(async {
                let server = tokio_modbus::server::tcp::Server::new(listener);
                let accept = |stream: tokio::net::TcpStream, _| {
                    let is_set = stream.set_nodelay(true);
                    ready(is_set.map(|()| Some((served.clone(), stream))))
                };
                server.serve(&accept, |_| ()).await
            })
        });
        let (asked, target_n) = (rig.clone(), self.target_n);
        std::thread::spawn(move || listen(&asked, target_n));
        let (mut last, mut due) = (Instant::now(), Instant::now());
        loop {
            due = (due + STEP).max(Instant::now());
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            let now = Instant::now();
            for event in rig.turn(now.duration_since(last).as_secs_f64()) {
                say(&format!("{} {}", event.what, event.t_ns))?;
            }
            last = now;
        }
    }
}

/// Lines from standard input until its end.
fn listen(rig: &Rig, target_n: f64) -> anyhow::Result<()> {
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let answer = match line.split_whitespace().collect::<Vec<_>>().as_slice() {
            ["pull", name] if rig.pull(name, true) => format!("pulled {name}"),
            ["plug", name] if rig.pull(name, false) => format!("plugged {name}"),
            ["report"] => {
                format!("report {}", serde_json::to_string(&step_response(target_n, &rig.points()))?)
            }
            _ => format!("`{line}`: expected pull or plug with gauge, gap or cell, or report"),
        };
        say(&answer)?;
    }
    Ok(())
}

fn say(line: &str) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}")?;
    Ok(out.flush()?)
}
