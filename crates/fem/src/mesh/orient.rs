//! Finds the tetrahedron behind each surface triangle and turns the triangle so that its normal leaves the solid.

use std::collections::HashMap;

use super::{Tet10, Tri6};

/// The four faces of a [`Tet10`] as [`Tri6`], turned so that the normal leaves the tetrahedron.
pub const FACES: [[usize; 6]; 4] =
    [[0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6]];

/// Oriented corners of every boundary face (a face of exactly one tetrahedron), by sorted corners.
pub struct Boundary(HashMap<[u32; 3], [u32; 3]>);

fn sorted(mut face: [u32; 3]) -> [u32; 3] {
    face.sort_unstable();
    face
}

impl Boundary {
    /// Collects the outer faces of a set of tetrahedra.
    #[must_use]
    pub fn new(tets: &[Tet10]) -> Self {
        let mut faces = HashMap::with_capacity(4 * tets.len());
        for tet in tets {
            for [a, b, c, ..] in FACES {
                let face = [a, b, c].map(|k| tet[k]);
                // The second owner takes the face off the boundary.
                if faces.insert(sorted(face), face).is_some() {
                    faces.remove(&sorted(face));
                }
            }
        }
        Self(faces)
    }

    /// Whether a face with these corners is on the boundary.
    #[must_use]
    pub fn has(&self, corners: [u32; 3]) -> bool {
        self.0.contains_key(&sorted(corners))
    }

    /// The triangle with its normal out of the solid; `None` when it is not a boundary face.
    #[must_use]
    pub fn outward(&self, tri: &Tri6) -> Option<Tri6> {
        let face = self.0.get(&sorted([tri[0], tri[1], tri[2]]))?;
        let start = face.iter().position(|n| *n == tri[0])?;
        if face[(start + 1) % 3] == tri[1] {
            return Some(*tri);
        }
        Some([tri[0], tri[2], tri[1], tri[5], tri[4], tri[3]])
    }
}

/// Whether oriented triangles close a surface: every edge met once in each direction.
///
/// # Errors
/// The corners of an edge that is open or met twice in one direction.
pub fn closed(triangles: &[Tri6]) -> Result<(), [u32; 2]> {
    let mut edges: HashMap<[u32; 2], i32> = HashMap::new();
    for t in triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            let sense = if a < b { 1 } else { -1 };
            *edges.entry([a.min(b), a.max(b)]).or_insert(0) += sense;
        }
    }
    edges.into_iter().find(|(_, sum)| *sum != 0).map_or(Ok(()), |(edge, _)| Err(edge))
}
