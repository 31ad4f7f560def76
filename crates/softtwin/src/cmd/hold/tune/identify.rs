//! Line, delay, play, swing and noise from the cycles of an experiment.

use super::experiment::Experiment;
use control::inverse::Quantity;
use control::settings::{GaugeAt, Settings};
use rom::memory::{InputMemory, Line};
use serde_json::{Value, json};
use train::measured::Run;
use train::memory::{Identified, identify};

/// One control cycle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub(super) time_s: f64,
    pub(super) command_mpa: f64,
    pub(super) gauge_mpa: f64,
    /// The quantity; NaN: not measured.
    pub(super) measured: f64,
}

/// Results of an experiment.
pub(super) struct Found {
    pub(super) settings: Settings,
    /// Constants with intervals, and noise.
    pub(super) report: Value,
    /// Quantities that it cannot tell.
    pub(super) remarks: Vec<String>,
}

/// Delays that are tried: every third, then the neighbours of the best.
const DELAYS: usize = 10;
const DELAYS_COARSE: usize = 3;
const DELAY_STEP_S: f64 = 0.01;
/// Rows of a search at most: more are thinned.
const ROWS: usize = 1_500;
/// Frequencies of the swing that are tried, Hz, and their ratio.
const SWING_HZ: [f64; 2] = [0.8, 25.0];
const SWING_RATIO: f64 = 1.01;
/// Amplitude of the swing over that of the noise at the same frequency from which it is one.
const SWING_OVER_NOISE: f64 = 5.0;
/// Longest damping ratio that a swing has.
const MOST_DAMPING: f64 = 0.3;

/// Identifies; constants that the experiment does not show stay those of `settings`.
pub(super) fn found(rows: &[Row], experiment: &Experiment, settings: &Settings, quantity: Quantity) -> Found {
    let (mut new, mut remarks) = (settings.clone(), Vec::new());
    let mut report = json!({ "gauge_noise_mpa": noise(rows, experiment, |row| row.gauge_mpa) });
    if settings.gauge_at == GaugeAt::Cavity {
        match line(rows) {
            Some((line, delay_s, of)) => {
                (new.line, new.delay_s) = (line, delay_s);
                report["line"] = constants(&of, "line");
                report["delay_s"] = json!(delay_s);
            }
            None => remarks.push("line: the gauge does not follow the command with a lag".to_owned()),
        }
    } else {
        remarks.push(
            "line: the gauge is before it; `calibrate --memory` identifies it from a recording".to_owned(),
        );
    }
    let is_measured = quantity != Quantity::Pressure && rows.iter().any(|row| row.measured.is_finite());
    if !is_measured {
        remarks.push("play, swing: nothing measures the quantity".to_owned());
        return Found { settings: new, report, remarks };
    }
    report["noise"] = json!(noise(rows, experiment, |row| row.measured));
    match play(rows) {
        Some((memory, of)) => {
            new.play = memory.play;
            report["play"] = constants(&of, "play");
        }
        None => {
            new.play = Vec::new();
            remarks.push("play: none above the noise".to_owned());
        }
    }
    match swing(rows, experiment) {
        Some((hz, damping, over_noise)) => {
            new = new.with_swing(hz, damping);
            report["swing"] = json!({ "hz": hz, "damping": damping, "over_noise": over_noise });
        }
        None => {
            new.swing_hz = 0.0;
            remarks
                .push("swing: none above the noise; steps as fast as the valve gives show more".to_owned());
        }
    }
    Found { settings: new, report, remarks }
}

fn constants(of: &Identified, name: &str) -> Value {
    let blocks = of.blocks.iter().filter(|block| block.is_kept && block.block.name().ends_with(name));
    let constants = blocks.flat_map(|block| &block.constants);
    constants
        .map(|constant| {
            (
                constant.name.to_owned(),
                json!({ "value": constant.value, "interval": constant.interval, "unit": constant.unit }),
            )
        })
        .collect::<serde_json::Map<_, _>>()
        .into()
}

/// Every n-th row of some.
fn thinned(rows: &[Row]) -> impl Iterator<Item = &Row> {
    rows.iter().step_by(rows.len().div_ceil(ROWS).max(1))
}

fn search<'a>(
    rows: impl Iterator<Item = &'a Row>,
    input: impl Fn(&Row) -> f64,
    output: impl Fn(&Row) -> f64,
) -> Option<(InputMemory, Identified)> {
    let mut run = Run { time_s: Vec::new(), inputs: vec![Vec::new()], outputs: vec![Vec::new()] };
    for row in rows {
        run.time_s.push(row.time_s);
        run.inputs[0].push(input(row));
        run.outputs[0].push(output(row));
    }
    let known = || run.outputs[0].iter().copied().filter(|value| value.is_finite());
    let scale = known().fold(f64::NEG_INFINITY, f64::max) - known().fold(f64::INFINITY, f64::min);
    let of = identify(&[run.clone()], false, &[scale], None)?;
    let memory = of.memory.as_ref()?.inputs.first()?.clone();
    Some((memory, of))
}

/// The line between command and gauge, at the delay that leaves the smallest error.
fn line(rows: &[Row]) -> Option<(Line, f64, Identified)> {
    let command_mpa = |time_s: f64| {
        let at = rows.partition_point(|row| row.time_s <= time_s);
        rows[at.saturating_sub(1)].command_mpa
    };
    let of_delay = |steps: usize| {
        let delay_s = steps as f64 * DELAY_STEP_S;
        let (memory, of) =
            search(thinned(rows), |row| command_mpa(row.time_s - delay_s), |row| row.gauge_mpa)?;
        Some((memory.line?, delay_s, of))
    };
    let error = |found: &(Line, f64, Identified)| found.2.left_out[1];
    let coarse = (0..DELAYS)
        .step_by(DELAYS_COARSE)
        .filter_map(of_delay)
        .min_by(|a, b| error(a).total_cmp(&error(b)))?;
    let at = (coarse.1 / DELAY_STEP_S).round() as usize;
    let near = [at.checked_sub(1), Some(at + 1)].into_iter().flatten().filter_map(of_delay);
    near.chain([coarse]).min_by(|a, b| error(a).total_cmp(&error(b)))
}

/// The play between gauge and quantity: the ramp shows its width, the steps that it is no lag.
fn play(rows: &[Row]) -> Option<(InputMemory, Identified)> {
    let (memory, of) = search(thinned(rows), |row| row.gauge_mpa, |row| row.measured)?;
    (!memory.play.is_empty()).then_some((memory, of))
}

/// Standard deviation from row to row in the second halves of the holds.
fn noise(rows: &[Row], experiment: &Experiment, value: impl Fn(&Row) -> f64) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for [begin, end] in &experiment.holds_s {
        let late: Vec<f64> = rows
            .iter()
            .filter(|row| row.time_s > 0.5 * (begin + end) && row.time_s < *end)
            .map(&value)
            .collect();
        // Second differences of independent noise have six times its variance; a swing hardly has any.
        let differences = late.windows(3).map(|row| (row[2] - 2.0 * row[1] + row[0]).powi(2) / 6.0);
        for square in differences.filter(|square| square.is_finite()) {
            sum += square;
            count += 1.0;
        }
    }
    f64::sqrt(sum / count)
}

/// Frequency and damping ratio of the free swing after steps, and its amplitude over the noise's.
///
/// Each hold is `quadratic in time + three exponentials + exp(-z w t) (a sin + b cos)`, by least squares; frequency and damping are those that
/// leave the smallest squares of all holds together.
fn swing(rows: &[Row], experiment: &Experiment) -> Option<(f64, f64, f64)> {
    let holds: Vec<Vec<[f64; 2]>> = experiment
        .holds_s
        .iter()
        .map(|[begin, end]| {
            let within =
                rows.iter().filter(|row| (*begin..*end).contains(&row.time_s) && row.measured.is_finite());
            within.map(|row| [row.time_s - begin, row.measured]).collect()
        })
        .filter(|hold: &Vec<[f64; 2]>| hold.len() > 4 * TERMS)
        .collect();
    let lengths_s = holds.iter().filter_map(|hold| Some(hold.last()?[0]));
    let length_s = lengths_s.fold(f64::INFINITY, f64::min);
    let rest =
        |hz: f64, damping: f64| holds.iter().map(|hold| squares(hold, hz, damping, length_s)).sum::<f64>();
    let without = holds.iter().map(|hold| squares(hold, 0.0, 0.0, length_s)).sum::<f64>();
    let count = ((SWING_HZ[1] / SWING_HZ[0]).ln() / SWING_RATIO.ln()) as i32;
    let tried = (0..count).map(|k| SWING_HZ[0] * SWING_RATIO.powi(k));
    let fits: Vec<(f64, f64)> = tried.map(|hz| (hz, without - rest(hz, 0.02))).collect();
    let (coarse_hz, explained) = fits.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let mut others: Vec<f64> = fits.iter().map(|fit| fit.1).collect();
    others.sort_by(f64::total_cmp);
    let over_noise = f64::sqrt(explained / others.get(others.len() / 2)?.max(f64::MIN_POSITIVE));
    let (mut hz, mut damping) = (coarse_hz, 0.02);
    for _ in 0..3 {
        hz = least(hz / 1.02, hz * 1.02, |hz| rest(hz, damping));
        damping = least(0.0, MOST_DAMPING, |damping| rest(hz, damping));
    }
    (over_noise > SWING_OVER_NOISE).then_some((hz, damping, over_noise))
}

/// Unknowns of a hold.
const TERMS: usize = 8;

/// Squares of a hold that cubic, exponentials and swing do not explain; `hz` 0: without swing.
fn squares(hold: &[[f64; 2]], hz: f64, damping: f64, length_s: f64) -> f64 {
    let w = std::f64::consts::TAU * hz;
    let terms = |t_s: f64| -> [f64; TERMS] {
        let x = t_s / length_s;
        let fade = if hz > 0.0 { (-damping * w * t_s).exp() } else { 0.0 };
        let (sine, cosine) = (w * t_s).sin_cos();
        [1.0, x, x * x, (-4.0 * x).exp(), (-12.0 * x).exp(), (-36.0 * x).exp(), fade * sine, fade * cosine]
    };
    let mut normal = rom::dense::Dense::zeros(TERMS);
    let (mut right, mut all) = ([0.0; TERMS], 0.0);
    for [t_s, value] in hold {
        let of = terms(*t_s);
        for row in 0..TERMS {
            right[row] += of[row] * value;
            for column in 0..TERMS {
                normal[(row, column)] += of[row] * of[column];
            }
        }
        all += value * value;
    }
    (0..TERMS).for_each(|at| normal[(at, at)] += 1e-9 * hold.len() as f64);
    let mut found = right;
    if normal.solve(&mut found, 1).is_none() {
        return all;
    }
    all - found.iter().zip(&right).map(|(a, b)| a * b).sum::<f64>()
}

/// Minimum of a function with one by the golden section.
fn least(mut low: f64, mut high: f64, of: impl Fn(f64) -> f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    for _ in 0..24 {
        let [first, second] = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
        if of(first) < of(second) { high = second } else { low = first }
    }
    0.5 * (low + high)
}

#[cfg(test)]
#[path = "../../../../tests/unit/cmd_tune.rs"]
mod tests;
