//! Reads the shared finite-element database for accuracy tests, where it is there.
//!
//! `formats` has the real readers; `rom` may not depend on it, and these forty lines keep the rule without a cycle.

#![allow(dead_code)] // every test binary uses its own part

use rom::snapshots::{Case, Database, FieldSpec, Footprint, NodeSet, RegimeKind, Split};
use std::path::{Path, PathBuf};

/// Which scene of the shared database.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum ObstacleKind {
    /// Free states and plate contact.
    Plate,
    /// The finger against a block.
    Gripper,
}

/// The shared database, or a printed notice that the test was skipped.
pub fn shared_database(scene: ObstacleKind) -> Option<Database> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    if !root.join("database/snapshots.npy").exists() {
        println!("SKIPPED: ../shared/database is not here");
        return None;
    }
    Some(read(&root, scene))
}

fn read(root: &Path, scene: ObstacleKind) -> Database {
    let cases_csv = std::fs::read_to_string(root.join("database/cases.csv")).expect("cases.csv");
    let all: Vec<(usize, Case)> = cases_csv.lines().skip(1).map(case).enumerate().collect();
    let gripper = |line: &str| line.split(',').nth(1) == Some("gripper");
    let wanted: Vec<bool> =
        cases_csv.lines().skip(1).map(|l| gripper(l) == (scene == ObstacleKind::Gripper)).collect();
    let bytes = npy(root.join("database/snapshots.npy"));
    let entries = bytes.len() / 4 / all.len();
    let mut snapshots = Vec::new();
    for (i, _) in all.iter().filter(|(i, _)| wanted[*i]) {
        let one = &bytes[i * entries * 4..(i + 1) * entries * 4];
        snapshots.extend(one.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().expect("4 bytes"))));
    }
    let nodes = npy(root.join("reference/abaqus_mesh/nodes.npy"));
    let numbers: Vec<f64> =
        nodes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().expect("8 bytes"))).collect();
    let mut database = Database {
        actuator: "pneunet".into(),
        fields: FieldSpec::of_the_paper(),
        node_count: entries / 5,
        cases: all.into_iter().filter(|(i, _)| wanted[*i]).map(|(_, c)| c).collect(),
        snapshots,
        undeformed_mm: Some(numbers.chunks_exact(3).map(|x| [x[0], x[1], x[2]]).collect()),
        surface_triangles: Vec::new(),
        node_sets: vec![NodeSet { name: "first".into(), nodes: (0..500).collect() }],
        obstacle: if scene == ObstacleKind::Gripper { Footprint::BLOCK } else { Footprint::PLATE },
        hash: [0; 32],
    };
    database.hash = database.content_hash();
    database
}

fn case(line: &str) -> Case {
    let c: Vec<&str> = line.split(',').collect();
    Case {
        name: c[0].into(),
        regime: if c[1] == "free" { RegimeKind::Free } else { RegimeKind::Contact },
        split: match c[2] {
            "train" => Split::Train,
            "test" => Split::Test,
            _ => Split::Check,
        },
        pressure_mpa: c[3].parse().expect("pressure"),
        gap_mm: c[4].parse().ok(),
        contact_force_n: c[5].parse().expect("force"),
    }
}

/// The data of an .npy file: what follows the header whose length bytes 8 and 9 give.
fn npy(path: PathBuf) -> Vec<u8> {
    let bytes = std::fs::read(path).expect("readable");
    let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[header..].to_vec()
}
