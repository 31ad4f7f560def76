//! Transfer of a state to another mesh of the same undeformed body: as a start on a finer mesh, and for comparing two meshes point
//! by point.

use crate::algebra::{Mat3, Vec3, add, axpy, det_inv_transpose, dot, scale, sub};
use crate::element::membrane::Plane;
use crate::element::tet10;
use crate::problem::Problem;
use crate::state::State;
use formats::mesh_file::Tri6;

/// Edge of a search cell over the mean edge of a box that holds one element.
const CELL_ELEMENTS: f64 = 2.0;

/// Locator of undeformed points in the elements of a problem. Undeformed elements have straight edges.
pub struct Locator<'a> {
    problem: &'a Problem,
    low: Vec3,
    cell_mm: f64,
    counts: [usize; 3],
    /// Elements whose box reaches into each cell.
    cells: Vec<Vec<u32>>,
}

/// A point in an element.
#[derive(Clone, Debug, PartialEq)]
pub struct ElementPoint {
    /// The element.
    pub element: usize,
    /// Its ten nodes.
    nodes: [u32; 10],
    /// Weight of each node at the point.
    weights: [f64; 10],
    /// Distance of the point from the element, as a fraction of the element's height; 0 inside.
    pub outside: f64,
}

impl ElementPoint {
    /// Value of a nodal field at the point, quadratic in the element.
    pub fn value(&self, field: &[f64]) -> f64 {
        self.nodes.iter().zip(self.weights).map(|(n, weight)| weight * field[*n as usize]).sum()
    }

    /// Value of a nodal vector field at the point.
    pub fn vector(&self, field: &[[f64; 3]]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        self.nodes
            .iter()
            .zip(self.weights)
            .for_each(|(n, weight)| axpy(weight, field[*n as usize], &mut sum));
        sum
    }
}

impl<'a> Locator<'a> {
    /// Sorts the elements into cells. Cost `O(elements)`.
    pub fn new(problem: &'a Problem) -> Self {
        let mesh = &problem.mesh;
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for x in &mesh.nodes_mm {
            for k in 0..3 {
                low[k] = low[k].min(x[k]);
                high[k] = high[k].max(x[k]);
            }
        }
        let extent = sub(high, low);
        let cell_mm = CELL_ELEMENTS * (extent.iter().product::<f64>() / mesh.tets.len() as f64).cbrt();
        let counts = extent.map(|length| (length / cell_mm) as usize + 1);
        let mut this =
            Self { problem, low, cell_mm, counts, cells: vec![Vec::new(); counts.iter().product()] };
        for (e, tet) in mesh.tets.iter().enumerate() {
            let corners = [0, 1, 2, 3].map(|n| this.cell(mesh.nodes_mm[tet[n] as usize]));
            let range = |k: usize| {
                let along = corners.map(|cell| cell[k]);
                along.into_iter().min().unwrap_or(0)..=along.into_iter().max().unwrap_or(0)
            };
            for i in range(0) {
                for j in range(1) {
                    for k in range(2) {
                        let bin = this.index([i, j, k]);
                        this.cells[bin].push(e as u32);
                    }
                }
            }
        }
        this
    }

    fn cell(&self, x: Vec3) -> [usize; 3] {
        std::array::from_fn(|k| (((x[k] - self.low[k]) / self.cell_mm) as usize).min(self.counts[k] - 1))
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (i * self.counts[1] + j) * self.counts[2] + k
    }

    /// Element that contains a point, or the nearest of those around it; `None` if no element is near.
    pub fn place(&self, x: [f64; 3]) -> Option<ElementPoint> {
        let [i, j, k] = self.cell(x);
        let around = |index: usize, count: usize| index.saturating_sub(1)..=(index + 1).min(count - 1);
        // A point on the cell's face may belong to a neighbour by rounding.
        let in_cell = self.nearest(x, self.cells[self.index([i, j, k])].iter());
        if in_cell.as_ref().is_some_and(|place| place.outside < 1.0e-9) {
            return in_cell;
        }
        let neighbours = around(i, self.counts[0])
            .flat_map(|i| around(j, self.counts[1]).map(move |j| (i, j)))
            .flat_map(|(i, j)| around(k, self.counts[2]).map(move |k| [i, j, k]));
        self.nearest(x, neighbours.flat_map(|cell| self.cells[self.index(cell)].iter()))
    }

    fn nearest<'c>(&self, x: Vec3, elements: impl Iterator<Item = &'c u32>) -> Option<ElementPoint> {
        let place = |e: &u32| {
            let nodes = self.problem.mesh.tets[*e as usize];
            let corner = |n: usize| self.problem.mesh.nodes_mm[nodes[n] as usize];
            let barycentric = barycentric([0, 1, 2, 3].map(corner), x);
            let outside = barycentric.iter().fold(0.0, |most: f64, l| most.max(-l));
            ElementPoint { element: *e as usize, nodes, weights: tet10::shape(barycentric), outside }
        };
        elements.map(place).min_by(|a, b| a.outside.total_cmp(&b.outside))
    }
}

/// Barycentric coordinates of `x` in a tetrahedron.
fn barycentric(corners: [Vec3; 4], x: Vec3) -> [f64; 4] {
    let edges: Mat3 = [1, 2, 3].map(|k| sub(corners[k], corners[0]));
    // x - x0 = sum of l_k edge_k, so l = (edges as columns)^-1 (x - x0): rows of the inverse transpose of the edges as rows.
    let (_, rows) = det_inv_transpose(&edges);
    let from = sub(x, corners[0]);
    let l = rows.map(|row| dot(row, from));
    [1.0 - l[0] - l[1] - l[2], l[0], l[1], l[2]]
}

/// State of the problem `from` on the mesh of `to`: interpolated displacements, with element pressures and sheet resultants of the
/// element around each middle. It is not an equilibrium of `to`, but near one if both are meshes of one body.
///
/// `None` if a node of `to` is near no element of `from`.
pub(crate) fn transferred(from: &Problem, state: &State, to: &Problem) -> Option<State> {
    let locator = Locator::new(from);
    let displacement = |x: &Vec3| Some(locator.place(*x)?.vector(&state.displacement_mm));
    let displacement_mm = to.mesh.nodes_mm.iter().map(displacement).collect::<Option<Vec<_>>>()?;
    let pressure =
        |tet: &[u32; 10]| Some(state.element_pressure_mpa[locator.place(middle(to, &tet[..4]))?.element]);
    let element_pressure_mpa = to.mesh.tets.iter().map(pressure).collect::<Option<Vec<_>>>()?;
    Some(State {
        displacement_mm,
        element_pressure_mpa,
        sheet_resultants_n_per_mm: resultants(from, state, to),
        load: state.load,
    })
}

/// Resultants of the triangle of the same film whose middle is nearest, the mean of its three points, in the axes of the other
/// mesh's triangle.
fn resultants(from: &Problem, state: &State, to: &Problem) -> Vec<[Plane; 3]> {
    let (old, new) = (&from.sheet, &to.sheet);
    let middles: Vec<Vec3> = old.triangles.iter().map(|t| middle(from, &t[..3])).collect();
    let nearest = |(t, nodes): (usize, &Tri6)| {
        let centre = middle(to, &nodes[..3]);
        let distance = |k: &usize| {
            let d = sub(middles[*k], centre);
            dot(d, d)
        };
        let same = (0..middles.len()).filter(|k| new.same_film(t, old, *k));
        let Some(k) = same.min_by(|a, b| distance(a).total_cmp(&distance(b))) else {
            return [[0.0; 3]; 3];
        };
        // The new axes in the old ones.
        let [c, s] = new.axes[t].map(|b| old.axes[k].map(|a| dot(b, a)));
        let turned = |[n11, n22, n12]: Plane| {
            let along = |u: [f64; 2], v: [f64; 2]| {
                u[0] * v[0] * n11 + u[1] * v[1] * n22 + (u[0] * v[1] + u[1] * v[0]) * n12
            };
            [along(c, c), along(s, s), along(c, s)]
        };
        let points = &state.sheet_resultants_n_per_mm[k];
        [turned(std::array::from_fn(|i| points.iter().map(|p| p[i]).sum::<f64>() / 3.0)); 3]
    };
    new.triangles.iter().enumerate().map(nearest).collect()
}

fn middle(problem: &Problem, corners: &[u32]) -> Vec3 {
    let sum = corners.iter().fold([0.0; 3], |sum, n| add(sum, problem.mesh.nodes_mm[*n as usize]));
    scale(1.0 / corners.len() as f64, sum)
}
