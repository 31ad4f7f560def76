//! Compares a measured contact force with the predicted one.

/// Raises an alarm when the residual stays outside the half-width for longer than a given time: a leak, a wrong gap, a torn
/// chamber. A single outlier, or the moment of touching, is none.
#[derive(Debug, Clone, Default)]
pub(super) struct ForceWatch {
    outside_since_ns: Option<u64>,
}

impl ForceWatch {
    /// Takes the residual of a reading taken at `t_sensor_ns`; true while the alarm stands. Without a measured force or
    /// without a half-width (NaN) nothing can be said, and the time begins anew.
    pub(super) fn update(
        &mut self,
        t_sensor_ns: u64,
        residual_n: f64,
        halfwidth_n: f64,
        after_ns: u64,
    ) -> bool {
        if residual_n.is_nan() || halfwidth_n.is_nan() || residual_n.abs() <= halfwidth_n {
            self.outside_since_ns = None;
            return false;
        }
        let since_ns = *self.outside_since_ns.get_or_insert(t_sensor_ns);
        t_sensor_ns.saturating_sub(since_ns) >= after_ns
    }
}

#[cfg(test)]
#[path = "../../tests/unit/twin_force_watch.rs"]
mod tests;
