//! The twin that is disturbed, and the faults, one after the other.

use super::observe::echo;
use crate::testbed::Testbed;
use softtwin::daemon::Daemon;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

/// A start that fails is tried again as often, as a service manager would; each failure is counted.
const STARTS: usize = 5;
const AFTER_A_FAILED_START: Duration = Duration::from_millis(200);
/// How long a program is stopped by SIGSTOP.
const STOPPED: Duration = Duration::from_millis(500);
/// How long a reader is stopped: longer than its buffers last.
const STOPPED_READER: Duration = Duration::from_secs(2);
/// Time for a reload.
const RELOAD: Duration = Duration::from_secs(1);
/// Size of the file that keeps the disk busy, MB.
const BALLAST_MB: usize = 2000;
/// Byte of the model file at which it is damaged.
const DAMAGED_AT: usize = 5000;

/// Name and action of each fault, in the order in which they come.
type Fault = (&'static str, fn(&mut Disturbed, &Testbed, &[u8]) -> anyhow::Result<()>);
const FAULTS: [Fault; 9] = [
    ("kill_bridge", |d, testbed, _| {
        d.bridge.take().map_or(Ok(()), |mut bridge| bridge.kill())?;
        d.start_bridge(testbed)
    }),
    ("kill_twin", |d, testbed, _| {
        d.twin.kill()?;
        d.restart_twin(testbed)
    }),
    ("stop_bridge_500ms", |d, _, _| d.bridge.as_mut().map_or(Ok(()), pause)),
    ("reload", |d, _, _| Ok(d.twin.signal(libc::SIGHUP)?)),
    ("damaged_model", damaged_model),
    ("stopped_reader", |_, testbed, _| stopped_reader(testbed)),
    ("stop_twin_500ms", |d, _, _| pause(&mut d.twin)),
    ("kill_both", |d, testbed, _| {
        d.twin.kill()?;
        d.bridge.take().map_or(Ok(()), |mut bridge| bridge.kill())?;
        d.start_bridge(testbed)?;
        d.restart_twin(testbed)
    }),
    ("busy_disk", |_, testbed, _| busy_disk(testbed)),
];

/// A twin and its bridge that are disturbed.
pub struct Disturbed {
    scene: PathBuf,
    bridge: Option<Daemon>,
    twin: Daemon,
    counts: BTreeMap<&'static str, u64>,
}

impl Disturbed {
    /// Starts the twin; the bridge comes later.
    pub fn start_twin(testbed: &Testbed, scene: PathBuf) -> anyhow::Result<Self> {
        let mut counts = BTreeMap::new();
        let twin = start(testbed, "twin", &scene, &mut counts)?;
        Ok(Self { scene, bridge: None, twin, counts })
    }

    /// Starts the bridge.
    pub fn start_bridge(&mut self, testbed: &Testbed) -> anyhow::Result<()> {
        self.bridge = Some(start(testbed, "bridge", &self.scene, &mut self.counts)?);
        Ok(())
    }

    fn restart_twin(&mut self, testbed: &Testbed) -> anyhow::Result<()> {
        self.twin = start(testbed, "twin", &self.scene, &mut self.counts)?;
        Ok(())
    }

    /// The fault of this turn.
    pub fn disturb(&mut self, testbed: &Testbed, model: &[u8], turn: usize) -> anyhow::Result<()> {
        let (name, fault) = FAULTS[turn % FAULTS.len()];
        *self.counts.entry(name).or_default() += 1;
        fault(self, testbed, model)
    }

    /// Stops both; returns how often each fault was made.
    pub fn stop(mut self) -> anyhow::Result<BTreeMap<&'static str, u64>> {
        self.bridge.as_mut().map_or(Ok(()), Daemon::stop)?;
        self.twin.stop()?;
        Ok(self.counts)
    }
}

fn start(
    testbed: &Testbed,
    role: &str,
    scene: &std::path::Path,
    counts: &mut BTreeMap<&'static str, u64>,
) -> anyhow::Result<Daemon> {
    let mut attempt = 1;
    loop {
        match testbed.daemon(role, scene, &[]) {
            Err(_) if attempt < STARTS => {
                *counts.entry("failed_start").or_default() += 1;
                attempt += 1;
                std::thread::sleep(AFTER_A_FAILED_START);
            }
            result => return result,
        }
    }
}

fn pause(daemon: &mut Daemon) -> anyhow::Result<()> {
    daemon.signal(libc::SIGSTOP)?;
    std::thread::sleep(STOPPED);
    Ok(daemon.signal(libc::SIGCONT)?)
}

/// A reload of a damaged file must leave the twin with the model it has.
fn damaged_model(disturbed: &mut Disturbed, testbed: &Testbed, model: &[u8]) -> anyhow::Result<()> {
    let mut damaged = model.to_vec();
    let end = damaged.len().min(DAMAGED_AT + 6);
    damaged[end.saturating_sub(6)..end].fill(b'x');
    testbed.write("disturbed.twin", damaged)?;
    disturbed.twin.signal(libc::SIGHUP)?;
    std::thread::sleep(RELOAD);
    testbed.write("disturbed.twin", model)?;
    Ok(())
}

fn stopped_reader(testbed: &Testbed) -> anyhow::Result<()> {
    let mut reader = echo(testbed, "softtwin/disturbed/field")?;
    std::thread::sleep(STOPPED);
    reader.signal(libc::SIGSTOP)?;
    std::thread::sleep(STOPPED_READER);
    Ok(reader.kill()?)
}

/// Busy disk of recording and management files: every access takes seconds.
fn busy_disk(testbed: &Testbed) -> anyhow::Result<()> {
    let path = testbed.path("ballast");
    let mut file = std::fs::File::create(&path)?;
    let megabyte = vec![0; 1 << 20];
    (0..BALLAST_MB).try_for_each(|_| file.write_all(&megabyte))?;
    file.sync_all()?;
    Ok(std::fs::remove_file(path)?)
}
