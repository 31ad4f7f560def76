//! The sheet's membrane: St. Venant-Kirchhoff on 6-node triangles, 3 Gauss points.
//!
//! `E = (F^T F - 1) / 2` with the 3 x 2 gradient `F`, resultants `N = C E` (N/mm). The resultants are
//! separate unknowns (see the Newton iteration), so the tangent's geometric part takes them as an argument.

use crate::algebra::{Mat3, Vec3, axpy, cross, dot, norm, scale, sub};
use crate::element::tri6;

/// Number of node pairs (a, b) with b <= a.
pub(crate) const PAIRS: usize = 21;

/// In-plane symmetric tensor (11, 22, 12).
pub(crate) type Plane = [f64; 3];

/// Undeformed geometry of one sheet triangle.
#[derive(Clone, Debug)]
pub(crate) struct MembraneGeometry {
    /// In-plane shape gradients at each Gauss point (1/mm).
    pub(crate) gradients: [[[f64; 2]; 6]; 3],
    /// Area represented by each Gauss point (mm2).
    pub(crate) weights: [f64; 3],
    /// In-plane position of the six nodes (mm).
    pub(crate) plane: [[f64; 2]; 6],
}

/// Orthonormal in-plane axes of a triangle's corners.
pub(crate) fn plane_axes(x: &[Vec3; 6]) -> [Vec3; 2] {
    let e1 = sub(x[1], x[0]);
    let e1 = scale(1.0 / norm(e1), e1);
    let normal = cross(e1, sub(x[2], x[0]));
    let e2 = cross(scale(1.0 / norm(normal), normal), e1);
    [e1, e2]
}

impl MembraneGeometry {
    /// Geometry in the plane spanned by `axes`.
    ///
    /// # Errors
    /// The Jacobian determinant (mm2), when it is zero at some Gauss point.
    pub(crate) fn new(x: &[Vec3; 6], axes: [Vec3; 2]) -> Result<Self, f64> {
        let plane = x.map(|p| [dot(p, axes[0]), dot(p, axes[1])]);
        let mut this = Self { gradients: [[[0.0; 2]; 6]; 3], weights: [0.0; 3], plane };
        for (q, [r, s, w]) in tri6::THREE_POINTS.into_iter().enumerate() {
            let (gradients, det) = plane_gradients(&plane, r, s);
            if det.is_nan() || det.abs() < f64::MIN_POSITIVE {
                return Err(det);
            }
            this.gradients[q] = gradients;
            this.weights[q] = 0.5 * det.abs() * w;
        }
        Ok(this)
    }
}

/// In-plane shape gradients at (r, s) and the Jacobian determinant.
pub(crate) fn plane_gradients(plane: &[[f64; 2]; 6], r: f64, s: f64) -> ([[f64; 2]; 6], f64) {
    let d = tri6::derivatives(r, s);
    let mut j = [[0.0; 2]; 2];
    for a in 0..6 {
        for i in 0..2 {
            for k in 0..2 {
                j[i][k] += plane[a][i] * d[a][k];
            }
        }
    }
    let det = j[0][0] * j[1][1] - j[0][1] * j[1][0];
    let gradients =
        d.map(|d| [(j[1][1] * d[0] - j[1][0] * d[1]) / det, (-j[0][1] * d[0] + j[0][0] * d[1]) / det]);
    (gradients, det)
}

/// `N = C E` for plane-stress stiffness (c11, c12, c33); the strain's third entry is the tensor component.
pub(crate) fn resultant(c: [f64; 3], e: Plane) -> Plane {
    [c[0] * e[0] + c[1] * e[1], c[1] * e[0] + c[0] * e[1], 2.0 * c[2] * e[2]]
}

fn tangents(gradients: &[[f64; 2]; 6], x: &[Vec3; 6]) -> [Vec3; 2] {
    let mut t = [[0.0; 3]; 2];
    for (g, x) in gradients.iter().zip(x) {
        axpy(g[0], *x, &mut t[0]);
        axpy(g[1], *x, &mut t[1]);
    }
    t
}

/// Green strain at Gauss point `q` for deformed nodes `x`.
pub(crate) fn strain(geometry: &MembraneGeometry, q: usize, x: &[Vec3; 6]) -> Plane {
    let t = tangents(&geometry.gradients[q], x);
    [0.5 * (dot(t[0], t[0]) - 1.0), 0.5 * (dot(t[1], t[1]) - 1.0), 0.5 * dot(t[0], t[1])]
}

/// Change of the strain at Gauss point `q`, linear in the displacement increment `du` at deformed nodes `x`.
pub(crate) fn strain_increment(
    geometry: &MembraneGeometry,
    q: usize,
    x: &[Vec3; 6],
    du: &[Vec3; 6],
) -> Plane {
    let t = tangents(&geometry.gradients[q], x);
    let d = tangents(&geometry.gradients[q], du);
    [dot(t[0], d[0]), dot(t[1], d[1]), 0.5 * (dot(t[0], d[1]) + dot(t[1], d[0]))]
}

/// `dE/du_a` as three vectors (11, 22, 2 x 12).
fn strain_rows(t: &[Vec3; 2], g: [f64; 2]) -> [Vec3; 3] {
    let mut shear = scale(g[1], t[0]);
    axpy(g[0], t[1], &mut shear);
    [scale(g[0], t[0]), scale(g[1], t[1]), shear]
}

/// Nodal forces (N) of the resultants `n` (one per Gauss point) at deformed nodes `x`.
pub(crate) fn force(geometry: &MembraneGeometry, x: &[Vec3; 6], n: &[Plane; 3]) -> [Vec3; 6] {
    let mut out = [[0.0; 3]; 6];
    for ((gradients, weight), n) in geometry.gradients.iter().zip(geometry.weights).zip(n) {
        let t = tangents(gradients, x);
        for (f, g) in out.iter_mut().zip(gradients) {
            for (row, n) in strain_rows(&t, *g).into_iter().zip(n) {
                axpy(weight * n, row, f);
            }
        }
    }
    out
}

/// Tangent blocks of node pairs (a, b <= a): material part with stiffness `c`, geometric part with the carried `n`.
pub(crate) fn tangent(
    geometry: &MembraneGeometry,
    x: &[Vec3; 6],
    n: &[Plane; 3],
    c: [f64; 3],
) -> [Mat3; PAIRS] {
    let mut out = [[[0.0; 3]; 3]; PAIRS];
    for ((gradients, w), n) in geometry.gradients.iter().zip(geometry.weights).zip(n) {
        let t = tangents(gradients, x);
        let mut pair = 0;
        for a in 0..6 {
            let ra = strain_rows(&t, gradients[a]);
            for b in 0..=a {
                let rb = strain_rows(&t, gradients[b]);
                let (ga, gb) = (gradients[a], gradients[b]);
                let geometric =
                    n[0] * ga[0] * gb[0] + n[1] * ga[1] * gb[1] + n[2] * (ga[0] * gb[1] + ga[1] * gb[0]);
                let block = &mut out[pair];
                pair += 1;
                for i in 0..3 {
                    for j in 0..3 {
                        block[i][j] += w
                            * (ra[0][i] * (c[0] * rb[0][j] + c[1] * rb[1][j])
                                + ra[1][i] * (c[1] * rb[0][j] + c[0] * rb[1][j])
                                + c[2] * ra[2][i] * rb[2][j]);
                    }
                    block[i][i] += w * geometric;
                }
            }
        }
    }
    out
}
