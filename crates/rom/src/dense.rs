//! Small dense systems, solved by Gaussian elimination with partial pivoting: what answers need without the linear algebra of
//! training.

use std::ops::{Index, IndexMut};

/// A square matrix, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Dense {
    size: usize,
    values: Vec<f64>,
}

impl Dense {
    /// Zeros.
    pub fn zeros(size: usize) -> Self {
        Self { size, values: vec![0.0; size * size] }
    }

    /// Each entry from its row and column.
    pub fn from_fn(size: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        let entry = &entry;
        Self { size, values: (0..size).flat_map(|i| (0..size).map(move |j| entry(i, j))).collect() }
    }

    /// Number of rows, and of columns.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Solves `A X = B` in place of `right`, which holds `size x columns` values row by row. `None` if a pivot is 0 or NaN.
    /// Cost `O(size^3 + size^2 columns)`.
    pub fn solve(mut self, right: &mut [f64], columns: usize) -> Option<()> {
        let n = self.size;
        for k in 0..n {
            let largest = (k..n).max_by(|a, b| self[(*a, k)].abs().total_cmp(&self[(*b, k)].abs()))?;
            if !self[(largest, k)].is_normal() {
                return None;
            }
            swap_rows(&mut self.values, n, k, largest);
            swap_rows(right, columns, k, largest);
            let inverse = 1.0 / self[(k, k)];
            for i in k + 1..n {
                let factor = self[(i, k)] * inverse;
                if factor != 0.0 {
                    subtract_row(&mut self.values, n, (i, k), k + 1, factor);
                    subtract_row(right, columns, (i, k), 0, factor);
                }
            }
        }
        for k in (0..n).rev() {
            let inverse = 1.0 / self[(k, k)];
            right[k * columns..(k + 1) * columns].iter_mut().for_each(|x| *x *= inverse);
            for i in 0..k {
                let factor = self[(i, k)];
                subtract_row(right, columns, (i, k), 0, factor);
            }
        }
        Some(())
    }

    /// Inverse; `None` if a pivot is 0 or NaN. Cost `O(size^3)`.
    pub fn inverse(self) -> Option<Self> {
        let size = self.size;
        let mut inverse = Self::from_fn(size, |i, j| if i == j { 1.0 } else { 0.0 });
        self.solve(&mut inverse.values, size)?;
        Some(inverse)
    }
}

impl Index<(usize, usize)> for Dense {
    type Output = f64;

    fn index(&self, (row, column): (usize, usize)) -> &f64 {
        &self.values[row * self.size + column]
    }
}

impl IndexMut<(usize, usize)> for Dense {
    fn index_mut(&mut self, (row, column): (usize, usize)) -> &mut f64 {
        &mut self.values[row * self.size + column]
    }
}

fn swap_rows(values: &mut [f64], width: usize, a: usize, b: usize) {
    if a != b {
        let (low, high) = values.split_at_mut(a.max(b) * width);
        low[a.min(b) * width..][..width].swap_with_slice(&mut high[..width]);
    }
}

/// Subtracts `factor` times one row of another, from a column on.
fn subtract_row(values: &mut [f64], width: usize, (from, row): (usize, usize), first: usize, factor: f64) {
    let (low, high) = values.split_at_mut(from.max(row) * width);
    let (changed, taken) = if from > row {
        (&mut high[..width], &low[row * width..][..width])
    } else {
        (&mut low[from * width..][..width], &high[..width])
    };
    changed[first..].iter_mut().zip(&taken[first..]).for_each(|(x, y)| *x -= factor * y);
}
