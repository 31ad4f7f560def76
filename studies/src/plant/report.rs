//! Percentiles and step responses, as the examples print them.

use serde::Serialize;

/// Percentiles of durations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Percentiles {
    /// How many there were.
    pub count: usize,
    /// Half were faster, us.
    pub p50_us: f64,
    /// 99 of 100 were faster, us.
    pub p99_us: f64,
    /// The slowest, us.
    pub max_us: f64,
}

/// Percentiles of durations in ns; all 0 when there are none. Sorts them.
pub fn percentiles(durations_ns: &mut [u64]) -> Percentiles {
    durations_ns.sort_unstable();
    let at = |share: f64| {
        let index = (share * durations_ns.len() as f64) as usize;
        durations_ns.get(index.min(durations_ns.len().saturating_sub(1))).map_or(0.0, |ns| *ns as f64 / 1e3)
    };
    Percentiles { count: durations_ns.len(), p50_us: at(0.5), p99_us: at(0.99), max_us: at(1.0) }
}

/// How a force followed a step to its target.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StepResponse {
    /// The target, N.
    pub target_n: f64,
    /// From the first command to the last time that the force was off by more than 5 % of the target, s; none: still is.
    pub settling_s: Option<f64>,
    /// Largest force beyond the target, share of it.
    pub overshoot: f64,
    /// Mean error over the last quarter, share of the target.
    pub final_error: f64,
    /// Root mean square of that error, share of the target.
    pub final_rms: f64,
}

/// Relative error within which a force is settled.
pub const SETTLED: f64 = 0.05;

/// Reads a step response off `(time in s, force in N)`, time counted from the first command.
pub fn step_response(target_n: f64, points: &[(f64, f64)]) -> StepResponse {
    let error = |force: f64| (force - target_n) / target_n;
    let last_off = points.iter().rposition(|(_, force)| error(*force).abs() > SETTLED);
    let settling_s = match last_off {
        None => points.first().map(|(time, _)| *time),
        Some(index) => points.get(index + 1).map(|(time, _)| *time),
    };
    let tail: Vec<f64> = points.iter().skip(points.len() * 3 / 4).map(|(_, force)| error(*force)).collect();
    let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / tail.len().max(1) as f64;
    StepResponse {
        target_n,
        settling_s,
        overshoot: points.iter().map(|(_, force)| error(*force)).fold(0.0, f64::max),
        final_error: mean(&mut tail.iter().copied()),
        final_rms: mean(&mut tail.iter().map(|e| e * e)).sqrt(),
    }
}

#[cfg(test)]
#[path = "../../tests/unit/plant_report.rs"]
mod tests;
