//! `softtwin doctor`: what keeps a twin from running, and what to do about it.

mod checks;

use crate::live::DomainArgs;
use crate::output;
use anyhow::{Result, bail};
use checks::Subject;
use serde::Serialize;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  The machine:
    softtwin doctor
  A service as it is installed, its scene, settings, models and sensors too:
    sudo -u softtwin SOFTTWIN_ROOT=/run/softtwin softtwin doctor --scene /etc/softtwin/finger.toml --config /etc/softtwin/twin.toml

Exit code 0 when nothing is wrong (warnings allowed), 1 otherwise. Sensors are asked once; a serial port that a running bridge
holds cannot be asked.";

/// Check shared memory, rights, versions, scene, models and sensors; each finding comes with its remedy.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Scene file whose models and sensors to check
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Settings file to check, its real-time wishes too
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// JSON instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Verdict {
    /// As it should be.
    Good,
    /// Works, not as well as it could.
    Warning,
    /// Does not work.
    Bad,
}

/// One thing that was looked at.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
struct Finding {
    /// What was looked at.
    subject: String,
    verdict: Verdict,
    /// What is there.
    found: String,
    /// What to do; empty when all is well.
    remedy: String,
}

impl Finding {
    fn good(subject: impl Into<String>, found: impl Into<String>) -> Self {
        Self { subject: subject.into(), verdict: Verdict::Good, found: found.into(), remedy: String::new() }
    }

    fn warning(subject: impl Into<String>, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            subject: subject.into(),
            verdict: Verdict::Warning,
            found: found.into(),
            remedy: remedy.into(),
        }
    }

    fn bad(subject: impl Into<String>, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { verdict: Verdict::Bad, ..Self::warning(subject, found, remedy) }
    }
}

impl Args {
    /// Looks at everything, then reports.
    ///
    /// # Errors
    /// When something is wrong.
    pub fn run(self) -> Result<()> {
        let subject = Subject { scene: self.scene.as_deref(), config: self.config.as_deref() };
        let findings = subject.examine(self.domain.join());
        if self.json {
            output::json(&findings)?;
        } else {
            for finding in &findings {
                output!("{}", line(finding))?;
            }
        }
        match findings.iter().filter(|finding| finding.verdict == Verdict::Bad).count() {
            0 => Ok(()),
            1 => bail!("1 thing is wrong"),
            count => bail!("{count} things are wrong"),
        }
    }
}

fn line(finding: &Finding) -> String {
    let mark = match finding.verdict {
        Verdict::Good => "ok  ",
        Verdict::Warning => "warn",
        Verdict::Bad => "BAD ",
    };
    let mut line = format!("{mark}  {}: {}", finding.subject, finding.found);
    if !finding.remedy.is_empty() {
        line += &format!("\n      -> {}", finding.remedy);
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finding_that_is_not_good_shows_its_remedy() {
        assert_eq!(line(&Finding::good("model", "read")), "ok    model: read");
        let bad = line(&Finding::bad("/dev/shm", "1 MB free", "free space"));
        assert_eq!(bad, "BAD   /dev/shm: 1 MB free\n      -> free space");
    }
}
