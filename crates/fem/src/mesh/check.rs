//! Checks of a mesh: all errors, each with its place and remedy.

use super::types::Mesh;
use crate::algebra::{add, cross, dot, norm, scale, sub};
use formats::Diagnostic;
use formats::mesh_file::{TET_EDGES, TET_FACES, TRI_EDGES, Tet10, Tri6};
use rom::parts::Parts;
use std::collections::HashMap;

/// Largest number of listed errors of a kind.
const LISTED: usize = 5;
/// Largest offset of a mid-side node from the middle of its edge, as a fraction of the edge's length.
const MIDSIDE_SHARE: f64 = 0.05;

/// All errors in nodes, elements and surfaces; empty for a valid mesh. `O(elements)`.
pub(crate) fn diagnostics(mesh: &Mesh) -> Vec<Diagnostic> {
    let nodes = mesh.nodes_mm.len();
    let surfaces = surfaces(mesh);
    let outside = |n: &u32| *n as usize >= nodes;
    if mesh.tets.iter().flatten().any(outside) || surfaces.iter().any(|s| s.1.iter().flatten().any(outside)) {
        return vec![Diagnostic::new(
            "elements",
            format!("nodes 0 .. {nodes}"),
            "larger indices; write the mesh again",
        )];
    }
    let mut list = Vec::new();
    report(&mut list, inverted_elements(mesh), "a positive volume (swap two corners or mesh again)");
    report(
        &mut list,
        duplicate_elements(mesh),
        "every element once (remove coincident solids and mesh again)",
    );
    report(&mut list, bent_edges(mesh), "mid-side nodes in the middle of straight edges");
    report(&mut list, unused_nodes(mesh), "every node in a tetrahedron (save only physical groups)");
    report(
        &mut list,
        separate_parts(mesh),
        "one connected body (fuse or fragment the solids so that they share faces)",
    );
    report(
        &mut list,
        stray_triangles(mesh, &surfaces),
        "triangles that are faces of tetrahedra (mesh solids and surfaces together)",
    );
    list
}

fn report(list: &mut Vec<Diagnostic>, bad: Vec<(String, String)>, expected: &str) {
    let more = bad.len().saturating_sub(LISTED);
    for (i, (place, found)) in bad.into_iter().take(LISTED).enumerate() {
        let rest =
            if i + 1 == LISTED && more > 0 { format!(" (and {more} more like this)") } else { String::new() };
        list.push(Diagnostic::new(place, expected, found + &rest));
    }
}

/// Names and triangles of all surfaces.
fn surfaces(mesh: &Mesh) -> Vec<(String, &[[u32; 6]])> {
    let mut all: Vec<(String, &[[u32; 6]])> =
        vec![("sheet".into(), &mesh.sheet), ("cavity".into(), &mesh.cavity), ("bottom".into(), &mesh.bottom)];
    let further = |name: &str, i: usize| format!("{name} {}", i + 1);
    all.extend(mesh.cavities.iter().enumerate().map(|(i, t)| (further("further cavity", i), t.as_slice())));
    all.extend(mesh.films.iter().enumerate().map(|(i, t)| (further("film", i), t.as_slice())));
    for (i, slot) in mesh.slots.iter().enumerate() {
        all.push((format!("slot_lower_{i}"), &slot.lower));
        all.push((format!("slot_upper_{i}"), &slot.upper));
    }
    all
}

fn node_place(mesh: &Mesh, node: u32) -> String {
    let [x, y, z] = mesh.nodes_mm[node as usize];
    format!("({x:.3}, {y:.3}, {z:.3}) mm")
}

fn inverted_elements(mesh: &Mesh) -> Vec<(String, String)> {
    let volume = |tet: &[u32; 10]| {
        let [p, a, b, c] = [0, 1, 2, 3].map(|i| mesh.nodes_mm[tet[i] as usize]);
        dot(sub(a, p), cross(sub(b, p), sub(c, p))) / 6.0
    };
    let bad = mesh.tets.iter().enumerate().map(|(e, tet)| (e, tet, volume(tet))).filter(|(.., v)| *v <= 0.0);
    bad.map(|(e, tet, v)| (format!("element {e} at {}", node_place(mesh, tet[0])), format!("{v:.3e} mm3")))
        .collect()
}

fn sorted<const N: usize>(mut nodes: [u32; N]) -> [u32; N] {
    nodes.sort_unstable();
    nodes
}

fn duplicate_elements(mesh: &Mesh) -> Vec<(String, String)> {
    let mut first: HashMap<[u32; 4], usize> = HashMap::with_capacity(mesh.tets.len());
    let mut bad = Vec::new();
    for (e, tet) in mesh.tets.iter().enumerate() {
        let key = sorted([tet[0], tet[1], tet[2], tet[3]]);
        if let Some(other) = first.insert(key, e) {
            bad.push((
                format!("element {e} at {}", node_place(mesh, tet[0])),
                format!("the corners of element {other}"),
            ));
        }
    }
    bad
}

fn bent_edges(mesh: &Mesh) -> Vec<(String, String)> {
    let p = |n: u32| mesh.nodes_mm[n as usize];
    let mut seen = vec![false; mesh.nodes_mm.len()];
    let mut bad = Vec::new();
    for (e, tet) in mesh.tets.iter().enumerate() {
        for (k, [i, j]) in TET_EDGES.into_iter().enumerate() {
            let (a, b, m) = (p(tet[i]), p(tet[j]), tet[4 + k]);
            let (off, length) = (norm(sub(p(m), scale(0.5, add(a, b)))), norm(sub(b, a)));
            if off > MIDSIDE_SHARE * length && !std::mem::replace(&mut seen[m as usize], true) {
                let place = format!("node {m} at {}, element {e}", node_place(mesh, m));
                bad.push((place, format!("{off:.3} mm off the middle of an edge of {length:.3} mm")));
            }
        }
    }
    bad
}

fn unused_nodes(mesh: &Mesh) -> Vec<(String, String)> {
    let mut used = vec![false; mesh.nodes_mm.len()];
    mesh.tets.iter().flatten().for_each(|n| used[*n as usize] = true);
    let bad = (0..used.len()).filter(|n| !used[*n]);
    bad.map(|n| (format!("node {n} at {}", node_place(mesh, n as u32)), "in none".into())).collect()
}

/// Bodies without a common node with the first.
fn separate_parts(mesh: &Mesh) -> Vec<(String, String)> {
    let mut parts = Parts::new(mesh.nodes_mm.len(), &mesh.tets);
    let mut sizes: HashMap<u32, (usize, usize)> = HashMap::new();
    for (e, tet) in mesh.tets.iter().enumerate() {
        sizes.entry(parts.root(tet[0])).or_insert((e, 0)).1 += 1;
    }
    let mut parts: Vec<(usize, usize)> = sizes.into_values().collect();
    parts.sort_unstable();
    let others = parts.into_iter().skip(1);
    others
        .map(|(e, size)| {
            let place = format!("element {e} at {}", node_place(mesh, mesh.tets[e][0]));
            (place, format!("a part of {size} elements without a node in common with element 0"))
        })
        .collect()
}

/// Triangles whose three corners and mid-sides are not those of a tetrahedron's face.
fn stray_triangles(mesh: &Mesh, surfaces: &[(String, &[[u32; 6]])]) -> Vec<(String, String)> {
    let mut middle: HashMap<[u32; 2], u32> = HashMap::new();
    let mut faces = std::collections::HashSet::with_capacity(mesh.tets.len() * 2);
    for tet in &mesh.tets {
        for (k, [i, j]) in TET_EDGES.into_iter().enumerate() {
            middle.insert(sorted([tet[i], tet[j]]), tet[4 + k]);
        }
        for [a, b, c, ..] in TET_FACES {
            faces.insert(sorted([tet[a], tet[b], tet[c]]));
        }
    }
    let mut bad = Vec::new();
    for (name, triangles) in surfaces {
        for (t, tri) in triangles.iter().enumerate() {
            let on_edges = TRI_EDGES
                .into_iter()
                .enumerate()
                .all(|(k, [i, j])| middle.get(&sorted([tri[i], tri[j]])) == Some(&tri[3 + k]));
            if !on_edges || !faces.contains(&sorted([tri[0], tri[1], tri[2]])) {
                bad.push((
                    format!("{name}, triangle {t} at {}", node_place(mesh, tri[0])),
                    "no such face".into(),
                ));
            }
        }
    }
    bad
}

/// Oriented corners of every boundary face (a face of exactly one tetrahedron), by sorted corners.
pub(crate) struct Boundary(HashMap<[u32; 3], [u32; 3]>);

impl Boundary {
    /// Collects the outer faces of a set of tetrahedra.
    pub(crate) fn new(tets: &[Tet10]) -> Self {
        let mut faces = HashMap::with_capacity(4 * tets.len());
        for tet in tets {
            for [a, b, c, ..] in TET_FACES {
                let face = [a, b, c].map(|k| tet[k]);
                // A face with two tetrahedra is inside.
                if faces.insert(sorted(face), face).is_some() {
                    faces.remove(&sorted(face));
                }
            }
        }
        Self(faces)
    }

    /// Corners of all boundary faces, in no order.
    pub(crate) fn faces(&self) -> impl Iterator<Item = [u32; 3]> {
        self.0.values().copied()
    }

    /// True if a face with these corners is on the boundary.
    pub(crate) fn has(&self, corners: [u32; 3]) -> bool {
        self.0.contains_key(&sorted(corners))
    }

    /// The triangle with its normal out of the solid; `None` when it is not a boundary face.
    pub(crate) fn outward(&self, tri: &Tri6) -> Option<Tri6> {
        let face = self.0.get(&sorted([tri[0], tri[1], tri[2]]))?;
        let start = face.iter().position(|n| *n == tri[0])?;
        if face[(start + 1) % 3] == tri[1] {
            return Some(*tri);
        }
        Some(flipped(tri))
    }
}

/// The triangle with its normal the other way.
pub(crate) fn flipped(t: &Tri6) -> Tri6 {
    [t[0], t[2], t[1], t[5], t[4], t[3]]
}

/// Checks that oriented triangles close a surface: every edge occurs once in each direction.
///
/// # Errors
/// The corners of an edge that is open or met twice in one direction.
pub(crate) fn closed(triangles: impl IntoIterator<Item = [u32; 3]>) -> Result<(), [u32; 2]> {
    let mut edges: HashMap<[u32; 2], i32> = HashMap::new();
    for [a, b, c] in triangles {
        for (a, b) in [(a, b), (b, c), (c, a)] {
            let sense = if a < b { 1 } else { -1 };
            *edges.entry([a.min(b), a.max(b)]).or_insert(0) += sense;
        }
    }
    edges.into_iter().find(|(_, sum)| *sum != 0).map_or(Ok(()), |(edge, _)| Err(edge))
}
