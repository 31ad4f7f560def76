//! A controller that holds a contact force by commanding pressure, with the twin as its model.
//!
//! `u = P(F*) + k_p e / g + k_i \int e / g dt`, with `e = F* - F`. `P(F*)` is the twin's inverse at the gap that is assumed:
//! it brings the force most of the way at once. `g = dF/dP` is the twin's gradient at the present state: divided by it, an
//! error in N becomes an error in MPa, so one pair of gains serves soft and stiff contact. The integral takes up what the
//! model does not know, above all a gap that is not the assumed one.

/// Gains and limits.
#[derive(Debug, Clone, Copy)]
pub struct Gains {
    /// Proportional gain: share of the model's inverse of the error.
    pub proportional: f64,
    /// Integral gain, 1/s.
    pub integral_per_s: f64,
    /// Smallest gradient that is divided by, N/MPa: out of contact the twin says 0.
    pub least_gradient: f64,
    /// Highest pressure that is commanded, MPa.
    pub highest_mpa: f64,
}

impl Default for Gains {
    /// For a lag of 80 ms behind a delay of 20 to 40 ms: the integral cancels the lag (`k_p / k_i = tau`), and the loop
    /// crosses over at `k_i` = 6/s, where the delay costs less than 15 degrees.
    fn default() -> Self {
        Self { proportional: 0.5, integral_per_s: 6.0, least_gradient: 3.0, highest_mpa: 0.09 }
    }
}

/// The controller's memory.
#[derive(Debug, Clone)]
pub struct Controller {
    gains: Gains,
    target_n: f64,
    feed_forward_mpa: f64,
    integral_mpa: f64,
}

impl Controller {
    /// A controller for `target_n`, with the twin's inverse as its feed-forward.
    pub fn new(gains: Gains, target_n: f64, feed_forward_mpa: f64) -> Self {
        Self { gains, target_n, feed_forward_mpa, integral_mpa: 0.0 }
    }

    /// The pressure to command, MPa, for a force and the twin's gradient there, `dt_s` after the last call.
    pub fn update(&mut self, force_n: f64, gradient_n_per_mpa: f64, dt_s: f64) -> f64 {
        let gains = self.gains;
        let error_mpa = (self.target_n - force_n) / gradient_n_per_mpa.max(gains.least_gradient);
        let integral_mpa = self.integral_mpa + gains.integral_per_s * error_mpa * dt_s;
        let wanted = self.feed_forward_mpa + gains.proportional * error_mpa + integral_mpa;
        let command = wanted.clamp(0.0, gains.highest_mpa);
        // At a limit the integral stands still, unless it leads away from it.
        if command == wanted || (wanted - command) * error_mpa < 0.0 {
            self.integral_mpa = integral_mpa;
        }
        command
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::step_response;

    /// The loop against a lag with delay and a force whose slope is not the one the controller is told.
    fn run(true_slope: f64, told_slope: f64, onset_mpa: f64) -> crate::report::StepResponse {
        let (dt_s, tau_s, delay) = (0.002, 0.08, 15);
        let mut controller = Controller::new(Gains::default(), 0.3, 0.05);
        let (mut pressure, mut commands) = (0.0_f64, vec![0.0; delay]);
        let mut points = Vec::new();
        for step in 0..2500 {
            let force = ((pressure - onset_mpa) * true_slope).max(0.0);
            points.push((f64::from(step) * dt_s, force));
            commands.push(controller.update(force, told_slope, dt_s));
            pressure += (commands[step as usize] - pressure) * dt_s / tau_s;
        }
        step_response(0.3, &points)
    }

    #[test]
    fn the_force_settles_although_the_model_is_wrong() {
        for (true_slope, told_slope, onset_mpa) in [(10.0, 10.0, 0.02), (10.0, 14.0, 0.02), (10.0, 7.0, 0.03)]
        {
            let found = run(true_slope, told_slope, onset_mpa);
            assert!(found.settling_s.is_some_and(|s| s < 2.5), "{true_slope} {told_slope}: {found:?}");
            // The last slope is told 30 % too small, so its feed-forward alone overshoots by as much.
            assert!(found.overshoot < 0.4 && found.final_error.abs() < 0.01, "{found:?}");
        }
    }

    #[test]
    fn a_limit_does_not_wind_the_integral_up() {
        let mut controller = Controller::new(Gains::default(), 5.0, 0.05);
        for _ in 0..10_000 {
            assert!(controller.update(0.0, 10.0, 0.002) <= 0.09);
        }
        // Beyond the target the command must fall at once, not after the integral has run down.
        assert!(controller.update(9.0, 10.0, 0.002) < 0.06);
    }
}
