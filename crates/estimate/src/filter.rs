//! The filter: an iterated extended Kalman filter over readings.

use crate::identify::{self, Identifiability};
use crate::matrix::{MAX_STATES, Symmetric, Vector};
use crate::normal::{chi_squared_quantile, truncated, upper_tail};
use crate::outcome::{Alarm, Estimate, Status, Update};
use crate::reading::{self, Linear, Prior, ReadingProblem, Side, Solution};
use crate::setup::{InputRole, MAX_INPUTS, MAX_ROWS, Measurement, Model, Setup, SetupError};
use crate::watch::Watch;

/// A block whose residual is that unlikely (one-sided normal quantile of 1e-4) is rejected.
const GATE_Z: f64 = 3.719;
/// Quantiles of the normal distribution around 95 % of its mass.
const BAND_Z: f64 = 1.959_964;
/// Contact begins at one of very many readings: by so much its evidence (twice the logarithm of the odds) must exceed that
/// against it while the gap is not known, for a false beginning would fix the gap at a wrong value.
const FIRST_CONTACT_EVIDENCE: f64 = 25.0;
/// A known gap that many standard deviations from the onset needs one side solved only.
const CLEAR: f64 = 6.0;
/// How far inside the contact the search begins when the prior lies outside (mm).
const INSIDE_CONTACT_MM: f64 = 0.5;

/// The filter's memory.
#[derive(Clone, Debug)]
pub struct Filter {
    setup: Setup,
    mean: Vector,
    covariance: Symmetric,
    /// Variances that the unknowns would have without any reading.
    unread: Vector,
    last_t_s: Option<f64>,
    /// Time between the last two readings (s).
    spacing_s: f64,
    /// Largest gap that readings without contact have excluded (mm).
    gap_floor_mm: f64,
    /// Evidence for a contact from readings in a row that only a contact explains whole.
    toward_contact: f64,
    identifiability: Identifiability,
    watch: Watch,
    alarm: Option<Alarm>,
}

impl Filter {
    /// Starts from what is known before any reading.
    ///
    /// # Errors
    /// All that is wrong with the setup.
    pub fn new(setup: Setup) -> Result<Self, Vec<SetupError>> {
        setup.check()?;
        let (mean, unread) = setup.priors();
        let covariance = Symmetric::diagonal(&unread[..setup.unknowns.len()]);
        Ok(Self {
            identifiability: Identifiability::default(),
            watch: Watch::default(),
            alarm: None,
            last_t_s: None,
            spacing_s: f64::INFINITY,
            gap_floor_mm: f64::NEG_INFINITY,
            toward_contact: 0.0,
            setup,
            mean,
            covariance,
            unread,
        })
    }

    /// What it was started with.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// Estimates in the order of the unknowns.
    pub fn estimates(&self) -> impl Iterator<Item = Estimate> {
        let gap = self.setup.gap_unknown();
        (0..self.setup.unknowns.len()).map(move |at| {
            let (mut value, mut sigma) = (self.mean[at], self.covariance.get(at, at).sqrt());
            if gap == Some(at) {
                (value, sigma) = truncated(value, sigma, self.gap_floor_mm);
            }
            Estimate { value, sigma, identifiable: self.identifiability.tells(at) }
        })
    }

    /// Correlation of two unknowns' errors.
    pub fn correlation(&self, a: usize, b: usize) -> f64 {
        self.covariance.correlation(a, b)
    }

    /// Standard deviation of a quantity with these derivatives by the model inputs, from the errors of the unknowns and the
    /// noise of the measured inputs.
    pub fn sigma_of(&self, by_input: &[f64; MAX_INPUTS]) -> f64 {
        let (mut by_unknown, mut variance) = ([0.0; MAX_STATES], 0.0);
        for (role, derivative) in self.setup.inputs.iter().zip(by_input) {
            match *role {
                InputRole::Given(_) => {}
                InputRole::Estimated(unknown) => by_unknown[unknown] += derivative,
                InputRole::Measured { sigma, bias } => {
                    variance += derivative * derivative * sigma * sigma;
                    if let Some(bias) = bias {
                        by_unknown[bias] -= derivative;
                    }
                }
            }
        }
        let spread = self.covariance.times(&by_unknown);
        variance += by_unknown.iter().zip(spread).map(|(a, b)| a * b).sum::<f64>();
        variance.max(0.0).sqrt()
    }

    /// Takes a reading into account. Allocates nothing.
    ///
    /// Cost: some 3 to 8 evaluations of the model, each with `O(rows x states^2)` operations beside it.
    pub fn update(&mut self, measurement: &Measurement, model: &mut impl Model) -> Update {
        if let Err(status) = self.advance(measurement) {
            return self.unchanged(status, measurement);
        }
        let Some(prior) = self.prior() else { return self.unchanged(Status::NotConverged, measurement) };
        let explained = self.best(measurement, &prior, model);
        let most = self.most_rejected(measurement);
        let mut update = match &explained {
            Some(explained) if explained.rejected.count_ones() > most => {
                let rejected = explained.rejected;
                Update { rejected, ..self.unchanged(Status::NotExplained, measurement) }
            }
            Some(explained) => self.accept(measurement, &prior, explained, model),
            None => self.unchanged(Status::NotConverged, measurement),
        };
        let solved = explained.filter(|_| update.status == Status::Used);
        let noise = solved.as_ref().map(|solved| &solved.solution.states[self.setup.unknowns.len()..]);
        let mut watch = std::mem::take(&mut self.watch);
        watch.add(&self.setup, measurement, &update, noise);
        let unread = self.unread.map(f64::sqrt);
        update.alarm = watch.judge(&self.setup, self.estimates().zip(unread));
        self.alarm = update.alarm;
        self.watch = watch;
        update
    }

    /// Lets the unknowns drift up to the reading's time.
    fn advance(&mut self, measurement: &Measurement) -> Result<(), Status> {
        if !self.setup.is_complete(measurement) {
            return Err(Status::InputMissing);
        }
        let passed_s = measurement.t_s - self.last_t_s.unwrap_or(measurement.t_s);
        let is_later = self.last_t_s.is_none_or(|last| measurement.t_s > last);
        if !is_later || !measurement.t_s.is_finite() {
            return Err(Status::NotLater);
        }
        if self.last_t_s.is_some() {
            self.spacing_s = passed_s;
        }
        self.last_t_s = Some(measurement.t_s);
        for (at, unknown) in self.setup.unknowns.iter().enumerate() {
            let drift = unknown.drift_per_sqrt_s * unknown.drift_per_sqrt_s * passed_s;
            self.covariance.add_diagonal(at, drift);
            self.unread[at] += drift;
        }
        if let Some(gap) = self.setup.gap_unknown() {
            // A gap that drifts may come back below what was excluded.
            self.gap_floor_mm -= self.setup.unknowns[gap].drift_per_sqrt_s * passed_s.sqrt();
        }
        Ok(())
    }

    /// The states before a reading.
    fn prior(&self) -> Option<Prior> {
        let (noise, count) = self.setup.noise_information();
        let information = self.covariance.cholesky()?.inverse().extended(&noise[..count]);
        let mut states = self.mean;
        states[self.setup.unknowns.len()..].fill(0.0);
        Some(Prior { states, information })
    }

    fn problem<'a>(
        &'a self,
        measurement: &'a Measurement,
        prior: &'a Prior,
        rejected: u32,
        side: Side,
    ) -> ReadingProblem<'a> {
        let mut weights = [0.0; MAX_ROWS];
        for (i, row) in self.setup.rows.iter().enumerate() {
            let is_used = measurement.rows[i].is_finite() && rejected & (1 << row.block) == 0;
            if is_used {
                weights[i] = 1.0 / row.variance(1.0);
            }
        }
        ReadingProblem { setup: &self.setup, measurement, prior, side, weights }
    }

    /// Blocks that may be rejected of a reading: half of them. Where more contradict, the model does not explain it.
    fn most_rejected(&self, measurement: &Measurement) -> u32 {
        let rows = self.setup.rows.iter().zip(&measurement.rows).filter(|(_, value)| value.is_finite());
        let present = rows.fold(0_u32, |bits, (row, _)| bits | 1 << row.block);
        (present.count_ones() / 2).max(1)
    }

    /// Solves on one side, and again without the blocks that contradict the rest, as long as their number and what they cost are
    /// `worth` it.
    fn explain(
        &self,
        measurement: &Measurement,
        prior: &Prior,
        side: Side,
        start: Option<Vector>,
        worth: impl Fn(u32, f64) -> bool,
        model: &mut impl Model,
    ) -> Option<Explained> {
        let (mut rejected, mut penalty) = (0_u32, 0.0);
        let start = start.unwrap_or(prior.states);
        loop {
            let problem = self.problem(measurement, prior, rejected, side);
            let solution = problem.solve(&start, model);
            // A value so wild that nothing is found with it is one that contradicts the state from before.
            let linear = match &solution {
                Some(solution) => solution.linear,
                None => problem.linearise(&start, model)?,
            };
            match (self.worst_block(measurement, &linear, rejected), solution) {
                (Some((block, limit)), _) if rejected.count_ones() <= self.most_rejected(measurement) => {
                    rejected |= 1 << block;
                    penalty += limit;
                    if !worth(rejected.count_ones(), penalty) {
                        return None;
                    }
                }
                (_, solution) => {
                    let solution = solution?;
                    let evidence = evidence(&solution) + penalty;
                    return Some(Explained { side, evidence, solution, rejected });
                }
            }
        }
    }

    /// The likelier of no contact and contact where the gap is unknown; otherwise the model decides.
    fn best(
        &mut self,
        measurement: &Measurement,
        prior: &Prior,
        model: &mut impl Model,
    ) -> Option<Explained> {
        let Some(unknown) = self.setup.gap_unknown() else {
            return self.explain(measurement, prior, Side::Any, None, |_, _| true, model);
        };
        let open = |model: &mut _| self.explain(measurement, prior, Side::Free, None, |_, _| true, model);
        let before = self.setup.inputs_at(measurement, &prior.states);
        let Some(onset_mm) = model.onset_gap_mm(&before) else { return open(model) };
        let sigma = self.covariance.get(unknown, unknown).sqrt();
        let inside = (onset_mm - self.mean[unknown]) / sigma;
        let start = self.contact_start(prior, unknown, onset_mm);
        if self.identifiability.tells(unknown) && inside.abs() > CLEAR {
            let (likely, start) =
                if inside > 0.0 { (Side::Contact, Some(start)) } else { (Side::Free, None) };
            let explained = self.explain(measurement, prior, likely, start, |_, _| true, model);
            if explained.is_some_and(|explained| explained.rejected == 0) {
                return explained;
            }
        }
        let open = open(model);
        let beyond = upper_tail(inside).max(f64::MIN_POSITIVE);
        let needed = if self.identifiability.tells(unknown) { 0.0 } else { FIRST_CONTACT_EVIDENCE };
        // Squares are not negative, and a reading only makes the determinant larger: a contact that rejects no fewer blocks cannot
        // be likelier once these cost more than this.
        let before = prior.information.cholesky()?.ln_determinant();
        let spare = |open: &Explained| open.evidence - 2.0 * beyond.ln() - before - needed;
        let is_open = |open: &Explained, rejected: u32, penalty: f64| {
            rejected >= open.rejected.count_ones() && penalty > spare(open)
        };
        if let Some(open) = open.filter(|open| is_open(open, 0, 0.0)) {
            self.toward_contact = 0.0;
            return Some(open);
        }
        let worth = |rejected: u32, penalty: f64| open.is_none_or(|open| !is_open(&open, rejected, penalty));
        let touching = self.explain(measurement, prior, Side::Contact, Some(start), worth, model);
        match (open, touching) {
            (Some(open), Some(touching)) => {
                let toward = open.evidence - 2.0 * beyond.ln() - touching.evidence;
                // Rejection bounds what one reading can say; readings in a row say it together.
                let partly = open.rejected.count_ones() > touching.rejected.count_ones();
                self.toward_contact = if partly { self.toward_contact + toward.max(0.0) } else { 0.0 };
                Some(if toward.max(self.toward_contact) <= needed { open } else { touching })
            }
            (Some(open), None) => {
                self.toward_contact = 0.0;
                Some(open)
            }
            (None, touching) => touching,
        }
    }

    /// The prior, moved into the contact along its covariance when it lies outside.
    fn contact_start(&self, prior: &Prior, unknown: usize, onset_mm: f64) -> Vector {
        let mut start = prior.states;
        let shift = onset_mm - INSIDE_CONTACT_MM - start[unknown];
        if shift < 0.0 {
            let variance = self.covariance.get(unknown, unknown);
            for (at, (start, spec)) in start.iter_mut().zip(&self.setup.unknowns).enumerate() {
                *start += self.covariance.get(at, unknown) / variance * shift;
                *start = start.clamp(spec.range[0], spec.range[1]);
            }
            start[unknown] = onset_mm - INSIDE_CONTACT_MM;
        }
        start
    }

    /// The block whose residual contradicts the rest most, when one does, with the largest sum of squares it might have.
    fn worst_block(&self, measurement: &Measurement, linear: &Linear, rejected: u32) -> Option<(usize, f64)> {
        let mut worst = (1.0, None);
        let blocks = self.setup.rows.last().map_or(0, |row| row.block + 1);
        for block in (0..blocks).filter(|block| rejected & (1 << block) == 0) {
            let (mut sum, mut count) = (0.0, 0);
            for (i, row) in self.setup.rows.iter().enumerate().filter(|(_, row)| row.block == block) {
                if measurement.rows[i].is_finite() {
                    sum += linear.residual[i] * linear.residual[i] / row.variance(1.0);
                    count += 1;
                }
            }
            let limit = chi_squared_quantile(count.max(1), GATE_Z);
            if sum / limit > worst.0 {
                worst = (sum / limit, Some((block, limit)));
            }
        }
        worst.1
    }

    /// Makes the solution the estimate.
    fn accept(
        &mut self,
        measurement: &Measurement,
        prior: &Prior,
        explained: &Explained,
        model: &mut impl Model,
    ) -> Update {
        let Explained { side, rejected, ref solution, .. } = *explained;
        let problem = self.problem(measurement, prior, rejected, side);
        let used = problem.weights.iter().filter(|w| **w > 0.0).count();
        let nis = innovation(&problem, solution);
        // The model's error does not average out within its correlation time.
        let lasting = self.lasting_weights(&problem.weights);
        let Some((factor, right)) = problem.normal_equations(&solution.states, &solution.linear, &lasting)
        else {
            return self.unchanged(Status::NotConverged, measurement);
        };
        let step = factor.solve(&right);
        let mut states = solution.states;
        states.iter_mut().zip(&step).for_each(|(x, s)| *x += s);
        for (x, unknown) in states.iter_mut().zip(&self.setup.unknowns) {
            *x = x.clamp(unknown.range[0], unknown.range[1]);
        }
        let count = self.setup.unknowns.len();
        let inputs = self.setup.inputs_at(measurement, &states);
        self.covariance = factor.inverse().leading(count);
        self.mean[..count].copy_from_slice(&states[..count]);
        let in_contact = side == Side::Contact || (side == Side::Any && solution.linear.in_contact);
        if side == Side::Free && rejected == 0 {
            self.gap_floor_mm =
                self.gap_floor_mm.max(model.onset_gap_mm(&inputs).unwrap_or(f64::NEG_INFINITY));
        } else if in_contact {
            self.gap_floor_mm = f64::NEG_INFINITY;
        }
        self.identifiability = identify::judge(&self.covariance, &self.unread);
        let band = [-BAND_Z, BAND_Z].map(|z| chi_squared_quantile(used, z));
        Update { status: Status::Used, inputs, in_contact, used, rejected, nis, nis_band: band, alarm: None }
    }

    /// Weights by which a reading tells the unknowns: the model's error counts as often as readings share it.
    fn lasting_weights(&self, weights: &[f64; MAX_ROWS]) -> [f64; MAX_ROWS] {
        let mut out = *weights;
        let shared = (self.setup.model_correlation_s / self.spacing_s).max(1.0);
        for (i, row) in self.setup.rows.iter().enumerate().filter(|(i, _)| weights[*i] > 0.0) {
            out[i] = 1.0 / row.variance(shared);
        }
        out
    }

    fn unchanged(&self, status: Status, measurement: &Measurement) -> Update {
        let mut states = self.mean;
        states[self.setup.unknowns.len()..].fill(0.0);
        let inputs = self.setup.inputs_at(measurement, &states);
        Update {
            status,
            inputs,
            in_contact: false,
            used: 0,
            rejected: 0,
            nis: f64::NAN,
            nis_band: [f64::NAN; 2],
            alarm: self.alarm,
        }
    }
}

/// A reading with one side of the onset assumed.
#[derive(Clone, Copy, Debug)]
struct Explained {
    side: Side,
    solution: Solution,
    /// Blocks that contradict the rest.
    rejected: u32,
    /// Twice the negative logarithm of the evidence, but for a constant; less is likelier.
    evidence: f64,
}

/// By Laplace's approximation.
fn evidence(solution: &Solution) -> f64 {
    solution.cost + solution.factor.ln_determinant()
}

/// Innovation squared over its covariance, linearised at the solution: `v^T R^-1 v - b^T A^-1 b` with the innovation
/// `v = z - h(prior)`, which needs a factor of as many rows as there are states, not measurements.
fn innovation(problem: &ReadingProblem<'_>, solution: &Solution) -> f64 {
    let moved = reading::difference(&solution.states, &problem.prior.states);
    let (mut sum, mut right) = (0.0, [0.0; MAX_STATES]);
    for (i, weight) in problem.weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
        let row = &solution.linear.jacobian[i];
        let along: f64 = row.iter().zip(&moved).map(|(d, m)| d * m).sum();
        let innovation = solution.linear.residual[i] + along;
        sum += weight * innovation * innovation;
        right.iter_mut().zip(row).for_each(|(right, d)| *right += weight * innovation * d);
    }
    let explained = solution.factor.solve(&right);
    sum - right.iter().zip(&explained).map(|(a, b)| a * b).sum::<f64>()
}
