//! Processes for a measurement, with a separate folder and shared-memory domain.

use anyhow::Context;
use softtwin::daemon::{Daemon, program};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::AtomicBool;
use wire::{Bus, Domain};

/// Folder and shared-memory domain; both are removed on drop, after the end of all programs in it.
#[derive(Debug)]
pub struct Testbed {
    folder: PathBuf,
    name: String,
}

/// Simulated readings: the pressure is a sine, the gap is constant.
#[derive(Debug, Clone, Copy)]
pub struct Sine {
    /// Readings per second.
    pub rate_hz: f64,
    /// Constant gap, mm.
    pub gap_mm: f64,
    /// Mean pressure, MPa.
    pub mean_mpa: f64,
    /// Amplitude of the pressure, MPa.
    pub amplitude_mpa: f64,
    /// Frequency of the pressure, Hz.
    pub frequency_hz: f64,
}

impl Sine {
    /// From 0.005 to 0.065 MPa and back within 2 s: through the onset of contact of the paper's actuator.
    pub const fn through_the_onset(rate_hz: f64, gap_mm: f64) -> Self {
        Self { rate_hz, gap_mm, mean_mpa: 0.035, amplitude_mpa: 0.03, frequency_hz: 0.5 }
    }

    /// The text of a scene with one actuator that is fed by these readings. `keys` are further keys of the actuator;
    /// `outputs` the keys of each field topic; an empty slice publishes the state only.
    pub fn scene(&self, actuator: &str, model: &Path, keys: &str, outputs: &[String]) -> String {
        let Self { rate_hz, gap_mm, mean_mpa, amplitude_mpa, frequency_hz } = self;
        let mut text = format!(
            "name = \"{actuator}\"\n[[actuator]]\nname = \"{actuator}\"\nmodel = {model:?}\n{keys}\n\
             [actuator.source]\nkind = \"simulate\"\nrate_hz = {rate_hz:?}\ngap_mm = {gap_mm:?}\n\
             profile = {{ shape = \"sine\", mean_mpa = {mean_mpa:?}, amplitude_mpa = {amplitude_mpa:?}, \
             frequency_hz = {frequency_hz:?} }}\n"
        );
        for output in outputs {
            text += &format!("[[actuator.output]]\n{output}\n");
        }
        text
    }
}

impl Testbed {
    /// Creates a temporary folder, and a shared-memory domain whose management files are in it.
    ///
    /// # Errors
    /// The folder cannot be created.
    pub fn new(label: &str) -> anyhow::Result<Self> {
        let name = format!("{label}_{}", std::process::id());
        let folder = std::env::temp_dir().join(format!("softtwin-{name}"));
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        Ok(Self { folder, name })
    }

    /// A file of the folder.
    pub fn path(&self, file: &str) -> PathBuf {
        self.folder.join(file)
    }

    /// Writes a file of the folder.
    ///
    /// # Errors
    /// I/O errors.
    pub fn write(&self, file: &str, content: impl AsRef<[u8]>) -> anyhow::Result<PathBuf> {
        let path = self.path(file);
        std::fs::write(&path, content).with_context(|| format!("cannot write {}", path.display()))?;
        Ok(path)
    }

    /// Shared-memory domain.
    pub fn domain(&self) -> Domain {
        Domain::of(Some(&self.name), Some(self.path("iox").display().to_string()))
    }

    /// Connection to the shared-memory domain.
    ///
    /// # Errors
    /// The shared-memory domain cannot be opened.
    pub fn bus(&self) -> anyhow::Result<Bus> {
        Ok(Bus::open(&self.domain())?)
    }

    /// Command in this shared-memory domain.
    pub fn command(&self, program: &Path) -> Command {
        let mut command = Command::new(program);
        command.env("SOFTTWIN_DOMAIN", &self.name).env("SOFTTWIN_ROOT", self.path("iox"));
        command
    }

    /// Starts `softtwind ROLE --scene SCENE MORE` and waits until it is ready.
    ///
    /// # Errors
    /// It does not start.
    pub fn daemon(&self, role: &str, scene: &Path, more: &[&OsStr]) -> anyhow::Result<Daemon> {
        let mut daemon = self.start_daemon(role, scene, more)?;
        daemon.wait_ready(&AtomicBool::new(false))?;
        Ok(daemon)
    }

    /// The same without waiting.
    ///
    /// # Errors
    /// I/O errors.
    pub fn start_daemon(&self, role: &str, scene: &Path, more: &[&OsStr]) -> anyhow::Result<Daemon> {
        let mut command = self.command(&program("softtwind")?);
        command.arg(role).arg("--scene").arg(scene).args(more).stdout(Stdio::null());
        Daemon::start(role, &mut command)
    }

    /// Runs a program of ours to its end and returns what it printed.
    ///
    /// # Errors
    /// It cannot be started or fails; the message has its standard error.
    pub fn run(&self, name: &str, arguments: &[&str]) -> anyhow::Result<String> {
        output_of(self.command(&program(name)?).args(arguments))
    }
}

/// Runs a command to its end and returns its standard output.
///
/// # Errors
/// It cannot be started or fails; the message has its standard error.
pub fn output_of(command: &mut Command) -> anyhow::Result<String> {
    let name = command.get_program().display().to_string();
    let done = command.stdin(Stdio::null()).output().with_context(|| format!("cannot start {name}"))?;
    let errors = String::from_utf8_lossy(&done.stderr);
    anyhow::ensure!(done.status.success(), "{name} ended with {}:\n{errors}", done.status);
    Ok(String::from_utf8(done.stdout)?)
}

impl Drop for Testbed {
    /// Removes shared memory that killed programs have left.
    fn drop(&mut self) {
        let prefix = self.domain().prefix;
        for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&prefix) {
                let _gone_already = std::fs::remove_file(entry.path());
            }
        }
        let _left_to_the_system = std::fs::remove_dir_all(&self.folder);
    }
}
