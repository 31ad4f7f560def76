//! The map from inputs to outputs by least squares, chosen on left-out segments, and the modes of the outputs.

use super::data::{
    COVERAGE, MAX_ROWS, MIN_ROWS, Measured, MeasuredError, OutputReport, Run, range_of, scales,
};
use super::layout::{PRESSURE_NAME, unit_of};
use super::motion::noise_of;
use crate::pod::decompose;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use rom::inputs::{InputMap, InputSpec, Inputs, PARAMETERS, PRESSURE, Parameter, Point, square_distance};
use rom::interpolant::{Interpolant, Metric};
use rom::radial::{KernelKind, Tail};
use rom::statistics::{mean, median, quantile};
use std::collections::BTreeMap;
use std::fmt::{self, Display};

const MAX_CENTRES: usize = 48;
/// Most segments of a run, and the parts they are dealt to.
pub(super) const SEGMENTS: usize = 20;
pub(super) const FOLDS: usize = 5;
/// Smallest error of an output in which modes are measured, as a fraction of its range.
const LEAST_ERROR: f64 = 1e-9;
/// Smallest change of the inputs' mean, or of a predicted value, that counts as rising or falling, as a fraction of its range.
const LEAST_TURN: f64 = 0.05;
/// Quantile of the standard normal distribution at the nominal coverage.
const NORMAL_QUANTILE: f64 = 1.28;
/// Cells of the predicted value in which rising and falling are compared, and the fewest rows of each.
const LOOP_CELLS: usize = 10;
const MIN_LOOP_ROWS: f64 = 3.0;
/// Relative regularisation of the tail: only makes the system definite.
const TAIL_SMOOTHING: f64 = 1e-10;
/// Largest mean square of a smoother map, over the smallest.
const MOST_ABOVE: f64 = 1.2;
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
    /// Outputs without their means.
    y: Vec<Vec<f64>>,
    pub means: Vec<f64>,
    /// Unit of each output's error.
    scales: Vec<f64>,
    fold: Vec<usize>,
    /// Number of the run.
    run: Vec<usize>,
    /// Changes between rising and falling of the mean scaled input.
    pub turns: usize,
    pub centres: Vec<Point>,
}

/// One row of a run.
struct Row {
    run: usize,
    inputs: Vec<f64>,
    outputs: Vec<f64>,
}

/// Modes of the outputs: an output is its mean plus the sum of shapes times coefficients.
pub(super) struct OutputModes {
    /// Inputs to coefficients.
    pub surrogate: Interpolant,
    /// Values by mode, then output.
    pub shapes: Vec<Vec<f64>>,
    pub singular_values: Vec<f64>,
}

impl OutputModes {
    /// Outputs without their means.
    pub(super) fn values(&self, x: &Point) -> Vec<f64> {
        self.outputs(&self.surrogate.values_at(x))
    }

    fn outputs(&self, coefficients: &[f64]) -> Vec<f64> {
        let sum = |k: usize| self.shapes.iter().zip(coefficients).map(|(shape, a)| a * shape[k]).sum();
        (0..self.shapes[0].len()).map(sum).collect()
    }
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
                nominal: median(rows.iter().map(|row| row.inputs[*at])).unwrap_or(f64::NAN),
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
        let run: Vec<usize> = rows.iter().map(|row| row.run).collect();
        let sum: Vec<f64> = x.iter().map(|x| x.iter().sum()).collect();
        let ways = directions(&run, &sum);
        let (mut fold_of, mut all_turns) = (Vec::new(), 0);
        for of_run in run.chunk_by(|a, b| a == b) {
            let count = of_run.len();
            let turns = turns(&ways[fold_of.len()..][..count]);
            fold_of.extend((0..count).map(|row| fold(row, count, turns.clamp(FOLDS, SEGMENTS))));
            all_turns += turns;
        }
        let means: Vec<f64> =
            (0..data.outputs.len()).map(|k| mean(rows.iter().map(|row| row.outputs[k]))).collect();
        let centred = |row: Row| row.outputs.iter().zip(&means).map(|(y, mean)| y - mean).collect();
        Ok(Self {
            centres: centres(&x, map.dimensions()),
            specs: InputSpec::ranged(InputSpec::without_range(&declared), [&map].into_iter()),
            y: rows.into_iter().map(centred).collect(),
            means,
            scales: scales(&data.outputs, &data.runs),
            fold: fold_of,
            run,
            turns: all_turns,
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

    /// Tail and smoothing by the errors on left-out segments, and these errors by row and output: the smoothest whose mean square exceeds the
    /// smallest by at most the standard error of the difference over the folds, and 20 %. Segments of one run repeat its levels and rates, which
    /// favours maps that follow them.
    pub(super) fn choose(&self) -> Option<(Choice, Vec<Vec<f64>>)> {
        let kernel = KernelKind::Cubic;
        let mut found: Vec<([f64; FOLDS], Choice, Vec<Vec<f64>>)> = Vec::new();
        for tail in [Tail::Linear, Tail::Quadratic] {
            let terms = self.terms(kernel, tail);
            let parts: Vec<Sums> =
                (0..FOLDS).map(|fold| Sums::of(&terms, &self.y, |at| self.fold[at] == fold)).collect();
            for smoothing in SMOOTHINGS {
                let Some(errors) = self.left_out(&terms, &parts, smoothing) else { continue };
                let square =
                    |e: &Vec<f64>| e.iter().zip(&self.scales).map(|(e, s)| (e / s).powi(2)).sum::<f64>();
                let mut sums = [0.0; FOLDS];
                errors.iter().zip(&self.fold).for_each(|(e, fold)| sums[*fold] += square(e));
                if sums.iter().all(|sum| sum.is_finite()) {
                    found.push((sums, Choice { kernel, tail, smoothing }, errors));
                }
            }
        }
        let total = |sums: &[f64; FOLDS]| sums.iter().sum::<f64>();
        let best = found.iter().map(|of| of.0).min_by(|a, b| total(a).total_cmp(&total(b)))?;
        let is_equal = |sums: &[f64; FOLDS]| {
            let centre = (total(sums) - total(&best)) / FOLDS as f64;
            let square: f64 = sums.iter().zip(&best).map(|(a, b)| (a - b - centre).powi(2)).sum();
            centre <= (square / (FOLDS * (FOLDS - 1)) as f64).sqrt()
                && total(sums) <= MOST_ABOVE * total(&best)
        };
        let equal = found.into_iter().filter(|(sums, ..)| is_equal(sums));
        let smoothest = equal
            .max_by(|a, b| a.1.smoothing.total_cmp(&b.1.smoothing).then(total(&b.0).total_cmp(&total(&a.0))));
        smoothest.map(|(_, choice, errors)| (choice, errors))
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

    /// Modes of the fitted values that are larger than those of noise, each output over its RMS error on left-out segments, and the errors
    /// there with them.
    pub(super) fn modes(
        &self,
        fitted: &Interpolant,
        errors: &[Vec<f64>],
    ) -> Option<(OutputModes, Vec<Vec<f64>>)> {
        let outputs = self.means.len();
        let unit = |k: usize| {
            let rms = mean(errors.iter().map(|e| e[k] * e[k])).sqrt();
            rms.max(LEAST_ERROR * range_of(self.column(k))).max(f64::MIN_POSITIVE)
        };
        let units: Vec<f64> = (0..outputs).map(unit).collect();
        let values: Vec<Vec<f64>> = self.x.iter().map(|x| fitted.values_at(x)).collect();
        let scaled = Mat::from_fn(outputs, values.len(), |k, row| values[row][k] / units[k]);
        let pod = decompose(scaled.as_ref()).ok().filter(|pod| pod.rank > 0)?;
        // Largest singular value of white noise of unit size behind a fit with this number of terms (Marchenko and Pastur).
        let terms = (fitted.weights.len() + fitted.tail_weights.len()) / outputs;
        let of_noise = (outputs as f64).sqrt() + (terms.min(values.len()) as f64).sqrt();
        let beyond = pod.singular_values[..pod.rank].iter().take_while(|size| **size > of_noise).count();
        let kept = beyond.max(1);
        let project = |row: &[f64]| -> Vec<f64> {
            let along = |mode: usize| (0..outputs).map(|k| row[k] / units[k] * pod.u[(k, mode)]).sum();
            (0..kept).map(along).collect()
        };
        let shape = |mode: usize| (0..outputs).map(|k| units[k] * pod.u[(k, mode)]).collect();
        let modes = OutputModes {
            surrogate: Interpolant {
                weights: fitted.weights.chunks_exact(outputs).flat_map(project).collect(),
                tail_weights: fitted.tail_weights.chunks_exact(outputs).flat_map(project).collect(),
                outputs: kept,
                ..fitted.clone()
            },
            shapes: (0..kept).map(shape).collect(),
            singular_values: pod.singular_values[..kept].to_vec(),
        };
        let with_modes = |(y, e): (&Vec<f64>, &Vec<f64>)| -> Vec<f64> {
            let predicted: Vec<f64> = y.iter().zip(e).map(|(y, e)| y - e).collect();
            y.iter().zip(modes.outputs(&project(&predicted))).map(|(y, value)| y - value).collect()
        };
        let errors = self.y.iter().zip(errors).map(with_modes).collect();
        Some((modes, errors))
    }

    pub(super) fn report(
        &self,
        name: &str,
        k: usize,
        predicted: &[Vec<f64>],
        errors: &[Vec<f64>],
    ) -> OutputReport {
        let own: Vec<f64> = errors.iter().map(|e| e[k]).collect();
        let (range, centre) = (range_of(self.column(k)), mean(self.column(k)));
        let square = mean(own.iter().map(|e| e * e));
        let predicted: Vec<f64> = predicted.iter().map(|row| row[k]).collect();
        let values: Vec<f64> = self.column(k).collect();
        let rows: Vec<(usize, f64)> = self.run.iter().copied().zip(values.iter().copied()).collect();
        let noise = |run: &[(usize, f64)]| noise_of(&run.iter().map(|row| row.1).collect::<Vec<_>>()).powi(2);
        OutputReport {
            name: name.into(),
            range,
            noise: mean(rows.chunk_by(|a, b| a.0 == b.0).map(noise)).sqrt(),
            rms: square.sqrt(),
            half_width: half_width(&self.run, &own),
            loop_share: self.loop_size(&values, &predicted) / range,
            explained: 1.0 - square / mean(self.column(k).map(|y| (y - centre).powi(2))),
        }
    }

    /// Half-width of the sizes of the worst outputs, of which `errors` has all.
    pub(super) fn half_width_of_worst(&self, sizes: Vec<f64>, errors: impl Iterator<Item = Vec<f64>>) -> f64 {
        quantile(sizes, COVERAGE) + errors.map(|own| shift(&self.run, &own)).fold(0.0, f64::max)
    }

    /// Mean difference of the values on rising and falling at equal predicted values.
    fn loop_size(&self, values: &[f64], predicted: &[f64]) -> f64 {
        let low = predicted.iter().copied().fold(f64::INFINITY, f64::min);
        let width = range_of(predicted.iter().copied()) / LOOP_CELLS as f64;
        let mut cells = vec![[(0.0_f64, 0.0_f64); 2]; LOOP_CELLS];
        let ways = directions(&self.run, predicted);
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

/// Changes between rising and falling.
pub(crate) fn turns(ways: &[i8]) -> usize {
    let moving: Vec<i8> = ways.iter().copied().filter(|way| *way != 0).collect();
    moving.windows(2).filter(|pair| pair[0] != pair[1]).count()
}

/// Direction of a value at each row: 1 rising, -1 falling, 0 not known.
pub(crate) fn directions(run: &[usize], values: &[f64]) -> Vec<i8> {
    let least = LEAST_TURN * range_of(values.iter().copied());
    let (mut directions, mut way, mut extreme) = (Vec::with_capacity(values.len()), 0_i8, values[0]);
    for (at, value) in values.iter().enumerate() {
        if at > 0 && run[at] != run[at - 1] {
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

/// Rows without missing values.
fn rows(data: &Measured) -> Vec<Row> {
    let at = |columns: &[Vec<f64>], row: usize| -> Vec<f64> { columns.iter().map(|c| c[row]).collect() };
    let of_run = |(run, of): (usize, &Run)| {
        let row = |row: usize| Row { run, inputs: at(&of.inputs, row), outputs: at(&of.outputs, row) };
        let is_whole = |row: &Row| row.inputs.iter().chain(&row.outputs).all(|v| v.is_finite());
        (0..of.time_s.len()).map(row).filter(is_whole).collect::<Vec<Row>>()
    };
    data.runs.iter().enumerate().flat_map(of_run).collect()
}

/// Bound of a further run's mean error, from the means of the runs or of the halves of a single one. `run`: number of the run by row.
fn shift(run: &[usize], errors: &[f64]) -> f64 {
    let runs = run.iter().max().map_or(1, |last| last + 1);
    let block = |at: usize| if runs > 1 { run[at] } else { 2 * at / errors.len() };
    let of_block = |of: usize| mean((0..errors.len()).filter(|at| block(*at) == of).map(|at| errors[at]));
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
