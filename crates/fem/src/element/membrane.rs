//! Membranes of sheet and films: St. Venant-Kirchhoff on 6-node triangles, 3 Gauss points, with fibres in tension.
//!
//! `E = (F^T F - 1) / 2` with the 3 x 2 gradient `F`, resultants `N = C E + sum_f k_f <m.E m> m m` (N/mm), `m` the fibres' direction
//! and `<>` the positive part, rounded. The resultants are separate unknowns (see the Newton iteration), so the tangent's geometric
//! part takes them as an argument.

use crate::algebra::{Mat3, Vec3, axpy, cross, dot, norm, scale, sub};
use crate::contact::penalty;
use crate::element::tri6;
use crate::material::{Film, SheetMaterial};

/// Number of node pairs (a, b) with b <= a.
pub(crate) const PAIRS: usize = 21;

/// In-plane symmetric tensor (11, 22, 12).
pub(crate) type Plane = [f64; 3];

/// Half the interval of fibre strains around 0 over which tension sets in. The undeformed film is free of stress: a slack fibre keeps the
/// compression of a strain of a quarter of it.
const FIBRE_ROUNDING: f64 = 5.0e-4;

/// Rounded positive part of a fibre's strain, as energy, force and stiffness per stiffness.
fn tension(strain: f64) -> [f64; 3] {
    let p = penalty(strain, FIBRE_ROUNDING);
    let offset = 0.25 * FIBRE_ROUNDING;
    [p.energy - offset * strain, p.force - offset, p.stiffness]
}

/// Resultant of a strain: plane-stress stiffness (11, 12, 33; N/mm), and families of fibres.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Law {
    isotropic: [f64; 3],
    /// `m m` of the direction (11, 22, 12), and stiffness per width (N/mm).
    fibres: Vec<(Plane, f64)>,
}

impl Law {
    /// Law of the sheet.
    pub(crate) fn of_sheet(sheet: &SheetMaterial) -> Self {
        Self { isotropic: sheet.membrane().stiffness_n_per_mm(), fibres: Vec::new() }
    }

    /// Law of a film in axes of which the first is that of the film.
    pub(crate) fn of(film: &Film) -> Self {
        let fibres = film.fibres.iter().map(|f| {
            let (s, c) = f.angle_deg.to_radians().sin_cos();
            ([c * c, s * s, c * s], f.stiffness_n / f.spacing_mm)
        });
        let isotropic = film.isotropic.map_or([0.0; 3], |film| film.stiffness_n_per_mm());
        Self { isotropic, fibres: fibres.collect() }
    }

    fn along(m: &Plane, e: Plane) -> f64 {
        m[0] * e[0] + m[1] * e[1] + 2.0 * m[2] * e[2]
    }

    /// Energy per area (N/mm).
    pub(crate) fn energy(&self, e: Plane) -> f64 {
        let n = resultant(self.isotropic, e);
        let fibres = self.fibres.iter().map(|(m, k)| k * tension(Self::along(m, e))[0]);
        0.5 * (n[0] * e[0] + n[1] * e[1] + 2.0 * n[2] * e[2]) + fibres.sum::<f64>()
    }

    /// Resultants (N/mm); the strain's third entry is the tensor component.
    pub(crate) fn resultant(&self, e: Plane) -> Plane {
        let mut n = resultant(self.isotropic, e);
        for (m, k) in &self.fibres {
            axpy(k * tension(Self::along(m, e))[1], *m, &mut n);
        }
        n
    }

    /// Derivative of the resultants with respect to (11, 22, 2 x 12).
    pub(crate) fn stiffness(&self, e: Plane) -> Mat3 {
        let [c11, c12, c33] = self.isotropic;
        let mut c = [[c11, c12, 0.0], [c12, c11, 0.0], [0.0, 0.0, c33]];
        for (m, k) in &self.fibres {
            let k = k * tension(Self::along(m, e))[2];
            for (row, m_row) in c.iter_mut().zip(m) {
                axpy(k * m_row, *m, row);
            }
        }
        c
    }

    /// Resultants of the strain `e + de`, linearised at `e`.
    pub(crate) fn linearised(&self, e: Plane, de: Plane) -> Plane {
        let mut n = self.resultant(e);
        let c = self.stiffness(e);
        axpy(1.0, c.map(|row| dot(row, [de[0], de[1], 2.0 * de[2]])), &mut n);
        n
    }
}

/// Undeformed geometry of one triangle.
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
fn resultant(c: [f64; 3], e: Plane) -> Plane {
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

/// Tangent blocks of node pairs (a, b <= a): material part of the law, geometric part with the carried `n`.
pub(crate) fn tangent(
    geometry: &MembraneGeometry,
    x: &[Vec3; 6],
    n: &[Plane; 3],
    law: &Law,
) -> [Mat3; PAIRS] {
    let mut out = [[[0.0; 3]; 3]; PAIRS];
    let points = geometry.gradients.iter().zip(geometry.weights).zip(n).enumerate();
    for (q, ((gradients, w), n)) in points {
        let c = law.stiffness(strain(geometry, q, x));
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
                for (k, row) in c.iter().enumerate() {
                    let mut stress = [0.0; 3];
                    row.iter().zip(rb).for_each(|(c, rb)| axpy(*c, rb, &mut stress));
                    for (entry, ra) in block.iter_mut().zip(ra[k]) {
                        axpy(w * ra, stress, entry);
                    }
                }
                for (i, row) in block.iter_mut().enumerate() {
                    row[i] += w * geometric;
                }
            }
        }
    }
    out
}
