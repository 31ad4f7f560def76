//! Onset pressure over gap, read off the free model: when does its lowest node above the obstacle reach it?

use super::TrainError;
use super::group::Plan;
use super::regime::Part;
use crate::config::TrainConfig;
use crate::regime::OnsetTable;
use crate::snapshots::Database;

/// Pressures the free model is asked at.
const STEPS: usize = 240;

/// The onset table for pressures from 0 to `max_pressure_mpa`.
pub(super) fn derive(
    database: &Database,
    config: &TrainConfig,
    plan: &Plan,
    free: &Part,
    max_pressure_mpa: f64,
) -> Result<OnsetTable, TrainError> {
    let missing = |axis: u8| TrainError::Onset(format!("no field is the coordinate along axis {axis}"));
    let [x, y, z] = [0, 1, 2].map(|axis| database.coordinate(axis).ok_or_else(|| missing(axis)));
    let (x, y, z) = (x?, y?, z?);
    let obstacle = config.obstacle.unwrap_or(database.obstacle);
    let (mut gaps, mut pressures): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    for step in 0..=STEPS {
        let pressure = max_pressure_mpa * step as f64 / STEPS as f64;
        let [xs, ys, zs] = [x, y, z].map(|f| free.field(plan, f, pressure));
        let below = |range: [f64; 2], v: f64| (range[0]..=range[1]).contains(&v);
        let lowest = (0..database.node_count)
            .filter(|&i| below(obstacle.x_mm, xs[i]) && below(obstacle.z_mm, zs[i]))
            .map(|i| ys[i])
            .fold(f64::INFINITY, f64::min);
        // Only a new lowest point closes a gap that was open before: the table stays monotone.
        if lowest.is_finite() && gaps.last().is_none_or(|deepest| -lowest > deepest + 1e-9) {
            gaps.push(-lowest);
            pressures.push(pressure);
        }
    }
    if gaps.len() < 2 {
        return Err(TrainError::Onset(format!(
            "the free model reaches only {} depth(s) over the obstacle (x {:?} mm, z {:?} mm)",
            gaps.len(),
            obstacle.x_mm,
            obstacle.z_mm
        )));
    }
    Ok(OnsetTable::new(gaps, pressures))
}
