//! Signs of a fitted contact force. An obstacle pushes and does not pull, and an actuator under more pressure pushes harder. Between the
//! training states an interpolant knows neither, and leave-one-out errors do not show it, so that both are looked at over the whole
//! region.

use crate::datasheet::ForceViolation;
use rom::hull::{DomainStatus, TrainingRange};
use rom::inputs::{InputAxis, InputMap, InputSpec, Inputs, PARAMETERS, PRESSURE, Point};
use rom::interpolant::Interpolant;
use rom::regime::OnsetAt;
use rom::rng::Rng;

/// Places along the pressure and along the gap, the ends of both included.
const ALONG: usize = 25;
/// Seed of the parameters' values at these places.
const SEED: u64 = 7;
/// Fraction of the largest force, or of its mean rise over the whole range of pressures, below which a wrong sign is rounding.
const ROUNDING: f64 = 1e-3;
/// Fraction of the largest force by which it must fall from a state to another with more pressure and no larger gap before the states
/// themselves say that force may fall: a tip that slides off its obstacle.
const FALLS: f64 = 5e-3;

/// A place of the region and what the fitted function is multiplied by there to be the force.
struct RegionPoint {
    inputs: Inputs,
    scaled: Point,
    /// Pressure above the onset, MPa; 1 if the fitted function is the force itself.
    factor: f64,
    /// Derivative of the factor with respect to pressure.
    factor_by_pressure: f64,
}

/// The region of a contact regime as a sample of places, and what the force must do there.
pub(crate) struct ForceRegion<'a> {
    points: Vec<RegionPoint>,
    inputs: &'a InputMap,
    largest_n: f64,
    /// False if the training states themselves show a force that falls while pressure rises.
    must_rise: bool,
}

impl<'a> ForceRegion<'a> {
    /// `states` are training states and their forces in N, `onset_at` the onset at a state if the force is fitted as a multiple of the
    /// pressure above it.
    pub fn new(
        (inputs, domain): (&'a InputMap, &TrainingRange),
        states: &[(Inputs, f64)],
        onset_at: Option<&dyn Fn(&Inputs) -> OnsetAt>,
    ) -> Self {
        let mut random = Rng::new(SEED);
        let leading = inputs.operating().clamp(1, inputs.dimensions());
        let mut points = Vec::new();
        for k in 0..ALONG.pow(leading as u32) {
            let mut scaled = Point::default();
            scaled[0] = (k % ALONG) as f64 / (ALONG - 1) as f64;
            scaled[1..leading].iter_mut().for_each(|x| *x = (k / ALONG) as f64 / (ALONG - 1) as f64);
            scaled[leading..inputs.dimensions()].iter_mut().for_each(|x| *x = random.uniform());
            if TrainingRange::status(domain.distance(&scaled)) != DomainStatus::Inside {
                continue;
            }
            let unscaled = |state: Inputs, (axis, x): (&InputAxis, &f64)| {
                state.with(axis.input, axis.min + x * (axis.max - axis.min))
            };
            let state = inputs.axes.iter().zip(&scaled).fold(states[0].0, unscaled);
            let factor = onset_at.map_or(1.0, |onset| state.pressure_mpa() - onset(&state).pressure_mpa);
            let factor_by_pressure = if onset_at.is_some() { 1.0 } else { 0.0 };
            if factor >= 0.0 {
                points.push(RegionPoint { inputs: state, scaled, factor, factor_by_pressure });
            }
        }
        let largest_n = states.iter().map(|state| state.1).fold(0.0, f64::max);
        let falls = states.iter().any(|(a, force_a)| {
            states.iter().any(|(b, force_b)| {
                let parameters = a.values()[PARAMETERS..].iter().zip(&b.values()[PARAMETERS..]);
                let is_pressed_further = a.pressure_mpa() < b.pressure_mpa()
                    && (a.gap_mm() >= b.gap_mm() || a.gap_mm().is_nan())
                    && parameters.into_iter().all(|(a, b)| a == b || (a.is_nan() && b.is_nan()));
                is_pressed_further && *force_b < force_a - FALLS * largest_n
            })
        });
        Self { points, inputs, largest_n, must_rise: !falls }
    }

    /// The place where a fitted function's force has the wrong sign, or the wrong derivative, by most; `None` where all is right.
    pub fn violation(&self, fitted: &Interpolant, specs: &[InputSpec]) -> Option<ForceViolation> {
        let pressure = self.inputs.axes.iter().position(|axis| axis.input == PRESSURE);
        let width_mpa = self.inputs.range(PRESSURE).map_or(1.0, |[low, high]| high - low);
        let largest_factor = self.points.iter().map(|point| point.factor).fold(0.0, f64::max);
        let mut worst: Option<(f64, ForceViolation)> = None;
        for point in &self.points {
            let (value, gradient) = fitted.value_and_gradient_at(&point.scaled);
            let force_n = value[0] * point.factor;
            let by_pressure = pressure.map(|axis| {
                value[0] * point.factor_by_pressure + point.factor * gradient[axis][0] / width_mpa
            });
            // The sign of the factor's multiple counts right behind the onset too, where the force itself is small.
            let pulls = -value[0] * largest_factor / self.largest_n;
            let falls =
                by_pressure.filter(|_| self.must_rise).map_or(0.0, |by| -by * width_mpa / self.largest_n);
            let size = pulls.max(falls);
            if size <= ROUNDING || worst.as_ref().is_some_and(|(most, _)| size <= *most) {
                continue;
            }
            let value_of = |axis: &InputAxis| (specs[axis.input].key(), point.inputs.values()[axis.input]);
            let inputs = self.inputs.axes.iter().map(value_of).collect();
            let force_by_pressure_n_per_mpa = by_pressure.unwrap_or(0.0);
            worst = Some((size, ForceViolation { inputs, force_n, force_by_pressure_n_per_mpa }));
        }
        worst.map(|(_, violation)| violation)
    }
}

#[cfg(test)]
#[path = "../tests/unit/force.rs"]
mod tests;
