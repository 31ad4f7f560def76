//! Resource usage of the programs of a soak test.

use crate::testbed::Testbed;
use serde_json::Value;
use softtwin::daemon::{Daemon, program};
use softtwin::resources;
use std::path::Path;
use std::process::Stdio;

/// Name of the actuator whose programs nothing disturbs.
pub const STEADY: &str = "steady";
/// Name of the actuator whose programs are killed and starved.
pub const DISTURBED: &str = "disturbed";
/// Usage of a program at one moment.
#[derive(Debug, Clone, Copy, Default)]
pub struct Usage {
    /// All pages in memory, shared ones too, kB.
    pub resident_kb: u64,
    /// Private memory, kB: the rest is program code and shared memory, mapped at its first use.
    pub private_kb: u64,
    /// Open files and sockets.
    pub open_files: u64,
    /// Threads.
    pub threads: u64,
}

/// One observation of everything.
#[derive(Debug)]
pub struct Row {
    /// Steady twin, its bridge, the recorder.
    pub programs: [Usage; 3],
    /// Files of the shared-memory domain in /dev/shm.
    pub shared_memory_files: u64,
    /// Management files of the shared-memory domain.
    pub management_files: u64,
    /// `softtwin top --once --json`.
    pub top: Vec<Value>,
}

impl Row {
    /// Observes the steady twin, its bridge, the recorder, and their shared-memory domain.
    pub fn observe(testbed: &Testbed, programs: [&Daemon; 3]) -> anyhow::Result<Self> {
        let usage = |daemon: &Daemon| {
            let process = daemon.id().to_string();
            let status = |key| resources::status(&process, key).unwrap_or(0);
            Usage {
                resident_kb: status("VmRSS"),
                private_kb: status("RssAnon"),
                open_files: open_files(&process).unwrap_or(0),
                threads: status("Threads"),
            }
        };
        let prefix = testbed.domain().prefix;
        let in_domain = |name: &std::ffi::OsStr| name.to_string_lossy().starts_with(&prefix);
        let shared = std::fs::read_dir("/dev/shm")?.flatten().filter(|entry| in_domain(&entry.file_name()));
        Ok(Self {
            programs: programs.map(usage),
            shared_memory_files: shared.count() as u64,
            management_files: count_files(&testbed.path("iox")),
            top: serde_json::from_str(&testbed.run("softtwin", &["top", "--once", "--json"])?)?,
        })
    }
}

/// A reader of a topic that prints to nowhere.
pub fn echo(testbed: &Testbed, key: &str) -> anyhow::Result<Daemon> {
    let mut command = testbed.command(&program("softtwin")?);
    Daemon::start("reader", command.args(["echo", key]).stdout(Stdio::null()))
}

/// Files below a folder.
pub fn count_files(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| if entry.path().is_dir() { count_files(&entry.path()) } else { 1 }).sum()
}

/// Open files and sockets of a process.
pub fn open_files(process: &str) -> Option<u64> {
    Some(std::fs::read_dir(format!("/proc/{process}/fd")).ok()?.count() as u64)
}
