//! Model, scene and settings files of a row, in a folder that goes away again.

use super::{Payload, WakeUp};
use anyhow::Context;
use rom::model::Model;
use runtime::config::{
    ActuatorSpec, FixedNodes, Gap, NodesSpec, OutputSpec, PlaceSpec, Precision, Queries, Realtime, Scene,
    Settings, StateSpec,
};
use runtime::source::{Profile, SimulateSpec, SourceSpec};
use std::path::PathBuf;

/// Name of the actuator.
pub const ACTUATOR: &str = "bench";
/// Topic of the tip's fields.
pub const TIP: &str = "tip";
/// Topic of the surface's fields.
pub const SURFACE: &str = "surface";

/// What a row measures.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// Readings a second.
    pub rate_hz: f64,
    /// What is published and read.
    pub payload: Payload,
    /// How twin and reader wait.
    pub wake: WakeUp,
}

/// The files of a row.
pub struct Files {
    /// Scene.
    pub scene: PathBuf,
    /// Settings of the twin.
    pub settings: PathBuf,
}

/// A folder in the system's temporary one.
pub struct Folder {
    path: PathBuf,
    gap_mm: f64,
    pressure_mpa: (f64, f64),
    tip: NodesSpec,
    surface: NodesSpec,
}

impl Folder {
    /// Makes the folder and saves the model there.
    pub fn create(model: &Model) -> anyhow::Result<Self> {
        let path = std::env::temp_dir().join(format!("softtwin-bench-{}", std::process::id()));
        std::fs::create_dir_all(&path).with_context(|| format!("cannot make {}", path.display()))?;
        let inputs = super::super::compute::inputs(model)?;
        let pressures = inputs.iter().map(|input| input.pressure_mpa);
        let gap_mm = inputs.first().map_or(f64::INFINITY, |input| input.gap_mm);
        let folder = Self {
            path,
            // A scene without a plate: a gap out of reach.
            gap_mm: if gap_mm.is_finite() { gap_mm } else { 1e3 },
            pressure_mpa: (pressures.clone().fold(f64::MAX, f64::min), pressures.fold(f64::MIN, f64::max)),
            tip: NodesSpec::Fixed(FixedNodes::List(super::super::compute::tip_nodes(model))),
            surface: surface(model),
        };
        std::fs::write(folder.path.join("bench.twin"), model.to_bytes()?)?;
        Ok(folder)
    }

    /// Writes scene and settings of a row.
    pub fn write(&self, row: Row) -> anyhow::Result<Files> {
        let output = |name: &str, nodes: &NodesSpec| OutputSpec {
            name: Some(name.into()),
            nodes: nodes.clone(),
            fields: Vec::new(),
            rate_hz: 0.0,
            precision: Precision::F32,
        };
        let outputs = match row.payload {
            Payload::StateOnly => Vec::new(),
            Payload::Tip => vec![output(TIP, &self.tip)],
            Payload::Surface => vec![output(SURFACE, &self.surface)],
            Payload::All => vec![output("all", &NodesSpec::default())],
        };
        let (low, high) = self.pressure_mpa;
        let profile = Profile::Sine {
            mean_mpa: (low + high) / 2.0,
            amplitude_mpa: (high - low) / 2.0,
            frequency_hz: 1.0,
        };
        let source =
            SimulateSpec { rate_hz: row.rate_hz, gap_mm: self.gap_mm, profile, ..SimulateSpec::default() };
        let scene = Scene {
            name: "bench".into(),
            actuators: vec![ActuatorSpec {
                name: ACTUATOR.into(),
                model: "bench.twin".into(),
                gap_mm: Gap::default(),
                // Every reading is answered, also after a hiccup: what is lost is then the transport's doing.
                backlog: 64,
                sensor: None,
                place: PlaceSpec::default(),
                queries: Queries::Off,
                source: Some(SourceSpec::Simulate(source)),
                state: StateSpec::default(),
                outputs,
            }],
            grasp: None,
            blocks: Vec::new(),
            folder: PathBuf::new(),
        };
        let realtime = Realtime {
            busy_poll: row.wake == WakeUp::BusyPoll,
            stay_awake: row.wake == WakeUp::EventAwake,
            prefault: true,
            ..Realtime::default()
        };
        let settings = Settings { realtime, ..Settings::default() };
        let files = Files { scene: self.path.join("scene.toml"), settings: self.path.join("twin.toml") };
        std::fs::write(&files.scene, toml::to_string(&scene)?)?;
        std::fs::write(&files.settings, toml::to_string(&settings)?)?;
        Ok(files)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // A folder that cannot be removed is the system's to clean; the measurement is done.
        let _ = std::fs::remove_dir_all(&self.path);
    }
}

/// The model's surface, or all nodes where it names none.
fn surface(model: &Model) -> NodesSpec {
    if model.header.node_sets.iter().any(|set| set.name == SURFACE) {
        return NodesSpec::Named(SURFACE.into());
    }
    NodesSpec::default()
}
