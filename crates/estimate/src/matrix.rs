//! Small symmetric matrices of a fixed largest size: no allocation, so that the filter can run in a control loop. Below them the
//! distributions that residuals are compared with.

/// Largest number of states: unknowns and the noise of measured inputs.
pub const MAX_STATES: usize = 12;

/// Sweeps of Jacobi rotations: they converge quadratically, in fewer than 8 for 12 states.
const SWEEPS: usize = 10;

/// Vector over the states; unused entries are 0.
pub type Vector = [f64; MAX_STATES];

/// Symmetric matrix over the first `size` states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Symmetric {
    size: usize,
    entries: [[f64; MAX_STATES]; MAX_STATES],
}

impl Symmetric {
    /// Matrix with this diagonal.
    ///
    /// # Panics
    /// If there are more than [`MAX_STATES`] values.
    pub fn diagonal(values: &[f64]) -> Self {
        assert!(values.len() <= MAX_STATES, "{} states, at most {MAX_STATES}", values.len());
        let mut out = Self { size: values.len(), entries: [[0.0; MAX_STATES]; MAX_STATES] };
        for (i, value) in values.iter().enumerate() {
            out.entries[i][i] = *value;
        }
        out
    }

    pub fn size(&self) -> usize {
        self.size
    }

    /// Entry of two states.
    pub fn get(&self, i: usize, j: usize) -> f64 {
        self.entries[i][j]
    }

    /// Sets one entry; the caller keeps the matrix symmetric.
    pub(crate) fn set(&mut self, i: usize, j: usize, value: f64) {
        self.entries[i][j] = value;
    }

    /// Makes a state independent of the others, with this diagonal entry.
    pub(crate) fn replace(&mut self, i: usize, value: f64) {
        self.entries[i] = [0.0; MAX_STATES];
        self.entries.iter_mut().for_each(|row| row[i] = 0.0);
        self.entries[i][i] = value;
    }

    /// Adds to a diagonal entry.
    pub(crate) fn add_diagonal(&mut self, i: usize, value: f64) {
        self.entries[i][i] += value;
    }

    /// `A += B`, both of the same size.
    pub(crate) fn add(&mut self, other: &Self) {
        let both = self.entries.iter_mut().flatten().zip(other.entries.iter().flatten());
        both.for_each(|(a, b)| *a += b);
    }

    /// `A_ij / sqrt(A_ii A_jj)`: a covariance's correlation.
    pub fn correlation(&self, i: usize, j: usize) -> f64 {
        self.get(i, j) / (self.get(i, i) * self.get(j, j)).sqrt()
    }

    /// `A += weight v v^T`.
    pub(crate) fn add_outer(&mut self, weight: f64, v: &Vector) {
        // Rows of constant length; unused entries stay 0.
        for (row, along) in self.entries.iter_mut().zip(v).take(self.size) {
            let along = weight * along;
            row.iter_mut().zip(v).for_each(|(entry, v)| *entry += along * v);
        }
    }

    /// `A v`.
    pub(crate) fn times(&self, v: &Vector) -> Vector {
        let mut out = [0.0; MAX_STATES];
        for (out, row) in out.iter_mut().zip(&self.entries).take(self.size) {
            *out = row.iter().zip(v).map(|(a, v)| a * v).sum();
        }
        out
    }

    /// Leading block of `size` states.
    pub(crate) fn leading(&self, size: usize) -> Self {
        Self { size: size.min(self.size), ..*self }
    }

    /// This matrix, followed on its diagonal by further states.
    pub(crate) fn extended(&self, more: &[f64]) -> Self {
        let mut out = Self::diagonal(&[0.0; MAX_STATES][..self.size + more.len()]);
        for i in 0..self.size {
            out.entries[i][..self.size].copy_from_slice(&self.entries[i][..self.size]);
        }
        for (i, value) in more.iter().enumerate() {
            out.entries[self.size + i][self.size + i] = *value;
        }
        out
    }

    /// Eigenvalues in any order, by Jacobi rotations.
    pub(crate) fn eigenvalues(&self) -> Vector {
        let mut a = self.entries;
        let pairs = || (0..self.size).flat_map(|p| (p + 1..self.size).map(move |q| (p, q)));
        for _ in 0..SWEEPS {
            for (p, q) in pairs() {
                if a[p][q] == 0.0 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for row in &mut a {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                let (above, below) = a.split_at_mut(q);
                for (x, y) in above[p].iter_mut().zip(&mut below[0]) {
                    (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
                }
            }
        }
        std::array::from_fn(|i| a[i][i])
    }

    /// Solves `A x = b` for the entries of `x` that are not held at a value; `None` if `A` is not positive definite.
    pub(crate) fn solve_with(&self, held: &[Option<f64>; MAX_STATES], b: &Vector) -> Option<Vector> {
        let (mut matrix, mut right) = (*self, *b);
        for (i, value) in held.iter().enumerate().filter_map(|(i, value)| Some((i, (*value)?))) {
            right.iter_mut().zip(&self.entries).for_each(|(right, row)| *right -= row[i] * value);
            matrix.entries[i] = [0.0; MAX_STATES];
            matrix.entries.iter_mut().for_each(|row| row[i] = 0.0);
            matrix.entries[i][i] = 1.0;
        }
        held.iter().zip(&mut right).for_each(|(held, right)| *right = held.unwrap_or(*right));
        Some(matrix.cholesky()?.solve(&right))
    }

    /// Cholesky factor; `None` if the matrix is not positive definite.
    pub(crate) fn cholesky(&self) -> Option<Cholesky> {
        let (mut l, mut over) = ([[0.0; MAX_STATES]; MAX_STATES], [0.0; MAX_STATES]);
        for i in 0..self.size {
            for j in 0..=i {
                let product: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
                let rest = self.entries[i][j] - product;
                if i == j {
                    // The comparison is false for NaN too.
                    if !(rest > 0.0 && rest.is_finite()) {
                        return None;
                    }
                    l[i][i] = rest.sqrt();
                    over[i] = 1.0 / l[i][i];
                } else {
                    l[i][j] = rest * over[j];
                }
            }
        }
        Some(Cholesky { size: self.size, l, over })
    }
}

/// `A = L L^T`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cholesky {
    size: usize,
    l: [[f64; MAX_STATES]; MAX_STATES],
    /// 1 over the diagonal of `l`.
    over: Vector,
}

impl Cholesky {
    /// Solves `A x = b`.
    pub(crate) fn solve(&self, b: &Vector) -> Vector {
        self.solve_from(0, b)
    }

    /// Solves `A x = b` for a `b` whose entries before `first` are 0.
    fn solve_from(&self, first: usize, b: &Vector) -> Vector {
        let mut x = *b;
        for i in first..self.size {
            let known: f64 = (first..i).map(|k| self.l[i][k] * x[k]).sum();
            x[i] = (x[i] - known) * self.over[i];
        }
        for i in (0..self.size).rev() {
            let known: f64 = (i + 1..self.size).map(|k| self.l[k][i] * x[k]).sum();
            x[i] = (x[i] - known) * self.over[i];
        }
        x
    }

    /// `A^-1`, exactly symmetric.
    pub(crate) fn inverse(&self) -> Symmetric {
        let mut out = Symmetric::diagonal(&[0.0; MAX_STATES][..self.size]);
        for j in 0..self.size {
            let mut unit = [0.0; MAX_STATES];
            unit[j] = 1.0;
            let column = self.solve_from(j, &unit);
            for (i, value) in column.iter().enumerate().take(self.size).skip(j) {
                out.entries[i][j] = *value;
                out.entries[j][i] = *value;
            }
        }
        out
    }

    /// Natural logarithm of the determinant of `A`.
    pub(crate) fn ln_determinant(&self) -> f64 {
        2.0 * (0..self.size).map(|i| self.l[i][i].ln()).sum::<f64>()
    }
}

/// Factorised noise block of a reading's normal equations, with its right-hand side.
fn noise_block(matrix: &Symmetric, right: &Vector, count: usize) -> Option<(Cholesky, Vector)> {
    let own = matrix.size() - count;
    let mut block = Symmetric::diagonal(&[0.0; MAX_STATES][..own]);
    let mut tail = [0.0; MAX_STATES];
    for i in 0..own {
        (0..own).for_each(|j| block.set(i, j, matrix.get(count + i, count + j)));
        tail[i] = right[count + i];
    }
    Some((block.cholesky()?, tail))
}

/// Step of a reading's noise at fixed unknowns.
pub(crate) fn noise_step(matrix: &Symmetric, right: &Vector, count: usize) -> Option<Vector> {
    let (factor, tail) = noise_block(matrix, right, count)?;
    Some(factor.solve(&tail))
}

/// Adds the Schur complement of the reading's noise to a matrix and a right-hand side of the unknowns.
pub(crate) fn eliminate(
    matrix: &Symmetric,
    right: &Vector,
    count: usize,
    to_matrix: &mut Symmetric,
    to_right: &mut Vector,
) -> Option<()> {
    let (factor, tail) = noise_block(matrix, right, count)?;
    let own = matrix.size() - count;
    for (i, right) in right.iter().enumerate().take(count) {
        let mut coupling = [0.0; MAX_STATES];
        (0..own).for_each(|k| coupling[k] = matrix.get(i, count + k));
        let carried = factor.solve(&coupling);
        for j in 0..count {
            let through: f64 = (0..own).map(|k| carried[k] * matrix.get(j, count + k)).sum();
            to_matrix.set(i, j, to_matrix.get(i, j) + matrix.get(i, j) - through);
        }
        to_right[i] += right - (0..own).map(|k| carried[k] * tail[k]).sum::<f64>();
    }
    Some(())
}

// ---- normal and chi-squared distributions ----

/// Density of the standard normal distribution.
pub(crate) fn density(z: f64) -> f64 {
    (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt()
}

/// Upper tail of the standard normal distribution, `P(Z > z)`.
pub(crate) fn upper_tail(z: f64) -> f64 {
    0.5 * libm::erfc(z * std::f64::consts::FRAC_1_SQRT_2)
}

/// Standard deviations beyond which the difference in [`truncated`] loses its digits.
const FAR: f64 = 30.0;

/// Mean and standard deviation of a normal variable known to lie above `floor`.
pub(crate) fn truncated(mean: f64, sigma: f64, floor: f64) -> (f64, f64) {
    let a = (floor - mean) / sigma;
    if a < -FAR {
        return (mean, sigma);
    }
    if a > FAR {
        // The tail is an exponential distribution of scale sigma / a to the first order.
        return (floor + sigma / a, sigma / a);
    }
    let ratio = density(a) / upper_tail(a);
    (mean + sigma * ratio, sigma * (1.0 + a * ratio - ratio * ratio).sqrt())
}

/// Chi-squared quantile of the probability of a standard normal variable below `z`, by the Wilson-Hilferty approximation; its
/// error is at most 0.5 % for the quantiles used here.
pub(crate) fn chi_squared_quantile(degrees: usize, z: f64) -> f64 {
    let n = degrees as f64;
    if degrees == 0 {
        return 0.0;
    }
    n * (1.0 - 2.0 / (9.0 * n) + z * (2.0 / (9.0 * n)).sqrt()).max(0.0).powi(3)
}

#[cfg(test)]
#[path = "../tests/unit/matrix.rs"]
mod tests;
