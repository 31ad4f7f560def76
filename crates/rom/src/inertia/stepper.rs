//! Motion over time: inner steps of fixed length, landing and leaving, defined outcomes of bad readings.
//!
//! Inner steps lie on a grid that begins at the first reading; inputs are straight lines between readings; a reading between two
//! instants of the grid is answered by a shorter step that is not kept. Results thus do not depend on how readings are cut.
//!
//! **Landing**: a step whose whole shape, linear modes included, penetrates the obstacle is repeated in contact: from the load of the
//! onset, amplitudes by projection of the position, momenta those of the velocity tested with the tangents of contact. **Leaving**: a
//! step whose contact force is negative is repeated free, in the same way. Projection never adds kinetic energy.

use super::manifold::{Amplitudes, Coordinates, MAX_LINEAR_MODES, Manifold, dot};
use super::momenta::{Forces, Instant, Step, Stepped, solve, step};
use crate::inputs::Inputs;
use crate::memory::{MAX_PRONY, PronyTerm};
use crate::snapshots::RegimeKind;
use thiserror::Error;

/// Distance beyond the training range of the load, as a fraction of it, at which the motion restarts at rest.
const FAR: f64 = 1.0;

/// Periods of the slowest linear mode of contact in which the effect of an impact fades by a factor of e.
const IMPACT_PERIODS: f64 = 3.0;
/// Periods in which the path of an undamped swing is forgotten by a factor of e.
const PATH_PERIODS: f64 = 32.0;
/// Load of a swing that an unknown past may have left, as a fraction of the training range of the load.
const PAST_FRACTION: f64 = 0.25;

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
pub enum ReadingError {
    /// Time is not later than that of the last reading.
    #[error("a reading at {found_ns} ns is not later than the last one, at {last_ns} ns")]
    NotLater {
        /// Its time.
        found_ns: u64,
        /// Time of the last reading.
        last_ns: u64,
    },
    /// An input that the model needs is not finite.
    #[error("a reading at {found_ns} ns has no finite pressure or load at rest")]
    NotFinite {
        /// Its time.
        found_ns: u64,
    },
}

/// Outcome of a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moved {
    /// State of the motion at the reading.
    pub state: MotionState,
    /// Largest distance of the load from its training range since the last reading, as a fraction of it; 0 inside.
    pub load_distance: f64,
    /// The inputs were held over a gap in the readings.
    pub held: bool,
    /// The motion began at rest with this reading: the first one, one after a long gap, or one at which the motion could not be continued.
    pub at_rest: bool,
}

/// Motion at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionState {
    /// Regime.
    pub regime: RegimeKind,
    /// Inputs, with the inertial load (mm/s2) in place of the load at rest.
    pub inputs: Inputs,
    /// Amplitudes of the linear modes, mm t^1/2.
    pub amplitudes: Amplitudes,
    /// Contact force, N; 0 when free, never negative.
    pub contact_force_n: f64,
    /// Kinetic energy, mJ.
    pub kinetic_mj: f64,
    /// Path of the motion, which fades as a swing does; amplitude of what impacts took from it, and of a swing that an unknown past may
    /// have left; mm, mass-weighted root mean square over the body.
    pub amplitudes_mm: [f64; 3],
}

/// Everything that the next step depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Now {
    regime: RegimeKind,
    instant: Instant,
    position: Coordinates,
    velocity: Coordinates,
    /// Inputs with the load at rest.
    inputs: Inputs,
    force_n: f64,
    /// Force of the relaxed elastomer, and its internal variables.
    relaxed_n: Relaxed,
    /// Path, and amplitudes of impacts and of an unknown past, in coordinates.
    faded: [f64; 3],
}

/// Contact force of the relaxed elastomer, N, and internal variables of its relaxation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Relaxed {
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
    now: Option<(Now, Clock)>,
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

    /// Takes readings as instants of one recording that begins at rest: inputs are straight lines between any two, however long.
    pub(super) fn as_recording(&mut self) {
        self.is_past_unknown = false;
        (self.settings.held_after_ns, self.settings.restart_after_ns) = (u64::MAX, u64::MAX);
    }

    /// Forgets the motion: the next reading begins at rest.
    pub fn reset(&mut self) {
        self.now = None;
    }

    /// Moves to a reading. Allocates nothing. Cost: `O(time / step)` inner steps and one more.
    ///
    /// # Errors
    /// [`ReadingError`]; the motion is unchanged.
    pub fn advance(&mut self, t_ns: u64, inputs: &Inputs) -> Result<Moved, ReadingError> {
        let rest = inputs.values()[self.manifold.load_input()];
        if !(inputs.pressure_mpa().is_finite() && rest.is_finite()) || inputs.gap_mm().is_nan() {
            return Err(ReadingError::NotFinite { found_ns: t_ns });
        }
        let Some((mut now, mut clock)) = self.now else { return Ok(self.begin(t_ns, inputs)) };
        if t_ns <= clock.last_ns {
            return Err(ReadingError::NotLater { found_ns: t_ns, last_ns: clock.last_ns });
        }
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
                return Ok(Moved { state, load_distance, held, at_rest: false });
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

    /// Distance of the load from its training range, as a fraction of it.
    fn outside(&self, now: &Now) -> f64 {
        let [low, high] = self.manifold.load_range();
        (low - now.instant.load).max(now.instant.load - high).max(0.0) / (high - low)
    }

    /// At rest under the reading's inputs.
    fn begin(&mut self, t_ns: u64, inputs: &Inputs) -> Moved {
        self.manifold.forget();
        let still = Amplitudes::default();
        let is_free = self.manifold.clearance_mm(inputs, &still) >= 0.0;
        let regime = if is_free { RegimeKind::Free } else { RegimeKind::Contact };
        let place = self.manifold.place(regime, inputs);
        let load = inputs.values()[self.manifold.load_input()];
        let instant = Instant {
            load,
            amplitudes: still,
            tangent: place.tangent,
            momenta: [0.0; _],
            rates: [0.0; _],
            relaxing: [[0.0; _]; _],
        };
        let (position, velocity) = (place.position, Coordinates::default());
        let [force_n, _] = self.force_n(regime, inputs, &instant, [0.0; 2]);
        let relaxed_n = Relaxed { force_n, ..Relaxed::default() };
        let range = self.manifold.load_range();
        let reach = if self.is_past_unknown { PAST_FRACTION * (range[1] - range[0]) } else { 0.0 };
        // A swing is one of the free body, which may touch only now.
        let tangent = self.manifold.place(RegimeKind::Free, inputs).tangent;
        let past = reach * dot(&tangent, &tangent).sqrt();
        let faded = [0.0, 0.0, past];
        let now = Now { regime, instant, position, velocity, inputs: *inputs, force_n, relaxed_n, faded };
        self.now = Some((now, Clock { begin_ns: t_ns, steps: 0, last_ns: t_ns, last: *inputs }));
        let state = self.state(&now);
        Moved { state, load_distance: self.outside(&now), held: false, at_rest: true }
    }

    fn state(&self, now: &Now) -> MotionState {
        let mass = dot(self.manifold.unit_load(), self.manifold.unit_load());
        MotionState {
            amplitudes_mm: now.faded.map(|length| if mass > 0.0 { length / mass.sqrt() } else { 0.0 }),
            regime: now.regime,
            inputs: now.inputs.with(self.manifold.load_input(), now.instant.load),
            amplitudes: now.instant.amplitudes,
            contact_force_n: now.force_n.max(0.0),
            kinetic_mj: 0.5 * dot(&now.velocity, &now.velocity),
        }
    }

    /// Contact force `F` of the relaxed elastomer, and the part of the damping, `beta dF/dt`, where pressure and gap change by `rates` per
    /// second.
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
        let inputs = inputs.with(self.manifold.load_input(), instant.load);
        let force = self.manifold.force(&inputs, &instant.amplitudes);
        let by = std::iter::once(&force.by_load).chain(&force.by_amplitude).zip(instant.rates);
        let by = by.chain(force.by_operation.iter().zip(rates));
        [force.n, self.settings.damping_s * by.map(|(by, rate)| by * rate).sum::<f64>()]
    }

    /// Contact force after a step, and what the next one needs of it.
    fn relaxed_n(&self, now: &Now, [force_n, damping_n]: [f64; 2], h: f64) -> (f64, Relaxed) {
        let mut next = Relaxed { force_n, ..now.relaxed_n };
        let mut sum = force_n + damping_n;
        for (term, state) in self.prony[..self.terms].iter().zip(&mut next.internal_n) {
            let (e, a) = term.within(h);
            *state = e * *state + a * (force_n - now.relaxed_n.force_n);
            sum += term.ratio * *state;
        }
        (sum, next)
    }

    /// One step with its change of regime, if any.
    fn step(&mut self, now: &Now, step_ns: u64, next: &Inputs) -> Option<Now> {
        let at = self.manifold.load_input();
        let damping_s = self.settings.damping_s;
        let (prony, terms) = (self.prony, self.terms);
        let of = |regime| Step {
            regime,
            prony: &prony[..terms],
            h: step_ns as f64 * 1e-9,
            damping_s,
            rest: [now.inputs.values()[at], next.values()[at]],
        };
        let stepped = step(&mut self.manifold, &of(now.regime), &now.instant, &now.position, next)?;
        let rate = |of: fn(&Inputs) -> f64| {
            let change = of(next) - of(&now.inputs);
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
        let faded = self.faded(now, &stepped, step_ns);
        if !leaves {
            return Some(moved(now.regime, stepped, next, (force_n, relaxed_n), faded));
        }
        let regime = match now.regime {
            RegimeKind::Free => RegimeKind::Contact,
            RegimeKind::Contact => RegimeKind::Free,
        };
        let changed = of(regime);
        let instant = self.arrival(now, &changed)?;
        let other = step(&mut self.manifold, &changed, &instant, &now.position, next)?;
        if regime == RegimeKind::Free && self.penetrates(next, &other.instant) {
            // Neither held nor away from the obstacle: it touches without force.
            return Some(moved(now.regime, stepped, next, (0.0, relaxed_n), faded));
        }
        // The load of the onset is not that of the position: its change in this step is no rate.
        let arrived = Instant { rates: [0.0; _], ..other.instant };
        let arrived_n = self.force_n(regime, next, &arrived, rates);
        let force_n = match regime {
            RegimeKind::Contact => self.relaxed_n(now, arrived_n, h),
            RegimeKind::Free => (0.0, Relaxed::default()),
        };
        let lost: Coordinates = std::array::from_fn(|i| now.velocity[i] - other.velocity[i]);
        let rate = self.contact_rate(&arrived).max(f64::MIN_POSITIVE);
        let [path, impact, past] = faded;
        let faded = match regime {
            RegimeKind::Contact => [path, impact.hypot(dot(&lost, &lost).sqrt() / rate), past],
            RegimeKind::Free => faded,
        };
        Some(moved(regime, Stepped { instant: arrived, ..other }, next, force_n, faded))
    }

    /// Circular frequency of the slowest linear mode of contact, or of the motion where it has none, rad/s.
    fn contact_rate(&self, instant: &Instant) -> f64 {
        let slowest = self.manifold.modes(RegimeKind::Contact).first();
        slowest.map_or_else(|| square_rate(self.manifold.unit_load(), instant).sqrt(), |mode| mode.rate_rad_s)
    }

    /// Path, and amplitudes of impacts and of an unknown past, after a step.
    fn faded(&self, now: &Now, stepped: &Stepped, step_ns: u64) -> [f64; 3] {
        let h = step_ns as f64 * 1e-9;
        let periods = |rate: f64| rate * h / std::f64::consts::TAU;
        let square = square_rate(self.manifold.unit_load(), &now.instant);
        let damped = 0.5 * self.settings.damping_s * square * h;
        let kept = (-damped.max(periods(square.sqrt()) / PATH_PERIODS)).exp();
        let [path, impact, past] = now.faded;
        let length = h * dot(&stepped.velocity, &stepped.velocity).sqrt();
        let of_impact = (-periods(self.contact_rate(&now.instant)) / IMPACT_PERIODS).exp();
        [kept * path + length, of_impact * impact, kept * past]
    }

    /// True if the whole shape of a free instant, linear modes included, reaches behind the obstacle.
    fn penetrates(&mut self, inputs: &Inputs, instant: &Instant) -> bool {
        let reached = inputs.with(self.manifold.load_input(), instant.load);
        self.manifold.clearance_mm(&reached, &instant.amplitudes) < 0.0
    }

    /// The present instant in another regime: load and amplitudes at the onset nearest to the position, momenta of the velocity tested
    /// with the tangents of arrival.
    fn arrival(&mut self, now: &Now, step: &Step<'_>) -> Option<Instant> {
        let at = self.manifold.load_input();
        let inputs = now.inputs.with(at, now.instant.load);
        let onset = self.manifold.onset_load(&inputs);
        let place = self.manifold.place(step.regime, &inputs.with(at, onset));
        let modes = self.manifold.modes(step.regime);
        let forces = Forces { modes, unit_load: self.manifold.unit_load(), damping_s: step.damping_s };
        let off = std::array::from_fn(|i| now.position[i] - place.position[i]);
        let (mut load, mut amplitudes) = (onset, Amplitudes::default());
        if step.regime == RegimeKind::Free {
            // Least squares over load and amplitudes.
            let count = 1 + modes.len();
            let mut matrix = [[0.0; 1 + MAX_LINEAR_MODES]; 1 + MAX_LINEAR_MODES];
            matrix[0] = forces.tested(&place.tangent, &place.tangent);
            for (k, mode) in modes.iter().enumerate() {
                matrix[0][1 + k] = dot(&place.tangent, &mode.shape);
                matrix[1 + k] = forces.tested(&place.tangent, &mode.shape);
            }
            let mut right = forces.tested(&place.tangent, &off);
            solve(&mut matrix, &mut right, count)?;
            load += right[0];
            amplitudes[..modes.len()].copy_from_slice(&right[1..count]);
        } else {
            // Where the tangent of contact is small, the load is that of the onset.
            amplitudes.iter_mut().zip(modes).for_each(|(y, mode)| *y = dot(&mode.shape, &off));
        }
        // The amplitudes are those of other modes; the load relaxes on.
        let relaxing =
            now.instant.relaxing.map(|[load, ..]| std::array::from_fn(|i| if i == 0 { load } else { 0.0 }));
        let acting =
            step.prony.iter().zip(&relaxing).map(|(term, h): (_, &[f64; _])| term.ratio * h[0]).sum::<f64>();
        let excess = step.rest[0] - load - acting;
        let momenta = forces.momenta(step.h, excess, &amplitudes, &place.tangent, &now.velocity);
        Some(Instant { load, amplitudes, tangent: place.tangent, momenta, rates: [0.0; _], relaxing })
    }
}

fn moved(
    regime: RegimeKind,
    stepped: Stepped,
    inputs: &Inputs,
    (force_n, relaxed_n): (f64, Relaxed),
    faded: [f64; 3],
) -> Now {
    let Stepped { instant, position, velocity } = stepped;
    Now { regime, instant, position, velocity, inputs: *inputs, force_n, relaxed_n, faded }
}

/// Square of the circular frequency of small swings along the tangent, 1/s2: `X_a' M e = w^2 X_a' M X_a`.
fn square_rate(unit: &Coordinates, instant: &Instant) -> f64 {
    let size = dot(&instant.tangent, &instant.tangent);
    // A body that does not yield moves with no load.
    if size > 0.0 { (dot(unit, &instant.tangent) / size).abs().max(f64::MIN_POSITIVE) } else { f64::MAX }
}
