//! Finds the tetrahedron behind each surface triangle and turns the triangle so that its normal leaves the solid.

use std::collections::HashMap;

use formats::mesh_file::{TET_FACES, Tet10, Tri6};

/// Oriented corners of every boundary face (a face of exactly one tetrahedron), by sorted corners.
pub(crate) struct Boundary(HashMap<[u32; 3], [u32; 3]>);

fn sorted(mut face: [u32; 3]) -> [u32; 3] {
    face.sort_unstable();
    face
}

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
