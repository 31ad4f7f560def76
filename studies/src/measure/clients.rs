//! Latency from publish to readers in Rust, C and Python at 1 kHz, and of questions beside the running twin.

use super::twin::{Duration, Twin, model, print};
use crate::testbed::{Sine, Testbed, output_of};
use anyhow::Context;
use serde_json::Value;
use softtwin::daemon::program;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Latency from publish to readers in Rust, C and Python, and what questions do to the twin's own latency.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    time: Duration,
}

/// The Python of scripts/check.sh clients, which has our client's packages.
pub const PYTHON: &str = "build/clients-venv/bin/python";
/// Time after which questions are being asked without interruption.
const SETTLED: std::time::Duration = std::time::Duration::from_secs(2);

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        let seconds = self.time.seconds.to_string();
        let testbed = Testbed::new("clients")?;
        let readings =
            Sine { rate_hz: 1000.0, gap_mm: 30.0, mean_mpa: 0.045, amplitude_mpa: 0.03, frequency_hz: 0.5 };
        let scene = readings.scene("finger", &model()?, "queries = \"fields\"", &["nodes = \"all\"".into()]);
        let scene = testbed.write("scene.toml", scene)?;
        let twin = Twin::start(testbed, &scene, &[], &[])?;
        let c = compile_c(&twin.testbed)?;
        for what in ["state", "field"] {
            let ours =
                twin.testbed.run("softtwin-studies", &["measure", "latency", what, "--seconds", &seconds])?;
            print(&format!("rust {what}"), json(&ours)?)?;
            let mut command = twin.testbed.command(&c);
            print(&format!("c {what}"), json(&output_of(command.args([seconds.as_str(), what]))?)?)?;
            if Path::new(PYTHON).exists() {
                let mut command = twin.testbed.command(PYTHON.as_ref());
                command.env("PYTHONPATH", "clients/python/src").arg("clients/python/examples/latency.py");
                let theirs = output_of(command.args([what, "--seconds", &seconds]))?;
                print(&format!("python {what}"), json(&theirs)?)?;
            }
        }
        print("twin alone", twin.health(5)?.pop())?;
        let mut asking = twin.testbed.command(&program("softtwin-studies")?);
        let asking = asking
            .args(["measure", "latency", "whatif", "--seconds", &seconds])
            .stdout(Stdio::piped())
            .spawn()?;
        std::thread::sleep(SETTLED);
        print("twin while asked", twin.health(5)?.pop())?;
        let asked = asking.wait_with_output()?;
        print("rust what-if", json(&String::from_utf8_lossy(&asked.stdout))?)?;
        twin.stop()
    }
}

fn json(text: &str) -> anyhow::Result<Value> {
    serde_json::from_str(text.trim()).with_context(|| format!("expected a JSON object, found {text}"))
}

/// The C client's latency program, linked with the library beside this program by the names that an installed one has.
fn compile_c(testbed: &Testbed) -> anyhow::Result<PathBuf> {
    let library = program("softtwind")?.with_file_name("libcapi.so");
    let folder = testbed.path("lib");
    std::fs::create_dir_all(&folder)?;
    for name in ["libsofttwin.so", "libsofttwin.so.0"] {
        std::os::unix::fs::symlink(&library, folder.join(name))?;
    }
    let out = testbed.path("latency");
    let mut command = Command::new("cc");
    command.args(["-O2", "-std=c11", "clients/c/examples/latency.c", "-Icrates/capi/include", "-lsofttwin"]);
    command.arg("-L").arg(&folder).arg(format!("-Wl,-rpath,{}", folder.display())).arg("-o").arg(&out);
    output_of(&mut command)?;
    Ok(out)
}
