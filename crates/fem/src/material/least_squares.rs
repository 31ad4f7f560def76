//! Small dense least squares, and a search over a few nonlinear constants.

/// Normal equations `G c = h` of rows `sum_k c_k a_k - b`, with `s = b.b`.
#[derive(Clone, Debug)]
pub(super) struct Gram {
    g: Vec<Vec<f64>>,
    h: Vec<f64>,
    s: f64,
}

impl Gram {
    /// Creates the equations from columns and a right-hand side of the same length.
    pub(super) fn new(columns: &[Vec<f64>], b: &[f64]) -> Self {
        let product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
        Self {
            g: columns.iter().map(|x| columns.iter().map(|y| product(x, y)).collect()).collect(),
            h: columns.iter().map(|x| product(x, b)).collect(),
            s: product(b, b),
        }
    }

    /// The columns `chosen`.
    pub(super) fn part(&self, chosen: &[usize]) -> Self {
        Self {
            g: chosen.iter().map(|i| chosen.iter().map(|j| self.g[*i][*j]).collect()).collect(),
            h: chosen.iter().map(|i| self.h[*i]).collect(),
            s: self.s,
        }
    }

    /// Least squares over all columns, with the sum of squares; `None` if they are linearly dependent.
    pub(super) fn solve(&self) -> Option<(Vec<f64>, f64)> {
        let n = self.h.len();
        let scale: Vec<f64> = (0..n).map(|i| self.g[i][i].sqrt()).collect();
        if scale.iter().any(|scale| scale.is_nan() || *scale <= 0.0) {
            return None;
        }
        let inverse = inverse(
            &(0..n)
                .map(|i| (0..n).map(|j| self.g[i][j] / (scale[i] * scale[j])).collect())
                .collect::<Vec<Vec<f64>>>(),
        )?;
        let c: Vec<f64> = (0..n)
            .map(|i| (0..n).map(|j| inverse[i][j] * self.h[j] / scale[j]).sum::<f64>() / scale[i])
            .collect();
        let sum = self.s - c.iter().zip(&self.h).map(|(c, h)| c * h).sum::<f64>();
        Some((c, sum.max(0.0)))
    }

    /// Least squares with coefficients of the given signs or 0: the best of all subsets of the columns.
    pub(super) fn solve_signed(&self, signs: &[f64]) -> Option<(Vec<f64>, f64)> {
        let n = self.h.len();
        let subset = |mask: u32| -> Option<(Vec<f64>, f64)> {
            let chosen: Vec<usize> = (0..n).filter(|i| mask >> i & 1 == 1).collect();
            let (part, sum) = self.part(&chosen).solve()?;
            let mut c = vec![0.0; n];
            chosen.iter().zip(&part).for_each(|(i, value)| c[*i] = *value);
            c.iter().zip(signs).all(|(c, sign)| c * sign >= 0.0).then_some((c, sum))
        };
        (1..1_u32 << n).filter_map(subset).min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// Inverse of a symmetric positive definite matrix by Cholesky's method; `None` if it is singular at rounding level.
pub(super) fn inverse(m: &[Vec<f64>]) -> Option<Vec<Vec<f64>>> {
    let n = m.len();
    let mut l = vec![vec![0.0; n]; n];
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = m[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            if i == j {
                if sum.is_nan() || sum <= 1.0e-13 * m[i][i] {
                    return None;
                }
                l[i][i] = sum.sqrt();
            } else {
                l[i][j] = sum / l[j][j];
            }
        }
    }
    let column = |unit: usize| {
        let mut y = vec![0.0; n];
        for i in 0..n {
            let right_hand_side = if i == unit { 1.0 } else { 0.0 };
            y[i] = (right_hand_side - (0..i).map(|k| l[i][k] * y[k]).sum::<f64>()) / l[i][i];
        }
        for i in (0..n).rev() {
            y[i] = (y[i] - (i + 1..n).map(|k| l[k][i] * y[k]).sum::<f64>()) / l[i][i];
        }
        y
    };
    Some((0..n).map(column).collect())
}

/// Minimum of `f` near `start` by the simplex method of Nelder and Mead.
pub(super) fn minimum(start: &[f64], step: f64, mut f: impl FnMut(&[f64]) -> f64) -> Vec<f64> {
    let n = start.len();
    let mut evaluate = |x: Vec<f64>| {
        let value = f(&x);
        (x, if value.is_nan() { f64::INFINITY } else { value })
    };
    let mut simplex = vec![evaluate(start.to_vec())];
    for k in 0..n {
        let mut x = start.to_vec();
        x[k] += step;
        simplex.push(evaluate(x));
    }
    for _ in 0..120 * n {
        simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
        let (best, worst) = (simplex[0].1, simplex[n].1);
        let size = simplex[n].0.iter().zip(&simplex[0].0).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if worst - best <= 1.0e-12 * best.abs() && size < 1.0e-7 {
            break;
        }
        let centre: Vec<f64> =
            (0..n).map(|k| simplex[..n].iter().map(|p| p.0[k]).sum::<f64>() / n as f64).collect();
        let along = |t: f64, from: &[f64]| -> Vec<f64> {
            centre.iter().zip(from).map(|(c, x)| c + t * (x - c)).collect()
        };
        let reflected = evaluate(along(-1.0, &simplex[n].0));
        if reflected.1 < best {
            let expanded = evaluate(along(-2.0, &simplex[n].0));
            simplex[n] = if expanded.1 < reflected.1 { expanded } else { reflected };
        } else if reflected.1 < simplex[n - 1].1 {
            simplex[n] = reflected;
        } else {
            let from = if reflected.1 < worst { reflected.0.clone() } else { simplex[n].0.clone() };
            let contracted = evaluate(along(0.5, &from));
            if contracted.1 < worst.min(reflected.1) {
                simplex[n] = contracted;
            } else {
                let corner = simplex[0].0.clone();
                for point in &mut simplex[1..] {
                    *point = evaluate(point.0.iter().zip(&corner).map(|(x, c)| 0.5 * (x + c)).collect());
                }
            }
        }
    }
    simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
    simplex.swap_remove(0).0
}
