//! A structure with three regimes, as another program leaves its results: a strip under an axial load that is straight below a load
//! and buckles to one of two sides by the sign of an imperfection, as VTU files.

use crate::Stage;
use crate::cantilever::{Node, beam, vtu_of};
use rom::snapshots::Split;
use rom::synthetic::strip;
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use train::config::{KernelKind, KernelSpec, Tail, TrainConfig};
use wire::{Bus, SensorSample, SensorWriter, Topic, now_ns};

const THICKNESS_MM: f64 = 2.0;
const LENGTH_MM: f64 = 100.0;

/// Name of the regime at a load and an imperfection.
pub fn regime(load_n: f64, imperfection_mm: f64) -> &'static str {
    strip::REGIMES[usize::from(strip::regime(load_n, imperfection_mm))]
}

/// The strip's nodes in a state.
pub fn nodes(load_n: f64, imperfection_mm: f64) -> Vec<Node> {
    let height_mm = strip::height_mm(load_n, imperfection_mm);
    let node = |(point, ..): Node| {
        let shape = (PI * point[0] / LENGTH_MM).sin();
        (
            point,
            [-1e-4 * load_n * point[0], height_mm * shape, 0.0],
            0.01 * load_n + 0.02 * height_mm.abs() * shape,
        )
    };
    beam(0.0, THICKNESS_MM).into_iter().map(node).collect()
}

/// Writes so many simulations into a folder, and `inputs.csv` with their inputs and regimes; names of the files. A fifth of the
/// states is for testing.
///
/// # Panics
/// When the folder cannot be written.
pub fn simulations(folder: &Path, count: usize) -> Vec<String> {
    let mut table = String::from("file,load_n,imperfection_mm,regime,split\n");
    let mut names = Vec::new();
    for (split, [load_n, imperfection_mm]) in strip::states(count) {
        let (load_n, imperfection_mm) = ((1e3 * load_n).round() / 1e3, (1e3 * imperfection_mm).round() / 1e3);
        let regime = regime(load_n, imperfection_mm);
        let name = format!("strip_{regime}_f{load_n}_i{imperfection_mm}.vtu");
        fs::write(folder.join(&name), vtu_of(&nodes(load_n, imperfection_mm))).unwrap();
        let split = if split == Split::Train { "train" } else { "test" };
        writeln!(table, "{name},{load_n},{imperfection_mm},{regime},{split}").unwrap();
        names.push(name);
    }
    fs::write(folder.join("inputs.csv"), table).unwrap();
    names
}

/// A model of the strip that calls its regimes so: the straight one, and those to the two sides.
///
/// # Panics
/// When it cannot be trained.
pub fn model_bytes(names: [&str; 3]) -> Vec<u8> {
    let mut database = strip::database(&strip::states(40));
    database.regime_names = names.map(String::from).to_vec();
    let mut config = TrainConfig { full_leave_one_out: false, ..TrainConfig::default() };
    config.free.kernels = vec![KernelSpec { kernel: KernelKind::Cubic, tail: Tail::Linear }];
    let (model, _) = train::train(&database, &config, &mut |_| {}).expect("the strip trains");
    model.to_bytes().expect("the strip can be written")
}

/// Writes a scene with the strip of [`model_bytes`] under measured loads, and that model as `strip.twin`.
pub fn scene(stage: &Stage, model: &[u8]) -> PathBuf {
    fs::write(stage.path("strip.twin"), model).unwrap();
    stage.write(
        "strip.toml",
        "name = \"bench\"\n[[actuator]]\nname = \"strip\"\nmodel = \"strip.twin\"\n\
         [actuator.inputs]\nload_n = \"measured\"\nimperfection_mm = 0.3\n[[actuator.output]]\n",
    )
}

/// A bridge's place: sends loads to the twin of [`scene`].
#[derive(Debug)]
pub struct Loads {
    writer: SensorWriter,
    seq: u64,
}

impl Loads {
    /// The one writer of the strip's readings.
    ///
    /// # Panics
    /// When there is another one.
    pub fn new(bus: &Bus) -> Self {
        let topic = Topic::sensor("strip").expect("a name");
        Self { writer: SensorWriter::create(bus, &topic).expect("the only writer"), seq: 0 }
    }

    /// Sends a reading of the load alone.
    ///
    /// # Panics
    /// When it cannot be sent.
    pub fn send(&mut self, load_n: f64) {
        self.seq += 1;
        let mut sample =
            SensorSample { boot_id: 1, seq: self.seq, t_sensor_ns: now_ns(), ..SensorSample::default() };
        sample.add_input("load_n", load_n);
        self.writer.publish(sample).expect("sent");
    }
}
