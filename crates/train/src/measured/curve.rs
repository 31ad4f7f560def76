//! The map from inputs to outputs by least squares, chosen on left-out segments.

use super::data::{COVERAGE, MAX_ROWS, MIN_ROWS, Measured, MeasuredError, OutputReport, mean, range_of};
use super::layout::{PRESSURE_NAME, unit_of};
use super::motion::noise_of;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use rom::inputs::{InputMap, InputSpec, Inputs, PARAMETERS, PRESSURE, Parameter, Point, square_distance};
use rom::interpolant::{Interpolant, Metric};
use rom::radial::{KernelKind, Tail};
use std::collections::BTreeMap;
use std::fmt::{self, Display};

const MAX_CENTRES: usize = 48;
/// Segments of a run, and the parts they are dealt to.
const SEGMENTS: usize = 20;
pub(super) const FOLDS: usize = 5;
/// Smallest change of the inputs' mean, or of a predicted value, that counts as rising or falling, as a fraction of its range.
const LEAST_TURN: f64 = 0.05;
/// Quantile of the standard normal distribution at the nominal coverage.
const NORMAL_QUANTILE: f64 = 1.28;
/// Cells of the predicted value in which rising and falling are compared, and the fewest rows of each.
const LOOP_CELLS: usize = 10;
const MIN_LOOP_ROWS: f64 = 3.0;
/// Relative regularisation of the tail: only makes the system definite.
const TAIL_SMOOTHING: f64 = 1e-10;
const SMOOTHINGS: [f64; 11] = [1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 10.0, 1e6];

/// One candidate.
#[derive(Clone, Copy)]
pub(super) struct Choice {
    pub kernel: KernelKind,
    pub tail: Tail,
    pub smoothing: f64,
}

impl Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}, smoothing {:.0e}", self.kernel, self.tail, self.smoothing)
    }
}

/// Rows in scaled inputs.
pub(super) struct Curve {
    pub map: InputMap,
    pub specs: Vec<InputSpec>,
    pub x: Vec<Point>,
    pub y: Vec<Vec<f64>>,
    fold: Vec<usize>,
    /// Number of the run.
    run: Vec<usize>,
    pub centres: Vec<Point>,
}

/// One row of a run.
struct Row {
    run: usize,
    fold: usize,
    inputs: Vec<f64>,
    outputs: Vec<f64>,
}

impl Curve {
    pub(super) fn new(data: &Measured, remarks: &mut Vec<String>) -> Result<Self, MeasuredError> {
        let all = rows(data);
        if all.len() < MIN_ROWS {
            return Err(MeasuredError::Few { expected: MIN_ROWS, found: all.len() });
        }
        let step = all.len().div_ceil(MAX_ROWS);
        if step > 1 {
            remarks.push(format!("{} rows: one in {step} is used", all.len()));
        }
        let rows: Vec<Row> = all.into_iter().step_by(step).collect();
        let pressure = data.inputs.iter().position(|name| name == PRESSURE_NAME);
        let parameters: Vec<usize> = (0..data.inputs.len()).filter(|at| Some(*at) != pressure).collect();
        let declared: Vec<Parameter> = parameters
            .iter()
            .map(|at| Parameter {
                name: data.inputs[*at].clone(),
                unit: unit_of(&data.inputs[*at]),
                nominal: median(rows.iter().map(|row| row.inputs[*at])),
            })
            .collect();
        let state = |row: &Row| {
            let start = Inputs::new(pressure.map_or(0.0, |at| row.inputs[at]), f64::INFINITY);
            let further = parameters.iter().enumerate();
            further.fold(start, |state, (k, at)| state.with(PARAMETERS + k, row.inputs[*at]))
        };
        let states: Vec<Inputs> = rows.iter().map(state).collect();
        let varying: Vec<usize> =
            pressure.map(|_| PRESSURE).into_iter().chain(PARAMETERS..PARAMETERS + parameters.len()).collect();
        let map = InputMap::of_states(&states, &varying);
        let x: Vec<Point> = states.iter().map(|state| map.scale(state)).collect();
        Ok(Self {
            centres: centres(&x, map.dimensions()),
            specs: InputSpec::ranged(InputSpec::without_range(&declared), [&map].into_iter()),
            fold: rows.iter().map(|row| row.fold).collect(),
            run: rows.iter().map(|row| row.run).collect(),
            y: rows.into_iter().map(|row| row.outputs).collect(),
            map,
            x,
        })
    }

    fn column(&self, output: usize) -> impl Iterator<Item = f64> + '_ {
        self.y.iter().map(move |y| y[output])
    }

    fn terms(&self, kernel: KernelKind, tail: Tail) -> Vec<Vec<f64>> {
        let row = |x: &Point| {
            let values = self.centres.iter().map(|c| kernel.value(square_distance(c, x)));
            values.chain(tail.values(self.map.dimensions(), x)).collect()
        };
        self.x.iter().map(row).collect()
    }

    /// Tail and smoothing with the smallest error on left-out segments, and these errors by row and output.
    pub(super) fn choose(&self) -> Option<(Choice, Vec<Vec<f64>>)> {
        let kernel = KernelKind::Cubic;
        let scale: Vec<f64> = (0..self.y[0].len()).map(|k| range_of(self.column(k))).collect();
        let mut best: Option<(f64, Choice, Vec<Vec<f64>>)> = None;
        for tail in [Tail::Linear, Tail::Quadratic] {
            let terms = self.terms(kernel, tail);
            let parts: Vec<Sums> =
                (0..FOLDS).map(|fold| Sums::of(&terms, &self.y, |at| self.fold[at] == fold)).collect();
            for smoothing in SMOOTHINGS {
                let Some(errors) = self.left_out(&terms, &parts, smoothing) else { continue };
                let square = |e: &Vec<f64>| e.iter().zip(&scale).map(|(e, s)| (e / s).powi(2)).sum::<f64>();
                let sum: f64 = errors.iter().map(square).sum();
                if sum.is_finite() && best.as_ref().is_none_or(|(least, ..)| sum < *least) {
                    best = Some((sum, Choice { kernel, tail, smoothing }, errors));
                }
            }
        }
        best.map(|(_, choice, errors)| (choice, errors))
    }

    fn left_out(&self, terms: &[Vec<f64>], parts: &[Sums], smoothing: f64) -> Option<Vec<Vec<f64>>> {
        let mut errors = vec![Vec::new(); terms.len()];
        for fold in 0..parts.len() {
            let others = parts.iter().enumerate().filter(|(other, _)| *other != fold);
            let weights = Sums::total(others.map(|(_, part)| part))?.solve(self.centres.len(), smoothing)?;
            for at in (0..terms.len()).filter(|at| self.fold[*at] == fold) {
                let predicted = |k: usize| -> f64 {
                    terms[at].iter().enumerate().map(|(i, v)| v * weights[(i, k)]).sum()
                };
                errors[at] = self.y[at].iter().enumerate().map(|(k, y)| y - predicted(k)).collect();
            }
        }
        Some(errors)
    }

    /// The fit to all rows.
    pub(super) fn interpolant(&self, choice: &Choice) -> Option<Interpolant> {
        let terms = self.terms(choice.kernel, choice.tail);
        let (centres, dimensions) = (self.centres.len(), self.map.dimensions());
        let solution = Sums::of(&terms, &self.y, |_| true).solve(centres, choice.smoothing)?;
        let part = |range: std::ops::Range<usize>| -> Vec<f64> {
            range.flat_map(|i| (0..solution.ncols()).map(move |k| (i, k))).map(|at| solution[at]).collect()
        };
        Some(Interpolant {
            kernel: choice.kernel,
            tail: choice.tail,
            dimensions,
            metric: Metric::IDENTITY,
            centres: self.centres.iter().flat_map(|c| &c[..dimensions]).copied().collect(),
            weights: part(0..centres),
            tail_weights: part(centres..solution.nrows()),
            outputs: solution.ncols(),
            smoothing: choice.smoothing,
            condition: f64::NAN,
            residual: 0.0,
            slopes: Vec::new(),
        })
    }

    /// Changes between rising and falling of the mean scaled input.
    pub(super) fn turns(&self) -> usize {
        let sum: Vec<f64> = self.x.iter().map(|x| x.iter().sum()).collect();
        let ways = self.directions(&sum);
        let mut moving = ways.iter().zip(&self.run).filter(|(way, _)| **way != 0);
        let Some(mut last) = moving.next() else { return 0 };
        let mut turns = 0;
        for next in moving {
            turns += usize::from(next.0 != last.0 && next.1 == last.1);
            last = next;
        }
        turns
    }

    /// Direction of a value at each row: 1 rising, -1 falling, 0 not known.
    fn directions(&self, values: &[f64]) -> Vec<i8> {
        let least = LEAST_TURN * range_of(values.iter().copied());
        let (mut directions, mut way, mut extreme) = (Vec::with_capacity(values.len()), 0_i8, values[0]);
        for (at, value) in values.iter().enumerate() {
            if at > 0 && self.run[at] != self.run[at - 1] {
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

    pub(super) fn report(
        &self,
        name: &str,
        k: usize,
        surrogate: &Interpolant,
        errors: &[Vec<f64>],
    ) -> OutputReport {
        let own: Vec<f64> = errors.iter().map(|e| e[k]).collect();
        let (range, centre) = (range_of(self.column(k)), mean(self.column(k)));
        let square = mean(own.iter().map(|e| e * e));
        let predicted: Vec<f64> = self.x.iter().map(|x| surrogate.values_at(x)[k]).collect();
        let values: Vec<f64> = self.column(k).collect();
        let rows: Vec<(usize, f64)> = self.run.iter().copied().zip(values.iter().copied()).collect();
        let noise = |run: &[(usize, f64)]| noise_of(&run.iter().map(|row| row.1).collect::<Vec<_>>()).powi(2);
        OutputReport {
            name: name.into(),
            range,
            noise: mean(rows.chunk_by(|a, b| a.0 == b.0).map(noise)).sqrt(),
            rms: square.sqrt(),
            half_width: self.half_width(own.iter().map(|e| e.abs()).collect(), &own),
            loop_share: self.loop_size(&values, &predicted) / range,
            explained: 1.0 - square / mean(self.column(k).map(|y| (y - centre).powi(2))),
        }
    }

    /// [`half_width`] of these rows.
    pub(super) fn half_width(&self, sizes: Vec<f64>, errors: &[f64]) -> f64 {
        half_width(&self.run, sizes, errors)
    }

    /// Mean difference of the values on rising and falling at equal predicted values.
    fn loop_size(&self, values: &[f64], predicted: &[f64]) -> f64 {
        let low = predicted.iter().copied().fold(f64::INFINITY, f64::min);
        let width = range_of(predicted.iter().copied()) / LOOP_CELLS as f64;
        let mut cells = vec![[(0.0_f64, 0.0_f64); 2]; LOOP_CELLS];
        let ways = self.directions(predicted);
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
}

fn rows(data: &Measured) -> Vec<Row> {
    let mut rows = Vec::new();
    for (number, run) in data.runs.iter().enumerate() {
        let at = |columns: &[Vec<f64>], row: usize| -> Vec<f64> { columns.iter().map(|c| c[row]).collect() };
        let whole: Vec<(Vec<f64>, Vec<f64>)> = (0..run.time_s.len())
            .map(|row| (at(&run.inputs, row), at(&run.outputs, row)))
            .filter(|(inputs, outputs)| inputs.iter().chain(outputs).all(|v| v.is_finite()))
            .collect();
        let count = whole.len();
        rows.extend(whole.into_iter().enumerate().map(|(at, (inputs, outputs))| Row {
            run: number,
            fold: fold(at, count),
            inputs,
            outputs,
        }));
    }
    rows
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

pub(super) fn quantile(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let at = (COVERAGE * (values.len() as f64 + 1.0)).ceil() as usize;
    values.get(at.clamp(1, values.len().max(1)) - 1).copied().unwrap_or(f64::NAN)
}

/// Quantile of the errors' `sizes` plus the bound of a further run's mean error. `run`: number of the run by row.
pub(super) fn half_width(run: &[usize], sizes: Vec<f64>, errors: &[f64]) -> f64 {
    let runs = run.iter().max().map_or(1, |last| last + 1);
    let count = runs.max(2);
    let block = |at: usize| if runs > 1 { run[at] } else { 2 * at / errors.len() };
    let of_block = |of: usize| mean((0..errors.len()).filter(|at| block(*at) == of).map(|at| errors[at]));
    let means: Vec<f64> = (0..count).map(of_block).filter(|v| v.is_finite()).collect();
    let (n, centre) = (means.len() as f64, mean(means.iter().copied()));
    let variance = means.iter().map(|m| (m - centre).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    quantile(sizes) + NORMAL_QUANTILE * (variance * (1.0 + 1.0 / n)).sqrt()
}

/// Fold of a row of a run of `count` rows: settled states are segments of one row.
pub(super) fn fold(row: usize, count: usize) -> usize {
    row * SEGMENTS.min(count) / count % FOLDS
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

/// Normal equations.
struct Sums {
    matrix: Mat<f64>,
    right: Mat<f64>,
    rows: f64,
}

impl Sums {
    fn of(terms: &[Vec<f64>], y: &[Vec<f64>], of: impl Fn(usize) -> bool) -> Self {
        let (count, outputs) = (terms[0].len(), y[0].len());
        let (mut matrix, mut right) = (Mat::<f64>::zeros(count, count), Mat::<f64>::zeros(count, outputs));
        let mut rows = 0.0;
        for (at, row) in terms.iter().enumerate().filter(|(at, _)| of(*at)) {
            rows += 1.0;
            for (i, own) in row.iter().enumerate() {
                row.iter().enumerate().for_each(|(j, v)| matrix[(j, i)] += own * v);
                y[at].iter().enumerate().for_each(|(k, y)| right[(i, k)] += own * y);
            }
        }
        Self { matrix, right, rows }
    }

    fn total<'a>(mut parts: impl Iterator<Item = &'a Self>) -> Option<Self> {
        let first = parts.next()?;
        let start = Self { matrix: first.matrix.clone(), right: first.right.clone(), rows: first.rows };
        Some(parts.fold(start, |sum, part| Self {
            matrix: sum.matrix + &part.matrix,
            right: sum.right + &part.right,
            rows: sum.rows + part.rows,
        }))
    }

    /// Weights with `smoothing` per row on the first `centres` terms.
    fn solve(&self, centres: usize, smoothing: f64) -> Option<Mat<f64>> {
        let mut system = self.matrix.clone();
        for i in 0..system.nrows() {
            system[(i, i)] += self.rows * if i < centres { smoothing } else { TAIL_SMOOTHING };
        }
        let factors = system.lblt(Side::Lower);
        let mut solution = factors.solve(&self.right);
        let correction = factors.solve(&self.right - &system * &solution);
        solution += correction;
        solution.norm_max().is_finite().then_some(solution)
    }
}
