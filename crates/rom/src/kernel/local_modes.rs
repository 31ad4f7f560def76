//! Local modes: in a group of neighbouring nodes a field needs fewer rows than the whole body does.
//!
//! With `Phi` the rows of a field over the nodes of a group (`nodes x m`: mean and modes) and `K = L L^T` the mean products of their
//! coefficients in use, `F = Phi L` is what the group sees. Of orthonormal columns `Q` that span `F`,
//!
//! ```text
//! Phi a ~ Q (Q^T Phi) a         k rows instead of m, their coefficients b = (Q^T Phi) a
//! ```
//! the mean squares of `b` are the row sums of squares of `Q^T F`. `Q` is a Gram-Schmidt basis, the largest column first, after one
//! iteration `F (F^T Q)`: as few columns as the singular vectors of `F` to a per cent, without a decomposition.
//!
//! All of it happens among orthonormal columns `W` that span `Phi`, in `m` numbers a column instead of one a node: `Phi = W (W^T Phi)`, so `W^T F`
//! has the products of `F`. Cost `O(nodes m^2)` once a group, and `O(nodes m k)` for each `L`.

use super::budget::Component;
use super::isa::with_widest_vectors;
use std::cell::OnceCell;

/// Share of what may be left out that is before local modes are looked for: over a part of the domain many columns add next to nothing.
const LEAST: f64 = 0.1;

/// Columns of one length, one after the other.
#[derive(Debug, Clone)]
pub(super) struct Columns {
    pub length: usize,
    pub values: Vec<f64>,
}

impl Columns {
    pub fn count(&self) -> usize {
        self.values.len() / self.length.max(1)
    }

    pub fn of(&self, at: usize) -> &[f64] {
        &self.values[at * self.length..][..self.length]
    }

    fn each(&self) -> impl Iterator<Item = &[f64]> {
        self.values.chunks_exact(self.length)
    }

    /// Sums of these columns, one for each column of factors.
    fn times<'a>(&self, factors: impl Iterator<Item = &'a [f64]>) -> Self {
        let mut values = Vec::new();
        for factors in factors {
            let mut sum = vec![0.0; self.length];
            // Of a triangle half is nothing.
            let all = self.each().zip(factors).filter(|(_, factor)| **factor != 0.0);
            all.for_each(|(column, factor)| add_times(&mut sum, column, *factor));
            values.extend(sum);
        }
        Self { length: self.length, values }
    }

    /// By column of `other`: the products of the columns with it.
    fn products(&self, other: &Self) -> Self {
        let values = other.each().flat_map(|other| self.each().map(|column| dot(column, other))).collect();
        Self { length: self.count(), values }
    }
}

/// The rows of a list over the nodes of a group.
#[derive(Debug)]
pub(super) struct GroupRows {
    pub rows: Columns,
    /// Orthonormal columns that span them, and each row's products with these; worked out when they are asked for.
    spanned: OnceCell<(Columns, Columns)>,
}

impl GroupRows {
    pub fn new(rows: Columns) -> Self {
        Self { rows, spanned: OnceCell::new() }
    }

    fn spanned(&self) -> &(Columns, Columns) {
        self.spanned.get_or_init(|| {
            let columns = span(&self.rows, 0.0, self.rows.count());
            let products = columns.products(&self.rows);
            (columns, products)
        })
    }
}

/// Sums side by side: additions do not wait for each other.
const SUMS: usize = 32;

fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; SUMS];
    add_products(a, b, &mut sums);
    let whole = a.len() / SUMS * SUMS;
    let rest: f64 = a[whole..].iter().zip(&b[whole..]).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

with_widest_vectors! {
    fn add_products(a: &[f64], b: &[f64], sums: &mut [f64; SUMS]) = add_products_plain;
}

with_widest_vectors! {
    pub(super) fn add_times(to: &mut [f64], from: &[f64], factor: f64) = add_times_plain;
}

#[inline(always)]
fn add_products_plain(a: &[f64], b: &[f64], sums: &mut [f64; SUMS]) {
    for (a, b) in a.chunks_exact(SUMS).zip(b.chunks_exact(SUMS)) {
        for k in 0..SUMS {
            sums[k] += a[k] * b[k];
        }
    }
}

#[inline(always)]
fn add_times_plain(to: &mut [f64], from: &[f64], factor: f64) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += factor * from;
    }
}

/// Lower triangle `L`, column by column, with `L L^T` the mean products of these vectors' entries; a column that follows from the
/// others is 0.
pub(super) fn square_root(vectors: &[Vec<f64>], size: usize) -> Columns {
    let entries: Vec<Vec<f64>> =
        (0..size).map(|i| vectors.iter().map(|vector| vector[i]).collect()).collect();
    let mean = |i: usize, j: usize| dot(&entries[i], &entries[j]) / vectors.len() as f64;
    let mut root = Columns { length: size, values: vec![0.0; size * size] };
    for j in 0..size {
        let diagonal = mean(j, j);
        let of = |root: &Columns, i: usize| {
            mean(i, j) - (0..j).map(|k| root.of(k)[i] * root.of(k)[j]).sum::<f64>()
        };
        let left = of(&root, j);
        // What rounding leaves of a column that follows from the others is no column.
        if left > 1e-13 * diagonal {
            let below: Vec<f64> = (j..size).map(|i| of(&root, i) / left.sqrt()).collect();
            root.values[j * size + j..(j + 1) * size].copy_from_slice(&below);
        }
    }
    root
}

/// A square that was lowered to less than this share of it has lost digits, and is summed up anew.
const LOST: f64 = 1e-6;

/// Orthonormal columns that span `columns` but for a sum of squares of `tolerance`, the largest first, `most` at most.
fn span(columns: &Columns, tolerance: f64, most: usize) -> Columns {
    let (length, mut rest) = (columns.length, columns.values.clone());
    let mut found = Columns { length, values: Vec::new() };
    // Squares of what is left of the columns, and as they were when they were last summed up.
    let mut squares: Vec<[f64; 2]> = columns.each().map(|column| [dot(column, column); 2]).collect();
    let all: f64 = squares.iter().map(|[now, _]| now).sum();
    while found.count() < most.min(length) {
        let Some((at, [largest, _])) = squares.iter().enumerate().max_by(|a, b| a.1[0].total_cmp(&b.1[0]))
        else {
            break;
        };
        // What is left of columns in the span is rounding.
        if squares.iter().map(|[now, _]| now).sum::<f64>() <= tolerance || *largest <= 1e-28 * all {
            break;
        }
        let mut next = rest[at * length..][..length].to_vec();
        // Once more against all before: what was taken off a column in many steps is orthogonal to rounding only.
        for before in found.values.chunks_exact(length) {
            let along = dot(before, &next);
            add_times(&mut next, before, -along);
        }
        let norm = dot(&next, &next).sqrt();
        next.iter_mut().for_each(|value| *value /= norm);
        for (column, [now, summed]) in rest.chunks_exact_mut(length).zip(&mut squares) {
            let along = dot(&next, column);
            add_times(column, &next, -along);
            *now -= along * along;
            if *now <= LOST * *summed {
                *now = dot(column, column);
                *summed = *now;
            }
        }
        found.values.extend(next);
    }
    found
}

/// The local modes of rows over a group, whose coefficients have the mean products `root root^T`, and the sum over the nodes of the
/// mean squares of what they leave out, about `tolerance` at most.
pub(super) fn local_modes(rows: &GroupRows, root: &Columns, tolerance: f64) -> (Vec<Component>, f64) {
    let (columns, rows) = rows.spanned();
    if columns.count() == 0 {
        return (Vec::new(), 0.0); // rows of nothing but 0
    }
    let seen = rows.times(root.each());
    let (counts, nothing) = without_least(&seen, LEAST * tolerance);
    let first = span(&counts, tolerance - nothing, rows.count());
    if first.count() == 0 {
        return (Vec::new(), dot(&seen.values, &seen.values));
    }
    let turned = counts.times(counts.products(&first).each());
    let modes = span(&turned, 0.0, first.count());
    let mut rest = seen;
    let mut components = Vec::with_capacity(modes.count());
    for mode in modes.each() {
        let mut square = 0.0;
        for column in rest.values.chunks_exact_mut(rows.length) {
            let along = dot(mode, column);
            add_times(column, mode, -along);
            square += along * along;
        }
        let of_rows = rows.each().map(|row| dot(mode, row)).collect();
        let values = columns.times(std::iter::once(mode)).values;
        components.push(Component { values, rms: square.sqrt(), of_rows });
    }
    (components, dot(&rest.values, &rest.values))
}

/// Without the columns that add least, whose sum of squares is `tolerance` at most, and that sum.
fn without_least(columns: &Columns, tolerance: f64) -> (Columns, f64) {
    let mut least: Vec<(f64, usize)> =
        columns.each().enumerate().map(|(at, column)| (dot(column, column), at)).collect();
    least.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut sum, mut left_out) = (0.0, vec![false; least.len()]);
    for (square, at) in least {
        if sum + square > tolerance {
            break;
        }
        sum += square;
        left_out[at] = true;
    }
    let kept =
        columns.each().zip(left_out).filter(|(_, out)| !out).flat_map(|(column, _)| column.iter().copied());
    (Columns { length: columns.length, values: kept.collect() }, sum)
}

/// Sum over the nodes of the mean squares of what the rows add, each by itself.
pub(super) fn energy(rows: &Columns, root: &Columns) -> f64 {
    rows.each().enumerate().map(|(at, row)| mean_square(root, at) * dot(row, row)).sum()
}

/// Of the coefficient of a row.
fn mean_square(root: &Columns, row: usize) -> f64 {
    root.each().map(|column| column[row] * column[row]).sum()
}

/// The rows as they are, for lists that are not worth a change.
pub(super) fn as_they_are(rows: &Columns, root: &Columns) -> Vec<Component> {
    let one = |(at, row): (usize, &[f64])| {
        let of_rows = (0..rows.count()).map(|j| if j == at { 1.0 } else { 0.0 }).collect();
        Component { values: row.to_vec(), rms: mean_square(root, at).sqrt(), of_rows }
    };
    rows.each().enumerate().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn local_modes_give_back_what_the_rows_give_but_for_what_they_say_they_leave_out(
            nodes in 1_usize..40,
            rows in proptest::collection::vec(proptest::collection::vec(-9.0..9.0_f64, 40), 1..9),
            vectors in proptest::collection::vec(proptest::collection::vec(-5.0..5.0_f64, 9), 1..20),
            share in 0.0..0.2_f64,
        ) {
            let count = rows.len();
            let columns = Columns { length: nodes, values: rows.iter().flat_map(|row| row[..nodes].to_vec()).collect() };
            let root = square_root(&vectors, count);
            let field = |vector: &[f64]| columns.times(std::iter::once(&vector[..count])).values;
            let mean_square = |of: &dyn Fn(&[f64]) -> Vec<f64>| {
                vectors.iter().map(|vector| dot(&of(vector), &of(vector))).sum::<f64>() / vectors.len() as f64
            };
            let all = mean_square(&field);
            let (modes, left_out) = local_modes(&GroupRows::new(columns.clone()), &root, share * all);
            prop_assert!(modes.len() <= count.min(nodes));
            let error = |vector: &[f64]| {
                let mut rest = field(vector);
                for mode in &modes {
                    add_times(&mut rest, &mode.values, -dot(&mode.of_rows, &vector[..count]));
                }
                rest
            };
            let found = mean_square(&error);
            prop_assert!((found - left_out).abs() <= 1e-9 * all, "{found} {left_out} of {all}");
            prop_assert!(left_out <= share * all + 1e-9 * all, "{left_out} {share} of {all}");
            let of_modes: f64 = modes.iter().map(|mode| mode.rms * mode.rms).sum();
            prop_assert!((of_modes + left_out - all).abs() <= 1e-9 * all);
            for (at, mode) in modes.iter().enumerate() {
                for (other, before) in modes[..=at].iter().enumerate() {
                    let product = dot(&mode.values, &before.values);
                    let expected = f64::from(u8::from(other == at));
                    prop_assert!((product - expected).abs() < 1e-9, "{product} for {expected}");
                }
            }
        }
    }
}
