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
mod tests {
    use super::ForceWatch;

    const MS: u64 = 1_000_000;

    #[test]
    fn the_alarm_comes_after_the_time_and_goes_at_once() {
        let mut watch = ForceWatch::default();
        let mut at = |ms: u64, residual_n: f64| watch.update(ms * MS, residual_n, 0.02, 300 * MS);
        assert!(!at(0, 0.01) && !at(100, -0.5) && !at(399, 0.5), "outside for 299 ms is no alarm");
        assert!(at(400, -0.5) && at(500, 0.03), "300 ms are, on either side");
        assert!(!at(600, 0.02), "back inside: over");
        assert!(!at(700, 0.5) && at(1_000, 0.5), "and the time begins anew");
    }

    #[test]
    fn an_outlier_or_a_missing_value_begins_anew() {
        let mut watch = ForceWatch::default();
        for ms in 0..1_000u64 {
            let residual_n = if ms % 100 == 99 { f64::NAN } else { 1.0 };
            assert!(!watch.update(ms * MS, residual_n, 0.02, 200 * MS), "{ms} ms");
        }
        assert!(!watch.update(0, 1.0, f64::NAN, 0), "without a half-width nothing can be said");
    }
}
