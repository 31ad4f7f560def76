//! Line, delay, play, swing and noise of an actuator from the control cycles of an experiment on its valve.
//!
//! The experiment drives steps, holds and a ramp. First comes the line between command and gauge with its delay (`line`). The play between
//! gauge and quantity is what [`crate::memory`] identifies, and what swings freely after a step is fitted to the holds.

mod data;
mod line;

pub use data::{ActuationCycle, ConstantInterval, Constants};
pub use line::ActuationLine;

use crate::measured::Run;
use crate::memory::{Identified, identify};
use rom::dense::Dense;
use rom::memory::{InputMemory, Play};
use rom::statistics::{mean, median, range};
use serde::Serialize;

/// What an experiment tells; absent is what it does not show.
#[derive(Debug, Clone, Serialize)]
pub struct Actuation {
    /// Standard deviation of the gauge.
    pub gauge_noise_mpa: f64,
    /// Line between command and gauge.
    #[serde(flatten)]
    pub line: Option<ActuationLine>,
    /// Standard deviation of the quantity, in its unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise: Option<f64>,
    /// Play between gauge and quantity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub play: Option<ActuationPlay>,
    /// Swing of the quantity after a step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub swing: Option<Swing>,
    /// What the experiment cannot tell.
    #[serde(skip)]
    pub remarks: Vec<String>,
}

/// The play between gauge and quantity.
#[derive(Debug, Clone, Serialize)]
pub struct ActuationPlay {
    /// Operators of pressure, MPa.
    #[serde(skip)]
    pub operators: Vec<Play>,
    /// Their constants and intervals.
    #[serde(flatten)]
    pub constants: Constants,
}

/// A free swing.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Swing {
    /// Frequency, Hz.
    pub hz: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Its amplitude over that of the noise at the same frequency.
    pub over_noise: f64,
}

/// Rows of a search at most: more are thinned.
const ROWS: usize = 1_500;
/// Frequencies of the swing that are tried, Hz, and their ratio.
const SWING_HZ: [f64; 2] = [0.8, 25.0];
const SWING_RATIO: f64 = 1.01;
/// Amplitude of the swing over that of the noise at the same frequency from which it is one.
const SWING_OVER_NOISE: f64 = 5.0;
/// Longest damping ratio that a swing has.
const MOST_DAMPING: f64 = 0.3;

/// Identifies. `holds_s` are begin and end of each step's hold. `sees_line`: the gauge is behind the line. `is_measured`: something else than
/// the gauge measures the quantity.
#[must_use]
pub fn identify_actuation(
    cycles: &[ActuationCycle],
    holds_s: &[[f64; 2]],
    sees_line: bool,
    is_measured: bool,
) -> Actuation {
    let mut remarks = Vec::new();
    let mut remark = |is_missing: bool, text: &str| {
        if is_missing {
            remarks.push(text.to_owned());
        }
    };
    let line = if sees_line { line::line(cycles) } else { None };
    remark(sees_line && line.is_none(), "line: the gauge does not follow the command with a lag");
    remark(!sees_line, "line: the gauge is before it; `calibrate --memory` identifies it from a recording");
    let is_measured = is_measured && cycles.iter().any(|cycle| cycle.measured.is_finite());
    let (play, swing) = if is_measured { (play(cycles), swing(cycles, holds_s)) } else { (None, None) };
    remark(!is_measured, "play, swing: nothing measures the quantity");
    remark(is_measured && play.is_none(), "play: none above the noise");
    remark(
        is_measured && swing.is_none(),
        "swing: none above the noise; steps as fast as the valve gives show more",
    );
    Actuation {
        gauge_noise_mpa: noise(cycles, holds_s, |cycle| cycle.gauge_mpa),
        line,
        noise: is_measured.then(|| noise(cycles, holds_s, |cycle| cycle.measured)),
        play,
        swing,
        remarks,
    }
}

fn constants(identified: &Identified, name: &str) -> Constants {
    let blocks = identified.blocks.iter().filter(|block| block.is_kept && block.block.name().ends_with(name));
    let constants = blocks.flat_map(|block| &block.constants);
    constants
        .map(|constant| {
            (
                constant.name,
                ConstantInterval { value: constant.value, interval: constant.interval, unit: constant.unit },
            )
        })
        .collect()
}

/// Every n-th row of some.
fn thinned(rows: &[ActuationCycle]) -> impl Iterator<Item = &ActuationCycle> {
    rows.iter().step_by(rows.len().div_ceil(ROWS).max(1))
}

fn search<'a>(
    rows: impl Iterator<Item = &'a ActuationCycle>,
    input: impl Fn(&ActuationCycle) -> f64,
    output: impl Fn(&ActuationCycle) -> f64,
) -> Option<(InputMemory, Identified)> {
    let mut run = Run { time_s: Vec::new(), inputs: vec![Vec::new()], outputs: vec![Vec::new()] };
    for row in rows {
        run.time_s.push(row.time_s);
        run.inputs[0].push(input(row));
        run.outputs[0].push(output(row));
    }
    let scale = range(&run.outputs[0]);
    let identified = identify(&[run], false, &[scale], None)?;
    let memory = identified.memory.as_ref()?.inputs.first()?.clone();
    Some((memory, identified))
}

/// The play between gauge and quantity: the ramp shows its width, the steps that it is no lag.
fn play(rows: &[ActuationCycle]) -> Option<ActuationPlay> {
    let (memory, identified) = search(thinned(rows), |row| row.gauge_mpa, |row| row.measured)?;
    let constants = constants(&identified, "play");
    (!memory.play.is_empty()).then_some(ActuationPlay { operators: memory.play, constants })
}

/// Standard deviation from row to row in the second halves of the holds.
fn noise(rows: &[ActuationCycle], holds_s: &[[f64; 2]], value: impl Fn(&ActuationCycle) -> f64) -> f64 {
    let late = |[begin, end]: &[f64; 2]| -> Vec<f64> {
        let is_late = |row: &&ActuationCycle| row.time_s > 0.5 * (begin + end) && row.time_s < *end;
        rows.iter().filter(is_late).map(&value).collect()
    };
    // Second differences of independent noise have six times its variance; a swing hardly has any.
    let squares = holds_s.iter().map(late).flat_map(|late| {
        late.windows(3).map(|row| (row[2] - 2.0 * row[1] + row[0]).powi(2) / 6.0).collect::<Vec<_>>()
    });
    mean(squares.filter(|square| square.is_finite())).sqrt()
}

/// Frequency and damping ratio of the free swing after steps, and its amplitude over the noise's.
///
/// Each hold is `quadratic in time + three exponentials + exp(-z w t) (a sin + b cos)`, by least squares; frequency and damping are those that
/// leave the smallest squares of all holds together.
fn swing(rows: &[ActuationCycle], holds_s: &[[f64; 2]]) -> Option<Swing> {
    let holds: Vec<Vec<[f64; 2]>> = holds_s
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
    let noise = median(fits.iter().map(|fit| fit.1))?;
    let over_noise = f64::sqrt(explained / noise.max(f64::MIN_POSITIVE));
    let (mut hz, mut damping) = (coarse_hz, 0.02);
    for _ in 0..3 {
        hz = least(hz / 1.02, hz * 1.02, |hz| rest(hz, damping));
        damping = least(0.0, MOST_DAMPING, |damping| rest(hz, damping));
    }
    (over_noise > SWING_OVER_NOISE).then_some(Swing { hz, damping, over_noise })
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
    let mut normal = Dense::zeros(TERMS);
    let (mut right, mut all) = ([0.0; TERMS], 0.0);
    for [t_s, value] in hold {
        let row_terms = terms(*t_s);
        for row in 0..TERMS {
            right[row] += row_terms[row] * value;
            for column in 0..TERMS {
                normal[(row, column)] += row_terms[row] * row_terms[column];
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
fn least(mut low: f64, mut high: f64, function: impl Fn(f64) -> f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    for _ in 0..24 {
        let [first, second] = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
        if function(first) < function(second) { high = second } else { low = first }
    }
    0.5 * (low + high)
}
