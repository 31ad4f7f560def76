//! Proper orthogonal decomposition by thin QR and SVD in f64.
//!
//! `Y - mean = Q R`, `R = U S V^T`, modes `Phi = Q U`, coefficients `A = S V^T` (Eqs. 3, 5, 6). Forming `Y^T Y` would
//! square the singular values and lose everything below 1e-8 of the largest; QR keeps them to rounding. All snapshots
//! lie in the span of `Q`, so leaving a case out repeats only the small SVD of `R`: exact and cheap.

use faer::{Mat, MatRef};
use rom::model::truncation_error;
use thiserror::Error;

/// Why a decomposition failed.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum PodError {
    /// No snapshot.
    #[error("no snapshots to decompose; at least 1 is needed")]
    Empty,
    /// The singular value decomposition did not converge: non-finite data.
    #[error("the singular value decomposition did not converge; check the snapshots for non-finite values")]
    NoConvergence,
}

/// What snapshots are deviations from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Centre {
    /// Nothing: the snapshots themselves are decomposed, as in the paper.
    Origin,
    /// Their mean.
    Mean,
    /// One of them. All its coefficients are 0, so any number of modes reproduces it exactly.
    State(usize),
}

impl Centre {
    /// The field that is subtracted from the first `states` columns.
    #[must_use]
    pub fn of(self, y: &Mat<f64>, states: usize) -> Vec<f64> {
        match self {
            Self::Origin => vec![0.0; y.nrows()],
            Self::State(state) => y.col_as_slice(state).to_vec(),
            Self::Mean => {
                let mut mean = vec![0.0; y.nrows()];
                for j in 0..states {
                    mean.iter_mut().zip(y.col_as_slice(j)).for_each(|(mean, v)| *mean += v / states as f64);
                }
                mean
            }
        }
    }
}

/// A group's snapshots in compact form: everything exact, nothing truncated yet.
pub struct Compact {
    /// Field at the [`Centre`], `n`.
    pub mean: Vec<f64>,
    /// Orthonormal basis of all (centred) snapshots, `n x r`.
    pub q: Mat<f64>,
    /// Snapshots in that basis, `r x m`: distances and norms are those of the full snapshots.
    pub r: Mat<f64>,
}

/// POD in the compact basis.
pub struct Pod {
    /// Left singular vectors in the compact basis, `r x rank`.
    pub u: Mat<f64>,
    /// Singular values, largest first, all of them; before them, of modes that were there, the norms of their coefficients.
    pub singular_values: Vec<f64>,
    /// Number of singular values above rounding.
    pub rank: usize,
}

impl Compact {
    /// Compacts snapshots given as columns. The last `directions` columns are derivatives or deviations: they belong to the span,
    /// and the centre is not theirs. Cost `O(n m^2)`.
    ///
    /// # Errors
    /// [`PodError::Empty`] without columns.
    pub fn new(mut y: Mat<f64>, directions: usize, centre: Centre) -> Result<Self, PodError> {
        let (n, m) = (y.nrows(), y.ncols() - directions);
        if m == 0 || n == 0 {
            return Err(PodError::Empty);
        }
        let mean = centre.of(&y, m);
        for j in 0..m {
            y.col_as_slice_mut(j).iter_mut().zip(&mean).for_each(|(v, mean)| *v -= mean);
        }
        let qr = y.qr();
        Ok(Self { mean, q: qr.compute_thin_Q(), r: qr.thin_R().to_owned() })
    }

    /// Snapshots, given as columns that are deviations from `mean`, in a basis that begins with these orthonormal modes (`n x k`). Cost
    /// `O(n m^2)`.
    pub fn beyond(mean: Vec<f64>, leading: &Mat<f64>, mut y: Mat<f64>) -> Self {
        let along = leading.transpose() * &y;
        y -= leading * &along;
        let qr = y.qr();
        let (rest, own) = (qr.compute_thin_Q(), qr.thin_R());
        let (k, columns) = (leading.ncols(), y.ncols());
        let q =
            Mat::from_fn(
                y.nrows(),
                k + rest.ncols(),
                |i, j| {
                    if j < k { leading[(i, j)] } else { rest[(i, j - k)] }
                },
            );
        let r = Mat::from_fn(
            k + own.nrows(),
            columns,
            |i, j| if i < k { along[(i, j)] } else { own[(i - k, j)] },
        );
        Self { mean, q, r }
    }

    /// The full-length modes of the first `count` compact modes, `n x count`.
    pub fn modes(&self, pod: &Pod, count: usize) -> Mat<f64> {
        &self.q * pod.u.get(.., ..count)
    }
}

/// As [`decompose`] where the first `leading` directions are modes already: the others follow from what those leave.
///
/// # Errors
/// As [`decompose`].
pub fn decompose_beyond(r: MatRef<'_, f64>, leading: usize) -> Result<Pod, PodError> {
    let (rows, columns) = (r.nrows(), r.ncols());
    let own = decompose(r.get(leading.., ..))?;
    let u = Mat::from_fn(rows, leading + own.rank, |i, j| match (i < leading, j < leading) {
        (true, true) => f64::from(u8::from(i == j)),
        (false, false) => own.u[(i - leading, j - leading)],
        _ => 0.0,
    });
    let along = |row: usize| (0..columns).map(|j| r[(row, j)].powi(2)).sum::<f64>().sqrt();
    let singular_values = (0..leading).map(along).chain(own.singular_values).collect();
    Ok(Pod { u, singular_values, rank: leading + own.rank })
}

/// SVD of compact snapshots. Cost `O(m^3)`.
///
/// # Errors
/// [`PodError::NoConvergence`] on non-finite data.
pub fn decompose(r: MatRef<'_, f64>) -> Result<Pod, PodError> {
    let svd = r.thin_svd().map_err(|_| PodError::NoConvergence)?;
    let singular_values: Vec<f64> = svd.S().column_vector().iter().copied().collect();
    let floor =
        singular_values.first().copied().unwrap_or(0.0) * f64::EPSILON * 4.0 * (r.ncols() as f64).sqrt();
    let rank = singular_values.iter().filter(|s| **s > floor && **s > 0.0).count();
    Ok(Pod { u: svd.U().get(.., ..rank).to_owned(), singular_values, rank })
}

impl Pod {
    /// Truncation error of Eq. (4): fraction of the energy beyond the first `modes`.
    pub fn truncation_error(&self, modes: usize) -> f64 {
        truncation_error(&self.singular_values, modes)
    }

    /// The fewest modes with truncation error at most `limit`, at least 1 unless the rank is 0.
    pub fn modes_for_energy(&self, limit: f64) -> usize {
        (1..=self.rank).find(|l| self.truncation_error(*l) <= limit).unwrap_or(self.rank)
    }
}
