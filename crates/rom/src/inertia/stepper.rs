//! Motion over time: inner steps of fixed length, landing and leaving, defined outcomes of bad readings.
//!
//! Inner steps lie on a grid that begins at the first reading; inputs are straight lines between readings; a reading between two
//! instants of the grid is answered by a shorter step that is not kept. Results thus do not depend on how readings are cut.
//!
//! **Landing**: a step whose whole shape, linear modes included, penetrates the obstacle is repeated in contact: from the load of the
//! onset, amplitudes by projection of the position, momenta those of the velocity tested with the tangents of contact. **Leaving**: a
//! step whose contact force is negative is repeated free, in the same way. Projection never adds kinetic energy.

use super::data::FadingMotion;
use super::manifold::{Amplitudes, Coordinates, Manifold, Tangents, dot};
use super::momenta::{Instant, Space, Step, StepEnd, Unknowns, amplitudes, rest, step, with_loads};
use crate::inputs::{Inputs, PRESSURE};
use crate::memory::{MAX_PRONY, PronyTerm};
use crate::snapshots::RegimeKind;
use thiserror::Error;

/// Distance beyond the training range of the load, as a fraction of it, at which the motion restarts at rest.
const FAR: f64 = 1.0;

/// Periods of the slowest linear mode of contact in which the effect of an impact fades by a factor of e.
const IMPACT_PERIODS: f64 = 3.0;
/// Periods in which the path of an undamped swing is forgotten by a factor of e.
const PATH_PERIODS: f64 = 32.0;
/// Loads of a swing that an unknown past may have left, as fractions of their training ranges.
pub(super) const PAST_FRACTION: f64 = 0.25;

/// Most inner steps between two readings of a recording, some seconds of computing. Any swing has faded after so many, so that a longer
/// gap restarts the motion at rest.
const MAX_STEPS: u64 = 4_000_000;

/// Constants of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSettings {
    /// Length of the inner steps, ns.
    pub step_ns: u64,
    /// Damping proportional to the stiffness, s.
    pub damping_s: f64,
    /// Time between two readings up to which inputs are straight lines, ns; beyond it the last one is held until the next reading.
    pub held_after_ns: u64,
    /// Time between two readings from which the motion restarts at rest, ns.
    pub restart_after_ns: u64,
}

/// Why a reading was not used. The motion is unchanged.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[allow(missing_docs)] // the messages say what the values are
pub enum ReadingError {
    /// Time is not later than that of the last reading.
    #[error("a reading at {found_ns} ns is not later than the last one, at {last_ns} ns")]
    NotLater { found_ns: u64, last_ns: u64 },
    /// An input that the model needs is not finite.
    #[error("a reading at {found_ns} ns has no finite pressure or load at rest")]
    NotFinite { found_ns: u64 },
}

/// Outcome of a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionStep {
    /// State of the motion at the reading.
    pub state: MotionState,
    /// Largest distance of a load from its training range since the last reading, as a fraction of it; 0 inside.
    pub load_distance: f64,
    /// The inputs were held over a gap in the readings.
    pub held: bool,
    /// The motion began at rest with this reading: the first one, one after a long gap, or one at which the motion could not be continued.
    pub at_rest: bool,
}

/// Motion at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionState {
    /// Whether the body touches.
    pub regime: RegimeKind,
    /// Inputs, with the inertial loads (mm/s2) in place of the loads at rest.
    pub inputs: Inputs,
    /// Amplitudes of the linear modes, mm t^1/2.
    pub amplitudes: Amplitudes,
    /// The state to draw. Motion that the loads and the linear modes cannot represent is approximated: the pressure is filtered with the time
    /// constant of the damping.
    pub shown: (Inputs, Amplitudes),
    /// Inputs whose equilibrium has the stress: those of `shown` with the part of the loads that a relaxing elastomer bears on top.
    pub stressed: Inputs,
    /// Contact force, N; 0 when free, never negative.
    pub contact_force_n: f64,
    /// Kinetic energy, mJ.
    pub kinetic_mj: f64,
    /// What the motion has left behind, mm.
    pub fading_mm: FadingMotion,
}

/// Everything that the next step depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
struct MotionInstant {
    regime: RegimeKind,
    instant: Instant,
    position: Coordinates,
    velocity: Coordinates,
    /// Inputs with the loads at rest.
    inputs: Inputs,
    /// Pressure ahead of what follows it with the time constant of the damping, MPa.
    ahead_mpa: f64,
    /// Internal variables of the relaxation under the pressure, MPa.
    relaxing_mpa: [f64; MAX_PRONY],
    force_n: f64,
    /// Force of the relaxed elastomer, and its internal variables.
    relaxed_n: RelaxedForce,
    /// What the motion has left behind, in coordinates.
    fading: FadingMotion,
}

/// Contact force of the relaxed elastomer, N, and internal variables of its relaxation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct RelaxedForce {
    force_n: f64,
    internal_n: [f64; MAX_PRONY],
}

/// Time and inputs of the last reading, begin of the grid, inner steps made.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Clock {
    begin_ns: u64,
    steps: u64,
    last_ns: u64,
    last: Inputs,
}

/// Motion on a manifold.
#[derive(Clone, Debug)]
pub struct Motion<M> {
    manifold: M,
    settings: MotionSettings,
    now: Option<(MotionInstant, Clock)>,
    /// Before the first reading the body may have moved.
    is_past_unknown: bool,
    prony: [PronyTerm; MAX_PRONY],
    /// Number of terms.
    terms: usize,
}

impl<M: Manifold> Motion<M> {
    /// Begins at rest with the first reading.
    pub fn new(manifold: M, settings: MotionSettings) -> Self {
        Self {
            manifold,
            settings: MotionSettings { step_ns: settings.step_ns.max(1), ..settings },
            now: None,
            is_past_unknown: true,
            prony: Default::default(),
            terms: 0,
        }
    }

    /// The elastomer relaxes by a series, of whose terms at most [`MAX_PRONY`] count; the family is the relaxed one. Pressures are those
    /// behind its load filter.
    #[must_use]
    pub fn relaxing(mut self, prony: &[PronyTerm]) -> Self {
        self.terms = prony.len().min(MAX_PRONY);
        self.prony[..self.terms].copy_from_slice(&prony[..self.terms]);
        self
    }

    /// The manifold.
    pub fn manifold(&mut self) -> &mut M {
        &mut self.manifold
    }

    /// Takes readings as instants of one recording that begins at rest: inputs are straight lines between any two that are at most
    /// [`MAX_STEPS`] inner steps apart.
    pub(super) fn as_recording(&mut self) {
        self.is_past_unknown = false;
        self.settings.held_after_ns = u64::MAX;
        self.settings.restart_after_ns = MAX_STEPS.saturating_mul(self.settings.step_ns);
    }

    /// Forgets the motion: the next reading begins at rest.
    pub fn reset(&mut self) {
        self.now = None;
    }

    /// Refuses a reading that [`Self::advance`] does not take.
    ///
    /// # Errors
    /// [`ReadingError`].
    pub fn check(&self, t_ns: u64, inputs: &Inputs) -> Result<(), ReadingError> {
        let rests = self.manifold.loads().iter().map(|load| inputs.values()[load.input]);
        if !rests.chain([inputs.pressure_mpa()]).all(f64::is_finite) || inputs.gap_mm().is_nan() {
            return Err(ReadingError::NotFinite { found_ns: t_ns });
        }
        match self.last_ns().filter(|last_ns| t_ns <= *last_ns) {
            Some(last_ns) => Err(ReadingError::NotLater { found_ns: t_ns, last_ns }),
            None => Ok(()),
        }
    }

    /// Moves to a reading. Allocates nothing. Cost: `O(time / step)` inner steps and one more.
    ///
    /// # Errors
    /// [`ReadingError`]; the motion is unchanged.
    pub fn advance(&mut self, t_ns: u64, inputs: &Inputs) -> Result<MotionStep, ReadingError> {
        self.check(t_ns, inputs)?;
        let Some((mut now, mut clock)) = self.now else { return Ok(self.begin(t_ns, inputs)) };
        let gap_ns = t_ns - clock.last_ns;
        if gap_ns > self.settings.restart_after_ns {
            return Ok(self.begin(t_ns, inputs));
        }
        let held = gap_ns > self.settings.held_after_ns;
        let (last_ns, last) = (clock.last_ns, clock.last);
        let between = |at_ns: u64| match at_ns {
            at_ns if at_ns == t_ns => *inputs,
            _ if held => last,
            at_ns => last.between(inputs, (at_ns - last_ns) as f64 / gap_ns as f64),
        };
        let h_ns = self.settings.step_ns;
        let mut load_distance = 0.0_f64;
        loop {
            let at_ns = clock.begin_ns + clock.steps * h_ns;
            if t_ns - at_ns < h_ns {
                let shown = if t_ns == at_ns { Some(now) } else { self.step(&now, t_ns - at_ns, inputs) };
                let Some(shown) = shown else { return Ok(self.begin(t_ns, inputs)) };
                load_distance = load_distance.max(self.outside(&shown));
                clock = Clock { last_ns: t_ns, last: *inputs, ..clock };
                self.now = Some((now, clock));
                let state = self.state(&shown);
                return Ok(MotionStep { state, load_distance, held, at_rest: false });
            }
            let next = self.step(&now, h_ns, &between(at_ns + h_ns));
            let Some(next) = next.filter(|next| self.outside(next) <= FAR) else {
                return Ok(self.begin(t_ns, inputs));
            };
            load_distance = load_distance.max(self.outside(&next));
            now = next;
            clock.steps += 1;
        }
    }

    /// Largest distance of a load from its training range, as a fraction of it.
    fn outside(&self, now: &MotionInstant) -> f64 {
        let loads = self.manifold.loads().iter().zip(now.instant.at);
        let distances = loads.map(|(load, at)| {
            let [low, high] = load.range;
            (low - at).max(at - high) / (high - low)
        });
        distances.fold(0.0, f64::max)
    }

    /// At rest under the reading's inputs.
    fn begin(&mut self, t_ns: u64, inputs: &Inputs) -> MotionStep {
        self.manifold.forget();
        let still = Amplitudes::default();
        let is_free = self.manifold.clearance_mm(inputs, &still) >= 0.0;
        let regime = if is_free { RegimeKind::Free } else { RegimeKind::Contact };
        let equilibrium = self.manifold.equilibrium(regime, inputs);
        let loads_at_rest = rest(self.manifold.loads(), inputs);
        let instant =
            Instant::at_rest(loads_at_rest, &equilibrium, &self.space(regime, &equilibrium.tangents));
        let (position, velocity) = (equilibrium.position, Coordinates::default());
        let [force_n, _] = self.force_n(regime, inputs, &instant, [0.0; 2]);
        let relaxed_n = RelaxedForce { force_n, ..RelaxedForce::default() };
        let reach = if self.is_past_unknown { PAST_FRACTION } else { 0.0 };
        // A swing is one of the free body, which may touch only now.
        let tangents = self.manifold.equilibrium(RegimeKind::Free, inputs).tangents;
        let swings = self.manifold.loads().iter().zip(&tangents);
        let squares = swings.map(|(load, along)| (load.range[1] - load.range[0]).powi(2) * dot(along, along));
        let unknown_past = reach * squares.sum::<f64>().sqrt();
        let fading = FadingMotion { unknown_past, ..FadingMotion::default() };
        let (inputs, ahead_mpa, relaxing_mpa) = (*inputs, 0.0, [0.0; _]);
        let now = MotionInstant {
            regime,
            instant,
            position,
            velocity,
            inputs,
            ahead_mpa,
            relaxing_mpa,
            force_n,
            relaxed_n,
            fading,
        };
        self.now = Some((now, Clock { begin_ns: t_ns, steps: 0, last_ns: t_ns, last: inputs }));
        let state = self.state(&now);
        MotionStep { state, load_distance: self.outside(&now), held: false, at_rest: true }
    }

    fn state(&self, now: &MotionInstant) -> MotionState {
        let loads = self.manifold.loads();
        let mass = dot(&loads[0].unit, &loads[0].unit);
        let mm = |length: f64| if mass > 0.0 { length / mass.sqrt() } else { 0.0 };
        let FadingMotion { path, impact, unknown_past } = now.fading;
        let Instant { at, of_pressure, .. } = now.instant;
        let at = std::array::from_fn(|i| at[i] + of_pressure[i] * now.ahead_mpa);
        let late_mpa = now.inputs.pressure_mpa() - now.ahead_mpa;
        let late = now.inputs.with(PRESSURE, late_mpa);
        let stressed = std::array::from_fn(|i| at[i] + self.borne(&now.instant.relaxing.map(|h| h[i])));
        let stressed_mpa = late_mpa + self.borne(&now.relaxing_mpa);
        MotionState {
            stressed: with_loads(loads, &late.with(PRESSURE, stressed_mpa), &stressed),
            fading_mm: FadingMotion { path: mm(path), impact: mm(impact), unknown_past: mm(unknown_past) },
            regime: now.regime,
            inputs: with_loads(loads, &now.inputs, &now.instant.at),
            amplitudes: amplitudes(&now.instant.at, loads.len()),
            shown: (with_loads(loads, &late, &at), amplitudes(&at, loads.len())),
            contact_force_n: now.force_n.max(0.0),
            kinetic_mj: 0.5 * dot(&now.velocity, &now.velocity),
        }
    }

    /// Contact force `F` of the relaxed elastomer, and the part of the damping: `beta dF/dt` along the motion of loads and linear modes and
    /// with the gap; what they do not resolve follows late and adds none. Pressure and gap change by `rates` per second.
    fn force_n(
        &mut self,
        regime: RegimeKind,
        inputs: &Inputs,
        instant: &Instant,
        rates: [f64; 2],
    ) -> [f64; 2] {
        if regime == RegimeKind::Free {
            return [0.0; 2];
        }
        let loads = self.manifold.loads().len();
        let inputs = with_loads(self.manifold.loads(), inputs, &instant.at);
        let force = self.manifold.force(&inputs, &amplitudes(&instant.at, loads));
        let [by_time_mpa, by_time_mm] = rates;
        let moved = instant.rates.iter().zip(&instant.of_pressure).map(|(rate, by)| rate + by * by_time_mpa);
        let by = force.by_load[..loads].iter().chain(&force.by_amplitude).zip(moved);
        let along = by.map(|(by, rate)| by * rate).sum::<f64>();
        [force.n, self.settings.damping_s * (along + force.by_gap * by_time_mm)]
    }

    /// Contact force after a step, and what the next one needs of it.
    fn relaxed_n(&self, now: &MotionInstant, [force_n, damping_n]: [f64; 2], h: f64) -> (f64, RelaxedForce) {
        let internal_n = self.relaxed(&now.relaxed_n.internal_n, force_n - now.relaxed_n.force_n, h);
        (force_n + damping_n + self.borne(&internal_n), RelaxedForce { force_n, internal_n })
    }

    /// Internal variables of the relaxation of a quantity that changes within a step.
    fn relaxed(&self, internal: &[f64; MAX_PRONY], change: f64, h: f64) -> [f64; MAX_PRONY] {
        let mut next = *internal;
        for (term, state) in self.prony[..self.terms].iter().zip(&mut next) {
            let (e, a) = term.within(h);
            *state = e * *state + a * change;
        }
        next
    }

    /// Part of a quantity that the relaxing elastomer bears, `sum r_k h_k`.
    fn borne(&self, internal: &[f64; MAX_PRONY]) -> f64 {
        self.prony[..self.terms].iter().zip(internal).map(|(term, h)| term.ratio * h).sum()
    }

    /// One step with its change of regime, if any.
    fn step(&mut self, now: &MotionInstant, step_ns: u64, next: &Inputs) -> Option<MotionInstant> {
        let damping_s = self.settings.damping_s;
        let (prony, terms) = (self.prony, self.terms);
        let rest = [&now.inputs, next].map(|inputs| rest(self.manifold.loads(), inputs));
        let step_in =
            |regime| Step { regime, prony: &prony[..terms], h: step_ns as f64 * 1e-9, damping_s, rest };
        let stepped = step(&mut self.manifold, &step_in(now.regime), &now.instant, &now.position, next)?;
        let rate = |value: fn(&Inputs) -> f64| {
            let change = value(next) - value(&now.inputs);
            if change.is_finite() { change / (step_ns as f64 * 1e-9) } else { 0.0 }
        };
        let rates = [rate(Inputs::pressure_mpa), rate(Inputs::gap_mm)];
        let force = self.force_n(now.regime, next, &stepped.instant, rates);
        let h = step_ns as f64 * 1e-9;
        let (force_n, relaxed_n) = self.relaxed_n(now, force, h);
        let leaves = match now.regime {
            RegimeKind::Free => self.penetrates(next, &stepped.instant),
            RegimeKind::Contact => force_n < 0.0,
        };
        let fading = self.after_fading(now, &stepped, step_ns);
        let late_mpa = damping_s * rates[0];
        let kept = if damping_s > 0.0 { (-h / damping_s).exp() } else { 0.0 };
        let ahead_mpa = late_mpa + kept * (now.ahead_mpa - late_mpa);
        let relaxing_mpa =
            self.relaxed(&now.relaxing_mpa, next.pressure_mpa() - now.inputs.pressure_mpa(), h);
        let moved = |regime, stepped: StepEnd, (force_n, relaxed_n), fading| {
            let StepEnd { instant, position, velocity } = stepped;
            MotionInstant {
                regime,
                instant,
                position,
                velocity,
                inputs: *next,
                ahead_mpa,
                relaxing_mpa,
                force_n,
                relaxed_n,
                fading,
            }
        };
        if !leaves {
            return Some(moved(now.regime, stepped, (force_n, relaxed_n), fading));
        }
        let regime = match now.regime {
            RegimeKind::Free => RegimeKind::Contact,
            RegimeKind::Contact => RegimeKind::Free,
        };
        let changed = step_in(regime);
        let instant = self.arrival(now, &changed)?;
        let other = step(&mut self.manifold, &changed, &instant, &now.position, next)?;
        if regime == RegimeKind::Free && self.penetrates(next, &other.instant) {
            // Neither held nor away from the obstacle: it touches without force.
            return Some(moved(now.regime, stepped, (0.0, relaxed_n), fading));
        }
        // The load of the onset is not that of the position: its change in this step is no rate.
        let arrived = Instant { rates: [0.0; _], ..other.instant };
        let arrived_n = self.force_n(regime, next, &arrived, rates);
        let force_n = match regime {
            RegimeKind::Contact => self.relaxed_n(now, arrived_n, h),
            RegimeKind::Free => (0.0, RelaxedForce::default()),
        };
        let lost: Coordinates = std::array::from_fn(|i| now.velocity[i] - other.velocity[i]);
        let rate = self.contact_rate(&arrived).max(f64::MIN_POSITIVE);
        let of_lost = if regime == RegimeKind::Contact { dot(&lost, &lost).sqrt() / rate } else { 0.0 };
        let fading = FadingMotion { impact: fading.impact.hypot(of_lost), ..fading };
        Some(moved(regime, StepEnd { instant: arrived, ..other }, force_n, fading))
    }

    /// Circular frequency of the slowest linear mode of contact, or of the motion where it has none, rad/s.
    fn contact_rate(&self, instant: &Instant) -> f64 {
        let slowest = self.manifold.modes(RegimeKind::Contact).first();
        slowest.map_or_else(|| self.square_rate(instant).sqrt(), |mode| mode.rate_rad_s)
    }

    /// What the motion has left behind after a step.
    fn after_fading(&self, now: &MotionInstant, stepped: &StepEnd, step_ns: u64) -> FadingMotion {
        let h = step_ns as f64 * 1e-9;
        let periods = |rate: f64| rate * h / std::f64::consts::TAU;
        let square = self.square_rate(&now.instant);
        let damped = 0.5 * self.settings.damping_s * square * h;
        let kept = (-damped.max(periods(square.sqrt()) / PATH_PERIODS)).exp();
        let length = h * dot(&stepped.velocity, &stepped.velocity).sqrt();
        let of_impact = (-periods(self.contact_rate(&now.instant)) / IMPACT_PERIODS).exp();
        FadingMotion {
            path: kept * now.fading.path + length,
            impact: of_impact * now.fading.impact,
            unknown_past: kept * now.fading.unknown_past,
        }
    }

    /// True if the whole shape of a free instant, linear modes included, reaches behind the obstacle.
    fn penetrates(&mut self, inputs: &Inputs, instant: &Instant) -> bool {
        let loads = self.manifold.loads().len();
        let reached = with_loads(self.manifold.loads(), inputs, &instant.at);
        self.manifold.clearance_mm(&reached, &amplitudes(&instant.at, loads)) < 0.0
    }

    /// The present instant in another regime: loads and amplitudes at the onset nearest to the position, momenta of the velocity tested
    /// with the tangents of arrival.
    fn arrival(&mut self, now: &MotionInstant, step: &Step<'_>) -> Option<Instant> {
        let reached = with_loads(self.manifold.loads(), &now.inputs, &now.instant.at);
        let onset = self.manifold.onset_load(&reached);
        let equilibrium =
            self.manifold.equilibrium(step.regime, &reached.with(self.manifold.loads()[0].input, onset));
        let space = self.space(step.regime, &equilibrium.tangents);
        let loads = space.loads.len();
        let off = std::array::from_fn(|i| now.position[i] - equilibrium.position[i]);
        let mut at: Unknowns = std::array::from_fn(|i| if i < loads { now.instant.at[i] } else { 0.0 });
        at[0] = onset;
        let along = match step.regime {
            RegimeKind::Free => space.nearest(&off),
            RegimeKind::Contact => {
                // Where the tangents of contact are small, the loads are those of the onset.
                let mut along = space.tested(&off);
                along[..loads].fill(0.0);
                along
            }
        };
        at.iter_mut().zip(along).for_each(|(u, by)| *u += by);
        // The amplitudes are those of other modes; the loads relax on.
        let relaxing =
            now.instant.relaxing.map(|h| std::array::from_fn(|i| if i < loads { h[i] } else { 0.0 }));
        let acting = |i: usize| self.borne(&relaxing.map(|h: Unknowns| h[i]));
        let excess = std::array::from_fn(|i| step.rest[0][i] - at[i] - acting(i));
        let arrived = Instant::at_rest(at, &equilibrium, &space);
        let momenta = space.momenta(step.h, step.damping_s, &arrived.elastic, &excess, &now.velocity);
        Some(Instant { momenta, relaxing, ..arrived })
    }

    fn space<'a>(&'a self, regime: RegimeKind, tangents: &'a Tangents) -> Space<'a> {
        Space { loads: self.manifold.loads(), modes: self.manifold.modes(regime), tangents }
    }

    /// Square of the circular frequency of small swings along the first tangent, 1/s2: `X_1' M e = w^2 X_1' M X_1`.
    fn square_rate(&self, instant: &Instant) -> f64 {
        let (unit, tangent) = (&self.manifold.loads()[0].unit, &instant.tangents[0]);
        let size = dot(tangent, tangent);
        // A body that does not yield moves with no load.
        if size > 0.0 { (dot(unit, tangent) / size).abs().max(f64::MIN_POSITIVE) } else { f64::MAX }
    }
}

/// Motion at the end of [`Motion::arrive`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionArrival {
    /// Outcome of the reading.
    pub moved: MotionStep,
    /// The body landed or left on the way, or touches without force.
    pub has_changed: bool,
}

/// A motion at an instant.
#[derive(Clone, Copy, Debug)]
pub struct SavedMotion(Option<(MotionInstant, Clock)>);

/// A motion whose load and velocity are set: an estimator corrects them at each reading, and tries others.
impl<M: Manifold> Motion<M> {
    /// The motion at its last instant, for [`Self::restore`].
    pub fn keep(&self) -> SavedMotion {
        SavedMotion(self.now)
    }

    /// Returns to an instant.
    pub fn restore(&mut self, kept: &SavedMotion) {
        self.now = kept.0;
    }

    /// Regime; `None` before the first reading.
    pub fn regime(&self) -> Option<RegimeKind> {
        self.now.as_ref().map(|(now, _)| now.regime)
    }

    /// Time of the last reading, ns; `None` before the first.
    pub fn last_ns(&self) -> Option<u64> {
        self.now.as_ref().map(|(_, clock)| clock.last_ns)
    }

    /// First load (mm/s2) and velocity along its tangent as a rate of the load (mm/s3); `None` before the first reading.
    pub fn swing(&self) -> Option<[f64; 2]> {
        self.now.as_ref().map(|(now, _)| [now.instant.at[0], load_rate(&now.instant)])
    }

    /// Moves to a reading, at which a new grid of steps begins. Steps are equal and at most `longest_ns`. A first reading, one after a long
    /// gap and one to which no motion leads begin at rest. A reading that is not later than the last changes nothing.
    pub fn arrive(&mut self, t_ns: u64, inputs: &Inputs, longest_ns: u64) -> MotionArrival {
        let Some((mut now, clock)) = self.now else { return self.arrive_at_rest(t_ns, inputs) };
        let gap_ns = t_ns.saturating_sub(clock.last_ns);
        if gap_ns > self.settings.restart_after_ns {
            return self.arrive_at_rest(t_ns, inputs);
        }
        let held = gap_ns > self.settings.held_after_ns;
        let count = gap_ns.div_ceil(longest_ns.max(1));
        let at_ns = |step: u64| (u128::from(gap_ns) * u128::from(step) / u128::from(count)) as u64;
        let (mut load_distance, mut has_changed) = (0.0_f64, false);
        for step in 1..=count {
            let next = match held {
                _ if step == count => *inputs,
                true => clock.last,
                false => clock.last.between(inputs, at_ns(step) as f64 / gap_ns as f64),
            };
            let stepped = self.step(&now, at_ns(step) - at_ns(step - 1), &next);
            let Some(stepped) = stepped.filter(|next| self.outside(next) <= FAR) else {
                return self.arrive_at_rest(t_ns, inputs);
            };
            load_distance = load_distance.max(self.outside(&stepped));
            has_changed |= stepped.regime != now.regime;
            has_changed |= stepped.regime == RegimeKind::Contact && stepped.force_n <= 0.0;
            now = stepped;
        }
        let last_ns = clock.last_ns.max(t_ns);
        self.now = Some((now, Clock { begin_ns: last_ns, steps: 0, last_ns, last: now.inputs }));
        let moved = MotionStep { state: self.state(&now), load_distance, held, at_rest: false };
        MotionArrival { moved, has_changed }
    }

    fn arrive_at_rest(&mut self, t_ns: u64, inputs: &Inputs) -> MotionArrival {
        MotionArrival { moved: self.begin(t_ns, inputs), has_changed: false }
    }

    /// Sets regime, inputs (their loads are those at rest), first load and velocity along it at the last instant. Further loads, and the
    /// amplitudes of the linear modes within a regime, stay. `None` before the first reading.
    pub fn set(
        &mut self,
        regime: RegimeKind,
        inputs: &Inputs,
        [load, to_rate]: [f64; 2],
    ) -> Option<MotionState> {
        let (now, clock) = self.now?;
        let (stays, loads) = (regime == now.regime, self.manifold.loads().len());
        let kept = |i: usize| if stays || i < loads { now.instant.at[i] } else { 0.0 };
        let mut guess: Unknowns = std::array::from_fn(kept);
        guess[0] = load;
        let equilibrium =
            self.manifold.equilibrium(regime, &with_loads(self.manifold.loads(), inputs, &guess));
        let mut position = equilibrium.position;
        for (mode, y) in self.manifold.modes(regime).iter().zip(&guess[loads..]) {
            position.iter_mut().zip(&mode.shape).for_each(|(q, phi)| *q += phi * y);
        }
        let more = to_rate - load_rate(&now.instant);
        let [along, ..] = equilibrium.tangents;
        let velocity: Coordinates = std::array::from_fn(|i| now.velocity[i] + more * along[i]);
        let space = self.space(regime, &equilibrium.tangents);
        let mut momenta = if stays { now.instant.momenta } else { space.tested(&velocity) };
        let mut rates = [0.0; _];
        if stays {
            let added = space.tested(&along.map(|t| more * t));
            momenta.iter_mut().zip(added).for_each(|(p, added)| *p += added);
            rates = now.instant.rates;
            rates[0] += more;
        }
        momenta[0] = to_rate * dot(&along, &along);
        let (elastic, of_pressure) = (space.elastic(), space.nearest(&equilibrium.by_pressure));
        let tangents = equilibrium.tangents;
        let instant = Instant { at: guess, tangents, of_pressure, elastic, momenta, rates, ..now.instant };
        let force_n = match regime {
            RegimeKind::Free => 0.0,
            RegimeKind::Contact => {
                let relaxing_n = self.borne(&now.relaxed_n.internal_n);
                self.force_n(regime, inputs, &instant, [0.0; 2]).iter().sum::<f64>() + relaxing_n
            }
        };
        let now = MotionInstant { regime, instant, position, velocity, inputs: *inputs, force_n, ..now };
        self.now = Some((now, Clock { last: *inputs, ..clock }));
        Some(self.state(&now))
    }
}

/// Velocity along the tangent of the first load, as its rate.
fn load_rate(instant: &Instant) -> f64 {
    let square = dot(&instant.tangents[0], &instant.tangents[0]);
    if square > 0.0 { instant.momenta[0] / square } else { 0.0 }
}
