//! Fit of constants to a whole recording: robust least squares with priors.
//!
//! The fit minimises over the unknowns `x` and the noise `e` of each reading's measured inputs
//!
//! ```text
//! (x - x0)^T P0^-1 (x - x0) + sum over readings of (sum e^2 / sigma^2 + sum over blocks of rho(|z - h(x, e)|^2 w))
//! ```
//!
//! with Huber's `rho`. The noise is eliminated reading by reading (Schur complement), so a step costs `O(readings)`; steps are
//! damped after Levenberg and Marquardt.

use crate::filter::Filter;
use crate::identify;
use crate::matrix::{MAX_STATES, Symmetric, Vector, chi_squared_quantile, eliminate, noise_step};
use crate::reading::{Linear, Prior, ReadingProblem, Side, difference};
use crate::setup::{Alarm, Estimate, MAX_ROWS, Measurement, Model, Setup, SetupError, Status};
use crate::watch::{Pattern, widened};

/// Steps after which the fit counts as not converged.
const MAX_STEPS: usize = 60;
/// Step length, in standard deviations, below which the fit ends.
const SMALL_STEP: f64 = 1e-3;
/// Newton steps for the noise of one reading at given unknowns.
const NOISE_STEPS: usize = 6;
/// Dampings tried in a row before the fit stops.
const MAX_DAMPINGS: usize = 12;
/// Residuals beyond this normal quantile count linearly (Huber).
const HUBER_Z: f64 = 2.0;

/// Blocks beyond this normal quantile are counted as outliers.
const OUTLIER_Z: f64 = 3.719;

/// Constants that explain a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Estimates in the order of the unknowns. The standard deviations contain the effect of memory of the plant as far as the recording
    /// does not exclude it.
    pub estimates: Vec<Estimate>,
    /// Covariance of their errors, without memory.
    pub covariance: Symmetric,
    /// True if the steps became small; otherwise the values are NaN.
    pub converged: bool,
    /// Squares of residuals and noise over their variances, without outliers, divided by the values used minus the unknowns; about 1
    /// if the standard deviations of model and sensors are right.
    pub chi2_per_dof: f64,
    pub used: usize,
    /// Measured values of blocks that contradict the fit.
    pub outliers: usize,
    /// Readings left out because of a missing input or a prediction that is not finite.
    pub skipped: usize,
    /// Alarm that most of the second half of a motion's readings have raised.
    pub alarm: Option<Alarm>,
}

impl Fit {
    /// Correlation of two unknowns' errors.
    pub fn correlation(&self, a: usize, b: usize) -> f64 {
        self.covariance.correlation(a, b)
    }
}

/// Fits the unknowns of a setup, as constants, to a recording. The filter's result is the start; with a motion, whose noise
/// is not that of single readings, it is the fit.
///
/// Cost: some ten to sixty evaluations of the model for each reading.
///
/// # Errors
/// All errors in the setup.
pub fn fit(setup: &Setup, readings: &[Measurement], model: &mut impl Model) -> Result<Fit, Vec<SetupError>> {
    let setup = &setup.clone().without_drift();
    let mut filter = Filter::new(setup.clone())?;
    if setup.swing.is_some() {
        return Ok(of_motion(&mut filter, readings, model));
    }
    readings.iter().for_each(|reading| {
        filter.update(reading, model);
    });
    let mut start = [0.0; MAX_STATES];
    for ((x, estimate), unknown) in start.iter_mut().zip(filter.estimates()).zip(&setup.unknowns) {
        *x = estimate.value.clamp(unknown.range[0], unknown.range[1]);
    }
    let mut batch = Batch::new(setup, readings);
    Ok(batch.minimise(start, model))
}

/// The filter's result after all readings of a motion.
fn of_motion(filter: &mut Filter, readings: &[Measurement], model: &mut impl Model) -> Fit {
    let (mut used, mut outliers, mut skipped, mut chi2) = (0, 0, 0, 0.0);
    let (mut alarm, mut alarms) = (None, 0);
    for (index, reading) in readings.iter().enumerate() {
        let update = filter.update(reading, model);
        let rows = filter.setup().rows.iter().zip(&reading.rows);
        outliers +=
            rows.filter(|(row, value)| value.is_finite() && update.rejected & (1 << row.block) != 0).count();
        if update.status == Status::Used {
            (used, chi2) = (used + update.used, chi2 + update.nis);
        } else {
            skipped += 1;
        }
        if update.alarm.is_some() && 2 * index >= readings.len() {
            (alarm, alarms) = (update.alarm, alarms + 1);
        }
    }
    Fit {
        estimates: filter.estimates().collect(),
        covariance: *filter.covariance(),
        converged: used > 0,
        chi2_per_dof: chi2 / used.max(1) as f64,
        used,
        outliers,
        skipped,
        alarm: alarm.filter(|_| 4 * alarms > readings.len()),
    }
}

struct Batch<'a> {
    setup: &'a Setup,
    readings: Vec<Measurement>,
    skipped: usize,
    /// Noise of the measured inputs per reading, from entry 0 on.
    noise: Vec<Vector>,
    /// Weight per row in the cost: inverse variance with the model's variance multiplied by the number of readings with the same error.
    shared_weights: [f64; MAX_ROWS],
    /// Inverse variance per row of a single reading.
    weights: [f64; MAX_ROWS],
}

/// Normal equations of all readings at a point.
struct Sums {
    matrix: Symmetric,
    right: Vector,
    cost: f64,
    chi2: f64,
    used: usize,
    outliers: usize,
    /// Readings without a finite prediction.
    failed: usize,
    /// Best noise per reading.
    noise: Vec<Vector>,
}

impl<'a> Batch<'a> {
    fn new(setup: &'a Setup, readings: &[Measurement]) -> Self {
        let kept: Vec<Measurement> = readings.iter().filter(|r| setup.is_complete(r)).copied().collect();
        let length_s = kept.last().zip(kept.first()).map_or(0.0, |(last, first)| last.t_s - first.t_s);
        let spacing_s = length_s / kept.len().max(2) as f64;
        let shared = if spacing_s > 0.0 { (setup.model_correlation_s / spacing_s).max(1.0) } else { 1.0 };
        let (mut shared_weights, mut weights) = ([0.0; MAX_ROWS], [0.0; MAX_ROWS]);
        for (i, row) in setup.rows.iter().enumerate() {
            shared_weights[i] = 1.0 / row.variance(shared.min(kept.len() as f64));
            weights[i] = 1.0 / row.variance(1.0);
        }
        let (skipped, noise) = (readings.len() - kept.len(), vec![[0.0; MAX_STATES]; kept.len()]);
        Self { setup, readings: kept, skipped, noise, shared_weights, weights }
    }

    fn unknowns(&self) -> usize {
        self.setup.unknowns.len()
    }

    fn prior(&self) -> (Vector, Symmetric) {
        (self.setup.priors().0, self.setup.prior_information())
    }

    fn minimise(&mut self, start: Vector, model: &mut impl Model) -> Fit {
        let mut x = start;
        let mut sums = self.sums(&x, model);
        let (mut damping, mut converged) = (1e-3, false);
        'steps: for _ in 0..MAX_STEPS {
            for _ in 0..MAX_DAMPINGS {
                let Some(step) = damped_step(&sums, damping) else { break 'steps };
                let mut trial = x;
                trial.iter_mut().zip(&step).for_each(|(x, s)| *x += s);
                for (x, unknown) in trial.iter_mut().zip(&self.setup.unknowns) {
                    *x = x.clamp(unknown.range[0], unknown.range[1]);
                }
                let before = std::mem::replace(&mut self.noise, sums.noise.clone());
                let there = self.sums(&trial, model);
                if there.failed <= sums.failed && there.cost <= sums.cost * (1.0 + 1e-12) {
                    let moved = difference(&trial, &x);
                    let length: f64 = moved.iter().zip(sums.matrix.times(&moved)).map(|(a, b)| a * b).sum();
                    (x, sums) = (trial, there);
                    damping = (damping * 0.1).max(1e-12);
                    if length < SMALL_STEP * SMALL_STEP {
                        converged = true;
                        break 'steps;
                    }
                    continue 'steps;
                }
                self.noise = before;
                damping = if damping < 1e-9 { 1e-6 } else { damping * 10.0 };
            }
            // No damped step reduces the sum: it is a minimum if an undamped step would be small.
            let undamped = damped_step(&sums, 0.0);
            converged = undamped.is_some_and(|step| {
                step.iter().zip(&sums.right).map(|(s, r)| s * r).sum::<f64>()
                    < 100.0 * SMALL_STEP * SMALL_STEP
            });
            break;
        }
        let memory = self.memory(&x, &sums, model);
        self.result(&x, &sums, &memory, converged)
    }

    fn result(&self, x: &Vector, sums: &Sums, memory: &[Pattern], converged: bool) -> Fit {
        let count = self.unknowns();
        let unread = self.setup.priors().1;
        let factor = sums.matrix.cholesky();
        let covariance = factor.map_or(Symmetric::diagonal(&unread[..count]), |factor| factor.inverse());
        let identifiability = identify::judge(&covariance, &unread);
        let estimate = |index: usize| {
            let (alone, prior) = (covariance.get(index, index).sqrt(), unread[index].sqrt());
            let sigma = widened(memory, index, alone, prior, x[index] - self.setup.unknowns[index].prior);
            let is_told =
                identifiability.is_identifiable(index) && sigma <= identify::MAX_SIGMA_RATIO * prior;
            let value = if converged { x[index] } else { f64::NAN };
            Estimate { value, sigma, identifiable: converged && is_told }
        };
        Fit {
            estimates: (0..count).map(estimate).collect(),
            covariance,
            converged,
            chi2_per_dof: sums.chi2 / sums.used.saturating_sub(count).max(1) as f64,
            used: sums.used,
            outliers: sums.outliers,
            skipped: self.skipped + sums.failed,
            alarm: None,
        }
    }

    /// Normal equations of the unknowns at a point, with the noise of each reading eliminated.
    fn sums(&self, x: &Vector, model: &mut impl Model) -> Sums {
        let count = self.unknowns();
        let (mean, information) = self.prior();
        let from_prior = difference(&mean, x);
        let right = information.times(&from_prior);
        let cost = from_prior.iter().zip(&right).map(|(a, b)| a * b).sum();
        let noise = self.noise.clone();
        let mut sums =
            Sums { matrix: information, right, cost, chi2: 0.0, used: 0, outliers: 0, failed: 0, noise };
        for (index, reading) in self.readings.iter().enumerate() {
            let mut states = *x;
            states[count..].copy_from_slice(&self.noise[index][..MAX_STATES - count]);
            if self.add_reading(reading, index, &states, &mut sums, model).is_none() {
                sums.failed += 1;
            }
        }
        sums
    }

    /// Prior of the noise of a reading at these states, and the weights of its values.
    fn of_reading(&self, reading: &Measurement, states: &Vector) -> (Prior, [f64; MAX_ROWS]) {
        let count = self.unknowns();
        let (noise, measured) = self.setup.noise_information();
        // The unknowns' prior is counted once, not with each reading.
        let information = Symmetric::diagonal(&[0.0; MAX_STATES][..count]).extended(&noise[..measured]);
        let mut prior = Prior { states: *states, information };
        prior.states[count..].fill(0.0);
        let mut weights = [0.0; MAX_ROWS];
        for (i, value) in reading.rows.iter().enumerate().take(self.setup.rows.len()) {
            weights[i] = if value.is_finite() { self.shared_weights[i] } else { 0.0 };
        }
        (prior, weights)
    }

    fn problem<'p>(
        &'p self,
        measurement: &'p Measurement,
        prior: &'p Prior,
        weights: [f64; MAX_ROWS],
    ) -> ReadingProblem<'p> {
        ReadingProblem { setup: self.setup, measurement, prior, side: Side::Any, weights }
    }

    fn add_reading(
        &self,
        reading: &Measurement,
        at: usize,
        states: &Vector,
        sums: &mut Sums,
        model: &mut impl Model,
    ) -> Option<()> {
        let count = self.unknowns();
        let (noise, measured) = self.setup.noise_information();
        let size = count + measured;
        let (prior, weights) = self.of_reading(reading, states);
        let problem = self.problem(reading, &prior, weights);
        let mut states = *states;
        for _ in 0..NOISE_STEPS {
            let linear = problem.linearise(&states, model)?;
            let (robust, _) = self.robust(&linear, &weights);
            let (matrix, right) = problem.equations(&states, &linear, &robust);
            let step = noise_step(&matrix, &right, count)?;
            let mut length = 0.0;
            for ((e, step), weight) in states[count..size].iter_mut().zip(step).zip(noise) {
                *e += step;
                length += step * step * weight;
            }
            if length < SMALL_STEP * SMALL_STEP {
                break;
            }
        }
        let linear = problem.linearise(&states, model)?;
        let (robust, terms) = self.robust(&linear, &weights);
        let (matrix, right) = problem.equations(&states, &linear, &robust);
        let squares = noise.iter().zip(&states[count..size]).map(|(w, e)| w * e * e);
        let of_noise: f64 = squares.sum();
        sums.cost += of_noise + terms.cost;
        sums.chi2 += of_noise + terms.chi2;
        sums.used += terms.used;
        sums.outliers += terms.outliers;
        sums.noise[at][..size - count].copy_from_slice(&states[count..size]);
        eliminate(&matrix, &right, count, &mut sums.matrix, &mut sums.right)
    }

    /// Kinds of memory: their effect on the unknowns, and their amplitude in the noise of the first measured input.
    fn memory(&self, x: &Vector, sums: &Sums, model: &mut impl Model) -> [Pattern; 2] {
        let mut patterns = Pattern::all(f64::INFINITY);
        let (first, factor) = (self.setup.measured_inputs().next(), sums.matrix.cholesky());
        let (Some((input, sigma)), Some(factor)) = (first, factor) else { return patterns };
        let count = self.unknowns();
        let (mut matrix, mut rights, mut differences) = (sums.matrix, [[0.0; MAX_STATES]; 2], Vec::new());
        for (index, reading) in self.readings.iter().enumerate() {
            patterns
                .iter_mut()
                .for_each(|pattern| pattern.advance(reading.t_s, reading.inputs[input], sigma));
            differences.push(patterns.each_ref().map(Pattern::difference));
            let Some(solved) = self.solved(index, x, sums, model) else { continue };
            let (of_reading, _) = self.equations(index, &solved, &solved.robust);
            for (pattern, to_right) in patterns.iter().zip(&mut rights) {
                let none = [0.0; MAX_STATES];
                let unit = solved.linear.of_memory(count, pattern.difference(), &none);
                let right = solved.linear.right_of(&solved.robust, &unit);
                eliminate(&of_reading, &right, count, &mut matrix, to_right);
            }
        }
        for (pattern, right) in patterns.iter_mut().zip(&rights) {
            pattern.move_by(&factor.solve(right)[..count]);
        }
        for (index, differences) in differences.iter().enumerate() {
            let Some(solved) = self.solved(index, x, sums, model) else { continue };
            let (of_reading, right) = self.equations(index, &solved, &solved.alone);
            let Some(step) = noise_step(&of_reading, &right, count) else { continue };
            for (pattern, difference) in patterns.iter_mut().zip(differences) {
                let unit = solved.linear.of_memory(count, *difference, pattern.sensitivity());
                let right = solved.linear.right_of(&solved.alone, &unit);
                if let Some(of_unit) = noise_step(&of_reading, &right, count) {
                    let [noise, of_unit] = [solved.states[count] + step[0], of_unit[0]].map(|e| e / sigma);
                    pattern.compare(noise * of_unit, of_unit * of_unit);
                }
            }
        }
        patterns
    }

    /// A reading at the solution.
    fn solved(&self, at: usize, x: &Vector, sums: &Sums, model: &mut impl Model) -> Option<ReadingSolution> {
        let (reading, count) = (&self.readings[at], self.unknowns());
        let mut states = *x;
        states[count..].copy_from_slice(&sums.noise[at][..MAX_STATES - count]);
        let (prior, weights) = self.of_reading(reading, &states);
        let linear = self.problem(reading, &prior, weights).linearise(&states, model)?;
        let (robust, _) = self.robust(&linear, &weights);
        let mut alone = self.weights;
        for (alone, (robust, shared)) in alone.iter_mut().zip(robust.iter().zip(&self.shared_weights)) {
            *alone *= if *shared > 0.0 { robust / shared } else { 0.0 };
        }
        Some(ReadingSolution { states, prior, linear, robust, alone })
    }

    fn equations(
        &self,
        at: usize,
        solved: &ReadingSolution,
        weights: &[f64; MAX_ROWS],
    ) -> (Symmetric, Vector) {
        let problem = self.problem(&self.readings[at], &solved.prior, *weights);
        problem.equations(&solved.states, &solved.linear, weights)
    }

    /// Huber weights per row, with cost and counts.
    fn robust(&self, linear: &Linear, weights: &[f64; MAX_ROWS]) -> ([f64; MAX_ROWS], Terms) {
        let (mut out, mut terms) = (*weights, Terms::default());
        let blocks = self.setup.rows.last().map_or(0, |row| row.block + 1);
        for block in 0..blocks {
            let rows = || {
                let of_block = self.setup.rows.iter().enumerate().filter(move |(_, row)| row.block == block);
                of_block.map(|(i, _)| i).filter(|i| weights[*i] > 0.0)
            };
            let squares = |weights: &[f64; MAX_ROWS]| -> f64 {
                rows().map(|i| weights[i] * linear.residual[i] * linear.residual[i]).sum()
            };
            let (degrees, sum, plain) =
                (rows().count(), squares(&self.shared_weights), squares(&self.weights));
            let limit = chi_squared_quantile(degrees, HUBER_Z);
            // Beyond the limit the cost grows linearly with the residual; the weight falls with it.
            let factor = if plain > limit { (limit / plain).sqrt() } else { 1.0 };
            terms.cost += sum * (2.0 * factor - factor * factor);
            if plain > chi_squared_quantile(degrees, OUTLIER_Z) {
                terms.outliers += degrees;
            } else {
                terms.chi2 += plain;
                terms.used += degrees;
            }
            rows().for_each(|i| out[i] *= factor);
        }
        (out, terms)
    }
}

/// A reading at the solution of the fit.
struct ReadingSolution {
    states: Vector,
    prior: Prior,
    linear: Linear,
    /// Robust weights, with the model's error shared by all readings.
    robust: [f64; MAX_ROWS],
    /// The same for the reading alone.
    alone: [f64; MAX_ROWS],
}

/// Contribution of one reading's measured values.
#[derive(Clone, Copy, Debug, Default)]
struct Terms {
    cost: f64,
    chi2: f64,
    used: usize,
    outliers: usize,
}

fn damped_step(sums: &Sums, damping: f64) -> Option<Vector> {
    let mut matrix = sums.matrix;
    for i in 0..matrix.size() {
        matrix.add_diagonal(i, damping * sums.matrix.get(i, i));
    }
    Some(matrix.cholesky()?.solve(&sums.right))
}
