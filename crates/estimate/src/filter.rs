//! Iterated extended Kalman filter over readings.
//!
//! Beside the filter are three parts of its state. A *trend* is the value of a measured input that changes steadily, from all its readings.
//! *Rewind* keeps estimates from before a contact that was detected late. The *motion* of a swing is carried from reading to reading.

use crate::identify::{self, Identifiability};
use crate::matrix::{Cholesky, MAX_STATES, Symmetric, Vector, chi_squared_quantile, truncated, upper_tail};
use crate::reading::{
    Explanation, LastPredictions, MAX_PREDICTIONS, Predictor, Prior, Prospect, ReadingProblem, Side,
    difference, innovation,
};
use crate::setup::{
    Alarm, Estimate, InputRole, MAX_INPUTS, MAX_ROWS, Measurement, Model, MotionState, PASTS, Setup,
    SetupError, Status, Swing, Update,
};
use crate::swing::{Passage, excluded_gap_mm, moving_inputs};
use crate::trend::InputTrend;
use crate::trial::{self, Trial};
use crate::watch::{AlarmWatch, CYCLES_S, Pattern, widened};

/// Quantiles of the normal distribution around 95 % of its mass.
const BAND_Z: f64 = 1.959_964;
/// Surplus of evidence (twice the log odds) for a first contact while the gap is unknown. Contact begins at one of very many
/// readings, and a false beginning would fix the gap at a wrong value.
const FIRST_CONTACT_EVIDENCE: f64 = 25.0;
/// Distance of a known gap from the onset, in standard deviations, beyond which one side is solved only.
const CLEAR: f64 = 6.0;
/// Largest factor by which [`Model::inside_contact_mm`] may be too large.
const INSIDE_AT_MOST: f64 = 2.0;
/// Normal quantile of 1 %: lower bound of the squares that a contact which explains a reading leaves.
const MIN_Z: f64 = -2.326;
/// Depth of the start inside the contact (mm) if the prior lies outside.
const INSIDE_CONTACT_MM: f64 = 0.5;
/// Predictions reserved for a search from earlier estimates.
const LEFT_TO_REWIND: u32 = 4;

/// Filter and its state.
#[derive(Clone, Debug)]
pub struct Filter {
    setup: Setup,
    mean: Vector,
    covariance: Symmetric,
    /// Variances of the unknowns without any reading.
    unread: Vector,
    last_t_s: Option<f64>,
    /// Time between the last two readings (s).
    spacing_s: f64,
    /// Largest gap that readings without contact have excluded (mm).
    gap_floor_mm: f64,
    /// Evidence for a contact from consecutive readings that only a contact explains completely.
    toward_contact: f64,
    identifiability: Identifiability,
    /// Last predictions, from which the next search starts; `None` only during an update.
    seen: Option<Box<LastPredictions>>,
    /// Estimates from before a contact that is not detected yet.
    before: Rewind,
    /// Largest errors of the measured inputs by their past, at the last reading.
    spread: [[f64; PASTS]; MAX_INPUTS],
    /// Last reading of a motion.
    last: Option<Measurement>,
    /// The last reading that was used indicated contact.
    in_contact: bool,
    /// Consecutive readings that the motion did not explain completely.
    unexplained: u32,
    /// Trend per input; `Some` for inputs that change steadily.
    trends: [Option<InputTrend>; MAX_INPUTS],
    watch: AlarmWatch,
    memory: [Pattern; 2],
    alarm: Option<Alarm>,
    /// Factor of the estimates' standard deviations by what the readings leave over.
    widening: f64,
    trial: Option<Trial>,
}

impl Filter {
    /// Starts from the priors.
    ///
    /// # Errors
    /// All errors in the setup.
    pub fn new(setup: Setup) -> Result<Self, Vec<SetupError>> {
        setup.check()?;
        let (mean, unread) = setup.priors();
        let covariance = Symmetric::diagonal(&unread[..setup.unknowns.len()]);
        Ok(Self {
            identifiability: Identifiability::default(),
            seen: Some(Box::default()),
            before: Rewind::new(),
            spread: [[0.0; PASTS]; MAX_INPUTS],
            last: None,
            in_contact: false,
            unexplained: 0,
            trends: [None; MAX_INPUTS],
            watch: AlarmWatch::default(),
            memory: Pattern::all(CYCLES_S),
            alarm: None,
            widening: 1.0,
            trial: None,
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

    /// Setup of the filter.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// Estimates in the order of the unknowns. The standard deviations contain the effect of memory as far as the readings do not
    /// exclude it, and grow with what the model leaves over of the readings.
    pub fn estimates(&self) -> impl Iterator<Item = Estimate> {
        let gap = self.setup.gap_unknown();
        (0..self.setup.unknowns.len()).map(move |at| {
            let (mut value, mut sigma) = (self.mean[at], self.covariance.get(at, at).sqrt());
            if gap == Some(at) {
                (value, sigma) = truncated(value, sigma, self.gap_floor_mm);
            }
            let unread = self.unread[at].sqrt();
            sigma *= self.widening;
            sigma = widened(&self.memory, at, sigma, unread, value - self.setup.unknowns[at].prior);
            let identifiable =
                self.identifiability.is_identifiable(at) && sigma <= identify::MAX_SIGMA_RATIO * unread;
            Estimate { value, sigma, identifiable }
        })
    }

    /// Covariance of the unknowns' errors, without memory of the plant.
    pub(crate) fn covariance(&self) -> &Symmetric {
        &self.covariance
    }

    /// Correlation of two unknowns' errors.
    pub fn correlation(&self, a: usize, b: usize) -> f64 {
        self.covariance.correlation(a, b)
    }

    /// Standard deviation of a quantity with these derivatives with respect to the model inputs, from the errors of the
    /// unknowns and the noise of the measured inputs.
    pub fn sigma_of(&self, by_input: &[f64; MAX_INPUTS]) -> f64 {
        let (mut by_unknown, mut variance) = ([0.0; MAX_STATES], 0.0);
        let inputs = self.setup.inputs.iter().zip(by_input).zip(&self.trends).zip(&self.spread);
        for (((role, derivative), trend), spread) in inputs {
            match *role {
                InputRole::Given(_) => {}
                InputRole::Estimated(unknown) => by_unknown[unknown] += derivative,
                InputRole::Measured { sigma, .. } => {
                    let noise = trend.map_or(sigma * sigma, |trend| trend.variance());
                    variance += derivative * derivative * noise;
                    role.offsets(*spread).for_each(|(unknown, by)| by_unknown[unknown] -= by * derivative);
                }
            }
        }
        let driving = self.setup.measured_inputs().next().map_or(0.0, |(input, _)| by_input[input]);
        for pattern in &self.memory {
            let of_unknowns: f64 = by_unknown.iter().zip(pattern.sensitivity()).map(|(a, b)| a * b).sum();
            variance += (of_unknowns + driving * pattern.difference()).powi(2) * pattern.square();
        }
        let spread = self.covariance.times(&by_unknown);
        let of_unknowns = by_unknown.iter().zip(spread).map(|(a, b)| a * b).sum::<f64>();
        variance += self.widening * self.widening * of_unknowns;
        variance.max(0.0).sqrt()
    }

    /// Returns the past of all memories to its prior: the next reading is that of another one. A motion begins with it.
    pub fn forget_past(&mut self) {
        self.last = None;
        for role in &self.setup.inputs {
            let InputRole::Measured { pasts, .. } = *role else { continue };
            for past in pasts.into_iter().flatten() {
                let unknown = &self.setup.unknowns[past];
                self.mean[past] = unknown.prior;
                self.covariance.replace(past, unknown.sigma * unknown.sigma);
            }
        }
    }

    /// Takes a reading into account. Allocates nothing.
    ///
    /// Cost: usually one prediction of the model, two if contact and no contact are both likely, at most [`MAX_PREDICTIONS`].
    /// Each takes `O(rows x states^2)` further operations. The onset gap is computed once or twice.
    pub fn update(&mut self, measurement: &Measurement, model: &mut impl Model) -> Update {
        if let Err(status) = self.advance(measurement) {
            return self.unchanged(status, measurement);
        }
        let mut measurement = *measurement;
        self.carry(&mut measurement, model);
        let update = self.explain(&measurement, model);
        self.settle(&measurement, &update, model);
        update
    }

    /// Takes a reading into account, to whose time the unknowns have been carried.
    fn explain(&mut self, measurement: &Measurement, model: &mut impl Model) -> Update {
        let Some(mut prior) = self.prior() else { return self.unchanged(Status::NotConverged, measurement) };
        let mut seen = self.seen.take().unwrap_or_default();
        let mut asked = Predictor { model, left: MAX_PREDICTIONS, seen: &mut seen };
        let mut explained = self.best(measurement, &prior, &mut asked);
        // With too few predictions left the next reading rewinds.
        let is_first = explained.as_ref().is_some_and(|explained| self.begins_contact(explained));
        let now = (is_first && asked.left >= LEFT_TO_REWIND).then_some((self.mean, self.covariance));
        if now.is_some()
            && let Some((earlier, again)) =
                explained.as_ref().and_then(|e| self.rewound(measurement, e, &mut asked))
        {
            (prior, explained) = (earlier, Some(again));
        }
        self.seen = Some(seen);
        let most = self.problem(measurement, &prior, Side::Any).most_rejected();
        let contradicting =
            explained.as_ref().map(|e| e.rejected).filter(|blocks| blocks.count_ones() > most);
        let accepted = explained.as_ref().filter(|_| contradicting.is_none());
        let used = accepted.and_then(|explained| self.accept(measurement, &prior, explained, model));
        let solved = accepted.filter(|_| used.is_some());
        let noise = solved.map(|solved| &solved.states[self.setup.unknowns.len()..]);
        let residuals = solved.map(|solved| self.residuals(measurement, solved));
        if let Some(now) = now {
            // Earlier estimates are kept only if the reading that required them is used.
            match used {
                Some(_) => {
                    self.before.forget();
                    // What was left over before belongs to a body in the air.
                    self.watch.begin_window();
                }
                None => (self.mean, self.covariance) = now,
            }
        }
        let update = used.unwrap_or_else(|| match contradicting {
            Some(rejected) => Update { rejected, ..self.unchanged(Status::NotExplained, measurement) },
            None => self.unchanged(Status::NotConverged, measurement),
        });
        self.conclude(measurement, update, noise.zip(residuals.as_ref()))
    }

    /// Residuals of the values that a reading's solution accepts, at the estimates after it and without noise of the measured inputs; NaN
    /// for all other values.
    fn residuals(&self, measurement: &Measurement, solved: &Explanation) -> [f64; MAX_ROWS] {
        let mut linear = solved.linear;
        let count = self.setup.unknowns.len();
        let mut there = [0.0; MAX_STATES];
        there[..count].copy_from_slice(&self.mean[..count]);
        linear.move_along(&difference(&there, &solved.states));
        let mut out = [f64::NAN; MAX_ROWS];
        let rows = self.setup.rows.iter().zip(&measurement.rows).zip(&linear.residual);
        for (out, ((row, value), residual)) in out.iter_mut().zip(rows) {
            if value.is_finite() && solved.rejected & (1 << row.block) == 0 {
                *out = *residual;
            }
        }
        out
    }

    /// Updates trends and alarms. `solved`: noise of the measured inputs and residuals without it; `None` if the reading was not used.
    fn conclude(
        &mut self,
        measurement: &Measurement,
        mut update: Update,
        solved: Option<(&[f64], &[f64; MAX_ROWS])>,
    ) -> Update {
        self.follow(measurement, &mut update.inputs);
        let mut watch = std::mem::take(&mut self.watch);
        watch.add(&self.setup, measurement, &update, solved);
        self.try_drift(measurement.t_s, &update, &mut watch);
        let unread = self.unread.map(f64::sqrt);
        let may_be_memory = self.memory.iter().any(Pattern::may_be);
        update.alarm =
            watch.judge(&self.setup, self.estimates().zip(unread), may_be_memory, self.trial.is_some());
        self.alarm = update.alarm;
        self.widening = watch.widening(&self.setup.rows);
        self.watch = watch;
        update
    }

    /// Begins and ends trials of a drifted gap or bias.
    fn try_drift(&mut self, t_s: f64, update: &Update, watch: &mut AlarmWatch) {
        let Some(mut trial) = self.trial else {
            if watch.asks_for_trial(t_s) && trial::released(&self.setup).next().is_some() {
                self.trial = Some(Trial::new(t_s, self.mean, self.covariance, self.gap_floor_mm));
                for at in trial::released(&self.setup) {
                    let sigma = self.setup.unknowns[at].sigma;
                    self.covariance.replace(at, sigma * sigma);
                    self.memory.iter_mut().for_each(|pattern| pattern.set(at, 0.0));
                }
                self.gap_floor_mm = f64::NEG_INFINITY;
            }
            return;
        };
        self.trial = match trial.add(t_s, update) {
            None => Some(trial),
            Some(true) => {
                watch.has_drifted(trial.drifted(&self.setup, &self.mean, t_s), t_s);
                None
            }
            Some(false) => {
                (self.mean, self.covariance) = (trial.mean, trial.covariance);
                self.gap_floor_mm = trial.gap_floor_mm;
                for at in trial::released(&self.setup) {
                    let drift = trial.variance(&self.setup, at, t_s) - trial.covariance.get(at, at);
                    self.covariance.add_diagonal(at, drift);
                }
                self.identifiability = identify::judge(&self.covariance, &self.unread);
                None
            }
        };
    }

    /// Replaces measured inputs that change steadily by the estimate from all their readings.
    fn follow(&mut self, measurement: &Measurement, inputs: &mut [f64; MAX_INPUTS]) {
        for (input, role) in self.setup.inputs.iter().enumerate() {
            let InputRole::Measured { sigma, rate_change: Some(change), .. } = *role else { continue };
            let value = measurement.inputs[input];
            let trend = InputTrend::follow(self.trends[input], measurement.t_s, value, sigma * sigma, change);
            self.trends[input] = Some(trend);
            inputs[input] = trend.value() - role.offset(measurement.spread[input], &self.mean);
        }
    }

    /// Propagates the unknowns to the reading's time.
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
        (self.last_t_s, self.spread) = (Some(measurement.t_s), measurement.spread);
        for (index, unknown) in self.setup.unknowns.iter().enumerate() {
            let drift = unknown.drift_variance(passed_s);
            self.covariance.add_diagonal(index, drift);
            self.unread[index] += drift;
        }
        if let Some((input, sigma)) = self.setup.measured_inputs().next() {
            let value = measurement.inputs[input];
            self.memory.iter_mut().for_each(|pattern| pattern.advance(measurement.t_s, value, sigma));
        }
        if let Some(gap) = self.setup.gap_unknown() {
            // A drifting gap may fall below the excluded range again.
            self.gap_floor_mm -= self.setup.unknowns[gap].drift_per_sqrt_s * passed_s.sqrt();
        }
        Ok(())
    }

    /// States before a reading.
    fn prior(&self) -> Option<Prior> {
        let (noise, count) = self.setup.noise_information();
        let information = self.covariance.cholesky()?.inverse().extended(&noise[..count]);
        Some(Prior { states: self.setup.without_noise(&self.mean), information })
    }

    fn problem<'a>(
        &'a self,
        measurement: &'a Measurement,
        prior: &'a Prior,
        side: Side,
    ) -> ReadingProblem<'a> {
        ReadingProblem { setup: &self.setup, measurement, prior, side, weights: [0.0; MAX_ROWS] }
    }

    /// True if a solution is a contact whose gap is not identifiable yet.
    fn begins_contact(&self, explained: &Explanation) -> bool {
        let gap = self.setup.gap_unknown();
        explained.side == Side::Contact && gap.is_some_and(|gap| !self.identifiability.is_identifiable(gap))
    }

    /// Prior and solution of the first contact reading, from the estimates before the contact began; the filter adopts them.
    fn rewound<M: Model>(
        &mut self,
        measurement: &Measurement,
        explained: &Explanation,
        asked: &mut Predictor<'_, M>,
    ) -> Option<(Prior, Explanation)> {
        let unknown = self.setup.gap_unknown()?;
        let before = self.before.before_contact(explained.states[unknown])?;
        let now = (self.mean, self.covariance);
        (self.mean, self.covariance) = (before.mean, before.covariance);
        // The motion is that of now.
        for at in (0..self.setup.unknowns.len()).filter(|at| self.setup.is_moving(*at)) {
            self.mean[at] = now.0[at];
            self.covariance.replace(at, now.1.get(at, at));
        }
        for (index, unknown) in self.setup.unknowns.iter().enumerate() {
            self.covariance.add_diagonal(index, unknown.drift_variance(measurement.t_s - before.t_s));
        }
        let again = self.prior().and_then(|prior| {
            let onset_mm = asked.model.onset_gap_mm(&self.setup.inputs_at(measurement, &prior.states))?;
            let start = self.contact_start(&prior, unknown, onset_mm);
            let mut problem = self.problem(measurement, &prior, Side::Contact);
            let again = asked.explain(&mut problem, &start, &self.spread(), |_| true)?;
            (again.rejected == explained.rejected).then_some((prior, again))
        });
        if again.is_none() {
            (self.mean, self.covariance) = now;
        }
        again
    }

    /// Standard deviations of the states before a reading.
    fn spread(&self) -> Vector {
        let mut out = [0.0; MAX_STATES];
        let count = self.setup.unknowns.len();
        for (index, out) in out.iter_mut().enumerate().take(count) {
            *out = self.covariance.get(index, index).sqrt();
        }
        out[count..].iter_mut().zip(self.setup.measured_inputs()).for_each(|(out, (_, sigma))| *out = sigma);
        out
    }

    /// More likely of no contact and contact if the gap is unknown; otherwise the model decides.
    fn best<M: Model>(
        &mut self,
        measurement: &Measurement,
        prior: &Prior,
        asked: &mut Predictor<'_, M>,
    ) -> Option<Explanation> {
        let (spread, all) = (self.spread(), |_: Prospect| true);
        let on = |side: Side| self.problem(measurement, prior, side);
        let Some(unknown) = self.setup.gap_unknown() else {
            return asked.explain(&mut on(Side::Any), &prior.states, &spread, all);
        };
        let before = self.setup.inputs_at(measurement, &prior.states);
        if self.identifiability.is_identifiable(unknown) {
            // Far inside the contact the onset is not needed.
            let inside_mm = asked.model.inside_contact_mm(&before).unwrap_or(f64::NEG_INFINITY);
            let inside = inside_mm / (INSIDE_AT_MOST * spread[unknown]);
            if inside > CLEAR {
                let touching = asked.explain(&mut on(Side::Contact), &prior.states, &spread, all);
                if touching.as_ref().is_some_and(|touching| touching.penalty <= inside * inside) {
                    return touching;
                }
            }
        }
        let Some(onset_mm) = asked.model.onset_gap_mm(&before) else {
            return asked.explain(&mut on(Side::Free), &prior.states, &spread, all);
        };
        let inside = (onset_mm - self.mean[unknown]) / spread[unknown];
        let start = self.contact_start(prior, unknown, onset_mm);
        if self.identifiability.is_identifiable(unknown) && inside.abs() > CLEAR {
            let likely = if inside > 0.0 {
                asked.explain(&mut on(Side::Contact), &start, &spread, all)
            } else {
                asked.explain(&mut on(Side::Free), &prior.states, &spread, all)
            };
            // The other side costs at least the square of this distance.
            if likely.as_ref().is_some_and(|likely| likely.penalty <= inside * inside) {
                return likely;
            }
        }
        let beyond = upper_tail(inside).max(f64::MIN_POSITIVE);
        let against_open = -2.0 * beyond.ln();
        if self.identifiability.is_identifiable(unknown) && inside > 0.0 {
            // Contact is more likely: no contact is solved only if its evidence may be comparable.
            let touching = asked.explain(&mut on(Side::Contact), &start, &spread, all);
            let worth = |open: Prospect| {
                touching.as_ref().is_none_or(|touching| open.evidence + against_open < touching.evidence)
            };
            let open = asked.explain(&mut on(Side::Free), &prior.states, &spread, worth);
            return self.likelier(open, touching, against_open, 0.0);
        }
        let open = asked.explain(&mut on(Side::Free), &prior.states, &spread, all);
        let needed = if self.identifiability.is_identifiable(unknown) { 0.0 } else { FIRST_CONTACT_EVIDENCE };
        // A reading increases the determinant, and a contact that explains it leaves residual squares too.
        let before = prior.information.cholesky()?.ln_determinant();
        let present = on(Side::Free).present().count();
        let least = before + chi_squared_quantile(present.saturating_sub(prior.information.size()), MIN_Z);
        let is_worth = |open: &Explanation, contact: Prospect| {
            // Consecutive readings that only a contact explains completely add up.
            let partly = open.rejected.count_ones() > contact.rejected.count_ones();
            contact.evidence + if partly { 0.0 } else { needed } < open.evidence + against_open
        };
        let at_best = Prospect { rejected: 0, evidence: least };
        let worth = |contact: Prospect| open.as_ref().is_none_or(|open| is_worth(open, contact));
        let touching =
            if worth(at_best) { asked.explain(&mut on(Side::Contact), &start, &spread, worth) } else { None };
        self.likelier(open, touching, against_open, needed)
    }

    /// More likely of the solved sides: contact if its evidence is larger by `needed`, or if it alone explains consecutive
    /// readings completely. `against_open` is the prior's evidence against no contact.
    fn likelier(
        &mut self,
        open: Option<Explanation>,
        touching: Option<Explanation>,
        against_open: f64,
        needed: f64,
    ) -> Option<Explanation> {
        match (open, touching) {
            (Some(open), Some(touching)) => {
                let toward = open.evidence + against_open - touching.evidence;
                // Rejection bounds the evidence of one reading; consecutive readings add up.
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

    /// Prior, moved into the contact along its covariance if it lies outside.
    fn contact_start(&self, prior: &Prior, unknown: usize, onset_mm: f64) -> Vector {
        let mut start = prior.states;
        let shift = onset_mm - INSIDE_CONTACT_MM - start[unknown];
        if shift < 0.0 {
            let variance = self.covariance.get(unknown, unknown);
            for (index, (start, spec)) in start.iter_mut().zip(&self.setup.unknowns).enumerate() {
                *start += self.covariance.get(index, unknown) / variance * shift;
                *start = start.clamp(spec.range[0], spec.range[1]);
            }
            start[unknown] = onset_mm - INSIDE_CONTACT_MM;
        }
        start
    }

    /// Adopts the solution as the estimate; `None`, without any change, if its normal equations have no factor.
    fn accept(
        &mut self,
        measurement: &Measurement,
        prior: &Prior,
        explained: &Explanation,
        model: &mut impl Model,
    ) -> Option<Update> {
        let Explanation { side, rejected, converged, .. } = *explained;
        let mut problem = self.problem(measurement, prior, side);
        problem.leave_out(rejected);
        let used = problem.weights.iter().filter(|w| **w > 0.0).count();
        let nis = innovation(&problem, explained);
        // The model's error does not average out within its correlation time.
        let lasting = self.lasting_weights(&problem.weights);
        let mut states = explained.states;
        let (matrix, right) = problem.equations(&states, &explained.linear, &lasting);
        let (step, factor) = problem.step(&states, &matrix, &right)?;
        states.iter_mut().zip(&step).for_each(|(x, s)| *x += s);
        problem.keep_in_range(&mut states);
        let count = self.setup.unknowns.len();
        self.learn_memory(&problem.weights, &lasting, explained, &factor);
        let inputs = self.setup.inputs_at(measurement, &states);
        self.covariance = factor.inverse().leading(count);
        self.mean[..count].copy_from_slice(&states[..count]);
        let in_contact = side == Side::Contact || (side == Side::Any && explained.linear.in_contact);
        if side == Side::Free && rejected == 0 {
            self.gap_floor_mm =
                self.gap_floor_mm.max(excluded_gap_mm(&self.setup, &self.covariance, &inputs, model));
            self.before.keep(measurement.t_s, &self.mean, &self.covariance, self.gap_floor_mm);
        } else if in_contact {
            self.gap_floor_mm = f64::NEG_INFINITY;
        }
        self.identifiability = identify::judge(&self.covariance, &self.unread);
        let band = [-BAND_Z, BAND_Z].map(|z| chi_squared_quantile(used, z));
        Some(Update {
            status: Status::Used,
            converged,
            inputs,
            in_contact,
            used,
            rejected,
            nis,
            nis_band: band,
            alarm: None,
        })
    }

    /// Takes a used reading into account: its noise with the weights of a single reading, the errors of the unknowns with those of the
    /// gain. The load of a motion takes up the noise; there the amplitude follows from the residuals.
    fn learn_memory(
        &mut self,
        weights: &[f64; MAX_ROWS],
        lasting: &[f64; MAX_ROWS],
        explained: &Explanation,
        gain: &Cholesky,
    ) {
        let (count, linear) = (self.setup.unknowns.len(), &explained.linear);
        let Some((_, sigma)) = self.setup.measured_inputs().next() else { return };
        for pattern in &mut self.memory {
            let unit = linear.of_memory(count, pattern.difference(), pattern.sensitivity());
            let right = linear.right_of(lasting, &unit);
            let step = gain.solve(&right);
            if self.setup.swing.is_some() {
                let product = |a: &[f64; MAX_ROWS]| -> f64 {
                    let rows = a.iter().zip(&unit).zip(lasting).filter(|(_, w)| **w > 0.0);
                    rows.map(|((a, unit), w)| w * a * unit).sum()
                };
                let taken_up: f64 = step.iter().zip(&right).map(|(step, right)| step * right).sum();
                pattern.compare(product(&linear.residual), (product(&unit) - taken_up).max(0.0));
            } else {
                let of_unit = explained.factor.solve(&linear.right_of(weights, &unit))[count];
                let [noise, of_unit] = [explained.states[count], of_unit].map(|e| e / sigma);
                pattern.compare(noise * of_unit, of_unit * of_unit);
            }
            pattern.move_by(&step[..count]);
        }
    }

    /// Weights of a reading for the unknowns: the model's variance is multiplied by the number of readings with the same error.
    fn lasting_weights(&self, weights: &[f64; MAX_ROWS]) -> [f64; MAX_ROWS] {
        let mut out = *weights;
        let shared = (self.setup.model_correlation_s / self.spacing_s).max(1.0);
        for (i, row) in self.setup.rows.iter().enumerate().filter(|(i, _)| weights[*i] > 0.0) {
            out[i] = 1.0 / row.variance(shared);
        }
        out
    }

    fn unchanged(&self, status: Status, measurement: &Measurement) -> Update {
        let states = self.setup.without_noise(&self.mean);
        let inputs = self.setup.inputs_at(measurement, &states);
        Update {
            status,
            converged: false,
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

// ---- motion between the readings ----

/// Consecutive readings with a contradiction after which a motion is unknown.
const LOST_AFTER: u32 = 3;

impl Filter {
    /// True if no obstacle is known.
    fn is_open(&self) -> bool {
        let gap = self.setup.gap_unknown();
        gap.is_some_and(|gap| !self.in_contact && !self.identifiability.is_identifiable(gap))
    }

    /// Carries the motion to a reading. A motion that begins there has load and rate of the priors.
    fn carry(&mut self, measurement: &mut Measurement, model: &mut impl Model) {
        let Some(swing) = self.setup.swing else { return };
        let carried = self.last.as_ref().and_then(|from| {
            let passage = Passage { setup: &self.setup, from, to: measurement, is_open: self.is_open() };
            passage.carry(&self.mean, &self.covariance, model)
        });
        let places = [swing.load, swing.rate];
        match &carried {
            Some(carried) => {
                carried.spread(&swing, &mut self.covariance);
                places.iter().zip(carried.states).for_each(|(index, value)| {
                    let [low, high] = self.setup.unknowns[*index].range;
                    self.mean[*index] = value.clamp(low, high);
                });
                measurement.load_by_input = carried.by_reading;
                for pattern in &mut self.memory {
                    let errors = carried.errors(pattern.sensitivity(), pattern.difference());
                    places.iter().zip(errors).for_each(|(index, error)| pattern.set(*index, error));
                }
            }
            None => {
                self.lose_motion(swing);
                places.iter().for_each(|at| self.mean[*at] = self.setup.unknowns[*at].prior);
            }
        }
    }

    /// Makes load and rate of a motion as unknown as before any reading.
    fn lose_motion(&mut self, swing: Swing) {
        for at in [swing.load, swing.rate] {
            let sigma = self.setup.unknowns[at].sigma;
            self.covariance.replace(at, sigma * sigma);
            self.memory.iter_mut().for_each(|pattern| pattern.set(at, 0.0));
        }
    }

    /// Gives the motion at a reading to the model.
    fn settle(&mut self, measurement: &Measurement, update: &Update, model: &mut impl Model) {
        let Some(swing) = self.setup.swing else { return };
        if update.status == Status::Used {
            self.in_contact = update.in_contact;
        }
        let is_explained = update.status == Status::Used && update.rejected == 0;
        self.unexplained = if is_explained { 0 } else { self.unexplained + 1 };
        if self.unexplained == LOST_AFTER {
            self.unexplained = 0;
            self.lose_motion(swing);
        }
        let inputs = moving_inputs(&self.setup, measurement, &self.mean, self.is_open());
        model.settle(
            &MotionState { t_s: measurement.t_s, inputs, rate: self.mean[swing.rate] },
            self.in_contact,
        );
        self.last = Some(*measurement);
    }
}

// ---- estimates from before a contact that was detected late ----
//
// A contact begins with small forces and shifts. The filter requires much evidence for it while the gap is unknown; until then the
// unknowns absorb it as a stiffer actuator or a biased gauge. Estimates are therefore stored while the lowest point approaches a possible
// obstacle. When a contact shows its gap, those from before it are restored.

/// Largest number of stored estimates.
const REWIND_MAX: usize = 64;
/// Descent of the lowest point between two stored estimates, mm.
const SPACING_MM: f64 = 0.5;
/// Distance of the lowest point from the obstacle, mm, from which on an estimate is from before a contact.
const CLEARANCE_MM: f64 = 1.5;

#[derive(Clone, Copy, Debug)]
struct SavedEstimate {
    t_s: f64,
    mean: Vector,
    covariance: Symmetric,
    /// Largest gap that readings without contact had excluded (mm).
    gap_floor_mm: f64,
}

/// Last estimates, the newest last. The capacity is allocated once.
#[derive(Debug)]
struct Rewind(Vec<SavedEstimate>);

/// Clones with full capacity.
impl Clone for Rewind {
    fn clone(&self) -> Self {
        let mut out = Self::new();
        out.0.extend_from_slice(&self.0);
        out
    }
}

impl Rewind {
    fn new() -> Self {
        Self(Vec::with_capacity(REWIND_MAX))
    }

    /// Stores an estimate if the lowest point is lower than at the last one.
    fn keep(&mut self, t_s: f64, mean: &Vector, covariance: &Symmetric, gap_floor_mm: f64) {
        // The bound falls if the gap drifts, and restarts after a contact: lower estimates are outdated.
        while self.0.last().is_some_and(|last| last.gap_floor_mm > gap_floor_mm + SPACING_MM) {
            self.0.pop();
        }
        if self.0.last().is_some_and(|last| gap_floor_mm < last.gap_floor_mm + SPACING_MM) {
            return;
        }
        if self.0.len() == REWIND_MAX {
            self.0.remove(0);
        }
        self.0.push(SavedEstimate { t_s, mean: *mean, covariance: *covariance, gap_floor_mm });
    }

    /// Last estimate from before a contact with an obstacle at `gap_mm`.
    fn before_contact(&self, gap_mm: f64) -> Option<SavedEstimate> {
        self.0.iter().rev().find(|kept| kept.gap_floor_mm <= gap_mm - CLEARANCE_MM).copied()
    }

    /// Removes all estimates, when a contact has begun.
    fn forget(&mut self) {
        self.0.clear();
    }
}

#[cfg(test)]
#[path = "../tests/unit/filter.rs"]
mod tests;
