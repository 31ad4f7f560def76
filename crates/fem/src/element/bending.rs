//! The sheet's plate bending on C0 triangles: an interior-penalty form, assembled once.
//!
//! For a sheet that bends almost without stretching, the curvature is the second derivative of the position itself,
//! `h_ab = n . x,ab`, and `|h|^2 = x,ab . x,ab`. The bending energy
//! `D/2 integral (1 - nu) x,ab . x,ab + nu x,aa . x,bb` is then quadratic in the positions, exactly invariant under
//! rigid motion, and its stiffness is one constant scalar matrix for all three components. Quadratic triangles are
//! only C0, so each interior edge adds, with `[.]` jump, `{.}` mean, `M = D (x,nn + nu x,tt)`:
//! `- {M} . [x,n]` (consistency, both ways) and `eta D / h [x,n] . [x,n]` (stability). `h` is the edge's length, or twice the
//! height of the flatter triangle over it if that is less: the consistency terms grow as `|e| / area`, so with the length alone
//! flat triangles would make the sheet's energy negative.

use std::collections::BTreeMap;

use crate::algebra::Vec3;
use crate::element::tri6;
use formats::mesh_file::{TRI_EDGES, Tri6};

/// One entry of the constant bending stiffness: `value` times the identity couples nodes `row >= col`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BendingEntry {
    /// Node with the larger index.
    pub(crate) row: u32,
    /// Node with the smaller index.
    pub(crate) col: u32,
    /// Stiffness (N/mm).
    pub(crate) value: f64,
}

/// Affine geometry of one triangle in the sheet's plane.
struct Flat {
    corner: [f64; 2],
    inverse: [[f64; 2]; 2],
    area: f64,
    centre: [f64; 2],
}

impl Flat {
    fn new(p: &[[f64; 2]; 6]) -> Self {
        let j = [[p[1][0] - p[0][0], p[2][0] - p[0][0]], [p[1][1] - p[0][1], p[2][1] - p[0][1]]];
        let det = j[0][0] * j[1][1] - j[0][1] * j[1][0];
        Self {
            corner: p[0],
            inverse: [[j[1][1] / det, -j[0][1] / det], [-j[1][0] / det, j[0][0] / det]],
            area: 0.5 * det.abs(),
            centre: [(p[0][0] + p[1][0] + p[2][0]) / 3.0, (p[0][1] + p[1][1] + p[2][1]) / 3.0],
        }
    }

    /// Second derivatives (11, 22, 12) of shape function `a`.
    fn second(&self, a: usize) -> [f64; 3] {
        let [rr, ss, rs] = tri6::SECOND[a];
        let m = &self.inverse;
        let at = |i: usize, j: usize| {
            rr * m[0][i] * m[0][j] + ss * m[1][i] * m[1][j] + rs * (m[0][i] * m[1][j] + m[1][i] * m[0][j])
        };
        [at(0, 0), at(1, 1), at(0, 1)]
    }

    /// Slope of the six shape functions in direction `n` at a point of the plane.
    fn slopes(&self, point: [f64; 2], n: [f64; 2]) -> [f64; 6] {
        let d = [point[0] - self.corner[0], point[1] - self.corner[1]];
        let r = self.inverse[0][0] * d[0] + self.inverse[0][1] * d[1];
        let s = self.inverse[1][0] * d[0] + self.inverse[1][1] * d[1];
        tri6::derivatives(r, s).map(|g| {
            let x = g[0] * self.inverse[0][0] + g[1] * self.inverse[1][0];
            let y = g[0] * self.inverse[0][1] + g[1] * self.inverse[1][1];
            x * n[0] + y * n[1]
        })
    }

    /// Bending moment about the edge, per unit value of shape function `a`, divided by `D`.
    fn moment(&self, a: usize, n: [f64; 2], poisson: f64) -> f64 {
        let [xx, yy, xy] = self.second(a);
        let normal = xx * n[0] * n[0] + yy * n[1] * n[1] + 2.0 * xy * n[0] * n[1];
        normal + poisson * (xx + yy - normal)
    }
}

/// Bending stiffness of a plane sheet: `stiffness` is `D` (N mm), `eta` the penalty factor.
///
/// `plane` holds the in-plane positions of each triangle's nodes, in axes common to the whole sheet.
///
/// # Errors
/// Corners of an edge shared by more than two triangles.
pub(crate) fn assemble(
    triangles: &[Tri6],
    plane: &[[[f64; 2]; 6]],
    stiffness: f64,
    poisson: f64,
    eta: f64,
) -> Result<Vec<BendingEntry>, [u32; 2]> {
    let flats: Vec<Flat> = plane.iter().map(Flat::new).collect();
    let mut sum = BTreeMap::new();
    for (nodes, flat) in triangles.iter().zip(&flats) {
        add_interior(&mut sum, nodes, flat, stiffness, poisson);
    }
    let mut edges: BTreeMap<[u32; 2], Vec<(usize, usize)>> = BTreeMap::new();
    for (t, nodes) in triangles.iter().enumerate() {
        for (e, [a, b]) in TRI_EDGES.into_iter().enumerate() {
            let key = [nodes[a].min(nodes[b]), nodes[a].max(nodes[b])];
            edges.entry(key).or_default().push((t, e));
        }
    }
    for (key, owners) in edges {
        match owners[..] {
            [_] => {}
            [(plus, e), (minus, _)] => {
                let ends = TRI_EDGES[e].map(|c| plane[plus][c]);
                let pair = [(&triangles[plus], &flats[plus]), (&triangles[minus], &flats[minus])];
                add_edge(&mut sum, pair, ends, stiffness, poisson, eta);
            }
            _ => return Err(key),
        }
    }
    Ok(sum.into_iter().map(|((row, col), value)| BendingEntry { row, col, value }).collect())
}

type Entries = BTreeMap<(u32, u32), f64>;

/// Adds entry (a, b) once a pair of an unordered loop: the lower triangle only.
fn add(sum: &mut Entries, a: u32, b: u32, value: f64) {
    if a >= b {
        *sum.entry((a, b)).or_insert(0.0) += value;
    }
}

fn add_interior(sum: &mut Entries, nodes: &Tri6, flat: &Flat, stiffness: f64, poisson: f64) {
    for a in 0..6 {
        let ha = flat.second(a);
        for b in 0..6 {
            let hb = flat.second(b);
            let full = ha[0] * hb[0] + ha[1] * hb[1] + 2.0 * ha[2] * hb[2];
            let traces = (ha[0] + ha[1]) * (hb[0] + hb[1]);
            let value = stiffness * flat.area * ((1.0 - poisson) * full + poisson * traces);
            add(sum, nodes[a], nodes[b], value);
        }
    }
}

fn add_edge(
    sum: &mut Entries,
    pair: [(&Tri6, &Flat); 2],
    ends: [[f64; 2]; 2],
    stiffness: f64,
    poisson: f64,
    eta: f64,
) {
    let along = [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]];
    let length = along[0].hypot(along[1]);
    let mut n = [along[1] / length, -along[0] / length];
    let inward = [pair[0].1.centre[0] - ends[0][0], pair[0].1.centre[1] - ends[0][1]];
    if n[0] * inward[0] + n[1] * inward[1] > 0.0 {
        n = [-n[0], -n[1]];
    }
    let nodes: Vec<u32> = pair.iter().flat_map(|(nodes, _)| nodes.iter().copied()).collect();
    let moment: Vec<f64> =
        pair.iter().flat_map(|(_, flat)| (0..6).map(|a| 0.5 * flat.moment(a, n, poisson))).collect();
    let height = 2.0 * pair[0].1.area.min(pair[1].1.area) / length;
    let h = length.min(2.0 * height);
    for t in [0.5 - 0.5 / 3.0_f64.sqrt(), 0.5 + 0.5 / 3.0_f64.sqrt()] {
        let point = [ends[0][0] + t * along[0], ends[0][1] + t * along[1]];
        let plus = pair[0].1.slopes(point, n);
        let minus = pair[1].1.slopes(point, n);
        let jump: Vec<f64> = plus.into_iter().chain(minus.map(|s| -s)).collect();
        for a in 0..12 {
            for b in 0..12 {
                let consistency = moment[a] * jump[b] + jump[a] * moment[b];
                let value = eta / h * jump[a] * jump[b] - consistency;
                add(sum, nodes[a], nodes[b], 0.5 * length * stiffness * value);
            }
        }
    }
}

/// Nodal forces `H x` (N) of the positions `x`.
pub(crate) fn add_force(entries: &[BendingEntry], x: &[Vec3], force: &mut [Vec3]) {
    for e in entries {
        let (row, col) = (e.row as usize, e.col as usize);
        for i in 0..3 {
            force[row][i] += e.value * x[col][i];
        }
        if row != col {
            for i in 0..3 {
                force[col][i] += e.value * x[row][i];
            }
        }
    }
}
