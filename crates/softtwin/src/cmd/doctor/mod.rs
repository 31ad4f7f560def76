//! `softtwin doctor`: what keeps a twin from running, and what to do about it.

mod domain;
mod finding;
mod machine;
mod scene;
mod services;

use crate::live::DomainArgs;
use crate::output;
use anyhow::{Result, bail};
use finding::{Finding, FindingLevel};
use runtime::config::Settings;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  The machine:
    softtwin doctor
  An installed service with its scene, settings, models and sensors:
    sudo -u softtwin SOFTTWIN_ROOT=/run/softtwin softtwin doctor \\
      --scene /etc/softtwin/finger.toml --config /etc/softtwin/twin.toml
  A recorder's folder and a gateway's configuration:
    softtwin doctor --recordings /var/lib/softtwin \\
      --gateway /etc/softtwin/gateway.toml

Exit code 0 when nothing is wrong (warnings allowed), 1 otherwise. Each sensor is read once; a serial port that a running \
bridge holds cannot be read.";

/// Check shared memory, rights, versions, scene, models and sensors; each finding comes with its remedy.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Scene file whose models and sensors to check
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Settings file to check, with its real-time options
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Folder of recordings to check: free space, series, whether they grow
    #[arg(long, value_name = "DIR")]
    recordings: Option<PathBuf>,
    /// Configuration of a gateway to check, by `softtwin-gateway --check`
    #[arg(long, value_name = "FILE")]
    gateway: Option<PathBuf>,
    /// JSON instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

impl Args {
    /// Checks everything, then reports.
    ///
    /// # Errors
    /// When something is wrong.
    pub fn run(self) -> Result<()> {
        let findings = self.findings();
        if self.json {
            output::json(&findings)?;
        } else {
            for finding in &findings {
                output!("{finding}")?;
            }
        }
        match findings.iter().filter(|finding| finding.level == FindingLevel::Bad).count() {
            0 => Ok(()),
            1 => bail!("1 thing is wrong"),
            count => bail!("{count} things are wrong"),
        }
    }

    /// All findings, the machine first. A check that is not possible is a finding too.
    fn findings(&self) -> Vec<Finding> {
        let bus = self.domain.join();
        let settings = self.config.as_deref().map(Settings::load);
        let mut findings = vec![machine::shared_memory(), domain::domain(&bus)];
        if let Ok(bus) = &bus {
            findings.push(machine::management_files(&bus.folder()));
            findings.extend(domain::topics(bus));
        }
        findings.extend(machine::real_time(settings.as_ref().and_then(|settings| settings.as_ref().ok())));
        findings.extend(settings.map(|settings| match settings {
            Ok(_) => Finding::good("settings", "read, nothing wrong"),
            Err(error) => Finding::bad("settings", error, "correct the file"),
        }));
        findings.extend(self.scene.iter().flat_map(|path| scene::scene(path)));
        findings.extend(self.recordings.iter().flat_map(|path| services::recordings(path)));
        findings.extend(self.gateway.iter().map(|path| services::gateway(path)));
        findings
    }
}
