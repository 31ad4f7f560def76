//! Maps of measured runs by ridge regression, chosen on left-out parts: the lags first, then kernel maps and reservoirs of them.
//!
//! Parts are six contiguous segments of one or two runs, or whole runs of several. If each run has its own value of an
//! input (such as a load), leaving out a whole run would judge extrapolation; segments are then left out. Features are computed once over
//! whole runs; only rows are left out, so that one Gram matrix per part gives all left-out fits.
//!
//! 1. A lag common to all inputs, or none, is chosen by a quadratic map; the best [`SETS`] are kept.
//! 2. To each, a lag of one input with a time of its own is added if it lowers the left-out error by [`GAIN`]: of inputs of
//!    several units also one as long as the run, which nearly integrates. The two next best are tried as well.
//! 3. Polynomials and kernel maps of these, and reservoirs with their own lags; of each family the mean of the best [`MEMBERS`], and
//!    the families weighted by their left-out error to the power -8: one that is worse by a third counts a tenth.
//!
//! Where successive rows have nothing in common (settled states, dealt in any order), inputs have no lags and there is no reservoir.

use super::data::{MIN_ROWS, Measured, MeasuredError, Run, max_gap_s, scales};
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use rom::inputs::{Inputs, PARAMETERS};
use rom::learned::{Lag, LearnedMap, LinearMap, MapInput, Reservoir, Support};
use rom::memory::Line;
use rom::rng::Rng;
use rom::statistics::{farthest_points, mean, median};
use std::ops::Range;

/// Rows beyond which only every n-th is used.
const MAX_ROWS: usize = 20_000;
/// Most rows of a regression.
const FITTED_ROWS: usize = 1500;
/// Left-out parts of one or two runs.
const PARTS: usize = 6;
/// Most left-out parts of several runs.
const MOST_PARTS: usize = 12;
/// Times that are tried for a lag.
const TIMES: usize = 10;
/// Ratios of a lag's filling time to its emptying time.
const RATIOS: [f64; 5] = [1.0 / 3.0, 0.6, 1.0, 1.0 / 0.6, 3.0];
/// Sets of lags that are kept.
const SETS: usize = 3;
/// Fraction by which a further lag must lower the left-out error.
const GAIN: f64 = 0.05;
/// Smoothing while lags are searched.
const QUICK: f64 = 1e-4;
/// Smoothings that are tried for the maps.
const SMOOTHINGS: [f64; 4] = [1e-7, 1e-5, 1e-3, 1e-1];
/// Factor on the left-out error that a larger smoothing must reach to be preferred to a smaller one.
const SMOOTHER: f64 = 0.995;
/// Smoothing of the base, which is to go on beyond what was visited.
pub(super) const BASE_SMOOTHING: f64 = 1e-2;
/// Best members of a family, whose mean is taken.
const MEMBERS: usize = 8;
/// Power of a family's left-out error in its weight.
const POWER: i32 = -8;
/// Smallest share of a family.
const LEAST_SHARE: f64 = 0.01;
/// Most centres of a kernel map.
const CENTRES: usize = 160;
/// Square distance, in standardised units, up to which two rows are one centre.
const SAME_CENTRE: f64 = 1e-12;
/// Radii that are tried for kernels, in units of the root of the number of lags.
const RADII: [f64; 4] = [0.5, 1.0, 2.0, 4.0];
/// Neurons of a reservoir.
const NEURONS: usize = 120;
/// Share of pairs of neurons that are connected.
const CONNECTED: f64 = 0.05;
/// Largest eigenvalues of the connections that are tried.
const SPECTRAL_RADII: [f64; 2] = [0.5, 0.95];
/// Strengths of the inputs that are tried.
const INPUT_SCALES: [f64; 2] = [0.2, 0.6];
/// Random reservoirs of each kind.
const DRAWINGS: usize = 2;
/// Ratio of half the mean square step of an input to its variance from which rows are dealt: 1 for any order.
const DEALT: f64 = 0.5;
/// Largest range within a run of an input that each run has its own value of, as a fraction of the whole range.
const OWN_INPUT: f64 = 0.05;

/// A run's rows that have all inputs.
pub(super) struct DrivenRun {
    pub time_ns: Vec<u64>,
    /// Values by row.
    pub inputs: Vec<Inputs>,
}

/// Measured rows, prepared.
pub(super) struct FittedRows {
    pub runs: Vec<DrivenRun>,
    /// Run and row of those that are fitted, in order.
    pub fitted: Vec<(usize, usize)>,
    /// Outputs at the fitted rows.
    pub y: Mat<f64>,
    /// Outputs of all rows that have them, by row, with their run.
    pub measured: Vec<(usize, Vec<f64>)>,
    /// Standardised inputs at the fitted rows, by input.
    pub inputs: Vec<MapInput>,
    /// Left-out parts of the fitted rows.
    pub parts: Vec<Range<usize>>,
    /// Halves of a run, or whole runs: leaving one out shows how errors grow far from what was visited. Empty where `parts` show it.
    pub far_parts: Vec<Range<usize>>,
    pub whole_runs: Vec<Range<usize>>,
    /// Three runs or more, and an input that does not move within any of them.
    pub have_own_inputs: bool,
    /// Unit of each output's error.
    pub units: Vec<f64>,
    pub interval_s: f64,
    pub duration_s: f64,
    pub are_dealt: bool,
    /// Inputs have several units: one of another kind may have to be integrated.
    pub are_mixed: bool,
}

/// Position in a model of each measured input.
pub(super) fn positions(names: &[String]) -> Vec<usize> {
    let pressure = names.iter().position(|name| name == super::layout::PRESSURE_NAME);
    let position = |index: usize| {
        let further = index - usize::from(pressure.is_some_and(|pressure| pressure < index));
        if Some(index) == pressure { rom::inputs::PRESSURE } else { PARAMETERS + further }
    };
    (0..names.len()).map(position).collect()
}

/// The values of an input, run by run.
fn values(runs: &[DrivenRun], input: usize) -> impl Iterator<Item = impl Iterator<Item = f64>> {
    runs.iter().map(move |run| run.inputs.iter().map(move |row| row.values()[input]))
}

fn map_input(runs: &[DrivenRun], input: usize) -> MapInput {
    let all = || values(runs, input).flatten();
    let centre = mean(all());
    let deviation = mean(all().map(|v| (v - centre).powi(2))).sqrt().max(f64::MIN_POSITIVE);
    let range = rom::statistics::range(all()) / deviation;
    MapInput { input: input as u32, mean: centre, deviation, range }
}

/// Half the mean square step of an input over its variance: 1 where successive rows have nothing in common.
fn roughness(runs: &[DrivenRun], input: &MapInput) -> f64 {
    let steps = values(runs, input.input as usize).flat_map(|run| {
        let run: Vec<f64> = run.collect();
        run.windows(2).map(|v| (v[1] - v[0]).powi(2)).collect::<Vec<_>>()
    });
    0.5 * mean(steps) / input.deviation.powi(2)
}

/// True of an input that each run has its own value of.
fn is_own(runs: &[DrivenRun], input: &MapInput) -> bool {
    let ranges = values(runs, input.input as usize).map(|run| rom::statistics::range(run) / input.deviation);
    ranges.fold(0.0, f64::max) < OWN_INPUT * input.range
}

impl FittedRows {
    pub(super) fn new(data: &Measured, remarks: &mut Vec<String>) -> Result<Self, MeasuredError> {
        let driven: Vec<Vec<usize>> = data.runs.iter().map(driven).collect();
        let all: usize = driven.iter().map(Vec::len).sum();
        let step = all.div_ceil(MAX_ROWS).max(1);
        if step > 1 {
            remarks.push(format!("{all} rows: one in {step} is used"));
        }
        let positions = positions(&data.inputs);
        let (mut runs, mut measured, mut whole) = (Vec::new(), Vec::new(), Vec::new());
        for (run, rows) in data.runs.iter().zip(driven).filter(|(_, rows)| !rows.is_empty()) {
            let begin_s = run.time_s[rows[0]];
            let rows: Vec<usize> = rows.into_iter().step_by(step).collect();
            let time_ns = |row: &usize| ((run.time_s[*row] - begin_s) * 1e9).round() as u64;
            let inputs = |row: &usize| {
                let columns = positions.iter().zip(&run.inputs);
                let start = Inputs::new(0.0, f64::INFINITY);
                columns.fold(start, |state, (at, column)| state.with(*at, column[*row]))
            };
            for (index, row) in rows.iter().enumerate() {
                let outputs: Vec<f64> = run.outputs.iter().map(|column| column[*row]).collect();
                if outputs.iter().all(|y| y.is_finite()) {
                    whole.push((runs.len(), index));
                    measured.push((runs.len(), outputs));
                }
            }
            runs.push(DrivenRun {
                time_ns: rows.iter().map(time_ns).collect(),
                inputs: rows.iter().map(inputs).collect(),
            });
        }
        if whole.len() < MIN_ROWS {
            return Err(MeasuredError::Few { expected: MIN_ROWS, found: whole.len() });
        }
        let keep = whole.len().div_ceil(FITTED_ROWS);
        let fitted: Vec<(usize, usize)> = whole.iter().copied().step_by(keep).collect();
        let y = Mat::from_fn(fitted.len(), data.outputs.len(), |row, k| measured[row * keep].1[k]);
        let inputs: Vec<MapInput> = positions.iter().map(|at| map_input(&runs, *at)).collect();
        let are_dealt = inputs.iter().any(|input| roughness(&runs, input) > DEALT);
        let have_own_inputs = runs.len() > 2 && inputs.iter().any(|input| is_own(&runs, input));
        let whole_runs = parts(&fitted, 1);
        let segments = parts(&fitted, PARTS.div_ceil(runs.len()));
        let (parts, far_parts) = match runs.len() {
            1 if are_dealt => (segments, Vec::new()),
            1 => (segments, parts(&fitted, 2)),
            2 => (segments, whole_runs.clone()),
            _ if have_own_inputs => (segments, whole_runs.clone()),
            _ => (whole_runs.clone(), Vec::new()),
        };
        let intervals =
            runs.iter().flat_map(|run| run.time_ns.windows(2).map(|t| 1e-9 * (t[1] - t[0]) as f64));
        let durations = || runs.iter().map(|run| 1e-9 * run.time_ns.last().copied().unwrap_or(0) as f64);
        Ok(Self {
            parts,
            far_parts,
            whole_runs,
            have_own_inputs,
            units: scales(&data.outputs, &data.runs),
            interval_s: median(intervals)
                .unwrap_or(1.0)
                .max(durations().sum::<f64>() / MAX_ROWS as f64)
                .max(1e-9),
            duration_s: median(durations()).unwrap_or(1.0),
            runs,
            fitted,
            y,
            measured,
            inputs,
            are_dealt,
            are_mixed: data
                .inputs
                .iter()
                .any(|name| super::layout::unit_of(name) != super::layout::unit_of(&data.inputs[0])),
        })
    }

    pub(super) fn outputs(&self) -> usize {
        self.y.ncols()
    }

    /// Root of the mean square error over outputs in their units.
    pub(super) fn size(&self, predicted: &Mat<f64>) -> f64 {
        let square = |k: usize| {
            let error = |row: usize| ((predicted[(row, k)] - self.y[(row, k)]) / self.units[k]).powi(2);
            mean((0..self.y.nrows()).map(error))
        };
        (0..self.outputs()).map(square).sum::<f64>().sqrt()
    }

    /// A map that holds filters and neurons alone.
    pub(super) fn bare(&self, lags: Vec<Lag>, reservoirs: Vec<Reservoir>) -> LearnedMap {
        LearnedMap {
            inputs: self.inputs.clone(),
            step_ns: (1e9 * self.interval_s).round().max(1.0) as u64,
            max_gap_s: max_gap_s(self.interval_s),
            lags,
            base: LinearMap { lags: Vec::new(), weights: Vec::new() },
            polynomials: Vec::new(),
            kernels: Vec::new(),
            reservoirs,
            support: Support { lags: Vec::new(), rows: Vec::new(), reach: 0.0, extent: 0.0 },
            widths: Vec::new(),
            drifts: Vec::new(),
            markers: Vec::new(),
        }
    }

    /// Values behind the lags and neurons at the fitted rows, as a session has them.
    fn follow(&self, map: &LearnedMap, mut at_row: impl FnMut(&rom::learned::LearnedState)) {
        let mut past = map.initial_state();
        let mut next = self.fitted.iter().peekable();
        for (index, run) in self.runs.iter().enumerate() {
            past.restart();
            for (row, (t_ns, inputs)) in run.time_ns.iter().zip(&run.inputs).enumerate() {
                if map.has_memory() {
                    past.advance(map, *t_ns, inputs, f64::INFINITY);
                } else {
                    past.settle(map, inputs);
                }
                if next.next_if(|fitted| **fitted == (index, row)).is_some() {
                    at_row(&past);
                }
            }
        }
    }
}

/// Contiguous parts of the fitted rows, `per_run` of each run.
fn parts(fitted: &[(usize, usize)], per_run: usize) -> Vec<Range<usize>> {
    let mut parts = Vec::new();
    let mut begin = 0;
    for of_run in fitted.chunk_by(|a, b| a.0 == b.0) {
        let ends = (1..=per_run).map(|k| begin + of_run.len() * k / per_run);
        let mut from = begin;
        for end in ends {
            parts.push(from..end);
            from = end;
        }
        begin += of_run.len();
    }
    parts.retain(|part| !part.is_empty());
    // Many runs: neighbours together.
    let joined = parts.len().div_ceil(MOST_PARTS);
    parts.chunks(joined).map(|joined| joined[0].start..joined[joined.len() - 1].end).collect()
}

/// The rows of a run that have all inputs and come after the row before.
fn driven(run: &Run) -> Vec<usize> {
    let mut last_s = f64::NEG_INFINITY;
    let mut is_driven = |row: &usize| {
        let time_s = run.time_s[*row];
        let keeps = time_s > last_s && run.inputs.iter().all(|column| column[*row].is_finite());
        if keeps {
            last_s = time_s;
        }
        keeps
    };
    (0..run.time_s.len()).filter(&mut is_driven).collect()
}

/// A ridge fit and its left-out predictions.
pub(super) struct Ridge {
    pub error: f64,
    pub left_out: Mat<f64>,
    /// Predictions with nothing left out.
    pub fitted: Mat<f64>,
    /// Predictions with [`FittedRows::far_parts`] left out; no rows without these.
    pub far: Mat<f64>,
    /// `features x outputs`.
    pub weights: Mat<f64>,
}

/// `(G + smoothing rows D)^-1 B`; the constant, which comes first, is hardly smoothed.
pub(super) fn solve(gram: &Mat<f64>, right: &Mat<f64>, smoothing: f64, rows: f64) -> Option<Mat<f64>> {
    let mut system = gram.clone();
    for i in 0..system.nrows() {
        system[(i, i)] += smoothing * rows * if i == 0 { 1e-6 } else { 1.0 };
    }
    let solution = system.llt(Side::Lower).ok()?.solve(right);
    solution.norm_max().is_finite().then_some(solution)
}

impl FittedRows {
    /// The fit with the largest of the smoothings that others do not beat by [`SMOOTHER`] in left-out error.
    pub(super) fn ridge(&self, features: &Mat<f64>, smoothings: &[f64]) -> Option<Ridge> {
        let (n, p) = (features.nrows(), features.ncols());
        let scale: Vec<f64> =
            (0..p).map(|j| (features.col(j).squared_norm_l2() / n as f64).sqrt() + 1e-9).collect();
        let scaled = Mat::from_fn(n, p, |i, j| features[(i, j)] / scale[j]);
        type Sums = (Mat<f64>, Mat<f64>);
        let sums = |parts: &[Range<usize>]| -> Vec<Sums> {
            let rows = |part: &Range<usize>| {
                (scaled.subrows(part.start, part.len()), self.y.subrows(part.start, part.len()))
            };
            parts.iter().map(rows).map(|(z, y)| (z.transpose() * z, z.transpose() * y)).collect()
        };
        let of_parts = sums(&self.parts);
        let start = (Mat::zeros(p, p), Mat::zeros(p, self.outputs()));
        let (gram, right) = of_parts.iter().fold(start, |(g, b), (gram, own)| (g + gram, b + own));
        let without = |parts: &[Range<usize>], sums: &[Sums], smoothing: f64| -> Option<Mat<f64>> {
            let mut left_out = Mat::zeros(if parts.is_empty() { 0 } else { n }, self.outputs());
            for (part, (own, b)) in parts.iter().zip(sums) {
                let left = (n - part.len()) as f64;
                let weights = solve(&(&gram - own), &(&right - b), smoothing, left)?;
                let predicted = scaled.subrows(part.start, part.len()) * &weights;
                left_out.subrows_mut(part.start, part.len()).copy_from(&predicted);
            }
            Some(left_out)
        };
        let mut best: Option<(f64, f64, Mat<f64>)> = None;
        for smoothing in smoothings {
            let Some(left_out) = without(&self.parts, &of_parts, *smoothing) else { continue };
            let error = self.size(&left_out);
            let is_better = best.as_ref().is_none_or(|best| error < SMOOTHER * best.0);
            if error.is_finite() && is_better {
                best = Some((error, *smoothing, left_out));
            }
        }
        let (error, smoothing, left_out) = best?;
        let far = without(&self.far_parts, &sums(&self.far_parts), smoothing)?;
        let mut weights = solve(&gram, &right, smoothing, n as f64)?;
        let fitted = &scaled * &weights;
        for (j, scale) in scale.iter().enumerate() {
            weights.row_mut(j).iter_mut().for_each(|w| *w /= scale);
        }
        Some(Ridge { error, left_out, fitted, far, weights })
    }
}

/// Values of filtered inputs at the fitted rows, each computed once.
pub(super) struct LagColumns<'a> {
    rows: &'a FittedRows,
    found: Vec<(Lag, Vec<f64>)>,
}

impl<'a> LagColumns<'a> {
    pub(super) fn new(rows: &'a FittedRows) -> Self {
        Self { rows, found: Vec::new() }
    }

    /// Columns of lags.
    pub(super) fn columns(&mut self, lags: &[Lag]) -> Mat<f64> {
        let missing: Vec<Lag> =
            lags.iter().filter(|lag| self.found.iter().all(|(known, _)| known != *lag)).copied().collect();
        if !missing.is_empty() {
            let mut columns = vec![Vec::with_capacity(self.rows.fitted.len()); missing.len()];
            self.rows.follow(&self.rows.bare(missing.clone(), Vec::new()), |past| {
                columns.iter_mut().zip(past.lags()).for_each(|(column, value)| column.push(*value));
            });
            self.found.extend(missing.into_iter().zip(columns));
        }
        let column = |lag: &Lag| self.found.iter().find(|(known, _)| known == lag).map(|(_, column)| column);
        let columns: Vec<&Vec<f64>> = lags.iter().filter_map(column).collect();
        Mat::from_fn(self.rows.fitted.len(), lags.len(), |i, j| columns[j][i])
    }
}

pub(super) fn polynomial(x: &Mat<f64>, degree: u32) -> Mat<f64> {
    let mut features = Mat::zeros(x.nrows(), rom::learned::polynomial_terms(x.ncols(), degree));
    for row in 0..x.nrows() {
        let mut column = 0;
        rom::learned::polynomial(
            x.ncols(),
            degree,
            |j| x[(row, j)],
            |term| {
                features[(row, column)] = term;
                column += 1;
            },
        );
    }
    features
}

fn square(x: &Mat<f64>, row: usize, centre: &[f64]) -> f64 {
    centre.iter().enumerate().map(|(j, c)| (x[(row, j)] - c).powi(2)).sum()
}

/// Rows spread over all: the one nearest to the mean, then each time the one farthest from those before it.
fn centres(x: &Mat<f64>) -> Vec<Vec<f64>> {
    let middle: Vec<f64> = (0..x.ncols()).map(|j| mean(x.col(j).iter().copied())).collect();
    let rows = || 0..x.nrows();
    let Some(first) = rows().min_by(|a, b| square(x, *a, &middle).total_cmp(&square(x, *b, &middle))) else {
        return Vec::new();
    };
    let distance =
        |a: usize, b: usize| -> f64 { (0..x.ncols()).map(|j| (x[(a, j)] - x[(b, j)]).powi(2)).sum() };
    let spread = farthest_points(x.nrows(), first, CENTRES, SAME_CENTRE, distance);
    spread.into_iter().map(|row| x.row(row).iter().copied().collect()).collect()
}

fn kernel_features(x: &Mat<f64>, squares: &Mat<f64>, radius: f64) -> Mat<f64> {
    let (first, scale) = (1 + x.ncols(), 1.0 / (radius * (x.ncols() as f64).sqrt()));
    Mat::from_fn(x.nrows(), first + squares.ncols(), |row, k| match k {
        0 => 1.0,
        k if k < first => x[(row, k - 1)],
        k => rom::learned::kernel(scale * squares[(row, k - first)].sqrt()),
    })
}

/// The features of which a member is a ridge map.
pub(super) enum MemberFeatures {
    Polynomial { lags: Vec<Lag>, degree: u32 },
    Kernel { lags: Vec<Lag>, centres: Vec<Vec<f64>>, radius: f64 },
    Reservoir(Reservoir),
}

/// A member of the answer.
pub(super) struct Member {
    pub features: MemberFeatures,
    pub fit: Ridge,
    pub share: f64,
}

/// Lags and members.
pub(super) struct ChosenMaps {
    pub members: Vec<Member>,
    /// Left-out predictions of the members together.
    pub left_out: Mat<f64>,
    /// The same with nothing left out.
    pub fitted: Mat<f64>,
    /// The same with whole runs left out ([`FittedRows::far_parts`]).
    pub far: Mat<f64>,
    /// The best lags that are common to all inputs.
    pub common: Vec<Lag>,
    pub base: LinearBase,
    pub errors: LeftOutErrors,
}

/// The linear map that answers alone far from the training.
pub(super) struct LinearBase {
    pub lags: Vec<Lag>,
    pub fit: Ridge,
}

/// Left-out errors in units.
#[derive(Clone, Copy)]
pub(super) struct LeftOutErrors {
    /// Of a linear map without lags.
    pub without_lags: f64,
    /// Of the members together.
    pub members: f64,
}

/// Lags with the left-out error of a map of them.
struct ScoredLags {
    error: f64,
    lags: Vec<Lag>,
}

/// Chooses lags and maps. Cost `O(rows features^2)` for each of some 60 maps.
pub(super) fn search(rows: &FittedRows, filtered: &mut LagColumns<'_>) -> Option<ChosenMaps> {
    let times = times(rows);
    let mut common = common_lags(rows, filtered, &times);
    let sets = lag_sets(rows, filtered, &times, &common);
    let mut families = polynomials_and_kernels(rows, filtered, sets);
    if !rows.are_dealt {
        families.push(reservoirs(rows, &times));
    }
    let (members, [left_out, fitted, far]) = ensemble(rows, families)?;
    let mut linear =
        |lags: &[Lag], smoothings: &[f64]| rows.ridge(&polynomial(&filtered.columns(lags), 1), smoothings);
    let mut bases = Vec::new();
    for ScoredLags { lags, .. } in &common {
        bases
            .extend(linear(lags, &SMOOTHINGS).map(|fit| ScoredLags { error: fit.error, lags: lags.clone() }));
    }
    let ScoredLags { lags, .. } = bases.into_iter().min_by(|a, b| a.error.total_cmp(&b.error))?;
    let fit = linear(&lags, &[BASE_SMOOTHING])?;
    let without_lags = linear(&same_lag(rows, None), &SMOOTHINGS)?.error;
    Some(ChosenMaps {
        errors: LeftOutErrors { without_lags, members: rows.size(&left_out) },
        members,
        left_out,
        fitted,
        far,
        common: common.swap_remove(0).lags,
        base: LinearBase { lags, fit },
    })
}

/// One lag for all inputs.
fn same_lag(rows: &FittedRows, line: Option<Line>) -> Vec<Lag> {
    (0..rows.inputs.len()).map(|input| Lag { input: input as u32, line }).collect()
}

/// Sets of lags with the left-out errors of their quadratic maps, the best first.
fn sorted(
    rows: &FittedRows,
    filtered: &mut LagColumns<'_>,
    sets: impl Iterator<Item = Vec<Lag>>,
) -> Vec<ScoredLags> {
    let mut error = |lags: &[Lag]| {
        let fit = rows.ridge(&polynomial(&filtered.columns(lags), 2), &[QUICK]);
        fit.map_or(f64::INFINITY, |fit| fit.error)
    };
    let mut found: Vec<ScoredLags> = sets.map(|lags| ScoredLags { error: error(&lags), lags }).collect();
    found.sort_by(|a, b| a.error.total_cmp(&b.error));
    found
}

/// Step 1: the best lags that are common to all inputs.
fn common_lags(rows: &FittedRows, filtered: &mut LagColumns<'_>, times: &[f64]) -> Vec<ScoredLags> {
    let asymmetric =
        |time: &f64| RATIOS.map(|q| Some(Line { fill_s: time * q.sqrt(), empty_s: time / q.sqrt() }));
    let times = if rows.are_dealt { &[] } else { times };
    let lines = [None].into_iter().chain(times.iter().flat_map(asymmetric));
    let mut found = sorted(rows, filtered, lines.map(|line| same_lag(rows, line)));
    found.truncate(SETS);
    found
}

/// Step 2: the common lags, and with them a further lag of one input where it gains enough.
fn lag_sets(
    rows: &FittedRows,
    filtered: &mut LagColumns<'_>,
    times: &[f64],
    common: &[ScoredLags],
) -> Vec<Vec<Lag>> {
    let mut further_lines: Vec<Option<Line>> = vec![None];
    if !rows.are_dealt {
        // A lag as long as the run nearly integrates; among inputs of one kind it would only follow the drift of this run.
        let whole_run = Some(&rows.duration_s).filter(|_| rows.are_mixed);
        let further = times.iter().chain(whole_run);
        further_lines.extend(further.map(|time| Some(Line { fill_s: *time, empty_s: *time })));
    }
    let mut sets: Vec<Vec<Lag>> = Vec::new();
    for ScoredLags { error, lags } in common {
        sets.push(lags.clone());
        let of_input = |input: u32| further_lines.iter().map(move |line| Lag { input, line: *line });
        let further = (0..rows.inputs.len() as u32).flat_map(of_input).filter(|lag| !lags.contains(lag));
        let extended = |lag: Lag| lags.iter().copied().chain([lag]).collect();
        let found = sorted(rows, filtered, further.map(extended));
        if found.first().is_some_and(|best| best.error <= (1.0 - GAIN) * error) {
            sets.extend(found.into_iter().take(3).map(|found| found.lags));
        }
    }
    sets
}

/// Step 3 without reservoirs: the family of kernel maps, then that of polynomials.
fn polynomials_and_kernels(
    rows: &FittedRows,
    filtered: &mut LagColumns<'_>,
    sets: Vec<Vec<Lag>>,
) -> Vec<Vec<Member>> {
    let (mut kernels, mut polynomials) = (Vec::new(), Vec::new());
    for lags in sets {
        let x = filtered.columns(&lags);
        for degree in 1..=3 {
            let Some(fit) = rows.ridge(&polynomial(&x, degree), &SMOOTHINGS) else { continue };
            let features = MemberFeatures::Polynomial { lags: lags.clone(), degree };
            polynomials.push(Member { features, fit, share: 0.0 });
        }
        let centres = centres(&x);
        let squares = Mat::from_fn(x.nrows(), centres.len(), |row, k| square(&x, row, &centres[k]));
        for radius in RADII {
            let Some(fit) = rows.ridge(&kernel_features(&x, &squares, radius), &SMOOTHINGS) else { continue };
            let features = MemberFeatures::Kernel { lags: lags.clone(), centres: centres.clone(), radius };
            kernels.push(Member { features, fit, share: 0.0 });
        }
    }
    vec![kernels, polynomials]
}

/// Times of lags, s.
pub(super) fn times(rows: &FittedRows) -> Vec<f64> {
    let shortest = 2.0 * rows.interval_s;
    let ratio = (rows.duration_s / 8.0).max(2.0 * shortest) / shortest;
    (0..TIMES).map(|k| shortest * ratio.powf(k as f64 / (TIMES - 1) as f64)).collect()
}

/// Members with their shares: the mean of the best of each family, the families weighted by the left-out error of that mean.
fn ensemble(rows: &FittedRows, mut families: Vec<Vec<Member>>) -> Option<(Vec<Member>, [Mat<f64>; 3])> {
    families.retain(|family| !family.is_empty());
    let mut weights = Vec::new();
    for family in &mut families {
        family.sort_by(|a, b| a.fit.error.total_cmp(&b.fit.error));
        family.truncate(MEMBERS);
        let sum = family
            .iter()
            .fold(Mat::zeros(rows.y.nrows(), rows.outputs()), |sum, member| sum + &member.fit.left_out);
        let mean = sum * faer::Scale(1.0 / family.len() as f64);
        weights.push(rows.size(&mean).max(1e-9));
    }
    let best = weights.iter().copied().fold(f64::INFINITY, f64::min);
    let weights: Vec<f64> = weights.iter().map(|error| (error / best).powi(POWER)).collect();
    let all: f64 = weights.iter().sum();
    let mut members = Vec::new();
    for (family, weight) in families.into_iter().zip(weights).filter(|(_, weight)| weight / all > LEAST_SHARE)
    {
        let share = weight / all / family.len() as f64;
        members.extend(family.into_iter().map(|member| Member { share, ..member }));
    }
    let all: f64 = members.iter().map(|member| member.share).sum();
    members.iter_mut().for_each(|member| member.share /= all);
    let together = |predicted: fn(&Ridge) -> &Mat<f64>| {
        let parts = members.iter().map(|member| predicted(&member.fit) * faer::Scale(member.share));
        parts.reduce(|sum, part| sum + part)
    };
    let predicted = [together(|fit| &fit.left_out)?, together(|fit| &fit.fitted)?, together(|fit| &fit.far)?];
    Some((members, predicted))
}

fn reservoirs(rows: &FittedRows, times: &[f64]) -> Vec<Member> {
    let drawings =
        (0..DRAWINGS).flat_map(|_| SPECTRAL_RADII.into_iter().flat_map(|r| INPUT_SCALES.map(|s| (r, s))));
    let drawn = drawings.enumerate().map(|(seed, (radius, scale))| {
        draw(seed as u64, rows.inputs.len(), rows.outputs(), radius, scale, times)
    });
    let drawn: Vec<Reservoir> = drawn.flatten().collect();
    let map = rows.bare((0..rows.inputs.len()).map(|k| Lag { input: k as u32, line: None }).collect(), drawn);
    let mut seen = Vec::new();
    rows.follow(&map, |past| seen.push((past.lags().to_vec(), past.neurons().to_vec())));
    let first = 1 + rows.inputs.len();
    let member = |(k, reservoir): (usize, Reservoir)| {
        let features = Mat::from_fn(seen.len(), first + NEURONS, |row, j| match j {
            0 => 1.0,
            j if j < first => seen[row].0[j - 1],
            j => seen[row].1[k * NEURONS + j - first],
        });
        let fit = rows.ridge(&features, &SMOOTHINGS)?;
        Some(Member { features: MemberFeatures::Reservoir(reservoir), fit, share: 0.0 })
    };
    map.reservoirs.into_iter().enumerate().filter_map(member).collect()
}

/// A random reservoir without weights.
fn draw(
    seed: u64,
    inputs: usize,
    outputs: usize,
    radius: f64,
    scale: f64,
    times: &[f64],
) -> Option<Reservoir> {
    let mut rng = Rng::new(seed + 1);
    let drive = (0..NEURONS * (1 + inputs)).map(|_| scale * (2.0 * rng.uniform() - 1.0)).collect();
    let mut matrix = Mat::<f64>::zeros(NEURONS, NEURONS);
    for i in 0..NEURONS {
        for j in 0..NEURONS {
            if rng.uniform() < CONNECTED {
                matrix[(i, j)] = rng.normal();
            }
        }
    }
    let eigenvalues = matrix.eigenvalues().ok()?;
    let largest = eigenvalues.iter().map(|value| value.re.hypot(value.im)).fold(0.0, f64::max);
    let (mut starts, mut sources, mut strengths) = (vec![0], Vec::new(), Vec::new());
    for i in 0..NEURONS {
        for j in (0..NEURONS).filter(|j| matrix[(i, *j)] != 0.0) {
            sources.push(j as u32);
            strengths.push(matrix[(i, j)] * radius / largest);
        }
        starts.push(sources.len() as u32);
    }
    let (low, high) = (times[0].ln(), times[times.len() - 1].ln());
    let times_s = (0..NEURONS).map(|_| (low + (high - low) * rng.uniform()).exp()).collect();
    let weights = vec![0.0; (1 + inputs + NEURONS) * outputs];
    Some(Reservoir { share: 0.0, times_s, drive, starts, sources, strengths, weights })
}
