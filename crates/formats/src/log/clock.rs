//! Files of one run with different clocks: offset by correlation, values on the first file's times.
//!
//! The offset is the shift with the largest correlation between the quantity of either file that moves most: `|r|` of the values, means
//! removed. An output follows its input late: of an input its first-order lag is taken, with the time constant of the largest `|r|`.
//! Its standard deviation is `sqrt(1 - r^2) / (r w sqrt(n))`, `w` the RMS rate over the standard deviation of the signal, `n = T w / pi` its
//! independent values. What a lag does not explain of an actuator's delay counts as offset.
//!
//! Columns of one table that were written at different instants (topics of a bus) are interpolated in the same way.

use super::{LogColumn, Recording};
use crate::error::Diagnostic;
use rom::statistics::median;

/// Points of the grid on which files are correlated.
const GRID: usize = 2000;
/// Smallest part of the shorter file that must overlap.
const MIN_OVERLAP: f64 = 0.5;
/// Smallest correlation, and the largest of another peak as a fraction of it.
const MIN_CORRELATION: f64 = 0.5;
const MAX_SECOND: f64 = 0.95;
/// Time constants of an output behind its input, rows of the grid.
const LAG_STEPS: [f64; 8] = [1.0, 2.0, 4.0, 7.0, 12.0, 20.0, 35.0, 60.0];
/// Median steps across which values are interpolated.
const MAX_STEPS: f64 = 5.0;

/// Joins files at the times of the first.
pub(super) fn join(
    mut first: Recording,
    further: Vec<(Recording, Option<f64>)>,
) -> Result<Recording, Diagnostic> {
    for (other, given_s) in further {
        let shift_s = match given_s {
            Some(offset_s) => other.start_s + offset_s - first.start_s,
            None => {
                let found = estimate(&first, &other)?;
                let offset_s = found.shift_s + first.start_s - other.start_s;
                first.remarks.push(format!(
                    "clock of a further file: offset_s = {offset_s:.4} +- {:.4} by correlation ({:.3}) of {}, which lag by {:.3} s; any other \
                     delay counts as offset: set offset_s if it is known",
                    found.sigma_s, found.correlation, found.names, found.lag_s
                ));
                found.shift_s
            }
        };
        let times: Vec<f64> = first.time_s.iter().map(|t| t - shift_s).collect();
        let onto = |series: LogColumn| {
            let values = interpolated(&other.time_s, &series.values, &times);
            LogColumn { name: series.name, values }
        };
        let missing = times.iter().filter(|t| !(0.0..=last(&other.time_s)).contains(*t)).count();
        if missing > 0 {
            first.remarks.push(format!("{missing} of {} rows lie outside a further file", times.len()));
        }
        first.remarks.extend(other.remarks);
        first.inputs.extend(other.inputs.into_iter().map(onto));
        first.outputs.extend(other.outputs.into_iter().map(onto));
    }
    Ok(first)
}

fn last(times: &[f64]) -> f64 {
    times.last().copied().unwrap_or(0.0)
}

/// Values between the own readings of columns that were written at different instants, where half of the rows of the outputs lack an input, or of
/// all outputs another one.
pub(super) fn interleave(
    time_s: &[f64],
    inputs: &mut [LogColumn],
    outputs: &mut [LogColumn],
    remarks: &mut Vec<String>,
) {
    let is_read = |series: &LogColumn, row: usize| series.values[row].is_finite();
    let measured = |row: &usize| outputs.iter().any(|series| is_read(series, *row));
    let measured: Vec<usize> = (0..time_s.len()).filter(measured).collect();
    let lacks = |all: &[LogColumn]| {
        let whole = measured.iter().filter(|row| all.iter().all(|series| is_read(series, **row)));
        2 * whole.count() < measured.len()
    };
    let (lack_inputs, lack_outputs) = (lacks(inputs), lacks(outputs));
    let mut fill = |columns: &mut [LogColumn]| {
        for series in columns.iter_mut().filter(|series| series.values.iter().any(|v| !v.is_finite())) {
            let read = time_s.iter().zip(&series.values).filter(|(_, v)| v.is_finite());
            let (times, values): (Vec<f64>, Vec<f64>) = read.map(|(t, v)| (*t, *v)).unzip();
            series.values = interpolated(&times, &values, time_s);
            remarks.push(format!(
                "{}: written at other instants than other columns, interpolated to theirs",
                series.name
            ));
        }
    };
    if lack_inputs {
        fill(inputs);
    }
    if lack_outputs {
        fill(outputs);
    }
}

/// Linear interpolation; NaN outside, at missing values and across gaps.
fn interpolated(times: &[f64], values: &[f64], at: &[f64]) -> Vec<f64> {
    let most = MAX_STEPS * median(times.windows(2).map(|pair| pair[1] - pair[0])).unwrap_or(0.0);
    let value_at = |t: &f64| {
        let next = times.partition_point(|time| time < t);
        match (next.checked_sub(1), times.get(next)) {
            (_, Some(time)) if time == t => values[next],
            (Some(before), Some(time)) if time - times[before] <= most => {
                let share = (t - times[before]) / (time - times[before]);
                values[before] + share * (values[next] - values[before])
            }
            _ => f64::NAN,
        }
    };
    at.iter().map(value_at).collect()
}

/// Estimated shift of a file's times to those of the first.
struct Shift {
    shift_s: f64,
    sigma_s: f64,
    correlation: f64,
    /// Time constant of the output behind the input.
    lag_s: f64,
    names: String,
}

/// The quantity whose values differ most from row to row on the scale of their standard deviation: steps and ramps instead of noise.
fn liveliest(recording: &Recording) -> Option<&LogColumn> {
    let smooth = |series: &&LogColumn| {
        let finite: Vec<f64> = series.values.iter().copied().filter(|v| v.is_finite()).collect();
        let mean = finite.iter().sum::<f64>() / finite.len() as f64;
        let variance: f64 = finite.iter().map(|v| (v - mean).powi(2)).sum();
        let steps: f64 = finite.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
        if variance > 0.0 { variance / steps } else { 0.0 }
    };
    let all = recording.inputs.iter().chain(&recording.outputs).filter(|series| smooth(series) > 0.0);
    all.max_by(|a, b| smooth(a).total_cmp(&smooth(b)))
}

fn estimate(first: &Recording, other: &Recording) -> Result<Shift, Diagnostic> {
    let refused = |found: String| {
        Diagnostic::new("offset_s", "clocks that a correlation can join; give offset_s in the mapping", found)
    };
    let (Some(a), Some(b)) = (liveliest(first), liveliest(other)) else {
        return Err(refused("a file in which nothing moves".into()));
    };
    let spans = [last(&first.time_s), last(&other.time_s)];
    let step_s = spans[0].max(spans[1]) / GRID as f64;
    let grid = |times: &[f64], series: &LogColumn, span: f64| -> Vec<f64> {
        let times_s: Vec<f64> = (0..(span / step_s) as usize + 1).map(|k| k as f64 * step_s).collect();
        interpolated(times, &series.values, &times_s)
    };
    let (mut x, mut y) = (grid(&first.time_s, a, spans[0]), grid(&other.time_s, b, spans[1]));
    let least = (MIN_OVERLAP * x.len().min(y.len()) as f64) as i64;
    let lags: Vec<i64> = (least - y.len() as i64..=x.len() as i64 - least).collect();
    let mut sizes: Vec<f64> = lags.iter().map(|lag| correlation(&x, &y, *lag).abs()).collect();
    let best = (0..sizes.len()).max_by(|i, j| sizes[*i].total_cmp(&sizes[*j]));
    let Some(mut best) = best.filter(|best| sizes[*best] >= MIN_CORRELATION) else {
        let most = sizes.iter().copied().fold(0.0, f64::max);
        return Err(refused(format!("a correlation of {most:.2} between {} and {} at most", a.name, b.name)));
    };
    // Lags between which the correlation does not fall below half of the peak belong to it.
    let low = (0..best).rev().find(|i| sizes[*i] < 0.5 * sizes[best]).unwrap_or(0);
    let high = (best..sizes.len()).find(|i| sizes[*i] < 0.5 * sizes[best]).unwrap_or(sizes.len());
    let others = (0..sizes.len()).filter(|i| !(low..high).contains(i) && is_peak(&sizes, *i));
    let second = others.max_by(|i, j| sizes[*i].total_cmp(&sizes[*j]));
    let second = second.filter(|second| sizes[*second] > MAX_SECOND * sizes[best]);
    let second = second.map(|second| (lags[second] - lags[best], sizes[second], sizes[best]));
    // The lag of an output behind an input moves the peak: the largest correlation over time constants and the shifts around it.
    let is_input =
        |recording: &Recording, series: &LogColumn| recording.inputs.iter().any(|s| s.name == series.name);
    let (mut lag_s, at) = (0.0, best);
    if is_input(first, a) != is_input(other, b) {
        let plain = (x.clone(), y.clone());
        for steps in LAG_STEPS {
            let (x_lagged, y_lagged) = match is_input(first, a) {
                true => (lagged(&plain.0, steps), plain.1.clone()),
                false => (plain.0.clone(), lagged(&plain.1, steps)),
            };
            let near =
                at.saturating_sub(2 * steps as usize + 1)..(at + 2 * steps as usize + 2).min(lags.len());
            let mut found = vec![0.0; lags.len()];
            near.clone().for_each(|i| found[i] = correlation(&x_lagged, &y_lagged, lags[i]).abs());
            let Some(peak) = near.max_by(|i, j| found[*i].total_cmp(&found[*j])) else { continue };
            if found[peak] > sizes[best] {
                (lag_s, best, sizes, x, y) = (steps * step_s, peak, found, x_lagged, y_lagged);
            }
        }
    }
    if let Some((apart, size, largest)) = second {
        let offset_s = lags[best] as f64 * step_s + first.start_s - other.start_s;
        let other_s = offset_s + apart as f64 * step_s;
        return Err(refused(format!(
            "{offset_s:.3} and {other_s:.3} s with correlations of {largest:.3} and {size:.3}"
        )));
    }
    let bend = |i: usize| sizes[i - 1] - 2.0 * sizes[i] + sizes[i + 1];
    let fraction = if is_peak(&sizes, best) && bend(best) < 0.0 {
        0.5 * (sizes[best - 1] - sizes[best + 1]) / bend(best)
    } else {
        0.0
    };
    let r = sizes[best].min(1.0);
    let rate = rate(if is_input(first, a) { &y } else { &x }, step_s);
    let independent = (spans[0].min(spans[1]) * rate / std::f64::consts::PI).max(1.0);
    Ok(Shift {
        shift_s: (lags[best] as f64 + fraction) * step_s,
        sigma_s: ((1.0 - r * r).sqrt() / (r * rate * independent.sqrt())).hypot(step_s / 12.0_f64.sqrt()),
        correlation: r,
        lag_s,
        names: format!("{} and {}", a.name, b.name),
    })
}

fn is_peak(sizes: &[f64], i: usize) -> bool {
    i > 0 && i + 1 < sizes.len() && sizes[i] >= sizes[i - 1] && sizes[i] >= sizes[i + 1]
}

/// First-order lag with a time constant of `steps` rows; the last value is held where one is missing.
fn lagged(values: &[f64], steps: f64) -> Vec<f64> {
    let keep = (-1.0 / steps).exp();
    let mut state = f64::NAN;
    let mut next = |v: &f64| {
        state = if state.is_finite() && v.is_finite() {
            v + keep * (state - v)
        } else if v.is_finite() {
            *v
        } else {
            state
        };
        if v.is_finite() { state } else { f64::NAN }
    };
    values.iter().map(&mut next).collect()
}

/// Correlation of `x[k + lag]` and `y[k]` over what overlaps.
fn correlation(x: &[f64], y: &[f64], lag: i64) -> f64 {
    let from = (-lag).max(0) as usize;
    let pairs =
        y.iter().enumerate().skip(from).map_while(|(k, y)| Some((*x.get((k as i64 + lag) as usize)?, *y)));
    let mut sums = [0.0; 6];
    for (x, y) in pairs.filter(|(x, y)| x.is_finite() && y.is_finite()) {
        sums.iter_mut().zip([1.0, x, y, x * x, y * y, x * y]).for_each(|(sum, v)| *sum += v);
    }
    let [n, x, y, xx, yy, xy] = sums;
    let size = ((xx - x * x / n) * (yy - y * y / n)).sqrt();
    if size > 0.0 { (xy - x * y / n) / size } else { 0.0 }
}

/// RMS rate over the standard deviation, 1/s.
fn rate(values: &[f64], step_s: f64) -> f64 {
    let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let mean = finite.iter().sum::<f64>() / finite.len() as f64;
    let variance = finite.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / finite.len() as f64;
    let square = finite.windows(2).map(|pair| ((pair[1] - pair[0]) / step_s).powi(2)).sum::<f64>();
    (square / finite.len() as f64 / variance).sqrt()
}
