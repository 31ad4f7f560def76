//! Named sets of elements and nodes, and element surfaces: `*ELSET`, `*NSET`, `*SURFACE, TYPE=ELEMENT`.
//!
//! A set of tetrahedra is a volume, a set of 6-node triangles and an element surface are surfaces; so is a set of nodes, which
//! stands for the outer faces between them. Names are compared without regard to case, as the programs do.

use crate::mesh_file::{TET_FACES, Tri6};
use std::collections::{BTreeMap, HashMap, HashSet};

/// Members of a set.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum SetMembers {
    Elements,
    Nodes,
    /// Element or set of elements, and one of its faces S1 to S4.
    Faces,
}

pub(super) struct Set {
    pub(super) name: String,
    pub(super) members: SetMembers,
    /// Instance of a set of the assembly.
    pub(super) instance: Option<String>,
    /// True if a line has first, last and step.
    pub(super) generate: bool,
    pub(super) lines: Vec<Vec<String>>,
}

impl Set {
    /// Set of a keyword; `None` for a surface of nodes or without a name.
    pub(super) fn begun(keyword: &str, options: &HashMap<String, &str>) -> Option<Self> {
        let (key, members) = match keyword {
            "ELSET" => ("ELSET", SetMembers::Elements),
            "NSET" => ("NSET", SetMembers::Nodes),
            _ => ("NAME", SetMembers::Faces),
        };
        let by_faces = options.get("TYPE").is_none_or(|kind| kind.eq_ignore_ascii_case("ELEMENT"));
        let name = options.get(key).filter(|_| members != SetMembers::Faces || by_faces)?;
        Some(Self {
            name: (*name).into(),
            members,
            instance: options.get("INSTANCE").map(|instance| (*instance).into()),
            generate: options.contains_key("GENERATE"),
            lines: Vec::new(),
        })
    }

    pub(super) fn add(&mut self, line: &str) {
        let words = line.split(',').map(str::trim).filter(|word| !word.is_empty());
        self.lines.push(words.map(|word| word.trim_matches('"').to_owned()).collect());
    }
}

/// Adds an element to the set that its block names, if any.
pub(super) fn include(sets: &mut Vec<Set>, set: Option<String>, label: String) {
    let Some(name) = set else { return };
    match sets
        .last_mut()
        .filter(|set| set.members == SetMembers::Elements && set.name == name && !set.generate)
    {
        Some(set) => set.lines.push(vec![label]),
        None => sets.push(Set {
            name,
            members: SetMembers::Elements,
            instance: None,
            generate: false,
            lines: vec![vec![label]],
        }),
    }
}

/// Element of a scope: VTK's kind, position among the cells of that kind, nodes of the mesh.
pub(super) type Element = (u8, u32, Vec<u32>);

/// Most members that `GENERATE` makes of one line.
const MAX_GENERATED: u64 = 100_000_000;

/// Adds the sets to surfaces and volumes. `elements` and `nodes` are those of the scope by their numbers.
pub(super) fn resolve(
    sets: &[&Set],
    elements: &HashMap<u64, Element>,
    nodes: &HashMap<u64, u32>,
    surfaces: &mut BTreeMap<String, Vec<Tri6>>,
    volumes: &mut BTreeMap<String, Vec<u32>>,
) {
    if sets.is_empty() {
        return;
    }
    let mut found: [BTreeMap<String, Vec<u64>>; 2] = [BTreeMap::new(), BTreeMap::new()];
    for set in sets.iter().filter(|set| set.members != SetMembers::Faces) {
        let known = &mut found[usize::from(set.members == SetMembers::Nodes)];
        let members = members(set, known);
        known.entry(set.name.to_ascii_uppercase()).or_default().extend(members);
    }
    let mut written = HashSet::new();
    for set in sets {
        let name = spelling(surfaces.keys().chain(volumes.keys()), &set.name);
        if set.members == SetMembers::Faces {
            let faces = faces(set, &found[0], elements);
            surfaces.entry(name).or_default().extend(faces);
        } else if written.insert((set.members == SetMembers::Nodes, set.name.to_ascii_uppercase())) {
            let labels =
                &found[usize::from(set.members == SetMembers::Nodes)][&set.name.to_ascii_uppercase()];
            if set.members == SetMembers::Nodes {
                let inside: HashSet<u32> = labels.iter().filter_map(|n| nodes.get(n).copied()).collect();
                let faces = between(&inside, elements);
                if !faces.is_empty() {
                    surfaces.entry(name).or_default().extend(faces);
                }
                continue;
            }
            for (kind, index, nodes) in labels.iter().filter_map(|label| elements.get(label)) {
                match (*kind, <Tri6>::try_from(nodes.as_slice())) {
                    (24, _) => volumes.entry(name.clone()).or_default().push(*index),
                    (22, Ok(triangle)) => surfaces.entry(name.clone()).or_default().push(triangle),
                    _ => {}
                }
            }
        }
    }
}

/// The first spelling of the name.
fn spelling<'a>(mut known: impl Iterator<Item = &'a String>, name: &str) -> String {
    known.find(|known| known.eq_ignore_ascii_case(name)).map_or_else(|| name.into(), Clone::clone)
}

/// Numbers of a set; names within it are those of earlier sets.
fn members(set: &Set, known: &BTreeMap<String, Vec<u64>>) -> Vec<u64> {
    let mut members = Vec::new();
    for line in &set.lines {
        if set.generate {
            let numbers: Vec<u64> = line.iter().filter_map(|word| word.parse().ok()).collect();
            if let [first, last, step @ ..] = numbers.as_slice() {
                let step = step.first().copied().unwrap_or(1).max(1);
                let count = (last.saturating_sub(*first) / step).min(MAX_GENERATED);
                members.extend((0..=count).map(|k| first + k * step));
            }
            continue;
        }
        for word in line {
            match word.parse() {
                Ok(number) => members.push(number),
                Err(_) => members.extend(known.get(&word.to_ascii_uppercase()).into_iter().flatten()),
            }
        }
    }
    members
}

fn faces(set: &Set, known: &BTreeMap<String, Vec<u64>>, elements: &HashMap<u64, Element>) -> Vec<Tri6> {
    let mut faces = Vec::new();
    for line in &set.lines {
        let [element, side, ..] = line.as_slice() else { continue };
        let Some(side) = ["S1", "S2", "S3", "S4"].iter().position(|s| s.eq_ignore_ascii_case(side)) else {
            continue;
        };
        let one = element.parse().ok();
        let labels = known.get(&element.to_ascii_uppercase()).into_iter().flatten().copied().chain(one);
        for (_, _, nodes) in labels.filter_map(|label| elements.get(&label)).filter(|(kind, ..)| *kind == 24)
        {
            faces.push(TET_FACES[side].map(|k| nodes[k]));
        }
    }
    faces
}

/// Outer faces of the tetrahedra whose six nodes are in the set.
fn between(inside: &HashSet<u32>, elements: &HashMap<u64, Element>) -> Vec<Tri6> {
    let mut faces: BTreeMap<[u32; 3], (usize, Tri6)> = BTreeMap::new();
    for (_, _, nodes) in elements.values().filter(|(kind, ..)| *kind == 24) {
        for face in TET_FACES.map(|face| face.map(|k| nodes[k])) {
            if face.iter().all(|n| inside.contains(n)) {
                let mut key = [face[0], face[1], face[2]];
                key.sort_unstable();
                faces.entry(key).or_insert((0, face)).0 += 1;
            }
        }
    }
    faces.into_values().filter(|(count, _)| *count == 1).map(|(_, face)| face).collect()
}
