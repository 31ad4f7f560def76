//! The 10-node tetrahedron with 4 Gauss points and one condensed pressure, or with the pressure of each point.
//!
//! Notation: `N` shape functions, `grad N` with respect to the undeformed position, `F` deformation gradient,
//! `g = F^-T grad N`, `f = F grad N`, `I1 = tr(F^T F)`, `I = J^(-2/3) I1`, `s = 2 W' J^(-2/3)`.
//! First Piola stress of an energy of `I`: `P = s (F - I1/3 F^-T) + p J F^-T`. For one of the principal stretches `s = 0`, and
//! [`Spectral`] adds the isochoric part.

use super::spectral::Spectral;
use crate::algebra::{Mat3, Vec3, axpy, det_inv_transpose, dot, mat_vec, scale};
use crate::material::{Dependence, Elastomer, Hyperelastic, is_stable_invariant};
use formats::mesh_file::TET_EDGES;

/// Barycentric coordinates of the Gauss points: `OWN` for the nearest corner, `OTHER` for the three others.
const OWN: f64 = 0.585_410_196_624_968_5;
const OTHER: f64 = 0.138_196_601_125_010_5;

/// Volume ratio below which a trial state counts as collapsed.
pub(crate) const MIN_VOLUME_RATIO: f64 = 0.05;

/// Number of node pairs (a, b) with b <= a.
pub(crate) const PAIRS: usize = 55;

/// A deformation outside the limits of the material law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Invalid {
    /// The volume ratio `J` fell to the given value.
    Collapsed(f64),
    /// The invariant `I` passed the material's limit.
    BeyondLimit(f64),
    /// The law is unstable at the invariant `I` (Drucker).
    Unstable(f64),
}

/// Undeformed geometry of one element.
#[derive(Clone, Debug)]
pub(crate) struct TetGeometry {
    /// Shape function gradients at each Gauss point (1/mm).
    pub(crate) gradients: [[Vec3; 10]; 4],
    /// Volume represented by each Gauss point (mm3).
    pub(crate) weights: [f64; 4],
}

/// Values of the ten shape functions at barycentric coordinates `l`.
pub(crate) fn shape(l: [f64; 4]) -> [f64; 10] {
    let mut n = [0.0; 10];
    for i in 0..4 {
        n[i] = l[i] * (2.0 * l[i] - 1.0);
    }
    for (m, [a, b]) in TET_EDGES.into_iter().enumerate() {
        n[4 + m] = 4.0 * l[a] * l[b];
    }
    n
}

/// Derivatives of the shape functions with respect to the reference coordinates (l1, l2, l3), with l0 = 1 - sum.
fn shape_derivatives(l: [f64; 4]) -> [Vec3; 10] {
    const DL: [Vec3; 4] = [[-1.0, -1.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut d = [[0.0; 3]; 10];
    for i in 0..4 {
        d[i] = scale(4.0 * l[i] - 1.0, DL[i]);
    }
    for (m, [a, b]) in TET_EDGES.into_iter().enumerate() {
        axpy(4.0 * l[b], DL[a], &mut d[4 + m]);
        axpy(4.0 * l[a], DL[b], &mut d[4 + m]);
    }
    d
}

/// Barycentric coordinates of Gauss point `q`.
pub(crate) fn gauss_point(q: usize) -> [f64; 4] {
    let mut l = [OTHER; 4];
    l[q] = OWN;
    l
}

impl TetGeometry {
    /// Gradients and weights from the undeformed nodes.
    ///
    /// # Errors
    /// The Jacobian determinant (mm3), when it is not positive at some Gauss point: an inverted element.
    pub(crate) fn new(x: &[Vec3; 10]) -> Result<Self, f64> {
        let mut this = Self { gradients: [[[0.0; 3]; 10]; 4], weights: [0.0; 4] };
        for q in 0..4 {
            let d = shape_derivatives(gauss_point(q));
            let mut jacobian = [[0.0; 3]; 3];
            for (xa, da) in x.iter().zip(&d) {
                for i in 0..3 {
                    axpy(xa[i], *da, &mut jacobian[i]);
                }
            }
            let (det, inv_t) = det_inv_transpose(&jacobian);
            if det.is_nan() || det <= 0.0 {
                return Err(det);
            }
            this.gradients[q] = d.map(|d| mat_vec(&inv_t, d));
            this.weights[q] = det / 24.0;
        }
        Ok(this)
    }

    /// Undeformed volume (mm3).
    pub(crate) fn volume_mm3(&self) -> f64 {
        self.weights.iter().sum()
    }

    /// Deformation gradient at Gauss point `q` for nodal displacements `u`.
    #[inline]
    pub(crate) fn deformation_gradient(&self, q: usize, u: &[Vec3; 10]) -> Mat3 {
        let mut f = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for (ua, ga) in u.iter().zip(&self.gradients[q]) {
            for i in 0..3 {
                axpy(ua[i], *ga, &mut f[i]);
            }
        }
        f
    }
}

/// Kinematics and energy at one Gauss point.
pub(crate) struct Point {
    f: Mat3,
    inv_t: Mat3,
    pub(crate) det: f64,
    trace: f64,
    iso: f64,
    /// Derivatives of an energy of `I`; 0 for one of the principal stretches.
    d1: f64,
    d2: f64,
    spectral: Option<Spectral>,
    pub(crate) w: f64,
}

pub(crate) fn point(
    geometry: &TetGeometry,
    q: usize,
    u: &[Vec3; 10],
    law: &Hyperelastic,
) -> Result<Point, Invalid> {
    let f = geometry.deformation_gradient(q, u);
    let (det, inv_t) = det_inv_transpose(&f);
    if det.is_nan() || det <= MIN_VOLUME_RATIO {
        return Err(Invalid::Collapsed(det));
    }
    let trace = dot(f[0], f[0]) + dot(f[1], f[1]) + dot(f[2], f[2]);
    let cbrt = det.cbrt();
    let iso = 1.0 / (cbrt * cbrt);
    let i1 = iso * trace;
    let mut point = Point { f, inv_t, det, trace, iso, d1: 0.0, d2: 0.0, spectral: None, w: 0.0 };
    match law.at(i1).ok_or(Invalid::BeyondLimit(i1))? {
        Dependence::Invariant(energy) => {
            if !law.is_always_stable() {
                let b = point.left_cauchy_green();
                let squares: f64 = b.iter().map(|row| dot(*row, *row)).sum();
                if !is_stable_invariant(&energy, i1, 0.5 * (i1 * i1 - squares)) {
                    return Err(Invalid::Unstable(i1));
                }
            }
            (point.d1, point.d2) = (energy.d1, energy.d2);
            point.w = energy.w;
        }
        Dependence::Stretches(powers) => {
            let spectral = Spectral::new(&point.left_cauchy_green(), &powers);
            if !law.is_always_stable() && !spectral.is_stable {
                return Err(Invalid::Unstable(i1));
            }
            point.w = spectral.w;
            point.spectral = Some(spectral);
        }
    }
    Ok(point)
}

impl Point {
    /// `J^(-2/3) F F^T`.
    fn left_cauchy_green(&self) -> Mat3 {
        let f = &self.f;
        std::array::from_fn(|i| std::array::from_fn(|j| self.iso * dot(f[i], f[j])))
    }
}

/// Contribution of one element.
#[derive(Clone, Debug)]
pub(crate) struct TetTerms {
    /// Nodal forces of the isochoric stress, and of the points' pressures (N).
    pub(crate) force: [Vec3; 10],
    /// `dV/du`: nodal forces of a unit pressure (mm2).
    pub(crate) volume_gradient: [Vec3; 10],
    /// Volume change `integral (J - 1)` (mm3).
    pub(crate) volume_change: f64,
    /// Tangent blocks of node pairs (a, b <= a), row by row of the lower triangle, without the condensed pressure.
    pub(crate) tangent: [Mat3; PAIRS],
}

impl Default for TetTerms {
    fn default() -> Self {
        Self {
            force: [[0.0; 3]; 10],
            volume_gradient: [[0.0; 3]; 10],
            volume_change: 0.0,
            tangent: [[[0.0; 3]; 3]; PAIRS],
        }
    }
}

impl TetTerms {
    /// Evaluates forces, volume terms and, when asked, the tangent at displacements `u` and carried pressure (MPa).
    ///
    /// Cost: about 7,000 multiplications per Gauss point with the tangent.
    ///
    /// # Errors
    /// [`Invalid`] when the element collapsed or its material passed its limit.
    pub(crate) fn evaluate(
        &mut self,
        geometry: &TetGeometry,
        u: &[Vec3; 10],
        pressure_mpa: f64,
        material: &Elastomer,
        with_tangent: bool,
    ) -> Result<(), Invalid> {
        let point_bulk_mpa = material.point_bulk_mpa();
        self.force = [[0.0; 3]; 10];
        self.volume_gradient = [[0.0; 3]; 10];
        self.volume_change = 0.0;
        if with_tangent {
            self.tangent = [[[0.0; 3]; 3]; PAIRS];
        }
        for q in 0..4 {
            let p = point(geometry, q, u, &material.law)?;
            let weight = geometry.weights[q];
            let gradients = &geometry.gradients[q];
            let mut g = [[0.0; 3]; 10];
            let mut f = [[0.0; 3]; 10];
            for a in 0..10 {
                g[a] = mat_vec(&p.inv_t, gradients[a]);
                f[a] = mat_vec(&p.f, gradients[a]);
            }
            let s = 2.0 * p.d1 * p.iso * weight;
            for a in 0..10 {
                axpy(s, f[a], &mut self.force[a]);
                axpy(-s * p.trace / 3.0, g[a], &mut self.force[a]);
                axpy(weight * p.det, g[a], &mut self.volume_gradient[a]);
            }
            if let Some(spectral) = &p.spectral {
                let stress = spectral.stress();
                for (force, g) in self.force.iter_mut().zip(g) {
                    axpy(weight, mat_vec(&stress, g), force);
                }
            }
            self.volume_change += weight * (p.det - 1.0);
            let mut pressure_mpa = pressure_mpa;
            if point_bulk_mpa > 0.0 {
                pressure_mpa = point_bulk_mpa * (p.det - 1.0);
                for (force, g) in self.force.iter_mut().zip(g) {
                    axpy(weight * pressure_mpa * p.det, g, force);
                }
            }
            if with_tangent {
                let follows = point_bulk_mpa * p.det * p.det * weight;
                self.add_tangent(&p, weight, [pressure_mpa, follows], gradients, &g, &f);
                if let Some(spectral) = &p.spectral {
                    spectral.add_tangent(weight, &g, &mut self.tangent);
                }
            }
        }
        Ok(())
    }

    /// `dP : (grad N_a, grad N_b)` at one Gauss point, in the five products it reduces to, at a pressure (MPa) that `follows` the
    /// point's volume (`K J^2` times the weight; 0 for a pressure of the element).
    fn add_tangent(
        &mut self,
        p: &Point,
        weight: f64,
        [pressure_mpa, follows]: [f64; 2],
        gradients: &[Vec3; 10],
        g: &[Vec3; 10],
        f: &[Vec3; 10],
    ) {
        let s = 2.0 * p.d1 * p.iso * weight;
        let kappa = 4.0 * p.d2 * p.iso * p.iso * weight;
        let pressure = pressure_mpa * p.det * weight;
        let third = p.trace / 3.0;
        let gf = -(2.0 / 3.0) * s - kappa * third;
        let gg = (2.0 / 3.0) * s * third + kappa * third * third + pressure + follows;
        let gg_swapped = s * third - pressure;
        let mut pair = 0;
        for a in 0..10 {
            for b in 0..=a {
                let block = &mut self.tangent[pair];
                pair += 1;
                let (mut with_g, mut with_f) = ([0.0; 3], [0.0; 3]);
                for j in 0..3 {
                    with_g[j] = gf * f[b][j] + gg * g[b][j];
                    with_f[j] = gf * g[b][j] + kappa * f[b][j];
                }
                for i in 0..3 {
                    let swapped = gg_swapped * g[b][i];
                    for j in 0..3 {
                        block[i][j] += g[a][i] * with_g[j] + f[a][i] * with_f[j] + swapped * g[a][j];
                    }
                }
                let diagonal = s * dot(gradients[a], gradients[b]);
                for (i, row) in block.iter_mut().enumerate() {
                    row[i] += diagonal;
                }
            }
        }
    }
}

/// A symmetric tensor (xx, yy, zz, xy, xz, yz) at each Gauss point.
pub(crate) type PointTensors = [[f64; 6]; 4];

/// Symmetric tensor as a matrix.
fn matrix([xx, yy, zz, xy, xz, yz]: [f64; 6]) -> Mat3 {
    [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
}

impl TetTerms {
    /// Adds the forces and the tangent of a given stress `H` (MPa) with the energy `J^(-2/3) H : C / 2`. Its second Piola stress
    /// `J^(-2/3) (H - (H : C) / 3 C^-1)` has no pressure.
    pub(crate) fn add_stress(
        &mut self,
        geometry: &TetGeometry,
        u: &[Vec3; 10],
        stress_mpa: &PointTensors,
        with_tangent: bool,
    ) {
        for (q, stress) in stress_mpa.iter().enumerate() {
            let (f, h) = (geometry.deformation_gradient(q, u), matrix(*stress));
            let (det, inv_t) = det_inv_transpose(&f);
            let s = det.cbrt().powi(-2) * geometry.weights[q];
            let gradients = &geometry.gradients[q];
            let turned = gradients.map(|n| mat_vec(&h, n));
            let (g, fh) = (gradients.map(|n| mat_vec(&inv_t, n)), turned.map(|n| mat_vec(&f, n)));
            let third = f.iter().map(|row| dot(*row, mat_vec(&h, *row))).sum::<f64>() / 3.0;
            for a in 0..10 {
                axpy(s, fh[a], &mut self.force[a]);
                axpy(-s * third, g[a], &mut self.force[a]);
            }
            if !with_tangent {
                continue;
            }
            let mut pair = 0;
            for a in 0..10 {
                for b in 0..=a {
                    let block = &mut self.tangent[pair];
                    pair += 1;
                    for i in 0..3 {
                        for j in 0..3 {
                            let mixed = g[a][i] * fh[b][j] + fh[a][i] * g[b][j];
                            let pressure = 2.0 / 3.0 * g[a][i] * g[b][j] + g[b][i] * g[a][j];
                            block[i][j] += s * (third * pressure - 2.0 / 3.0 * mixed);
                        }
                        block[i][i] += s * dot(gradients[a], turned[b]);
                    }
                }
            }
        }
    }
}

/// Isochoric second Piola stress times `J^(2/3)` (MPa) at the Gauss points: `2 W' (1 - tr C / 3 C^-1)` or `J^(2/3) F^-1 tau F^-T`.
///
/// # Errors
/// [`Invalid`] as in [`TetTerms::evaluate`].
pub(crate) fn isochoric_stress(
    geometry: &TetGeometry,
    u: &[Vec3; 10],
    law: &Hyperelastic,
) -> Result<PointTensors, Invalid> {
    let mut out = [[0.0; 6]; 4];
    for (q, stress) in out.iter_mut().enumerate() {
        let p = point(geometry, q, u, law)?;
        let tau = p.spectral.as_ref().map_or([[0.0; 3]; 3], Spectral::stress);
        for (s, (i, j)) in stress.iter_mut().zip(ENTRIES) {
            let inverse: f64 = p.inv_t.iter().map(|row| row[i] * row[j]).sum();
            let unit = if i == j { 1.0 } else { 0.0 };
            let isochoric: f64 =
                (0..3).map(|k| p.inv_t[k][i] * (0..3).map(|l| tau[k][l] * p.inv_t[l][j]).sum::<f64>()).sum();
            *s = 2.0 * p.d1 * (unit - p.trace / 3.0 * inverse) + isochoric / p.iso;
        }
    }
    Ok(out)
}

/// Deviatoric Cauchy stress (MPa) of a given stress as in [`TetTerms::add_stress`].
pub(crate) fn cauchy_of_stress(
    geometry: &TetGeometry,
    u: &[Vec3; 10],
    stress_mpa: &PointTensors,
) -> PointTensors {
    let mut out = [[0.0; 6]; 4];
    for (q, out) in out.iter_mut().enumerate() {
        let (f, h) = (geometry.deformation_gradient(q, u), matrix(stress_mpa[q]));
        let det = det_inv_transpose(&f).0;
        let factor = det.cbrt().powi(-2) / det;
        let turned = f.map(|row| mat_vec(&h, row));
        let third = (0..3).map(|i| dot(f[i], turned[i])).sum::<f64>() / 3.0;
        for (s, (i, j)) in out.iter_mut().zip(ENTRIES) {
            *s = factor * (dot(f[i], turned[j]) - if i == j { third } else { 0.0 });
        }
    }
    out
}

/// Rows and columns of a symmetric tensor's entries.
const ENTRIES: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// Deviatoric Cauchy stress (xx, yy, zz, xy, xz, yz; MPa) at the four Gauss points: `2 W' J^(-2/3) dev(F F^T) / J` or `tau / J`.
///
/// # Errors
/// [`Invalid`] as in [`TetTerms::evaluate`].
pub(crate) fn deviatoric_stress(
    geometry: &TetGeometry,
    u: &[Vec3; 10],
    law: &Hyperelastic,
) -> Result<PointTensors, Invalid> {
    let mut out = [[0.0; 6]; 4];
    for (q, stress) in out.iter_mut().enumerate() {
        let p = point(geometry, q, u, law)?;
        let factor = 2.0 * p.d1 * p.iso / p.det;
        let isochoric = p.spectral.as_ref().map_or([[0.0; 3]; 3], Spectral::stress);
        for (s, (i, j)) in stress.iter_mut().zip(ENTRIES) {
            let mean = if i == j { p.trace / 3.0 } else { 0.0 };
            *s = factor * (dot(p.f[i], p.f[j]) - mean) + isochoric[i][j] / p.det;
        }
    }
    Ok(out)
}

/// Von Mises stress `sqrt(3/2 s : s)` of a deviatoric stress (MPa).
pub(crate) fn von_mises(s: [f64; 6]) -> f64 {
    let squares = s.map(|v| v * v);
    (1.5 * (squares[0] + squares[1] + squares[2] + 2.0 * (squares[3] + squares[4] + squares[5]))).sqrt()
}

/// Linear extrapolation of Gauss point tensors to the ten nodes (mid-sides: mean of their corners).
///
/// Components are extrapolated, not invariants: near a free surface the invariant of the extrapolated tensor stays
/// positive and meaningful where an extrapolated invariant would turn negative.
pub(crate) fn extrapolate(values: [[f64; 6]; 4]) -> [[f64; 6]; 10] {
    let mut out = [[0.0; 6]; 10];
    for k in 0..6 {
        let sum: f64 = values.iter().map(|v| v[k]).sum();
        for i in 0..4 {
            out[i][k] = (values[i][k] - OTHER * sum) / (OWN - OTHER);
        }
        for (m, [a, b]) in TET_EDGES.into_iter().enumerate() {
            out[4 + m][k] = 0.5 * (out[a][k] + out[b][k]);
        }
    }
    out
}
