//! Mesh of an actuator, moved to other dimensions of the same actuator.
//!
//! Every face lies in a plane x, y or z = const. Moving these planes is a piecewise-linear map of each coordinate between
//! them; corners of elements follow it, mid-sides stay in the middle of their edges, so elements stay straight. A face
//! stays exactly on its plane, and nodes and elements keep their order.

use super::boxes::{Bounds, Boxes};
use super::file::{Actuator, Shape};
use crate::algebra::{Vec3, add, cross, dot, norm, scale, sub};
use crate::mesh::Mesh;
use formats::Diagnostic;
use formats::mesh_file::TET_EDGES;

/// Planes nearer than this are one: sums of decimal lengths differ in their last digits (mm).
const SAME_MM: f64 = 1.0e-9;

/// Nodes of `mesh`, made for `from`, moved to the dimensions of `to` (mm). Cost: linear in the nodes.
///
/// # Errors
/// Another number of chambers, planes that would cross or come apart, inverted elements.
pub fn moved_nodes(mesh: &Mesh, from: &Actuator, to: &Actuator) -> Result<Vec<Vec3>, Vec<Diagnostic>> {
    let count = |shape: &Shape<'_>| shape.chambers.count;
    let (from, to) = match (from.shape(), to.shape()) {
        (None, None) if from.support == to.support => return Ok(mesh.nodes_mm.clone()),
        (Some(a), Some(b))
            if count(&a) == count(&b)
                && from.support == to.support
                && a.chambers.opposite == b.chambers.opposite =>
        {
            (a, b)
        }
        _ => {
            let expected = "chambers and support as the mesh has them";
            let found = "another number of chambers, or another held face";
            return Err(vec![Diagnostic::new("shape", expected, found)]);
        }
    };
    let mut wrong = Vec::new();
    let (old, new) = (faces(&Boxes::of(&from)), faces(&Boxes::of(&to)));
    let maps = [0, 1, 2].map(|axis| axis_map(axis, &old, &new, &mut wrong));
    if !wrong.is_empty() {
        return Err(wrong);
    }
    if maps.iter().flatten().all(|(before, after)| before == after) {
        return Ok(mesh.nodes_mm.clone());
    }
    let follow = |p: &Vec3| -> Vec3 { std::array::from_fn(|axis| mapped(&maps[axis], p[axis])) };
    let mut nodes: Vec<Vec3> = mesh.nodes_mm.iter().map(follow).collect();
    for tet in &mesh.tets {
        for (k, [i, j]) in TET_EDGES.into_iter().enumerate() {
            let middle = |x: &[Vec3]| scale(0.5, add(x[tet[i] as usize], x[tet[j] as usize]));
            let n = tet[4 + k] as usize;
            // The offset of a mid-side node from the middle (rounding, a curved edge) is kept.
            let off = sub(mesh.nodes_mm[n], middle(&mesh.nodes_mm));
            nodes[n] = add(middle(&nodes), off);
        }
    }
    let turned = (0..mesh.tets.len()).find(|e| quality(&nodes, &mesh.tets[*e]) <= 0.0);
    match turned {
        None => Ok(nodes),
        Some(e) => {
            let node_mm = mesh.nodes_mm[mesh.tets[e][0] as usize];
            let place = format!("element {e} at {node_mm:.2?} mm");
            Err(vec![Diagnostic::new(
                place,
                "an element that keeps its side; change the measures less",
                "it turns over",
            )])
        }
    }
}

/// Smallest and mean quality of the elements at these nodes: 1 for a regular tetrahedron, 0 for a flat one.
pub fn mesh_quality(mesh: &Mesh, nodes_mm: &[Vec3]) -> (f64, f64) {
    let all = mesh.tets.iter().map(|tet| quality(nodes_mm, tet));
    let (least, sum) = all.fold((f64::INFINITY, 0.0), |(least, sum), q| (q.min(least), sum + q));
    (least, sum / mesh.tets.len() as f64)
}

/// Volume by the cube of the root-mean-square edge, scaled to 1 for a regular tetrahedron; negative if inverted.
fn quality(nodes: &[Vec3], tet: &[u32; 10]) -> f64 {
    let [a, b, c, d] = [0, 1, 2, 3].map(|k| nodes[tet[k] as usize]);
    let volume = dot(cross(sub(b, a), sub(c, a)), sub(d, a)) / 6.0;
    let squares: f64 =
        [(a, b), (a, c), (a, d), (b, c), (b, d), (c, d)].map(|(p, q)| norm(sub(p, q)).powi(2)).iter().sum();
    6.0 * 2.0_f64.sqrt() * volume / (squares / 6.0).powf(1.5)
}

/// All boxes with their names for messages.
fn faces(boxes: &Boxes) -> Vec<(String, Bounds)> {
    let mut named: Vec<(String, Bounds)> = Vec::new();
    for (name, b) in &boxes.solids {
        let name = match *name {
            "lower" => "base below the sheet",
            "upper" => "base above the sheet",
            "opposite" => "opposite body",
            name => name,
        };
        named.push((name.to_owned(), *b));
    }
    for (row, prefix) in boxes.rows.iter().zip(["", "opposite "]) {
        let mut add = |name: &str, all: &[Bounds]| {
            named.extend(all.iter().enumerate().map(|(i, b)| (format!("{prefix}{name} {}", i + 1), *b)));
        };
        add("chamber", &row.chambers);
        add("channel", &row.channels);
        named.extend(row.slots.iter().map(|(i, b)| (format!("{prefix}slot {}", i + 1), *b)));
    }
    named
}

/// Break points of one coordinate, old and new, rising.
fn axis_map(
    axis: usize,
    old: &[(String, Bounds)],
    new: &[(String, Bounds)],
    wrong: &mut Vec<Diagnostic>,
) -> Vec<(f64, f64)> {
    let ends = |(old, new): (&(String, Bounds), &(String, Bounds))| {
        [0, 1].map(|side| (old.1[axis][side], new.1[axis][side], old.0.clone()))
    };
    let mut planes: Vec<(f64, f64, String)> = old.iter().zip(new).flat_map(ends).collect();
    planes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut map: Vec<(f64, f64)> = Vec::new();
    let mut last = String::new();
    for (before, after, name) in planes {
        let place = || format!("{last} and {name}, along {}", ["x", "y", "z"][axis]);
        match map.last().copied() {
            Some((b, a)) if before - b < SAME_MM => {
                if (after - a).abs() > SAME_MM {
                    let expected = "faces that lie in one plane of the mesh stay in one plane";
                    wrong.push(Diagnostic::new(place(), expected, format!("{a} and {after} mm")));
                }
                continue;
            }
            Some((b, a)) if after <= a => {
                let expected = format!("faces in the order of the mesh ({b} and {before} mm there)");
                wrong.push(Diagnostic::new(
                    place(),
                    expected,
                    format!("{a} and {after} mm: they would cross"),
                ));
            }
            _ => {}
        }
        map.push((before, after));
        last = name;
    }
    map
}

fn mapped(map: &[(f64, f64)], value: f64) -> f64 {
    let above = map.partition_point(|(before, _)| *before < value).clamp(1, map.len() - 1);
    let [(b0, a0), (b1, a1)] = [map[above - 1], map[above]];
    a0 + (value - b0) * (a1 - a0) / (b1 - b0)
}
