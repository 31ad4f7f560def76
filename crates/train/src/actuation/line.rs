//! The line between command and gauge, its delay, and how fast the valve moves, from an experiment.
//!
//! ```text
//! w' = (u(t - delay) - w) as fast as the valve moves,   c' = (w - c) / tau of filling or emptying,   p = offset + gain c
//! ```
//!
//! A wrong delay is mistaken for a lag of the line, and the other way round, so all constants are fitted together, to every reading: thinned
//! readings do not show a delay. The scan over the delay finds the right valley, Gauss and Newton's method its bottom. Each interval is the
//! spread over the constants that follow when a tenth of the record is left out, which includes what the equations above do not describe.

use super::data::{ActuationCycle, ConstantInterval, Constants};
use rom::dense::Dense;
use rom::memory::Line;
use rom::statistics::mean;
use serde::Serialize;

/// A line with its delay.
#[derive(Debug, Clone, Serialize)]
pub struct ActuationLine {
    /// Its times, as a line.
    #[serde(skip)]
    pub line: Line,
    /// Its times and their intervals.
    #[serde(rename = "line")]
    pub constants: Constants,
    /// Time from command to valve.
    pub delay: ConstantInterval,
    /// Fastest change that the valve gives; absent where the experiment was not faster.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub valve_rate: Option<ConstantInterval>,
    /// Root mean square of what the line leaves of the gauge.
    pub residual_mpa: f64,
}

/// Delays that are scanned: up to the most, at these distances without and with a limited rate of the valve.
const MOST_DELAY_S: f64 = 0.3;
const SCAN_S: [f64; 2] = [0.01, 0.03];
/// Times of the line, s, at which the scan begins and between which they are sought.
const FIRST_S: f64 = 0.1;
const TIME_S: [f64; 2] = [1e-3, 60.0];
/// Rates of the valve that are tried, relative to the fastest change of the command.
const RATES: [f64; 6] = [0.6, 0.35, 0.2, 0.12, 0.07, 0.04];
/// Squares with a limited rate, relative to those without, below which the rate is one.
const RATE_SHARE: f64 = 0.8;
/// Part of the gauge's variance that a line leaves at most.
const UNEXPLAINED: f64 = 0.5;
/// Parts of the record of which each is left out once.
const PARTS: usize = 10;
/// 95 % quantile of Student's distribution with `PARTS - 1` degrees of freedom.
const STUDENT: f64 = 1.833;

/// Unknowns: delay in s; logarithms of the times in s and of the valve's rate in MPa/s.
type Unknowns = [f64; 4];
const DELAY: usize = 0;
const FILL: usize = 1;
const EMPTY: usize = 2;
const RATE: usize = 3;
/// Changes of the unknowns for their derivatives.
const CHANGE: Unknowns = [5e-4, 1e-3, 1e-3, 1e-3];

/// Readings of the gauge and the commands before them.
struct Record {
    time_s: Vec<f64>,
    command_mpa: Vec<f64>,
    gauge_mpa: Vec<f64>,
}

/// Unknowns with what they leave of the gauge.
#[derive(Clone)]
struct Fit {
    unknowns: Unknowns,
    residuals_mpa: Vec<f64>,
    squares: f64,
}

/// The line between command and gauge; `None` where the gauge does not follow the command.
pub(super) fn line(rows: &[ActuationCycle]) -> Option<ActuationLine> {
    let rows = || rows.iter().filter(|row| row.gauge_mpa.is_finite() && row.command_mpa.is_finite());
    let record = Record {
        time_s: rows().map(|row| row.time_s).collect(),
        command_mpa: rows().map(|row| row.command_mpa).collect(),
        gauge_mpa: rows().map(|row| row.gauge_mpa).collect(),
    };
    let (lag, rate_too) = ([DELAY, FILL, EMPTY], [DELAY, FILL, EMPTY, RATE]);
    let at_once = record.descend(record.scan(f64::INFINITY, SCAN_S[0])?, &lag);
    let fastest = record.fastest_mpa_per_s();
    let by_rate = RATES.iter().filter_map(|rate| record.scan((rate * fastest).ln(), SCAN_S[1]));
    let by_rate = by_rate.min_by(|a, b| a.squares.total_cmp(&b.squares))?;
    let by_rate = record.descend(by_rate, &rate_too);
    let has_rate = by_rate.squares < RATE_SHARE * at_once.squares && by_rate.unknowns[RATE] < fastest.ln();
    let (found, sought): (Fit, &[usize]) = if has_rate { (by_rate, &rate_too) } else { (at_once, &lag) };
    let count = record.gauge_mpa.len() as f64;
    let middle_mpa = mean(record.gauge_mpa.iter().copied());
    let all: f64 = record.gauge_mpa.iter().map(|gauge_mpa| (gauge_mpa - middle_mpa).powi(2)).sum();
    let follows = found.squares < UNEXPLAINED * all;
    if !follows {
        return None;
    }
    let spread = record.spread(&found, sought)?;
    let constant = |index: usize, unit: &'static str| {
        let [low, value, high] = [-spread[index], 0.0, spread[index]]
            .map(|off| found.unknowns[index] + off)
            .map(|unknown| if index == DELAY { unknown.max(0.0) } else { unknown.exp() });
        ConstantInterval { value, interval: [low, high], unit }
    };
    let [fill, empty] = [FILL, EMPTY].map(|at| constant(at, "s"));
    Some(ActuationLine {
        line: Line { fill_s: fill.value, empty_s: empty.value },
        constants: [("filling", fill), ("emptying", empty)].into_iter().collect(),
        delay: constant(DELAY, "s"),
        valve_rate: has_rate.then(|| constant(RATE, "MPa/s")),
        residual_mpa: (found.squares / count).sqrt(),
    })
}

impl Record {
    fn fastest_mpa_per_s(&self) -> f64 {
        let steps = self.time_s.windows(2).zip(self.command_mpa.windows(2));
        let rates = steps.map(|(time_s, mpa)| (mpa[1] - mpa[0]).abs() / (time_s[1] - time_s[0]).max(1e-4));
        rates.fold(1e-6, f64::max)
    }

    /// The best of all delays with a given rate of the valve; the times are fitted to each.
    fn scan(&self, rate: f64, step_s: f64) -> Option<Fit> {
        let mut unknowns = [0.0, FIRST_S.ln(), FIRST_S.ln(), rate];
        let of_delay = |step: usize| {
            unknowns[DELAY] = step as f64 * step_s;
            let fit = self.descend(self.fit(unknowns), &[FILL, EMPTY]);
            unknowns = fit.unknowns;
            fit
        };
        let fits = (0..=(MOST_DELAY_S / step_s) as usize).map(of_delay);
        fits.filter(|fit| fit.squares.is_finite()).min_by(|a, b| a.squares.total_cmp(&b.squares))
    }

    /// Gauss and Newton's method in some of the unknowns; a step that does not help is halved.
    fn descend(&self, mut at: Fit, sought: &[usize]) -> Fit {
        const STEPS: usize = 20;
        const ENOUGH: f64 = 1e-4;
        for _ in 0..STEPS {
            let Some(step) = self.step(&at, sought, &|_| true) else { break };
            let before = at.squares;
            let halved = (0..5).map(|halvings| 0.5_f64.powi(halvings));
            let tried = halved.map(|share| self.fit(moved(at.unknowns, sought, &step, share)));
            let Some(better) = tried.into_iter().find(|fit| fit.squares < before) else { break };
            at = better;
            if at.squares > (1.0 - ENOUGH) * before {
                break;
            }
        }
        at
    }

    /// The step of the unknowns to the least squares of the readings that `is_taken` names, linear in the unknowns.
    fn step(&self, at: &Fit, sought: &[usize], is_taken: &dyn Fn(usize) -> bool) -> Option<Vec<f64>> {
        let slopes: Vec<Vec<f64>> = sought
            .iter()
            .map(|unknown| {
                let change = CHANGE[*unknown];
                let beside = self.fit(moved(at.unknowns, &[*unknown], &[change], 1.0));
                let pairs = beside.residuals_mpa.iter().zip(&at.residuals_mpa);
                pairs.map(|(beside, here)| (beside - here) / change).collect()
            })
            .collect();
        let sum = |a: &[f64], b: &[f64]| -> f64 {
            let pairs = a.iter().zip(b).enumerate().filter(|(index, _)| is_taken(*index));
            pairs.map(|(_, (a, b))| a * b).sum()
        };
        let normal = Dense::from_fn(sought.len(), |row, column| sum(&slopes[row], &slopes[column]));
        let mut step: Vec<f64> = slopes.iter().map(|slope| -sum(slope, &at.residuals_mpa)).collect();
        normal.solve(&mut step, 1)?;
        step.iter().all(|change| change.is_finite()).then_some(step)
    }

    /// Half-width of each unknown's 90 % interval, by leaving out each part of the record once.
    fn spread(&self, at: &Fit, sought: &[usize]) -> Option<Unknowns> {
        let count = self.time_s.len();
        let steps: Option<Vec<Vec<f64>>> =
            (0..PARTS).map(|part| self.step(at, sought, &|row| row * PARTS / count != part)).collect();
        let steps = steps?;
        let mut spread = [0.0; 4];
        for (column, unknown) in sought.iter().enumerate() {
            let estimates = || steps.iter().map(|step| step[column]);
            let middle = mean(estimates());
            let squares: f64 = estimates().map(|step| (step - middle).powi(2)).sum();
            spread[*unknown] = STUDENT * (squares * (PARTS - 1) as f64 / PARTS as f64).sqrt();
        }
        Some(spread)
    }

    fn fit(&self, unknowns: Unknowns) -> Fit {
        let shown_mpa = self.response(unknowns);
        let [of_line, of_gauge] = [&shown_mpa, &self.gauge_mpa].map(|values| mean(values.iter().copied()));
        let (mut both, mut square) = (0.0, f64::MIN_POSITIVE);
        for (line, gauge) in shown_mpa.iter().zip(&self.gauge_mpa) {
            both += (line - of_line) * (gauge - of_gauge);
            square += (line - of_line).powi(2);
        }
        let gain = (both / square).max(0.0);
        let residuals_mpa: Vec<f64> = shown_mpa
            .iter()
            .zip(&self.gauge_mpa)
            .map(|(line, gauge)| gauge - of_gauge - gain * (line - of_line))
            .collect();
        let squares = residuals_mpa.iter().map(|residual| residual * residual).sum();
        Fit { unknowns, residuals_mpa, squares }
    }

    /// Pressure behind the line at each reading: a command holds from its delayed time to that of the next one.
    fn response(&self, [delay_s, fill, empty, rate]: Unknowns) -> Vec<f64> {
        let (fill_s, empty_s, rate) = (fill.exp(), empty.exp(), rate.exp());
        let mut wanted_mpa = self.command_mpa.first().copied().unwrap_or(0.0);
        let (mut valve_mpa, mut cavity_mpa) = (wanted_mpa, wanted_mpa);
        let (mut time_s, mut next) = (self.time_s.first().copied().unwrap_or(0.0), 0);
        let mut advance = |wanted_mpa: f64, until_s: f64| {
            let mut left_s = until_s - time_s;
            time_s = until_s;
            // First as fast as the valve moves, then at rest.
            let ramp_s = ((wanted_mpa - valve_mpa).abs() / rate).min(left_s);
            for (step_s, is_ramp) in [(ramp_s, true), (left_s - ramp_s, false)] {
                if step_s <= 0.0 {
                    continue;
                }
                let is_there = !is_ramp || ramp_s < left_s;
                let from_mpa = if is_ramp { valve_mpa } else { wanted_mpa };
                valve_mpa = if is_there {
                    wanted_mpa
                } else {
                    valve_mpa + (rate * step_s).copysign(wanted_mpa - valve_mpa)
                };
                let tau_s = if valve_mpa >= cavity_mpa { fill_s } else { empty_s };
                let behind_mpa = (valve_mpa - from_mpa) / step_s * tau_s;
                cavity_mpa =
                    valve_mpa - behind_mpa + (cavity_mpa - from_mpa + behind_mpa) * (-step_s / tau_s).exp();
                left_s -= step_s;
            }
            cavity_mpa
        };
        let at_reading = |at: &f64| {
            while next < self.time_s.len() && self.time_s[next] + delay_s <= *at {
                advance(wanted_mpa, self.time_s[next] + delay_s);
                wanted_mpa = self.command_mpa[next];
                next += 1;
            }
            advance(wanted_mpa, *at)
        };
        self.time_s.iter().map(at_reading).collect()
    }
}

/// Some of the unknowns moved, within what is sought.
fn moved(mut unknowns: Unknowns, sought: &[usize], step: &[f64], share: f64) -> Unknowns {
    for (unknown, step) in sought.iter().zip(step) {
        let [low, high] = match *unknown {
            DELAY => [0.0, MOST_DELAY_S],
            FILL | EMPTY => TIME_S.map(f64::ln),
            _ => [f64::NEG_INFINITY, f64::INFINITY],
        };
        // A step of more than a factor of two is not one of a small change.
        let most = if *unknown == DELAY { 0.05 } else { 0.7 };
        unknowns[*unknown] = (unknowns[*unknown] + (share * step).clamp(-most, most)).clamp(low, high);
    }
    unknowns
}

#[cfg(test)]
#[path = "../../tests/unit/actuation_line.rs"]
mod tests;
