//! A structure with three regimes, as another program leaves its results: a strip under an axial load that is straight below a load
//! and buckles to one of two sides by the sign of an imperfection, as VTU files.

use crate::cantilever::{Node, beam, vtu_of};
use rom::snapshots::Split;
use rom::synthetic::strip;
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

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
