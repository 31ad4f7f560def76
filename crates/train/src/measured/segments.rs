//! Segments of a run: directions of what moves, and errors on what was left out.

use super::data::COVERAGE;
use rom::inputs::Point;
use rom::statistics::{mean, quantile, range};
use std::collections::BTreeMap;

const MAX_CENTRES: usize = 48;
/// Most segments of a run, and the parts they are dealt to.
pub(super) const SEGMENTS: usize = 20;
pub(super) const FOLDS: usize = 5;
/// Smallest change of the inputs' mean, or of a predicted value, that counts as rising or falling, as a fraction of its range.
const LEAST_TURN: f64 = 0.05;
/// Quantile of the standard normal distribution at the nominal coverage.
const NORMAL_QUANTILE: f64 = 1.28;
/// Cells of the predicted value in which rising and falling are compared, and the fewest rows of each.
const LOOP_CELLS: usize = 10;
const MIN_LOOP_ROWS: f64 = 3.0;

/// Mean difference of the values on rising and falling at equal predicted values.
pub(super) fn loop_size(run: &[usize], values: &[f64], predicted: &[f64]) -> f64 {
    let low = predicted.iter().copied().fold(f64::INFINITY, f64::min);
    let width = range(predicted.iter().copied()) / LOOP_CELLS as f64;
    let mut cells = vec![[(0.0_f64, 0.0_f64); 2]; LOOP_CELLS];
    let ways = directions(run, predicted);
    for ((value, p), way) in values.iter().zip(predicted).zip(ways).filter(|(_, way)| *way != 0) {
        let cell = (((p - low) / width) as usize).min(LOOP_CELLS - 1);
        let (sum, count) = &mut cells[cell][usize::from(way > 0)];
        *sum += value - p;
        *count += 1.0;
    }
    let both = cells.iter().filter(|c| c[0].1 >= MIN_LOOP_ROWS && c[1].1 >= MIN_LOOP_ROWS);
    let size = mean(both.map(|c| (c[0].0 / c[0].1 - c[1].0 / c[1].1).abs()));
    if size.is_finite() { size } else { 0.0 }
}

/// Changes between rising and falling.
pub(crate) fn turns(ways: &[i8]) -> usize {
    let moving: Vec<i8> = ways.iter().copied().filter(|way| *way != 0).collect();
    moving.windows(2).filter(|pair| pair[0] != pair[1]).count()
}

/// Direction of a value at each row: 1 rising, -1 falling, 0 not known.
pub(crate) fn directions(run: &[usize], values: &[f64]) -> Vec<i8> {
    let least = LEAST_TURN * range(values.iter().copied());
    let (mut directions, mut way, mut extreme) = (Vec::with_capacity(values.len()), 0_i8, values[0]);
    for (index, value) in values.iter().enumerate() {
        if index > 0 && run[index] != run[index - 1] {
            (way, extreme) = (0, *value);
        }
        let ahead = value - extreme;
        let sign = i8::from(ahead > 0.0) - i8::from(ahead < 0.0);
        if sign == way || ahead.abs() > least {
            (way, extreme) = (sign, *value);
        }
        directions.push(way);
    }
    directions
}

/// Bound of a further run's mean error, from the means of the runs or of the halves of a single one. `run`: number of the run by row.
fn shift(run: &[usize], errors: &[f64]) -> f64 {
    let runs = run.iter().max().map_or(1, |last| last + 1);
    let block = |index: usize| if runs > 1 { run[index] } else { 2 * index / errors.len() };
    let of_block =
        |wanted: usize| mean((0..errors.len()).filter(|at| block(*at) == wanted).map(|at| errors[at]));
    let means: Vec<f64> = (0..runs.max(2)).map(of_block).filter(|v| v.is_finite()).collect();
    let (n, centre) = (means.len() as f64, mean(means.iter().copied()));
    let variance = means.iter().map(|m| (m - centre).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    NORMAL_QUANTILE * (variance * (1.0 + 1.0 / n)).sqrt()
}

/// Half-width from errors on left-out segments: their quantile plus the bound of a further run's mean error.
pub(super) fn half_width(run: &[usize], errors: &[f64]) -> f64 {
    quantile(errors.iter().map(|e| e.abs()), COVERAGE) + shift(run, errors)
}

/// Fold of a row of a run of `count` rows: settled states are segments of one row.
pub(super) fn fold(row: usize, count: usize, segments: usize) -> usize {
    row * segments.min(count) / count % FOLDS
}

/// Means of the rows in cells of a grid, as fine as [`MAX_CENTRES`] allows.
pub(super) fn centres(x: &[Point], dimensions: usize) -> Vec<Point> {
    let mut per_axis = MAX_CENTRES;
    loop {
        let mut found: BTreeMap<Vec<usize>, (Point, f64)> = BTreeMap::new();
        for point in x {
            let cell = |v: &f64| ((v * per_axis as f64) as usize).min(per_axis - 1);
            let (sum, count) = found.entry(point[..dimensions].iter().map(cell).collect()).or_default();
            sum.iter_mut().zip(point).for_each(|(sum, v)| *sum += v);
            *count += 1.0;
        }
        if found.len() <= MAX_CENTRES || per_axis == 1 {
            return found.into_values().map(|(sum, count)| sum.map(|v| v / count)).collect();
        }
        per_axis -= 1;
    }
}
