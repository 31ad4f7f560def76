//! Stresses and moduli along the principal directions, and material stability.

use super::law::{Dependence, Energy, Hyperelastic, Power};
use crate::algebra::{Mat3, Vec3};

/// Kirchhoff stresses along the principal directions and their moduli.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Principal {
    /// `l_i dW/dl_i` (MPa), up to a pressure.
    pub(crate) t: Vec3,
    /// Derivatives of `t` with respect to `ln l_j` (MPa).
    pub(crate) moduli: Mat3,
}

impl Principal {
    /// Response at squared isochoric stretches `x`.
    pub(crate) fn of_powers(powers: &[Power; 3], x: Vec3) -> Self {
        let mut this = Self { t: [0.0; 3], moduli: [[0.0; 3]; 3] };
        for power in powers.iter().filter(|power| power.mu_mpa != 0.0) {
            for (i, x) in x.iter().enumerate() {
                let term = power.mu_mpa * x.powf(0.5 * power.alpha);
                this.t[i] += term;
                this.moduli[i][i] += power.alpha * term;
            }
        }
        this
    }

    fn of_invariant(energy: &Energy, x: Vec3) -> Self {
        let moduli = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let diagonal = if i == j { 4.0 * energy.d1 * x[i] } else { 0.0 };
                diagonal + 4.0 * energy.d2 * x[i] * x[j]
            })
        });
        Self { t: x.map(|x| 2.0 * energy.d1 * x), moduli }
    }

    /// Drucker's criterion: positive work of stress and strain increments for every isochoric increment.
    pub(crate) fn is_stable(&self) -> bool {
        const BASIS: [Vec3; 2] = [
            [std::f64::consts::FRAC_1_SQRT_2, -std::f64::consts::FRAC_1_SQRT_2, 0.0],
            [0.408_248_290_463_863, 0.408_248_290_463_863, -0.816_496_580_927_726],
        ];
        let product = |a: Vec3, b: Vec3| -> f64 {
            (0..3)
                .flat_map(|i| (0..3).map(move |j| (i, j)))
                .map(|(i, j)| a[i] * self.moduli[i][j] * b[j])
                .sum()
        };
        let (a, b, c) =
            (product(BASIS[0], BASIS[0]), product(BASIS[0], BASIS[1]), product(BASIS[1], BASIS[1]));
        a + c > 0.0 && a * c - b * b > 0.0
    }
}

/// Drucker's criterion for an energy of the first invariant: `W' > 0` and `W' + W'' (I - 9 / I2) > 0`, where `I - 9 / I2` is the largest
/// squared rate of `I / 2` over `sum x_i e_i^2` among isochoric logarithmic strain rates `e`.
pub(crate) fn is_stable_invariant(energy: &Energy, i1: f64, i2: f64) -> bool {
    energy.d1 > 0.0 && energy.d1 + energy.d2 * (i1 - 9.0 / i2) > 0.0
}

/// Largest stretch of a bar up to which stability is examined.
const EXAMINED: f64 = 15.0;
/// Steps of the logarithmic stretch up to there.
const STEPS: usize = 600;
/// Ratios `ln l2 / ln l1` from tension of a bar over pure shear to equibiaxial tension (or compression of a bar).
const RATIOS: [f64; 7] = [-0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0];

impl Hyperelastic {
    /// Response at squared isochoric stretches `x`; `None` beyond the law's limit.
    pub(crate) fn principal(&self, x: Vec3) -> Option<Principal> {
        Some(match self.at(x[0] + x[1] + x[2])? {
            Dependence::Invariant(energy) => Principal::of_invariant(&energy, x),
            Dependence::Stretches(powers) => Principal::of_powers(&powers, x),
        })
    }

    /// Stretch of a bar in tension whose first invariant is the smallest at which some deformation is unstable (Drucker), up to a
    /// stretch of 15; `None` if there is none.
    pub fn stable_to(&self) -> Option<f64> {
        if self.is_always_stable() {
            return None;
        }
        let stable_invariant = |ratio: f64| {
            let first = |k: &usize| !self.is_stable_at(ratio, EXAMINED.ln() * *k as f64 / STEPS as f64);
            let step = (1..=STEPS).find(first)?;
            let log_stretch = |k: usize| EXAMINED.ln() * k as f64 / STEPS as f64;
            let (mut low, mut high) = (log_stretch(step - 1), log_stretch(step));
            for _ in 0..30 {
                let middle = 0.5 * (low + high);
                if self.is_stable_at(ratio, middle) { low = middle } else { high = middle }
            }
            Some(stretches(ratio, low).iter().sum::<f64>())
        };
        let limit = RATIOS.into_iter().filter_map(stable_invariant).fold(f64::INFINITY, f64::min);
        let stretch = super::tension::stretch_at(limit);
        (stretch <= EXAMINED).then_some(stretch)
    }

    /// Drucker's criterion at `ln l1 = e`, `ln l2 = ratio e`; a state beyond the law's limit is not unstable.
    fn is_stable_at(&self, ratio: f64, e: f64) -> bool {
        self.principal(stretches(ratio, e)).is_none_or(|principal| principal.is_stable())
    }
}

/// Squared stretches.
fn stretches(ratio: f64, e: f64) -> Vec3 {
    [2.0 * e, 2.0 * ratio * e, -2.0 * (1.0 + ratio) * e].map(f64::exp)
}
