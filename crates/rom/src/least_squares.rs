//! Damped least squares after Levenberg and Marquardt, for a handful of unknowns between bounds.
//!
//! A step solves `(J^T J + damping) s = -J^T r` over the unknowns that do not press against a bound. The damping grows until a step
//! reduces the sum of squares, and shrinks after it: near the minimum the steps are those of Gauss and Newton. It also keeps the
//! answer near its start where the residuals leave unknowns open.

use crate::dense::Dense;

/// Factors on the damping after a step that reduces the sum of squares, and after one that does not.
const LOWER: f64 = 0.2;
const RAISE: f64 = 5.0;

/// Residuals as a function of unknowns.
pub trait Residuals {
    /// Residuals at some unknowns; `None` where there are none.
    fn at(&mut self, unknowns: &[f64]) -> Option<Vec<f64>>;

    /// Their derivatives, one column per unknown, at the unknowns at which [`Residuals::at`] gave `residuals` last with a smaller sum
    /// of squares than before; `None` where there are none.
    fn jacobian(&mut self, unknowns: &[f64], residuals: &[f64]) -> Option<Vec<Vec<f64>>>;

    /// Smallest and largest value of an unknown.
    fn bounds(&self, unknown: usize) -> [f64; 2];
}

/// How far to search.
#[derive(Clone, Copy, Debug)]
pub struct Search {
    /// Most steps.
    pub steps: usize,
    /// Most dampings tried for a step.
    pub tries: usize,
    /// Damping of the first step.
    pub damping: f64,
    /// Adds the damping times its own diagonal entry to each unknown's, so that the unknowns may have any unit; otherwise times the
    /// largest entry.
    pub by_unknown: bool,
    /// Largest change of an unknown in a step.
    pub largest_change: f64,
    /// Sum of squares at which the search ends.
    pub met: f64,
    /// Decrease of the sum of squares, as a part of it, below which the search ends.
    pub least_decrease: f64,
}

/// Unknowns with the smallest sum of squares that was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Minimum {
    /// The unknowns.
    pub unknowns: Vec<f64>,
    /// Residuals there.
    pub residuals: Vec<f64>,
    /// No step reduces the sum of squares any more, or only by less than was asked; false if the steps ran out.
    pub is_converged: bool,
}

/// Sum of squares.
pub fn square(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum()
}

/// `J^T J` with its diagonal multiplied by `1 + damping`, and a billionth of the largest entry added, so that an unknown without influence does not
/// move.
pub fn normal_matrix(jacobian: &[Vec<f64>], damping: f64) -> Dense {
    normal(&jacobian.iter().collect::<Vec<_>>(), damping, true)
}

fn normal(columns: &[&Vec<f64>], damping: f64, by_unknown: bool) -> Dense {
    let largest = columns.iter().map(|column| square(column)).fold(f64::MIN_POSITIVE, f64::max);
    Dense::from_fn(columns.len(), |i, j| {
        let sum = dot(columns[i], columns[j]);
        match (i == j, by_unknown) {
            (false, _) => sum,
            (true, true) => sum * (1.0 + damping) + 1e-9 * largest,
            (true, false) => sum + damping * largest,
        }
    })
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Searches from `start`, which is moved between the bounds. `None` if there are no residuals or no derivatives there.
pub fn minimise(problem: &mut impl Residuals, start: &[f64], search: &Search) -> Option<Minimum> {
    let within = |problem: &dyn Fn(usize) -> [f64; 2], mut x: Vec<f64>| {
        for (k, x) in x.iter_mut().enumerate() {
            let [low, high] = problem(k);
            *x = x.clamp(low, high);
        }
        x
    };
    let mut x = within(&|k| problem.bounds(k), start.to_vec());
    let mut residuals = problem.at(&x)?;
    let (mut damping, mut is_converged) = (search.damping, false);
    for _ in 0..search.steps {
        let before = square(&residuals);
        if before <= search.met {
            is_converged = true;
            break;
        }
        let jacobian = problem.jacobian(&x, &residuals)?;
        let mut better = None;
        for _ in 0..search.tries {
            let bounds = |k: usize| problem.bounds(k);
            let Some(trial) = step(&bounds, &x, &jacobian, &residuals, damping, search) else { break };
            let trial = within(&bounds, trial);
            better = problem.at(&trial).filter(|found| square(found) < before).map(|found| (trial, found));
            damping *= if better.is_some() { LOWER } else { RAISE };
            if better.is_some() {
                break;
            }
        }
        let Some(found) = better else {
            is_converged = true;
            break;
        };
        (x, residuals) = found;
        if square(&residuals) > (1.0 - search.least_decrease) * before {
            is_converged = true;
            break;
        }
    }
    Some(Minimum { unknowns: x, residuals, is_converged })
}

/// The unknowns after a step; `None` if each presses against a bound.
fn step(
    bounds: &dyn Fn(usize) -> [f64; 2],
    x: &[f64],
    jacobian: &[Vec<f64>],
    residuals: &[f64],
    damping: f64,
    search: &Search,
) -> Option<Vec<f64>> {
    let downhill: Vec<f64> = jacobian.iter().map(|column| -dot(column, residuals)).collect();
    let is_open = |k: &usize| {
        let [low, high] = bounds(*k);
        !(x[*k] <= low && downhill[*k] <= 0.0 || x[*k] >= high && downhill[*k] >= 0.0)
    };
    let open: Vec<usize> = (0..x.len()).filter(is_open).collect();
    if open.is_empty() {
        return None;
    }
    let columns: Vec<&Vec<f64>> = open.iter().map(|k| &jacobian[*k]).collect();
    let mut change: Vec<f64> = open.iter().map(|k| downhill[*k]).collect();
    normal(&columns, damping, search.by_unknown).solve(&mut change, 1)?;
    let mut trial = x.to_vec();
    for (k, change) in open.iter().zip(&change) {
        trial[*k] += change.clamp(-search.largest_change, search.largest_change);
    }
    trial.iter().all(|v| v.is_finite()).then_some(trial)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley, with the second unknown below a bound.
    struct Valley(f64);

    impl Residuals for Valley {
        fn at(&mut self, x: &[f64]) -> Option<Vec<f64>> {
            Some(vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]])
        }

        fn jacobian(&mut self, x: &[f64], _: &[f64]) -> Option<Vec<Vec<f64>>> {
            Some(vec![vec![-20.0 * x[0], -1.0], vec![10.0, 0.0]])
        }

        fn bounds(&self, unknown: usize) -> [f64; 2] {
            [-2.0, if unknown == 1 { self.0 } else { 2.0 }]
        }
    }

    #[test]
    fn the_minimum_is_found_also_on_a_bound() {
        for by_unknown in [true, false] {
            let search = Search {
                steps: 100,
                tries: 18,
                damping: 1e-3,
                by_unknown,
                largest_change: f64::INFINITY,
                met: 1e-20,
                least_decrease: 0.0,
            };
            let free = minimise(&mut Valley(2.0), &[-1.2, 1.0], &search).unwrap();
            assert!(free.is_converged && free.unknowns.iter().all(|x| (x - 1.0).abs() < 1e-8), "{free:?}");
            let bound = minimise(&mut Valley(0.25), &[-1.2, 1.0], &search).unwrap();
            // On the bound, 200 x^3 - 49 x - 1 = 0.
            let x = bound.unknowns[0];
            assert!(
                bound.unknowns[1] == 0.25 && (200.0 * x * x * x - 49.0 * x - 1.0).abs() < 1e-4,
                "{bound:?}"
            );
        }
    }
}
