//! Choosing kernel, tail, metric, smoothing and modes by leave-one-out in closed form.
//!
//! With orthonormal modes the error of leaving case `i` out, at `l` modes, is
//! `e_i(l)^2 = sum_{k<l} E_ik^2 + sum_{k>=l} A_ik^2`: interpolation residuals (Rippa) of the kept modes plus the energy
//! of the dropped ones. The score is its mean over the cases inside the training range (`over_cases`): leaving out a corner of the
//! domain measures extrapolation, which no kernel choice should be judged by. Test cases are never seen here. Smoothing
//! carries a handicap.
//!
//! Groups that belong together (the three coordinates: what counts is the length of their error) are chosen together and
//! share a kernel; each keeps its own number of modes.

use crate::config::{KernelSpec, ModeChoice, RegimeConfig};
use crate::datasheet::Candidate;
use crate::fit::{Fit, FitError, Samples, condition_of, fit};
use rom::inputs::Point;
use rom::interpolant::{Interpolant, Metric, Slope};
use std::ops::Range;

/// Fewer scored cases than this say nothing about modes: all are kept, so that at least the samples are reproduced.
const MIN_CASES: usize = 4;

/// The winner for one group, and the others, best first.
#[derive(Clone, Debug)]
pub struct Choice {
    /// The fit of the first `modes` outputs.
    pub fit: Fit,
    /// Modes kept.
    pub modes: usize,
    /// The group's own leave-one-out score.
    pub error: f64,
    /// All candidates, best first.
    pub candidates: Vec<Candidate>,
    /// Parameters (by axis) without which left-out states are predicted as well.
    pub idle: Vec<usize>,
}

/// States that all groups of a regime share.
#[derive(Clone, Copy, Debug)]
pub struct States<'a> {
    /// Leading inputs that are pressure or gap; the others are parameters.
    pub operating: usize,
    /// Inputs in use.
    pub dimensions: usize,
    /// Scaled inputs.
    pub inputs: &'a [Point],
    /// Per state: weight of its error in the score; 0 leaves it out of the score (not out of the fit).
    pub score: &'a [f64],
    /// Known derivatives, ordered by state.
    pub slopes: &'a [Slope],
    /// State that is reproduced whatever the smoothing.
    pub exact: Option<usize>,
}

/// One group's coefficients.
#[derive(Clone, Debug)]
pub struct Task {
    /// `states x outputs`: coefficients of all modes that may be kept.
    pub values: Vec<f64>,
    /// Modes that may be kept.
    pub outputs: usize,
    /// `slopes x outputs`: derivatives of the coefficients with respect to scaled inputs; empty if a field has none.
    pub slope_values: Vec<f64>,
    /// Per state: energy in the modes that cannot be kept.
    pub dropped: Vec<f64>,
    /// Number of modes.
    pub modes: ModeChoice,
    /// Modes the energy criterion asks for.
    pub modes_for_energy: usize,
    /// Modes that are kept in any case: those of the free regime, so that fields agree at the onset.
    pub leading: usize,
}

impl Task {
    /// Square of the norm of a state's coefficients, those that cannot be kept included.
    fn square(&self, state: usize) -> f64 {
        let kept = &self.values[state * self.outputs..(state + 1) * self.outputs];
        self.dropped[state] + kept.iter().map(|a| a * a).sum::<f64>()
    }
}

/// A candidate: score of all groups together, and by group modes and own score.
struct CandidateScore {
    score: f64,
    groups: Vec<(usize, f64)>,
}

/// Number of the best kernels whose metric is refined.
const REFINED: usize = 3;

/// Start of the search for the lengths of parameters: fields vary less along them than along the pressure.
const PARAMETER_SCALE: f64 = 0.35;
/// Factors on a parameter around the metric being refined.
const PARAMETER_STRETCHES: [f64; 4] = [0.4, 0.7, 1.4, 2.5];
/// Passes over the parameters.
const SWEEPS: usize = 2;

/// Factors on the second input around the metric being refined.
const STRETCHES: [f64; 3] = [0.7, 1.0, 1.4];

/// Tries every candidate of `config` on groups that belong together and keeps the best: first every kernel with every
/// anisotropy and smoothing, then sheared and stretched metrics around the best of the best few kernels, then, parameter
/// after parameter, stretched ones along it. A fit that is not sound is taken only if all sound ones are much worse; soundness is asked
/// for only of fits that would otherwise be taken. Cost `O(candidates x n^3)`.
///
/// # Errors
/// The last refusal when no candidate could be fitted.
pub fn choose(
    states: States,
    tasks: &[Task],
    config: &RegimeConfig,
    is_sound: &dyn Fn(&Interpolant) -> bool,
) -> Result<Vec<Choice>, FitError> {
    let outputs: usize = tasks.iter().map(|t| t.outputs).sum();
    let values = side_by_side(tasks, states.inputs.len(), |task| &task.values);
    let samples = Samples {
        dimensions: states.dimensions,
        inputs: states.inputs,
        values: &values,
        outputs,
        slopes: &[],
        slope_values: &[],
        exact: states.exact,
    };
    let known = |task: &Task| task.slope_values.len() == states.slopes.len() * task.outputs;
    let differentiated = !states.slopes.is_empty() && tasks.iter().all(known);
    let rows = if differentiated { states.slopes.len() } else { 0 };
    let slope_values = side_by_side(tasks, rows, |task| &task.slope_values);
    let floor = DATA_ROUNDING * size(states, tasks);
    let (best, refusal, trials) = (None, FitError::Empty, Vec::new());
    let mut search = Search { samples, states, tasks, floor, is_sound, best, refusal, trials };
    for spec in &config.kernels {
        for (metric, smoothing) in variants(states.dimensions, states.operating, config) {
            search.attempt(*spec, metric, smoothing);
        }
    }
    if states.operating > 1 {
        search.refine(&config.shear);
    }
    for _ in 0..SWEEPS {
        for input in states.operating..states.dimensions {
            search.stretch(input, &PARAMETER_STRETCHES);
        }
    }
    if differentiated {
        search.with_slopes(config, &slope_values);
    }
    search.choices()
}

/// Relative increase of the score from which a left-out parameter counts as needed.
const MISSED: f64 = 0.1;
/// Ratio of scores from which no other factors on the other inputs are tried.
const DOUBTED: f64 = 2.0;

/// True if states are predicted as well without a parameter: the chosen kernel, fitted over the other inputs.
fn idle(samples: &Samples, states: States, tasks: &[Task], chosen: &Fit, axis: usize) -> bool {
    let without = |x: &Point| -> Point {
        let mut rest = Point::default();
        let others = (0..samples.dimensions).filter(|i| *i != axis);
        rest.iter_mut().zip(others).for_each(|(r, i)| *r = x[i]);
        rest
    };
    let (kernel, tail) = (chosen.interpolant.kernel, chosen.interpolant.tail);
    let inputs: Vec<Point> = samples.inputs.iter().map(without).collect();
    let scale = without(&chosen.interpolant.metric.scale);
    let metric = Metric { scale: scale.map(|s| if s > 0.0 { s } else { 1.0 }), ..chosen.interpolant.metric };
    let kept: Vec<usize> =
        (0..samples.slopes.len()).filter(|j| samples.slopes[*j].axis as usize != axis).collect();
    let slope = |j: &usize| {
        let slope = samples.slopes[*j];
        Slope { axis: slope.axis - u32::from(slope.axis as usize > axis), ..slope }
    };
    let row = |j: &usize| samples.slope_values[j * samples.outputs..(j + 1) * samples.outputs].to_vec();
    let slopes: Vec<Slope> = kept.iter().map(slope).collect();
    let slope_values: Vec<f64> = kept.iter().flat_map(row).collect();
    let fewer = Samples {
        dimensions: samples.dimensions - 1,
        inputs: &inputs,
        slopes: &slopes,
        slope_values: &slope_values,
        ..samples.clone()
    };
    // Where two states differ in this parameter alone, nothing can be fitted without it: it is not idle.
    let score_of = |metric: Metric| {
        let fit = fit(&fewer, KernelSpec { kernel, tail }, metric, chosen.interpolant.smoothing).ok()?;
        Some(score(states, tasks, &fit.residuals).score)
    };
    let limit = (1.0 + MISSED) * score(states, tasks, &chosen.residuals).score;
    let Some(mut without) = score_of(metric) else { return false };
    // The other inputs' factors were chosen beside this one: they may change by one step before it is said to be missed.
    let mut metric = metric;
    for (i, stretch) in (0..fewer.dimensions).flat_map(|i| SLOPE_STRETCHES.map(|stretch| (i, stretch))) {
        if without <= limit || without > DOUBTED * limit {
            break;
        }
        let mut other = metric;
        other.scale[i] *= stretch;
        if let Some(better) = score_of(other).filter(|score| *score < without) {
            (without, metric) = (better, other);
        }
    }
    without <= limit
}

/// Floating-point operations that may be spent on metrics with derivatives, over the cube of the system's size.
const SLOPE_BUDGET: f64 = 4e10;
/// Smallest factor that the derivatives may suggest for an input: one without any effect keeps its centres apart.
const MIN_LENGTH_SCALE: f64 = 0.02;
/// Smoothing that is tried with derivatives beside the kernel's own.
const SLOPE_SMOOTHING: f64 = 1e-9;
/// Shears nearer than this to that of a metric are tried with derivatives.
const NEAR_SHEAR: f64 = 0.11;
/// Factors on an input around the metric that was chosen without derivatives.
const SLOPE_STRETCHES: [f64; 4] = [0.85, 1.2, 0.6, 1.6];
/// Ratio of a derivative's leave-one-out error to the median from which it contradicts the others.
const OUTLIER: f64 = 12.0;

/// Factor by which smoothing must lower the error to be chosen: it misses the training states, which are computed and hence exact.
/// It wins only where the kernel is so ill-conditioned that the interpolant is noise.
const SMOOTHING_MUST_GAIN: f64 = 2.0;

/// Factor by which a fit that is not sound must be better than one that is. Leave-one-out errors of sound kernels differ by less where
/// there are states enough; a fit that is three times as wrong is no remedy for a wrong sign between two states.
const UNSOUND_MUST_GAIN: f64 = 3.0;

/// Ranking value of a candidate: the score, with the handicaps of smoothing and of a fit known not to be sound.
fn merit(score: f64, smoothing: f64, is_unsound: bool) -> f64 {
    let smoothed = if smoothing > 0.0 { SMOOTHING_MUST_GAIN * score } else { score };
    if is_unsound { UNSOUND_MUST_GAIN * smoothed } else { smoothed }
}

/// A candidate that was tried, and the modes each group would keep with it.
struct Trial {
    spec: KernelSpec,
    row: Candidate,
    modes: Vec<usize>,
    with_slopes: bool,
    is_unsound: bool,
}

/// The best candidate so far.
struct Best {
    scored: CandidateScore,
    fit: Fit,
    is_unsound: bool,
}

struct Search<'a> {
    samples: Samples<'a>,
    states: States<'a>,
    tasks: &'a [Task],
    /// Errors below this are the data's own rounding.
    floor: f64,
    is_sound: &'a dyn Fn(&Interpolant) -> bool,
    best: Option<Best>,
    refusal: FitError,
    trials: Vec<Trial>,
}

impl<'a> Search<'a> {
    fn attempt(&mut self, spec: KernelSpec, metric: Metric, smoothing: f64) {
        let samples = self.samples.clone();
        self.attempt_on(&samples, spec, metric, smoothing);
    }

    fn attempt_on(&mut self, samples: &Samples, spec: KernelSpec, metric: Metric, smoothing: f64) {
        let derivatives = if samples.slopes.is_empty() { "" } else { ", derivatives" };
        let kernel = format!("{}, {}{derivatives}", spec.kernel.name(), spec.tail.name());
        let mut row = Candidate { kernel, metric, smoothing, modes: 0, error: None, refused: None };
        let mut modes = vec![0; self.tasks.len()];
        let mut is_unsound = false;
        match fit(samples, spec, metric, smoothing) {
            Ok(fit) => {
                let scored = score(self.states, self.tasks, &fit.residuals);
                row.error = Some(scored.score);
                modes = scored.groups.iter().map(|g| g.0).collect();
                let mut found = Best { scored, fit, is_unsound };
                if self.is_best(&found) {
                    is_unsound = !(self.is_sound)(&found.fit.interpolant);
                    found.is_unsound = is_unsound;
                    if self.is_best(&found) {
                        self.best = Some(found);
                    }
                }
            }
            Err(e) => {
                row.refused = Some(e.to_string());
                self.refusal = e;
            }
        }
        let with_slopes = !samples.slopes.is_empty();
        self.trials.push(Trial { spec, row, modes, with_slopes, is_unsound });
    }

    /// Compares scores. At rounding level the higher-degree tail wins: it extrapolates better.
    fn is_best(&self, new: &Best) -> bool {
        let Some(best) = &self.best else { return true };
        let merit_of = |tried: &Best| {
            merit(tried.scored.score.max(self.floor), tried.fit.interpolant.smoothing, tried.is_unsound)
        };
        let terms = |tried: &Best| tried.fit.interpolant.tail.terms(self.samples.dimensions);
        merit_of(new) < merit_of(best) || (merit_of(new) == merit_of(best) && terms(new) > terms(best))
    }

    /// The best few kernels again, fitted to the derivatives as well, then other metrics around the best of these. Where
    /// derivatives contradict their neighbours (a contact set that changes, a state that did not converge) a fit without
    /// those is tried too. Leave-one-out decides, as between any two candidates.
    fn with_slopes(&mut self, config: &RegimeConfig, values: &'a [f64]) {
        let (all, shears) = (&config.kernels, &config.shear);
        let kernels: Vec<_> = self
            .best_kernels(false)
            .into_iter()
            .filter(|(spec, ..)| spec.kernel.takes_derivatives())
            .collect();
        (self.samples.slopes, self.samples.slope_values) = (self.states.slopes, values);
        let size = self.samples.inputs.len() + values.len() / self.samples.outputs.max(1);
        let smoothings = [0.0, SLOPE_SMOOTHING];
        for (spec, metric, smoothing) in &kernels {
            smoothings.iter().for_each(|own| self.attempt(*spec, *metric, own.max(*smoothing)));
        }
        let over_parameters = self.states.operating < self.samples.dimensions;
        if over_parameters && let Some(metric) = self.by_variation() {
            let specs = all.iter().filter(|spec| spec.kernel.takes_derivatives());
            specs.for_each(|spec| self.attempt(*spec, metric, 0.0));
        }
        let mut tries = (SLOPE_BUDGET / (size as f64).powi(3)) as usize;
        if self.states.operating > 1 {
            tries = self.refine_with_slopes(shears, tries);
        }
        let (sweeps, axes) = (if over_parameters { SWEEPS } else { 1 }, 1..self.samples.dimensions);
        for axis in (0..sweeps).flat_map(|_| axes.clone()) {
            let Some((spec, metric, smoothing)) = self.best_with_slopes() else { return };
            for factor in SLOPE_STRETCHES.iter().take(tries) {
                self.attempt(spec, metric.stretched(axis, metric.scale[axis] * factor), smoothing);
            }
            tries = tries.saturating_sub(SLOPE_STRETCHES.len());
        }
        self.without_outliers();
    }

    /// Sheared and stretched metrics near those of the best few kernels with derivatives: what derivatives say in between moves
    /// the best metric. At most `tries` of them; returns how many are left.
    fn refine_with_slopes(&mut self, shears: &[f64], mut tries: usize) -> usize {
        for (spec, metric, smoothing) in self.best_kernels(true) {
            let near = shears.iter().filter(|shear| (*shear - metric.shear).abs() < NEAR_SHEAR);
            let others = near.flat_map(|shear| sheared(metric, *shear)).filter(|other| *other != metric);
            let others: Vec<Metric> = others.take(tries).collect();
            tries -= others.len();
            others.into_iter().for_each(|other| self.attempt(spec, other, smoothing));
        }
        tries
    }

    /// Lengths by how much the derivatives along an input differ from state to state, against those along the first input: what
    /// a tail takes up, the same derivative everywhere, needs no near centres. `None` if an input has no derivatives.
    fn by_variation(&self) -> Option<Metric> {
        let outputs = self.samples.outputs;
        let variation = |axis: usize| {
            let own =
                (0..self.samples.slopes.len()).filter(|j| self.samples.slopes[*j].axis as usize == axis);
            let rows: Vec<&[f64]> =
                own.map(|j| &self.samples.slope_values[j * outputs..(j + 1) * outputs]).collect();
            let count = rows.len() as f64;
            let of_output = |k: usize| {
                let mean = rows.iter().map(|row| row[k]).sum::<f64>() / count;
                rows.iter().map(|row| (row[k] - mean).powi(2)).sum::<f64>() / count
            };
            (0..outputs).map(of_output).sum::<f64>().sqrt()
        };
        let first = variation(0);
        let scale = |metric: Metric, axis: usize| {
            metric.stretched(axis, (variation(axis) / first).clamp(MIN_LENGTH_SCALE, 1.0 / MIN_LENGTH_SCALE))
        };
        let metric = (1..self.samples.dimensions).fold(Metric::IDENTITY, scale);
        metric.scale.iter().all(|s| s.is_finite()).then_some(metric)
    }

    /// The best candidate so far that was fitted to derivatives.
    fn best_with_slopes(&mut self) -> Option<(KernelSpec, Metric, f64)> {
        self.best_kernels(true).into_iter().next()
    }

    /// The best fit to derivatives again, without those of states where they are far from what the others predict.
    fn without_outliers(&mut self) {
        let Some((spec, metric, smoothing)) = self.best_with_slopes() else { return };
        let Ok(all) = fit(&self.samples, spec, metric, smoothing) else { return };
        let outputs = self.samples.outputs;
        let size = |j: usize| {
            all.slope_residuals[j * outputs..(j + 1) * outputs].iter().map(|e| e * e).sum::<f64>().sqrt()
        };
        let sizes: Vec<f64> = (0..self.samples.slopes.len()).map(size).collect();
        let mut sorted = sizes.clone();
        sorted.sort_by(f64::total_cmp);
        let limit = OUTLIER * sorted[sorted.len() / 2];
        let worst = |slope: &Slope| {
            let own = self.samples.slopes.iter().zip(&sizes).filter(|(s, _)| s.centre == slope.centre);
            own.map(|(_, size)| *size).fold(0.0, f64::max)
        };
        let kept: Vec<usize> =
            (0..sizes.len()).filter(|j| worst(&self.samples.slopes[*j]) <= limit).collect();
        if kept.len() == sizes.len() || kept.is_empty() {
            return;
        }
        let slopes: Vec<Slope> = kept.iter().map(|&j| self.samples.slopes[j]).collect();
        let row = |&j: &usize| self.samples.slope_values[j * outputs..(j + 1) * outputs].to_vec();
        let values: Vec<f64> = kept.iter().flat_map(row).collect();
        let samples = Samples { slopes: &slopes, slope_values: &values, ..self.samples.clone() };
        self.attempt_on(&samples, spec, metric, smoothing);
    }

    /// Best first; refused ones last.
    fn sort(&mut self) {
        let score = |t: &Trial| {
            t.row.error.map_or(f64::INFINITY, |error| merit(error, t.row.smoothing, t.is_unsound))
        };
        self.trials.sort_by(|a, b| score(a).total_cmp(&score(b)));
    }

    /// Sheared and stretched metrics around the best few kernels.
    fn refine(&mut self, shears: &[f64]) {
        for (spec, metric, smoothing) in self.best_kernels(false) {
            for shear in shears.iter().copied().filter(|s| *s != metric.shear) {
                sheared(metric, shear).into_iter().for_each(|other| self.attempt(spec, other, smoothing));
            }
        }
    }

    /// Metrics stretched along one input around the best few kernels.
    fn stretch(&mut self, input: usize, factors: &[f64]) {
        for (spec, metric, smoothing) in self.best_kernels(false) {
            for factor in factors.iter().map(|f| f * metric.scale[input]) {
                self.attempt(spec, metric.stretched(input, factor), smoothing);
            }
        }
    }

    /// The best few kernels, each with its best metric and smoothing so far; with derivatives or of all.
    fn best_kernels(&mut self, with_slopes: bool) -> Vec<(KernelSpec, Metric, f64)> {
        self.sort();
        let mut best: Vec<(KernelSpec, Metric, f64)> = Vec::new();
        let fitted = |t: &&Trial| t.row.error.is_some() && (t.with_slopes || !with_slopes);
        for trial in self.trials.iter().filter(fitted) {
            if best.len() < REFINED && best.iter().all(|s| s.0 != trial.spec) {
                best.push((trial.spec, trial.row.metric, trial.row.smoothing));
            }
        }
        best
    }

    fn choices(mut self) -> Result<Vec<Choice>, FitError> {
        self.sort();
        let Best { scored, mut fit, .. } = self.best.ok_or(self.refusal)?;
        if fit.interpolant.slopes.is_empty() {
            (self.samples.slopes, self.samples.slope_values) = (&[], &[]);
        }
        fit.interpolant.condition = condition_of(&fit.interpolant, self.states.exact);
        let axes = self.states.operating..self.states.dimensions;
        let idle: Vec<usize> =
            axes.filter(|axis| idle(&self.samples, self.states, self.tasks, &fit, *axis)).collect();
        let mut first = 0;
        let choice = |(g, task): (usize, &Task)| {
            let (modes, error) = scored.groups[g];
            let kept = first..first + modes;
            first += task.outputs;
            let candidates =
                self.trials.iter().map(|t| Candidate { modes: t.modes[g], ..t.row.clone() }).collect();
            Choice { fit: keep_outputs(&fit, kept), modes, error, candidates, idle: idle.clone() }
        };
        Ok(self.tasks.iter().enumerate().map(choice).collect())
    }
}

/// Candidates with another shear, at each of the stretches along the second input.
fn sheared(metric: Metric, shear: f64) -> [Metric; STRETCHES.len()] {
    STRETCHES.map(|stretch| Metric { shear, ..metric.stretched(1, metric.scale[1] * stretch) })
}

/// All groups' coefficients of a state in one row: one factorisation serves all.
fn side_by_side(tasks: &[Task], rows: usize, values: impl Fn(&Task) -> &[f64]) -> Vec<f64> {
    let mut all = Vec::new();
    for i in 0..rows {
        tasks
            .iter()
            .for_each(|task| all.extend_from_slice(&values(task)[i * task.outputs..(i + 1) * task.outputs]));
    }
    all
}

/// Metric and smoothing variants that every kernel is tried with first.
fn variants(dimensions: usize, operating: usize, config: &RegimeConfig) -> Vec<(Metric, f64)> {
    let factors = if operating > 1 { config.anisotropy.as_slice() } else { &[1.0] };
    let start = (operating..dimensions).fold(Metric::IDENTITY, |m, i| m.stretched(i, PARAMETER_SCALE));
    let metric = |f: f64| if operating > 1 { start.stretched(1, f) } else { start };
    factors.iter().flat_map(|f| config.smoothing.iter().map(move |s| (metric(*f), *s))).collect()
}

/// Relative rounding error of snapshots, which are f32.
const DATA_ROUNDING: f64 = 6e-8;

/// Mean over the scored cases of the weighted norm of all groups' coefficients.
fn size(states: States, tasks: &[Task]) -> f64 {
    let square = |i: usize| tasks.iter().map(|t| t.square(i)).sum::<f64>();
    let scored = states.score.iter().enumerate().filter(|(_, w)| **w > 0.0);
    let (sum, count) = scored.fold((0.0, 0.0), |(s, n), (i, w)| (s + w * square(i).sqrt(), n + 1.0));
    if count > 0.0 { sum / count } else { 0.0 }
}

/// Modes to keep by group, and the scores with them.
fn score(states: States, tasks: &[Task], residuals: &[f64]) -> CandidateScore {
    let stride: usize = tasks.iter().map(|t| t.outputs).sum();
    let mut first = 0;
    let case_errors_of = |task: &Task| {
        let errors = case_errors(states, task, &|i, k| residuals[i * stride + first + k]);
        first += task.outputs;
        errors
    };
    let errors: Vec<Vec<Vec<f64>>> = tasks.iter().map(case_errors_of).collect();
    let levels: Vec<Vec<f64>> =
        tasks.iter().zip(&errors).map(|(task, errors)| levels(task, errors)).collect();
    let square = mean(&levels, |levels| least(levels).powi(2));
    let mut squares = vec![0.0; states.score.iter().filter(|w| **w > 0.0).count()];
    let mut groups = Vec::new();
    for ((task, errors), levels) in tasks.iter().zip(&errors).zip(&levels) {
        let modes = modes_to_keep(task, errors.len(), levels, square).max(task.leading);
        squares.iter_mut().zip(errors).for_each(|(s, e)| *s += e[modes] * e[modes]);
        groups.push((modes, mean(errors, |e| e[modes])));
    }
    let geometric = !states.slopes.is_empty() && states.dimensions > 1 && stride > 1;
    CandidateScore { score: over_cases(&squares, geometric), groups }
}

/// Mean over the cases of the roots of `squares`, arithmetic or geometric. Where derivatives are fitted over several inputs it is
/// geometric, as for the number of modes: without a state and its derivatives the next known ones are twice as far as from any
/// state asked for, and at the edge and along kinks that costs so much that a sum would be of these few cases. Of a single output
/// it is arithmetic: its error has a sign, and is close to 0 by chance in some cases.
fn over_cases(squares: &[f64], geometric: bool) -> f64 {
    if geometric { geometric_mean(squares, |s| s.sqrt()) } else { mean(squares, |s| s.sqrt()) }
}

/// `square` is the mean square of the least level of all groups that are chosen together. What may be left out is the same for each of
/// them: of an axis along which hardly anything moves it is a larger share of its own error, since what counts is the length.
fn modes_to_keep(task: &Task, cases: usize, levels: &[f64], square: f64) -> usize {
    match task.modes {
        ModeChoice::Fixed(modes) => modes.min(task.outputs),
        ModeChoice::Energy(_) => task.modes_for_energy.min(task.outputs),
        ModeChoice::LeaveOneOut(_) if cases < MIN_CASES => task.outputs,
        ModeChoice::LeaveOneOut(factor) => {
            let limit = (least(levels).powi(2) + (factor * factor - 1.0) * square).sqrt();
            levels.iter().position(|level| *level <= limit).unwrap_or(task.outputs)
        }
    }
}

fn least(levels: &[f64]) -> f64 {
    levels.iter().copied().fold(f64::INFINITY, f64::min)
}

/// Error with 0, 1, ... all modes. Geometric mean over cases: every case asks for the modes it needs at its own level of error.
/// An arithmetic one would stop at the error of the few cases that are hard to interpolate.
fn levels(task: &Task, errors: &[Vec<f64>]) -> Vec<f64> {
    (0..=task.outputs).map(|l| geometric_mean(errors, |e| e[l])).collect()
}

fn mean<T>(cases: &[T], value: impl Fn(&T) -> f64) -> f64 {
    cases.iter().map(value).sum::<f64>() / cases.len() as f64
}

/// An error is at least the rounding of the largest: a state without one (that in the middle, of 0 modes) would make all others 0.
fn geometric_mean<T>(cases: &[T], value: impl Fn(&T) -> f64) -> f64 {
    let least = DATA_ROUNDING * cases.iter().map(&value).fold(0.0, f64::max);
    mean(cases, |case| value(case).max(least).max(f64::MIN_POSITIVE).ln()).exp()
}

/// Weighted leave-one-out error with 0, 1, ... all modes, per scored case. `residual(state, mode)`.
fn case_errors(states: States, task: &Task, residual: &dyn Fn(usize, usize) -> f64) -> Vec<Vec<f64>> {
    let outputs = task.outputs;
    let scored = states.score.iter().enumerate().filter(|(_, w)| **w > 0.0);
    let errors_of_state = |(i, weight): (usize, &f64)| {
        let data = &task.values[i * outputs..(i + 1) * outputs];
        // Sums from the far end: what a mode adds must not drown in what larger modes hold.
        let mut left_out: Vec<f64> = vec![task.dropped[i]; outputs + 1];
        for k in (0..outputs).rev() {
            left_out[k] = left_out[k + 1] + data[k] * data[k];
        }
        let mut kept = 0.0;
        let mut errors = vec![weight * left_out[0].sqrt()];
        for k in 0..outputs {
            kept += residual(i, k).powi(2);
            errors.push(weight * (kept + left_out[k + 1]).sqrt());
        }
        errors
    };
    scored.map(errors_of_state).collect()
}

/// The fit of some of the outputs.
fn keep_outputs(fit: &Fit, kept: Range<usize>) -> Fit {
    let outputs = fit.interpolant.outputs;
    let cut = |values: &[f64]| -> Vec<f64> {
        if outputs == 0 {
            return Vec::new();
        }
        values.chunks_exact(outputs).flat_map(|row| row[kept.clone()].to_vec()).collect()
    };
    let interpolant = Interpolant {
        weights: cut(&fit.interpolant.weights),
        tail_weights: cut(&fit.interpolant.tail_weights),
        outputs: kept.len(),
        ..fit.interpolant.clone()
    };
    Fit { interpolant, residuals: cut(&fit.residuals), slope_residuals: Vec::new() }
}
