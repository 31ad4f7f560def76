//! Radial kernels and polynomial tails, with the derivatives the gradients need.
//!
//! Kernels carry the sign that makes them conditionally positive definite (`-r`, `r^2 ln r`, `r^3`, `-r^5`, and the sum of
//! the last two), so that smoothing is always added with the same sign. The sign does not change an interpolant.

use crate::inputs::{MAX_INPUTS, Point};
use serde::{Deserialize, Serialize};
use std::fmt::{self, Display};

/// Polynomial added to a kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tail {
    /// None: the paper's method.
    None,
    /// A constant.
    Constant,
    /// Constant and linear terms.
    Linear,
    /// Up to second order.
    Quadratic,
}

/// Kernel of an interpolant, over inputs scaled to [0, 1].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum KernelKind {
    /// `r`: the paper's linear spline.
    Linear,
    /// `r^2 ln r`.
    ThinPlate,
    /// `r^3`.
    Cubic,
    /// `r^5`.
    Quintic,
    /// `exp(-(shape r)^2)`.
    Gaussian {
        /// Shape parameter over scaled inputs, > 0.
        shape: f64,
    },
    /// Matern 7/2 of one length over scaled inputs: between quintic (long) and a process that forgets (short).
    Matern72 {
        /// Length over scaled inputs, > 0.
        length: f64,
    },
    /// `r^3 - r^5 / crossover^2`: cubic between near centres, quintic between far ones. The quintic part
    /// follows smooth large-scale behaviour; a kink between two centres disturbs neighbours less than with a quintic alone.
    CubicQuintic {
        /// Distance over scaled inputs at which both count the same, > 0.
        crossover: f64,
    },
}

/// Its name with its parameter: `quintic`, `matern-7/2 of length 0.500`.
impl Display for KernelKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())?;
        match self {
            Self::Linear | Self::ThinPlate | Self::Cubic | Self::Quintic => Ok(()),
            Self::Gaussian { shape } => write!(f, " of shape {shape:.3}"),
            Self::Matern72 { length } => write!(f, " of length {length:.3}"),
            Self::CubicQuintic { crossover } => write!(f, " of crossover {crossover:.3}"),
        }
    }
}

impl Display for Tail {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl KernelKind {
    /// `g(r)`, `g'(r) / r` and `(g'(r) / r)' / r` for a squared distance. A gradient multiplies `x - x_k` by the second; second
    /// derivatives multiply products of two coordinates of `x - x_k` by the third. Where they are singular at `r = 0`, the
    /// product's limit is 0, and 0 is returned.
    #[inline(always)] // in a loop over centres the match is taken once
    pub(crate) fn derivatives(self, r2: f64) -> [f64; 3] {
        let over = |numerator: f64, denominator: f64| if r2 > 0.0 { numerator / denominator } else { 0.0 };
        match self {
            Self::Linear => {
                let r = r2.sqrt();
                [-r, over(-1.0, r), over(1.0, r2 * r)]
            }
            Self::ThinPlate if r2 == 0.0 => [0.0, 0.0, 0.0],
            Self::ThinPlate => {
                let ln_r = 0.5 * r2.ln();
                [r2 * ln_r, 2.0 * ln_r + 1.0, over(2.0, r2)]
            }
            Self::Cubic => {
                let r = r2.sqrt();
                [r2 * r, 3.0 * r, over(3.0, r)]
            }
            Self::Quintic => {
                let r = r2.sqrt();
                [-r2 * r2 * r, -5.0 * r2 * r, -15.0 * r]
            }
            Self::CubicQuintic { crossover } => {
                let (r, far) = (r2.sqrt(), r2 / (crossover * crossover));
                [r2 * r * (1.0 - far), r * (3.0 - 5.0 * far), over(3.0 - 15.0 * far, r)]
            }
            Self::Gaussian { shape } => {
                let g = exp(-shape * shape * r2);
                [g, -2.0 * shape * shape * g, 4.0 * shape.powi(4) * g]
            }
            Self::Matern72 { length } => {
                let s = (7.0 * r2).sqrt() / length;
                let e = exp(-s);
                let over_r = -1.4 / (length * length) * (1.0 + s + s * s / 3.0) * e;
                let second = 9.8 / (3.0 * length.powi(4)) * (1.0 + s) * e;
                [(1.0 + s + s * s * (0.4 + s / 15.0)) * e, over_r, second]
            }
        }
    }

    /// `g(r)` for a squared distance.
    pub fn value(self, r2: f64) -> f64 {
        self.derivatives(r2)[0]
    }

    /// True if second derivatives exist everywhere, which the fit of derivatives needs.
    pub const fn takes_derivatives(self) -> bool {
        !matches!(self, Self::Linear | Self::ThinPlate)
    }

    /// Name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::ThinPlate => "thin-plate",
            Self::Cubic => "cubic",
            Self::Quintic => "quintic",
            Self::Gaussian { .. } => "gaussian",
            Self::Matern72 { .. } => "matern-7/2",
            Self::CubicQuintic { .. } => "cubic-quintic",
        }
    }
}

/// `exp(x)` for `x <= 0` to about one unit in the last place: `2^n exp(r)` with `|r| <= ln 2 / 2`. Written with products and sums alone,
/// because the compiler makes vector instructions of these in a loop over centres and every processor gives the same bits.
#[inline(always)]
fn exp(x: f64) -> f64 {
    /// Added to a number, it leaves the nearest integer in the lowest bits.
    const TO_INTEGER: f64 = 1.5 * (1_u64 << 52) as f64;
    /// `ln 2`, cut so that its product with `n` is exact, and the rest of it.
    const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];
    /// `1 / k!`, the highest power first.
    const TAYLOR: [f64; 14] = [
        1.605_904_383_682_161_3e-10,
        2.087_675_698_786_81e-9,
        2.505_210_838_544_172e-8,
        2.755_731_922_398_589e-7,
        2.755_731_922_398_589_3e-6,
        2.480_158_730_158_73e-5,
        1.984_126_984_126_984e-4,
        1.388_888_888_888_889e-3,
        8.333_333_333_333_333e-3,
        4.166_666_666_666_666_4e-2,
        1.666_666_666_666_666_6e-1,
        0.5,
        1.0,
        1.0,
    ];
    let x = if x < -700.0 { -700.0 } else { x };
    let shifted = x * std::f64::consts::LOG2_E + TO_INTEGER;
    let n = shifted - TO_INTEGER;
    let r = (x - n * LN_2[0]) - n * LN_2[1];
    let mut sum = TAYLOR[0];
    for factor in &TAYLOR[1..] {
        sum = sum * r + factor;
    }
    // NaN is no longer one once its exponent is shifted.
    f64::from_bits(sum.to_bits().wrapping_add(shifted.to_bits() << 52)) + 0.0 * x
}

/// Kernels in model files: their number and their parameter, 0 for those without one. A number is never given to another kernel. In text
/// they have their names.
pub(crate) mod numbered {
    use super::KernelKind;
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(kernel: &KernelKind, to: S) -> Result<S::Ok, S::Error> {
        if to.is_human_readable() {
            return kernel.serialize(to);
        }
        let number_and_parameter: (u32, f64) = match *kernel {
            KernelKind::Linear => (0, 0.0),
            KernelKind::ThinPlate => (1, 0.0),
            KernelKind::Cubic => (2, 0.0),
            KernelKind::Quintic => (3, 0.0),
            KernelKind::Gaussian { shape } => (4, shape),
            KernelKind::Matern72 { length } => (5, length),
            KernelKind::CubicQuintic { crossover } => (6, crossover),
        };
        number_and_parameter.serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<KernelKind, D::Error> {
        if from.is_human_readable() {
            return KernelKind::deserialize(from);
        }
        Ok(match <(u32, f64)>::deserialize(from)? {
            (0, _) => KernelKind::Linear,
            (1, _) => KernelKind::ThinPlate,
            (2, _) => KernelKind::Cubic,
            (3, _) => KernelKind::Quintic,
            (4, shape) => KernelKind::Gaussian { shape },
            (5, length) => KernelKind::Matern72 { length },
            (6, crossover) => KernelKind::CubicQuintic { crossover },
            (number, _) => return Err(D::Error::custom(format!("kernel {number}, expected 0 to 6"))),
        })
    }
}

impl Tail {
    /// Number of terms over `dimensions` inputs.
    pub fn terms(self, dimensions: usize) -> usize {
        match self {
            Self::None => 0,
            Self::Constant => 1,
            Self::Linear => 1 + dimensions,
            Self::Quadratic => 1 + dimensions + dimensions * (dimensions + 1) / 2,
        }
    }

    /// Calls `with` for the terms in use at `u`: value and gradient of `1`, of every input, of every product of two.
    pub fn each_term(self, dimensions: usize, u: &Point, mut with: impl FnMut(f64, Point)) {
        let order = match self {
            Self::None => return,
            Self::Constant => 0,
            Self::Linear => 1,
            Self::Quadratic => 2,
        };
        with(1.0, [0.0; MAX_INPUTS]);
        for i in (0..dimensions).filter(|_| order > 0) {
            let mut slope = [0.0; MAX_INPUTS];
            slope[i] = 1.0;
            with(u[i], slope);
        }
        for (i, j) in (0..dimensions).flat_map(|i| (i..dimensions).map(move |j| (i, j))).filter(|_| order > 1)
        {
            let mut slope = [0.0; MAX_INPUTS];
            slope[i] += u[j];
            slope[j] += u[i];
            with(u[i] * u[j], slope);
        }
    }

    /// Values of the terms in use at `u`.
    pub fn values(self, dimensions: usize, u: &Point) -> Vec<f64> {
        let mut values = Vec::with_capacity(self.terms(dimensions));
        self.each_term(dimensions, u, |value, _| values.push(value));
        values
    }

    /// Name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "no tail",
            Self::Constant => "constant tail",
            Self::Linear => "linear tail",
            Self::Quadratic => "quadratic tail",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::exp;

    #[test]
    fn exponentials_are_those_of_the_library_to_the_last_places() {
        for x in (0..200_000).map(|i| -f64::from(i) * 3.456_7e-3) {
            let (own, known) = (exp(x), x.exp());
            assert!((own - known).abs() <= 4.0 * f64::EPSILON * known, "{x}: {own} {known}");
        }
        assert_eq!(exp(0.0), 1.0);
        assert!(exp(f64::NEG_INFINITY) < 1e-300 && exp(f64::NAN).is_nan());
    }
}
