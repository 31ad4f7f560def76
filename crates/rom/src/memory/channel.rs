//! States of one input's blocks.

use super::creep::MAX_CREEPS;
use super::play::MAX_PLAYS;
use super::spec::InputMemory;

/// Longest inner step as a fraction of the shortest creep time.
const INNER: f64 = 0.25;
/// Time of an orifice's flow that counts as a time constant for the inner steps.
const FLOW: f64 = 0.2;
/// Most inner steps.
const MAX_INNER: f64 = 64.0;

/// Line, play and creep of an input at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Channel {
    input: f64,
    line: f64,
    plays: [f64; MAX_PLAYS],
    after_play: f64,
    creeps: [f64; MAX_CREEPS],
    output: f64,
}

impl Channel {
    /// All states in equilibrium with `past`, the input now being `input`.
    pub(super) fn at_rest(of: &InputMemory, past: f64, input: f64) -> Self {
        let mut channel = Self {
            input,
            line: if of.has_lag() { past } else { input },
            plays: [past; MAX_PLAYS],
            after_play: past,
            creeps: [past; MAX_CREEPS],
            output: past,
        };
        channel.follow(of);
        channel.read(of);
        channel
    }

    pub(super) fn output(&self) -> f64 {
        self.output
    }

    /// Pressure behind the line.
    pub(super) fn behind_line(&self) -> f64 {
        self.line
    }

    pub(super) fn input(&self) -> f64 {
        self.input
    }

    /// States of the creep terms.
    pub(super) fn creeps(&self) -> &[f64; MAX_CREEPS] {
        &self.creeps
    }

    /// The input jumps.
    pub(super) fn jump(&mut self, of: &InputMemory, to: f64) {
        self.input = to;
        if !of.has_lag() {
            self.line = to;
        }
        self.follow(of);
        self.read(of);
    }

    /// The input goes to `to` within `dt_s`: straight, or after a gap by a jump at its end. Nothing happens within no time.
    pub(super) fn advance(&mut self, of: &InputMemory, to: f64, dt_s: f64, max_gap_s: f64) {
        if dt_s > max_gap_s {
            self.step(of, self.input, dt_s);
            self.jump(of, to);
        } else if dt_s > 0.0 {
            self.step(of, to, dt_s);
        }
    }

    /// The input goes straight to `to` within `dt_s`, which is above 0.
    pub(super) fn step(&mut self, of: &InputMemory, to: f64, dt_s: f64) {
        let shortest = of.creep.iter().map(|creep| creep.time_s).fold(f64::INFINITY, f64::min);
        let shortest = of.orifice.map_or(shortest, |orifice| shortest.min(FLOW * orifice.time_s));
        let count = (dt_s / (INNER * shortest)).ceil().clamp(1.0, MAX_INNER);
        let (from, inner_s) = (self.input, dt_s / count);
        for k in 1..=count as u32 {
            let next = from + (to - from) * f64::from(k) / count;
            let of_orifice = of.orifice.map(|orifice| orifice.within(self.line, self.input, next, inner_s));
            match of.line.or(of_orifice).map(|line| line.step(self.line, self.input, next, inner_s)) {
                Some((end, turn)) => {
                    let mut rest_s = inner_s;
                    if let Some(turn) = turn {
                        self.line = turn.value;
                        self.drive(of, turn.after_s);
                        rest_s -= turn.after_s;
                    }
                    self.line = end;
                    self.drive(of, rest_s);
                }
                None => {
                    self.line = next;
                    self.drive(of, inner_s);
                }
            }
            self.input = next;
        }
        self.read(of);
    }

    /// Play and creep follow the line, which has not turned for `dt_s`.
    fn drive(&mut self, of: &InputMemory, dt_s: f64) {
        let before = self.after_play;
        self.follow(of);
        if dt_s > 0.0 {
            for (creep, state) in of.creep.iter().zip(&mut self.creeps) {
                *state = creep.step(*state, before, self.after_play, dt_s);
            }
        }
    }

    fn follow(&mut self, of: &InputMemory) {
        let mut sum = self.line;
        for (play, state) in of.play.iter().zip(&mut self.plays) {
            *state = play.follow(*state, self.line);
            sum += play.weight * (*state - self.line);
        }
        self.after_play = sum;
    }

    fn read(&mut self, of: &InputMemory) {
        let late = of.creep.iter().zip(&self.creeps);
        self.output =
            self.after_play + late.map(|(c, state)| c.weight * (state - self.after_play)).sum::<f64>();
    }
}
