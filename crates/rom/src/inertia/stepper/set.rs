//! A motion whose load and velocity are set: an estimator corrects them at each reading, and tries others.

use super::{Clock, FAR, Motion, MotionState, Moved, Now};
use crate::inertia::manifold::{Coordinates, Manifold, dot};
use crate::inertia::momenta::{Instant, Unknowns, with_loads};
use crate::inputs::Inputs;
use crate::snapshots::RegimeKind;

/// Motion at the end of [`Motion::arrive`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reached {
    /// Outcome of the reading.
    pub moved: Moved,
    /// The body landed or left on the way, or touches without force.
    pub has_changed: bool,
}

/// A motion at an instant.
#[derive(Clone, Copy, Debug)]
pub struct Kept(Option<(Now, Clock)>);

impl<M: Manifold> Motion<M> {
    /// The motion at its last instant, for [`Self::restore`].
    pub fn keep(&self) -> Kept {
        Kept(self.now)
    }

    /// Returns to an instant.
    pub fn restore(&mut self, kept: &Kept) {
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
        self.now.as_ref().map(|(now, _)| [now.instant.at[0], rate(&now.instant)])
    }

    /// Moves to a reading, at which a new grid of steps begins. Steps are equal and at most `longest_ns`. A first reading, one after a long
    /// gap and one to which no motion leads begin at rest. A reading that is not later than the last changes nothing.
    pub fn arrive(&mut self, t_ns: u64, inputs: &Inputs, longest_ns: u64) -> Reached {
        let Some((mut now, clock)) = self.now else { return self.begun(t_ns, inputs) };
        let gap_ns = t_ns.saturating_sub(clock.last_ns);
        if gap_ns > self.settings.restart_after_ns {
            return self.begun(t_ns, inputs);
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
                return self.begun(t_ns, inputs);
            };
            load_distance = load_distance.max(self.outside(&stepped));
            has_changed |= stepped.regime != now.regime;
            has_changed |= stepped.regime == RegimeKind::Contact && stepped.force_n <= 0.0;
            now = stepped;
        }
        let last_ns = clock.last_ns.max(t_ns);
        self.now = Some((now, Clock { begin_ns: last_ns, steps: 0, last_ns, last: now.inputs }));
        let moved = Moved { state: self.state(&now), load_distance, held, at_rest: false };
        Reached { moved, has_changed }
    }

    fn begun(&mut self, t_ns: u64, inputs: &Inputs) -> Reached {
        Reached { moved: self.begin(t_ns, inputs), has_changed: false }
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
        let mut at: Unknowns = std::array::from_fn(kept);
        at[0] = load;
        let place = self.manifold.place(regime, &with_loads(self.manifold.loads(), inputs, &at));
        let mut position = place.position;
        for (mode, y) in self.manifold.modes(regime).iter().zip(&at[loads..]) {
            position.iter_mut().zip(&mode.shape).for_each(|(q, phi)| *q += phi * y);
        }
        let more = to_rate - rate(&now.instant);
        let [along, ..] = place.tangents;
        let velocity: Coordinates = std::array::from_fn(|i| now.velocity[i] + more * along[i]);
        let space = self.space(regime, &place.tangents);
        let mut momenta = if stays { now.instant.momenta } else { space.tested(&velocity) };
        let mut rates = [0.0; _];
        if stays {
            let added = space.tested(&along.map(|t| more * t));
            momenta.iter_mut().zip(added).for_each(|(p, added)| *p += added);
            rates = now.instant.rates;
            rates[0] += more;
        }
        momenta[0] = to_rate * dot(&along, &along);
        let (elastic, of_pressure) = (space.elastic(), space.nearest(&place.by_pressure));
        let tangents = place.tangents;
        let instant = Instant { at, tangents, of_pressure, elastic, momenta, rates, ..now.instant };
        let force_n = match regime {
            RegimeKind::Free => 0.0,
            RegimeKind::Contact => {
                let relaxing_n = self.borne(&now.relaxed_n.internal_n);
                self.force_n(regime, inputs, &instant, [0.0; 2]).iter().sum::<f64>() + relaxing_n
            }
        };
        let now = Now { regime, instant, position, velocity, inputs: *inputs, force_n, ..now };
        self.now = Some((now, Clock { last: *inputs, ..clock }));
        Some(self.state(&now))
    }
}

/// Velocity along the tangent of the first load, as its rate.
fn rate(instant: &Instant) -> f64 {
    let square = dot(&instant.tangents[0], &instant.tangents[0]);
    if square > 0.0 { instant.momenta[0] / square } else { 0.0 }
}
