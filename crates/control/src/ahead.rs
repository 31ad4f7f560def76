//! Targets ahead of now, from what a caller knows of them: a value and its rate, or a series of values to come.

use crate::law::Target;

/// Values that follow each other at equal times, the first one now; after the last one it stays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetSeries<'a> {
    pub values: &'a [f64],
    /// Time from one value to the next, s.
    pub interval_s: f64,
}

impl TargetSeries<'_> {
    /// The target at a time ahead, on the straight line between two values.
    pub fn at(&self, ahead_s: f64) -> Target {
        let Some(last) = self.values.len().checked_sub(1) else { return Target::step(f64::NAN) };
        let along = (ahead_s / self.interval_s).max(0.0);
        if along >= last as f64 {
            return Target::step(self.values[last]);
        }
        let before = along as usize;
        let change = self.values[before + 1] - self.values[before];
        Target {
            value: self.values[before] + (along - before as f64) * change,
            rate: change / self.interval_s,
        }
    }
}

/// Time constant of the lag that smooths the change of the rate, s.
const SMOOTH_S: f64 = 0.03;
/// Time for which the change of the rate goes on: a target is known no farther.
const KEPT_S: f64 = 0.3;

/// Continues a target of which value and rate are known: the rate changes on as it has done, less and less. The lead of the law, shaper and
/// delay together, is a good part of a sine's period, over which a straight line overshoots: at 0.5 Hz and 0.25 s by 28 % of the amplitude.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct TargetTrend {
    last_rate: Option<f64>,
    /// The last changes of the rate per second, and their smoothed middle one: a bend, as at the beginning of a ramp, is one change that does not
    /// go on.
    changes: [f64; 3],
    smooth: f64,
}

impl TargetTrend {
    /// Takes the target of now; the targets ahead follow.
    pub(crate) fn step(&mut self, target: Target, dt_s: f64) -> impl Fn(f64) -> Target + use<> {
        let change = match self.last_rate {
            Some(last) if dt_s > 0.0 => (target.rate - last) / dt_s,
            _ => 0.0,
        };
        self.last_rate = Some(target.rate);
        let [first, second, _] = self.changes;
        self.changes = [change, first, second];
        let mut sorted = self.changes;
        sorted.sort_by(f64::total_cmp);
        self.smooth += (sorted[1] - self.smooth) * (1.0 - (-dt_s / SMOOTH_S).exp());
        let smooth = self.smooth;
        move |ahead_s| {
            let gone = KEPT_S * -(-ahead_s / KEPT_S).exp_m1();
            Target {
                value: target.value + target.rate * ahead_s + smooth * KEPT_S * (ahead_s - gone),
                rate: target.rate + smooth * gone,
            }
        }
    }
}

#[cfg(test)]
#[path = "../tests/unit/ahead.rs"]
mod tests;
