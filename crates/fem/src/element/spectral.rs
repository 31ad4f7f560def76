//! Stress and tangent of an energy of the principal stretches at one Gauss point.
//!
//! `tau` is the deviatoric Kirchhoff stress, `c` its spatial moduli: with `g = F^-T grad N` the nodal force is `tau g_a` and the tangent
//! `g_a . c . g_b + (g_a . tau g_b) 1`. Along the principal directions only `c_iijj` and `c_ijij = c_ijji` differ from 0.

use crate::algebra::{Mat3, Vec3, axpy, dot, mat_vec, symmetric_eigen};
use crate::material::{Power, Principal};

/// Stress and moduli along the principal directions.
pub(crate) struct Spectral {
    /// Principal directions, one per row.
    axes: Mat3,
    /// Principal values of `tau` (MPa).
    stress: Vec3,
    /// `c_iijj` (MPa).
    normal: Mat3,
    /// `c_ijij` for `i != j` (MPa).
    shear: Mat3,
    /// False if Drucker's criterion is violated.
    pub(crate) is_stable: bool,
    pub(crate) w: f64,
}

impl Spectral {
    /// Response at the isochoric left Cauchy-Green tensor `b`.
    pub(crate) fn new(b: &Mat3, powers: &[Power; 3]) -> Self {
        let (x, axes) = symmetric_eigen(b);
        let principal = Principal::of_powers(powers, x);
        let mean = principal.t.iter().sum::<f64>() / 3.0;
        let stress = principal.t.map(|t| t - mean);
        // Without volume change: rows and columns of the moduli minus their means.
        let diagonal: Vec3 = std::array::from_fn(|i| principal.moduli[i][i]);
        let ninth = diagonal.iter().sum::<f64>() / 9.0;
        let mut normal: Mat3 =
            std::array::from_fn(|i| std::array::from_fn(|j| ninth - (diagonal[i] + diagonal[j]) / 3.0));
        for i in 0..3 {
            normal[i][i] += diagonal[i] - 2.0 * stress[i];
        }
        let mut shear = [[0.0; 3]; 3];
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            let slopes = powers.iter().filter(|power| power.mu_mpa != 0.0);
            let slope: f64 =
                slopes.map(|p| p.mu_mpa * divided_difference(x[i], x[j], 0.5 * p.alpha - 1.0)).sum();
            shear[i][j] = x[i] * x[j] * slope + mean;
            shear[j][i] = shear[i][j];
        }
        Self {
            axes,
            stress,
            normal,
            shear,
            is_stable: principal.is_stable(),
            w: powers
                .iter()
                .filter(|power| power.mu_mpa != 0.0)
                .map(|p| p.mu_mpa / p.alpha * (x.iter().map(|x| x.powf(0.5 * p.alpha)).sum::<f64>() - 3.0))
                .sum(),
        }
    }

    /// `tau` (MPa).
    pub(crate) fn stress(&self) -> Mat3 {
        let entry =
            |i: usize, j: usize| (0..3).map(|k| self.stress[k] * self.axes[k][i] * self.axes[k][j]).sum();
        std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)))
    }

    /// Adds the tangent of the isochoric stress to the blocks of node pairs (a, b <= a).
    pub(crate) fn add_tangent(&self, weight: f64, g: &[Vec3; 10], tangent: &mut [Mat3]) {
        let g = g.map(|g| mat_vec(&self.axes, g));
        let mut pair = 0;
        for a in 0..10 {
            for b in 0..=a {
                let products: Vec3 = std::array::from_fn(|k| g[a][k] * g[b][k]);
                let along = dot(self.stress, products);
                let mut local = [[0.0; 3]; 3];
                for i in 0..3 {
                    for j in 0..3 {
                        local[i][j] += weight * (self.normal[i][j] * g[a][i] * g[b][j]);
                        if i != j {
                            local[i][j] += weight * self.shear[i][j] * g[a][j] * g[b][i];
                            local[i][i] += weight * self.shear[i][j] * products[j];
                        }
                    }
                    local[i][i] += weight * along;
                }
                let block = &mut tangent[pair];
                pair += 1;
                for (local, axis) in local.iter().zip(&self.axes) {
                    let row: Vec3 = std::array::from_fn(|j| (0..3).map(|l| local[l] * self.axes[l][j]).sum());
                    for (block, along) in block.iter_mut().zip(axis) {
                        axpy(*along, row, block);
                    }
                }
            }
        }
    }
}

/// `(a^s - b^s) / (a - b)` for positive `a`, `b`; `s a^(s - 1)` where they are equal. Accurate for nearly equal ones.
fn divided_difference(a: f64, b: f64, s: f64) -> f64 {
    let r = a.ln() - b.ln();
    let ratio = if r == 0.0 { s } else { (s * r).exp_m1() / r.exp_m1() };
    b.powf(s - 1.0) * ratio
}
