//! Linear prediction of a case from earlier ones. Reader and writer run the same operations in the same order.

/// Indices of the earlier cases nearest to `target` (mean square over a few nodes), nearest first, at most `most`.
pub(super) fn nearest(known: &[Vec<i32>], target: &[i32], most: usize) -> Vec<usize> {
    let stride = (target.len() / 500).max(1);
    let distance = |case: &[i32]| -> f64 {
        let pairs = case.iter().zip(target).step_by(stride);
        pairs.map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum()
    };
    let mut order: Vec<(f64, usize)> =
        known.iter().enumerate().map(|(i, case)| (distance(case), i)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    order.into_iter().take(most).map(|(_, i)| i).collect()
}

/// Least-squares weights of the basis, by elimination of the damped normal equations. Inexact weights affect the size of the file, not its
/// accuracy.
pub(super) fn weights(known: &[Vec<i32>], basis: &[usize], target: &[i32]) -> Vec<f64> {
    let n = basis.len();
    let dot = |a: &[i32], b: &[i32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    let mut rows: Vec<Vec<f64>> = basis
        .iter()
        .map(|i| {
            let mut row: Vec<f64> = basis.iter().map(|j| dot(&known[*i], &known[*j])).collect();
            row.push(dot(&known[*i], target));
            row
        })
        .collect();
    for (k, row) in rows.iter_mut().enumerate() {
        row[k] += 1e-12 * row[k] + 1.0;
    }
    for k in 0..n {
        let (above, below) = rows.split_at_mut(k + 1);
        let pivot = &above[k];
        for row in below {
            let factor = row[k] / pivot[k];
            for (value, p) in row[k..].iter_mut().zip(&pivot[k..]) {
                *value -= factor * p;
            }
        }
    }
    let mut weights = vec![0.0; n];
    for k in (0..n).rev() {
        let rest: f64 = (k + 1..n).map(|j| rows[k][j] * weights[j]).sum();
        weights[k] = (rows[k][n] - rest) / rows[k][k];
    }
    if weights.iter().all(|w| w.is_finite()) { weights } else { vec![0.0; n] }
}

/// Prediction in integer steps.
pub(super) fn predict(known: &[Vec<i32>], basis: &[usize], weights: &[f64], nodes: usize) -> Vec<i32> {
    let mut sum = vec![0.0_f64; nodes];
    for (case, weight) in basis.iter().zip(weights) {
        for (s, k) in sum.iter_mut().zip(&known[*case]) {
            *s += weight * f64::from(*k);
        }
    }
    sum.into_iter().map(|s| s.round() as i32).collect()
}
