//! Blocks of the law, with pressures as values: path to the target, input shaping, notch, play.

use crate::settings::Settings;
use rom::memory::{Line, MAX_PLAYS, Play};

/// One step of the line for an input that is held over it.
pub(crate) fn lag(state: f64, input: f64, line: Line, dt_s: f64) -> f64 {
    let time_s = if input >= state { line.fill_s } else { line.empty_s };
    state + (input - state) * (1.0 - (-dt_s / time_s).exp())
}

/// Play operators with their states.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plays {
    states: [f64; MAX_PLAYS],
}

impl Plays {
    /// All in the middle of their play.
    pub(crate) fn at(value: f64) -> Self {
        Self { states: [value; MAX_PLAYS] }
    }

    pub(crate) fn states(&self) -> [f64; MAX_PLAYS] {
        self.states
    }

    /// Output for an input that does not move.
    pub(crate) fn output(mut self, plays: &[Play], input: f64) -> f64 {
        self.follow(plays, input)
    }

    /// Output for an input.
    pub(crate) fn follow(&mut self, plays: &[Play], input: f64) -> f64 {
        let mut sum = input;
        for (play, state) in plays.iter().zip(&mut self.states) {
            *state = play.follow(*state, input);
            sum += play.weight * (*state - input);
        }
        sum
    }
}

/// Entries of a [`Past`].
const ENTRIES: usize = 64;
/// They, and the two between which the oldest value lies.
const KEPT: usize = ENTRIES + 2;

/// A value over the last `span_s`, at `ENTRIES` evenly spaced times.
#[derive(Debug, Clone)]
struct Past {
    spacing_s: f64,
    values: [f64; KEPT],
    newest: usize,
    /// Time since the newest entry, s.
    rest_s: f64,
}

impl Past {
    fn new(span_s: f64) -> Self {
        Self { spacing_s: span_s / ENTRIES as f64, values: [0.0; KEPT], newest: 0, rest_s: 0.0 }
    }

    fn start(&mut self, value: f64) {
        self.values = [value; KEPT];
    }

    /// `value` is reached at the end of the step.
    fn step(&mut self, value: f64, dt_s: f64) {
        let before = self.values[self.newest];
        self.rest_s += dt_s;
        let mut passed = 0;
        while self.rest_s >= self.spacing_s && passed < KEPT {
            self.rest_s -= self.spacing_s;
            self.newest = (self.newest + 1) % KEPT;
            // The value at that instant on the line from the last entry.
            let along = (1.0 - self.rest_s / dt_s).clamp(0.0, 1.0);
            self.values[self.newest] = before + (value - before) * along;
            passed += 1;
        }
        self.rest_s = self.rest_s.min(self.spacing_s);
    }

    /// The value `entries` spacings ago.
    fn late(&self, entries: usize) -> f64 {
        let [older, newer] =
            [entries, entries - 1].map(|back| self.values[(self.newest + KEPT - back) % KEPT]);
        older + (newer - older) * (self.rest_s / self.spacing_s)
    }
}

/// A value as it was a fixed time ago.
#[derive(Debug, Clone)]
pub(crate) struct Delay {
    past: Option<Past>,
}

impl Delay {
    pub(crate) fn new(delay_s: f64) -> Self {
        Self { past: (delay_s > 0.0).then(|| Past::new(delay_s)) }
    }

    pub(crate) fn start(&mut self, value: f64) {
        if let Some(past) = &mut self.past {
            past.start(value);
        }
    }

    /// The late value; `value` is reached at the end of the step.
    pub(crate) fn step(&mut self, value: f64, dt_s: f64) -> f64 {
        let Some(past) = &mut self.past else { return value };
        past.step(value, dt_s);
        past.late(ENTRIES)
    }
}

/// Shaper of zero vibration and derivative (Singer and Seering 1990): the input now, half a period and a period ago, weighted so that their swings
/// cancel, also with a frequency that is off by some percent. A convex sum of paths that the line can follow is one as well.
#[derive(Debug, Clone)]
pub(crate) struct Shaper {
    weights: [f64; 3],
    /// Over a period; `None` without swing.
    past: Option<Past>,
}

impl Shaper {
    pub(crate) fn new(settings: &Settings) -> Self {
        let damped = (1.0 - settings.swing_damping.powi(2)).sqrt();
        let decay = (-std::f64::consts::PI * settings.swing_damping / damped).exp();
        let sum = (1.0 + decay).powi(2);
        let period_s = 1.0 / (settings.swing_hz * damped);
        Self {
            weights: [1.0 / sum, 2.0 * decay / sum, decay * decay / sum],
            past: (settings.swing_hz > 0.0).then(|| Past::new(period_s)),
        }
    }

    pub(crate) fn start(&mut self, value: f64) {
        if let Some(past) = &mut self.past {
            past.start(value);
        }
    }

    /// Shaped value; `value` is reached at the end of the step.
    pub(crate) fn step(&mut self, value: f64, dt_s: f64) -> f64 {
        let Some(past) = &mut self.past else { return value };
        past.step(value, dt_s);
        let [now, half, whole] = self.weights;
        now * value + half * past.late(ENTRIES / 2) + whole * past.late(ENTRIES)
    }
}

/// Notch at the swing, wide enough for a frequency that is off by some percent; trapezoidal rule at any step.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Notch {
    states: [f64; 2],
}

/// Damping of the notch's poles and zeros.
const NOTCH: [f64; 2] = [0.7, 0.05];

impl Notch {
    pub(crate) fn start(&mut self, value: f64) {
        self.states = [0.0, value];
    }

    pub(crate) fn step(&mut self, value: f64, hz: f64, dt_s: f64) -> f64 {
        if hz <= 0.0 || dt_s <= 0.0 {
            return value;
        }
        let g = (std::f64::consts::PI * hz * dt_s).min(1.0).tan();
        let [pole, zero] = NOTCH;
        let band = (self.states[0] + g * (value - self.states[1])) / (1.0 + g * (g + 2.0 * pole));
        let low = self.states[1] + g * band;
        self.states = [2.0 * band - self.states[0], 2.0 * low - self.states[1]];
        value - 2.0 * (pole - zero) * band
    }
}

/// Path of the reference: first order towards the target, within what the line gives in each direction.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Path {
    pub(crate) value: f64,
}

impl Path {
    /// Advances towards `target`, which moves by `rate` per second; `slopes` are the largest fall (negative) and rise.
    pub(crate) fn step(
        &mut self,
        target: f64,
        rate: f64,
        slopes: [f64; 2],
        approach_s: f64,
        dt_s: f64,
    ) -> bool {
        let from = self.value;
        let end = target + (from - (target - rate * dt_s)) * (-dt_s / approach_s).exp();
        let [fall, rise] = slopes.map(|slope| slope * dt_s);
        self.value = from + (end - from).clamp(fall, rise);
        self.value != end
    }
}
