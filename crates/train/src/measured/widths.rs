//! Half-widths of a map of measured runs: from left-out errors, growing with the members' spread and with the distance from what was visited,
//! with an allowance for the next run.
//!
//! ```text
//! e^2 = c0 + c1 spread + c2 d^2       reweighted least squares on left-out errors, c >= 0; half-width: the 90 % quantile of |e| over its root
//! a0  = 0.03 r^(1/3) L^(2/3)          what recordings of many rigs suggest: r range of the output, L length of the ranges in its unit
//! a^2 = (2 a0^2 + n m^2) / (2 + n)    m^2: mean square of the left-out mean errors of n runs; of one run 4 times that of its segments
//! ```
//!
//! Errors with segments left out show what is near the data, those with halves or whole runs left out what is far from it.

use super::data::COVERAGE;
use super::maps::{
    BASE_SMOOTHING, ChosenMaps, FittedRows, LagColumns, LinearBase, Member, Ridge, polynomial, solve, times,
};
use faer::Mat;
use rom::halfwidths::HALFWIDTH_SIGMAS;
use rom::learned::{Drift, Lag, OutputWidth, Support};
use rom::memory::Line;
use rom::statistics::{mean, median, quantile};
use std::ops::Range;

/// Standard deviation of the difference between runs, as a fraction of the ranges, and the exponent of the output's own.
const ALLOWANCE: f64 = 0.03;
const OWN_RANGE: f64 = 1.0 / 3.0;
/// Variance between two runs over that between segments of one, of an offset that wanders as a random walk: 2.8 if the second run
/// follows at once, 4 if it begins after a third of a run.
const WANDERS_ON: f64 = 4.0;
/// Runs that the allowance of one run counts for.
const PRIOR_RUNS: f64 = 2.0;
/// Share of values within a standard deviation.
const ONE_SIGMA: f64 = 0.68;
/// Smallest reach, in units of the root of the number of lags.
const LEAST_REACH: f64 = 0.25;
/// Quantile of the distances between parts that is the reach.
const REACHED: f64 = 0.95;
/// Quantile beyond which squared errors are clipped.
const CLIPPED: f64 = 0.99;
/// Smallest constant part of the squared error, as a fraction of its median.
const LEAST_NOISE: f64 = 0.1;
/// Rounds of the fit of the squared error.
const REWEIGHTED: usize = 10;
/// Outer part of an input that is left out to see how the base goes on.
const OUTER: f64 = 0.3;
/// Fewest rows of the outer and of the inner part.
const FEWEST: [usize; 2] = [10, 30];
/// Distance added to those at which the growth is measured.
const NEAR: f64 = 0.25;
/// Part of a run's duration over which an offset wanders by the allowance.
const WANDERS: f64 = 0.25;
/// Index of the lag, among the times that are tried, that stands for the distant past.
const LONGER_PAST: usize = 7;

/// Lags by which places are told apart, with their rows.
pub(super) struct Places {
    pub lags: Vec<Lag>,
    pub support: Support,
    /// Distance of each fitted row from those of other parts, and of those with [`FittedRows::far_parts`] left out.
    distances: [Vec<f64>; 2],
}

/// Distance of each row of a part from the nearest row outside it.
fn distances(z: &Mat<f64>, is_in: impl Fn(usize) -> bool) -> Vec<(usize, f64)> {
    let (inside, others): (Vec<usize>, Vec<usize>) = (0..z.nrows()).partition(|row| is_in(*row));
    let row = |row: usize| -> Vec<f64> { z.row(row).iter().copied().collect() };
    let others: Vec<Vec<f64>> = others.into_iter().map(row).collect();
    let nearest = |index: usize| {
        let x = row(index);
        let square = |y: &Vec<f64>| x.iter().zip(y).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        (index, others.iter().map(square).fold(f64::INFINITY, f64::min).sqrt())
    };
    inside.into_iter().map(nearest).collect()
}

/// Places that the training visited: inputs now, behind the common lag, and behind a long one.
pub(super) fn places(rows: &FittedRows, found: &ChosenMaps, filtered: &mut LagColumns<'_>) -> Places {
    let mut lags: Vec<Lag> = Vec::new();
    let long = (!rows.are_dealt).then(|| times(rows)[LONGER_PAST]);
    let lags_of =
        |line: Option<Line>| (0..rows.inputs.len()).map(move |input| Lag { input: input as u32, line });
    let long = long.map(|time| Line { fill_s: time, empty_s: time });
    for lag in lags_of(None)
        .chain(found.common.iter().copied())
        .chain(long.into_iter().flat_map(|line| lags_of(Some(line))))
    {
        if !lags.contains(&lag) {
            lags.push(lag);
        }
    }
    let z = filtered.columns(&lags);
    let left_out = |parts: &[Range<usize>]| -> Vec<f64> {
        let of_part = |part: &Range<usize>| distances(&z, |row| part.contains(&row));
        parts.iter().flat_map(of_part).map(|(_, d)| d).collect()
    };
    let left = [left_out(&rows.parts), left_out(&rows.far_parts)];
    let of_reach = &left[usize::from(rows.have_own_inputs)];
    let finite = || of_reach.iter().copied().filter(|d| d.is_finite());
    let reach = quantile(finite(), REACHED).max(LEAST_REACH * (lags.len() as f64).sqrt());
    let range = mean(rows.inputs.iter().map(|input| input.range));
    let all = (0..z.nrows()).flat_map(|row| (0..z.ncols()).map(move |j| (row, j)));
    let support = Support { lags: Vec::new(), rows: all.map(|at| z[at]).collect(), reach, extent: range };
    Places { lags, support, distances: left }
}

/// Half-widths and drifts by output.
pub(super) fn widths(
    rows: &FittedRows,
    found: &ChosenMaps,
    places: &Places,
    filtered: &mut LagColumns<'_>,
) -> (Vec<OutputWidth>, Vec<Drift>) {
    let base_errors: Vec<f64> = (0..rows.outputs()).map(|k| base_error(rows, found, k)).collect();
    let growths = growths(rows, found, places, &base_errors, filtered);
    let output_width = |k: usize| {
        let mut terms: Vec<[f64; 3]> = Vec::new();
        let mut errors_and_terms = |left_out: &Mat<f64>,
                                    of_member: fn(&Ridge) -> &Mat<f64>,
                                    distances: &[f64]| {
            let spread = |row: usize| -> f64 {
                let squared_deviation =
                    |member: &Member| (of_member(&member.fit)[(row, k)] - left_out[(row, k)]).powi(2);
                found.members.iter().map(|member| member.share * squared_deviation(member)).sum()
            };
            terms
                .extend((0..left_out.nrows()).map(|row| [1.0, spread(row), distances[row].min(1e6).powi(2)]));
            (0..left_out.nrows()).map(|row| left_out[(row, k)] - rows.y[(row, k)]).collect::<Vec<f64>>()
        };
        let errors = errors_and_terms(&found.left_out, |fit| &fit.left_out, &places.distances[0]);
        let far = errors_and_terms(&found.far, |fit| &fit.far, &places.distances[1]);
        let all: Vec<f64> = errors.iter().chain(&far).copied().collect();
        let fitted = found.fitted.col(k).iter().zip(rows.y.col(k).iter());
        let residual = quantile(fitted.map(|(fitted, y)| (fitted - y).abs()), ONE_SIGMA);
        let factors = squared_error(&all, &terms, residual * residual);
        let scale = |terms: &[f64; 3]| terms.iter().zip(&factors).map(|(t, c)| t * c).sum::<f64>().sqrt();
        let q = quantile(all.iter().zip(&terms).map(|(e, t)| e.abs() / scale(t)), COVERAGE).powi(2);
        let range = rom::statistics::range(rows.y.col(k).iter().copied());
        let prior = ALLOWANCE * range.powf(OWN_RANGE) * rows.units[k].powf(1.0 - OWN_RANGE);
        let square_of_mean = |part: &Range<usize>| mean(errors[part.clone()].iter().copied()).powi(2);
        let between = |parts: &[Range<usize>]| mean(parts.iter().map(square_of_mean));
        let allowance = if rows.are_dealt && rows.runs.len() == 1 {
            // Settled states that are dealt in any order show the rig's drift already.
            mean(errors.iter().copied()).powi(2)
        } else {
            let are_alike = rows.runs.len() > 1 && !rows.have_own_inputs;
            let (variance, runs) = match are_alike {
                true => (between(&rows.whole_runs), rows.runs.len() as f64),
                false => (WANDERS_ON * between(&rows.parts), 1.0),
            };
            (PRIOR_RUNS * prior * prior + runs * variance) / (PRIOR_RUNS + runs)
        };
        let LinearBase { lags, fit: base } = &found.base;
        let slopes = lags
            .iter()
            .enumerate()
            .map(|(index, lag)| base.weights[(1 + index, k)].abs() * rows.inputs[lag.input as usize].range);
        let width = OutputWidth {
            noise: q * factors[0],
            spread: q * factors[1],
            distance: q * factors[2],
            allowance: HALFWIDTH_SIGMAS.powi(2) * allowance,
            base: base_errors[k],
            growth: growths[k],
            range,
            past: slopes.sum(),
        };
        let square = mean(errors.iter().map(|e| e * e));
        let drift = Drift {
            start: allowance,
            per_s: allowance / (WANDERS * rows.duration_s).max(1e-9),
            noise_s: square * agreement_s(rows, &errors),
        };
        (width, drift)
    };
    (0..rows.outputs()).map(output_width).unzip()
}

/// Error of the base on left-out parts that nine of ten rows stay below.
fn base_error(rows: &FittedRows, found: &ChosenMaps, output: usize) -> f64 {
    let errors = rows.y.col(output).iter().zip(found.base.fit.left_out.col(output).iter());
    quantile(errors.map(|(y, predicted)| (predicted - y).abs()), COVERAGE)
}

/// Time over which errors of successive rows agree, s; at least an interval.
fn agreement_s(rows: &FittedRows, errors: &[f64]) -> f64 {
    let centre = mean(errors.iter().copied());
    let product = |a: f64, b: f64| (a - centre) * (b - centre);
    let correlation =
        mean(errors.windows(2).map(|e| product(e[0], e[1]))) / mean(errors.iter().map(|e| product(*e, *e)));
    let steps = rows.fitted.windows(2).filter(|at| at[0].0 == at[1].0).map(|at| {
        let time = |row: usize| rows.runs[at[0].0].time_ns[row] as f64 * 1e-9;
        time(at[1].1) - time(at[0].1)
    });
    let interval_s = median(steps).unwrap_or(rows.interval_s);
    if correlation > 0.0 { (-interval_s / correlation.min(0.999).ln()).max(interval_s) } else { interval_s }
}

/// Factors of the squared error, none negative, by reweighted least squares: each square counts in units of what is expected at its place, so
/// that the small errors near the data are fitted as well as the large ones far from it. The constant is at least `least`, the square of the
/// residual: left-out rows have a distance, those that are asked for later may have none.
fn squared_error(errors: &[f64], terms: &[[f64; 3]], least: f64) -> [f64; 3] {
    let squares: Vec<f64> = errors.iter().map(|e| e * e).collect();
    let least = least.max(LEAST_NOISE * quantile(squares.iter().copied(), 0.5)).max(f64::MIN_POSITIVE);
    let mut factors = [mean(squares.iter().copied()).max(least), 0.0, 0.0];
    for _ in 0..REWEIGHTED {
        let expected = terms.iter().map(|t| t.iter().zip(&factors).map(|(t, c)| t * c).sum::<f64>());
        let expected: Vec<f64> = expected.collect();
        let clip = quantile(squares.iter().zip(&expected).map(|(e2, s2)| e2 / s2), CLIPPED);
        let scaled = terms.iter().zip(&expected).map(|(t, s2)| t.map(|t| t / s2));
        let relative = squares.iter().zip(&expected).map(|(e2, s2)| (e2 / s2).min(clip));
        factors = not_negative(scaled.zip(relative));
        factors[0] = factors[0].max(least);
    }
    factors
}

/// Least squares of three factors, none negative: of all subsets of the terms the one that fits best.
fn not_negative(rows: impl Iterator<Item = ([f64; 3], f64)>) -> [f64; 3] {
    let (mut gram, mut right) = ([[0.0; 3]; 3], [0.0; 3]);
    for (t, value) in rows {
        for i in 0..3 {
            right[i] += t[i] * value;
            (0..3).for_each(|j| gram[i][j] += t[i] * t[j]);
        }
    }
    let mut best = (0.0, [0.0; 3]);
    for subset in 1_u8..8 {
        let has: Vec<usize> = (0..3).filter(|k| subset & (1 << k) != 0).collect();
        let size = |i: usize| gram[i][i].sqrt().max(f64::MIN_POSITIVE);
        let ridge = |i: usize, j: usize| if i == j { 1e-9 } else { 0.0 };
        let entry = |i: usize, j: usize| gram[has[i]][has[j]] / size(has[i]) / size(has[j]) + ridge(i, j);
        let system = rom::dense::Dense::from_fn(has.len(), entry);
        let mut solution: Vec<f64> = has.iter().map(|k| right[*k] / size(*k)).collect();
        if system.solve(&mut solution, 1).is_none() || solution.iter().any(|c| c.is_nan() || *c < 0.0) {
            continue;
        }
        let mut factors = [0.0; 3];
        has.iter().zip(&solution).for_each(|(k, c)| factors[*k] = c / size(*k));
        let curvature: f64 =
            (0..3).map(|i| factors[i] * (0..3).map(|j| gram[i][j] * factors[j]).sum::<f64>()).sum();
        let loss = curvature - 2.0 * factors.iter().zip(right).map(|(c, r)| c * r).sum::<f64>();
        if loss < best.0 {
            best = (loss, factors);
        }
    }
    best.1
}

/// Growth of the base's error beyond its data: it is fitted without the outer part in either direction of each lagged input and judged there.
fn growths(
    rows: &FittedRows,
    found: &ChosenMaps,
    places: &Places,
    base_errors: &[f64],
    filtered: &mut LagColumns<'_>,
) -> Vec<f64> {
    let x = filtered.columns(&found.base.lags);
    let z = filtered.columns(&places.lags);
    let features = polynomial(&x, 1);
    let mut growths: Option<Vec<f64>> = None;
    for (axis, sign) in (0..x.ncols()).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]) {
        let limit = quantile((0..x.nrows()).map(|row| sign * x[(row, axis)]), 1.0 - OUTER);
        let is_outer = |row: usize| sign * x[(row, axis)] > limit;
        let inner: Vec<usize> = (0..x.nrows()).filter(|row| !is_outer(*row)).collect();
        let outer = x.nrows() - inner.len();
        if outer < FEWEST[0] || inner.len() < FEWEST[1] {
            continue;
        }
        let f = Mat::from_fn(inner.len(), features.ncols(), |i, j| features[(inner[i], j)]);
        let y = Mat::from_fn(inner.len(), rows.outputs(), |i, k| rows.y[(inner[i], k)]);
        let fitted = solve(&(f.transpose() * &f), &(f.transpose() * y), BASE_SMOOTHING, inner.len() as f64);
        let Some(weights) = fitted else { continue };
        let far = distances(&z, is_outer);
        let growth = |k: usize| {
            let growth_at = |(row, d): &(usize, f64)| {
                let value: f64 = (0..features.ncols()).map(|j| features[(*row, j)] * weights[(j, k)]).sum();
                ((value - rows.y[(*row, k)]).abs() - base_errors[k]).max(0.0) / (d + NEAR)
            };
            quantile(far.iter().map(growth_at), COVERAGE)
        };
        let found: Vec<f64> = (0..rows.outputs()).map(growth).collect();
        let known = growths.get_or_insert_with(|| found.clone());
        known.iter_mut().zip(&found).for_each(|(a, b)| *a = a.max(*b));
    }
    growths.unwrap_or_else(|| {
        (0..rows.outputs()).map(|k| 0.2 * rom::statistics::range(rows.y.col(k).iter().copied())).collect()
    })
}
