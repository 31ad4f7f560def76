//! Mesh on a grid: planes through every face of the actuator, each box between them split into tetrahedra.
//!
//! Every cube becomes the six tetrahedra of Kuhn's triangulation, which is conforming on a grid. Elements are as flat as
//! the parts, so more of them are needed than from a mesher; the shape is exact, and no other program is required.

use super::boxes::Boxes;
use super::file::Shape;
use super::surfaces;
use formats::Diagnostic;
use formats::mesh_file::{MeshFile, TET_EDGES, Tet10};
use std::collections::HashMap;

/// Corner paths of the six tetrahedra of a cube; true if the orientation is left-handed.
const PATHS: [([usize; 3], bool); 6] = [
    ([0, 1, 2], false),
    ([0, 2, 1], true),
    ([1, 0, 2], true),
    ([1, 2, 0], false),
    ([2, 0, 1], false),
    ([2, 1, 0], true),
];

/// Largest number of boxes whose mesh can be solved in the memory of a usual computer.
const MAX_CUBES: usize = 200_000;

/// Meshes an actuator with elements no longer than `size_mm` along any axis, every box divided once more into `times`
/// parts along each axis; surfaces are named.
///
/// Meshes that differ in `times` alone are of one family: elements keep their shape while they shrink, so that their
/// error falls with their size. Cost: linear in the elements, about `6 x volume x times^3 / size^3`.
///
/// # Errors
/// An invalid size, 0 times, or more boxes than can be solved.
pub(crate) fn mesh(shape: &Shape<'_>, size_mm: f64, times: usize) -> Result<MeshFile, Diagnostic> {
    if !(size_mm.is_finite() && size_mm > 0.0) {
        return Err(Diagnostic::new("element size", "a finite length above 0 mm", size_mm));
    }
    if times == 0 {
        return Err(Diagnostic::new("parts of a box", "1 or more", times));
    }
    let boxes = Boxes::of(shape);
    let planes = [0, 1, 2].map(|axis| boxes.planes(axis));
    let counts = planes.each_ref().map(|axis| parts(axis, size_mm, times));
    let cubes: f64 = counts.iter().map(|axis| axis.iter().sum::<f64>()).product();
    if cubes > MAX_CUBES as f64 {
        let expected = format!("a size that makes at most {MAX_CUBES} boxes; choose a larger one");
        return Err(Diagnostic::new("element size", expected, format!("{cubes:.0} boxes at {size_mm} mm")));
    }
    let mut grid = Grid::new([0, 1, 2].map(|axis| divided(&planes[axis], &counts[axis])));
    // Elements below the sheet mirror those above it: opposite rows that are alike have meshes that are alike.
    grid.mirror_below_mm = shape.chambers.opposite.as_ref().map(|_| shape.base_mm() + shape.base.lower_mm);
    grid.fill(|centre| boxes.solid_at(centre));
    let surfaces = surfaces::locate(shape, &grid.points_mm, &grid.tets);
    let volumes = surfaces::volumes(shape, &grid.points_mm, &grid.tets);
    Ok(MeshFile { points_mm: grid.points_mm, tets: grid.tets, surfaces, volumes })
}

/// Number of parts of each interval.
fn parts(planes: &[f64], size_mm: f64, times: usize) -> Vec<f64> {
    // A length that is an integer multiple of the size up to rounding needs no further part.
    let count = |length_mm: f64| (length_mm / size_mm - 1.0e-9).ceil().max(1.0);
    planes.windows(2).map(|w| count(w[1] - w[0]) * times as f64).collect()
}

fn divided(planes: &[f64], counts: &[f64]) -> Vec<f64> {
    let mut values = vec![planes[0]];
    for (w, count) in planes.windows(2).zip(counts) {
        values.extend((1..=*count as usize).map(|i| w[0] + (w[1] - w[0]) * i as f64 / count));
    }
    values
}

/// Nodes and elements under construction. A node's key is its place on the grid with halved steps.
struct Grid {
    axes: [Vec<f64>; 3],
    nodes: HashMap<[usize; 3], u32>,
    points_mm: Vec<[f64; 3]>,
    tets: Vec<Tet10>,
    mirror_below_mm: Option<f64>,
}

impl Grid {
    fn new(axes: [Vec<f64>; 3]) -> Self {
        Self { axes, nodes: HashMap::new(), points_mm: Vec::new(), tets: Vec::new(), mirror_below_mm: None }
    }

    fn fill(&mut self, solid: impl Fn([f64; 3]) -> bool) {
        let [nx, ny, nz] = self.axes.each_ref().map(|axis| axis.len() - 1);
        for cube in (0..nx).flat_map(|i| (0..ny).flat_map(move |j| (0..nz).map(move |k| [i, j, k]))) {
            let centre = self.place(cube.map(|c| 2 * c + 1));
            if solid(centre) {
                let is_mirrored = self.mirror_below_mm.is_some_and(|y| centre[1] < y);
                for (path, against) in PATHS {
                    self.tet(cube, path, against, is_mirrored);
                }
            }
        }
    }

    /// Position of a key: on a plane where it is even, halfway between two where it is odd.
    fn place(&self, key: [usize; 3]) -> [f64; 3] {
        std::array::from_fn(|k| {
            let axis = &self.axes[k];
            0.5 * (axis[key[k] / 2] + axis[key[k].div_ceil(2)])
        })
    }

    fn node(&mut self, key: [usize; 3]) -> u32 {
        if let Some(node) = self.nodes.get(&key) {
            return *node;
        }
        let node = self.points_mm.len() as u32;
        self.points_mm.push(self.place(key));
        self.nodes.insert(key, node);
        node
    }

    fn tet(&mut self, cube: [usize; 3], path: [usize; 3], against: bool, is_mirrored: bool) {
        let mut corners = [cube.map(|c| 2 * c); 4];
        for (step, axis) in path.into_iter().enumerate() {
            for corner in &mut corners[step + 1..] {
                corner[axis] += 2;
            }
        }
        if is_mirrored {
            corners.iter_mut().for_each(|corner| corner[1] = 2 * (2 * cube[1] + 1) - corner[1]);
        }
        if against != is_mirrored {
            corners.swap(2, 3);
        }
        let mut tet: Tet10 = [0; 10];
        for (n, corner) in tet.iter_mut().zip(corners) {
            *n = self.node(corner);
        }
        for (n, [i, j]) in TET_EDGES.into_iter().enumerate() {
            tet[4 + n] = self.node(std::array::from_fn(|k| (corners[i][k] + corners[j][k]) / 2));
        }
        self.tets.push(tet);
    }
}
