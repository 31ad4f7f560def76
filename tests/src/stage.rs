//! Folder, model and shared-memory domain of one multi-process test.

use crate::synthetic;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use train::config::{KernelKind, KernelSpec, RegimeConfig, Tail, TrainConfig};
use wire::{Bus, Domain};

/// Folder and shared-memory domain of one multi-process test.
#[derive(Debug)]
pub struct Stage {
    /// Folder of the test's files.
    pub folder: tempfile::TempDir,
    /// Name of its shared-memory domain.
    pub domain_name: String,
}

/// Model file of the beam; trained once per test program.
pub fn model_bytes() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| train(KernelKind::Cubic))
}

/// Model file of the same beam with another kernel.
pub fn other_model_bytes() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| train(KernelKind::ThinPlate))
}

fn train(kernel: KernelKind) -> Vec<u8> {
    let regime = || RegimeConfig {
        kernels: vec![KernelSpec { kernel, tail: Tail::Linear }],
        ..RegimeConfig::default()
    };
    let config = TrainConfig { free: regime(), contact: regime(), ..TrainConfig::default() };
    let (model, _) = train::train(&synthetic::plate(), &config, &mut |_| {}).expect("the beam trains");
    model.to_bytes().expect("the beam can be written")
}

impl Stage {
    /// Creates a folder with the beam's model, and a separate shared-memory domain.
    pub fn new(label: &str) -> Self {
        Self::with_model(label, model_bytes())
    }

    /// As [`Self::new`], with another model in place of the beam.
    pub fn with_model(label: &str, model: &[u8]) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(folder.path().join("beam.twin"), model).expect("writable");
        Self { folder, domain_name: Domain::unique_name(label) }
    }

    /// Shared-memory domain, for ports of the test itself.
    pub fn domain(&self) -> Domain {
        Domain::of(Some(&self.domain_name), Some(self.root().display().to_string()))
    }

    /// Bus in the shared-memory domain.
    pub fn bus(&self) -> Bus {
        Bus::open(&self.domain()).expect("a shared-memory domain that can be opened")
    }

    /// Folder of iceoryx2's management files.
    pub fn root(&self) -> PathBuf {
        self.folder.path().join("iox")
    }

    /// Path of a file of the test.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file of the test.
    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, text).expect("writable");
        path
    }

    /// Scene with one finger and the given source; outputs are all nodes and the tip.
    pub fn finger(&self, source: &str) -> PathBuf {
        self.write(
            "finger.toml",
            &format!(
                r#"
                name = "finger"
                [[actuator]]
                name = "finger"
                model = "beam.twin"
                [actuator.source]
                {source}
                [[actuator.output]]
                nodes = "all"
                [[actuator.output]]
                nodes = "tip"
                fields = ["y", "displacement"]
                "#
            ),
        )
    }

    /// Scene with one finger and the given source; the output is all nodes.
    pub fn whole_finger(&self, source: &str) -> PathBuf {
        let path = self.finger(source);
        let text = std::fs::read_to_string(&path).expect("just written");
        let whole = text.rsplit_once("[[actuator.output]]").map(|(whole, _tip)| whole).expect("two outputs");
        self.write("whole.toml", whole)
    }

    /// Trace of `count` readings at `rate_hz` with linearly rising pressure.
    pub fn trace(&self, name: &str, count: usize, rate_hz: f64, to_mpa: f64, gap_mm: f64) -> PathBuf {
        let mut text = String::from("t_s,pressure_mpa,gap_mm\n");
        for row in 0..count {
            let fraction = row as f64 / (count - 1) as f64;
            text += &format!("{},{},{gap_mm}\n", row as f64 / rate_hz, fraction * to_mpa);
        }
        self.write(name, &text)
    }

    /// Files and folders of the shared-memory domain, in `/dev/shm` and in [`Self::root`].
    pub fn everything(&self) -> std::collections::BTreeSet<PathBuf> {
        let prefix = self.domain().prefix;
        let mut found = std::collections::BTreeSet::new();
        let mut folders = vec![self.root()];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
                found.insert(entry.path());
                if entry.path().is_dir() {
                    folders.push(entry.path());
                }
            }
        }
        let shared = std::fs::read_dir("/dev/shm").into_iter().flatten().flatten();
        found.extend(
            shared.filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix)).map(|e| e.path()),
        );
        found
    }

    /// Files that remain in `/dev/shm` and in [`Self::root`], without the management segment.
    pub fn leftovers(&self) -> Vec<String> {
        let prefix = self.domain().prefix;
        let mut left = Vec::new();
        for folder in [PathBuf::from("/dev/shm"), self.root()] {
            collect(&folder, &prefix, &mut left);
        }
        left
    }
}

impl Drop for Stage {
    /// Removes files that killed programs leave in shared memory.
    fn drop(&mut self) {
        let prefix = self.domain().prefix;
        for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&prefix) {
                let _gone_already_is_fine = std::fs::remove_file(entry.path());
            }
        }
    }
}

fn collect(folder: &Path, prefix: &str, left: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let name = entry.file_name().to_string_lossy().into_owned();
        if path.is_dir() {
            collect(&path, prefix, left);
        } else if name.starts_with(prefix) && !name.ends_with(".global_mgmt") {
            left.push(path.display().to_string());
        }
    }
}
