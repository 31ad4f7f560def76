//! The inverse of a model along the pressure: Newton's method on the model's own gradient, kept in a bracket by bisection.

/// Force and observable of one state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Contact force, N; 0 without contact.
    pub force_n: f64,
    /// Derivative with respect to pressure, N/MPa.
    pub force_by_pressure: f64,
    /// The observable that is followed, such as the tip's height in mm or an angle in degrees.
    pub observable: f64,
    /// Derivative with respect to pressure, per MPa.
    pub observable_by_pressure: f64,
    /// Pressure of first contact at this gap, MPa; infinite out of reach.
    pub onset_mpa: f64,
}

/// A model of the actuator: any state is answered, without allocation.
pub trait Model {
    /// Force and observable at a pressure in MPa and a gap in mm.
    fn at(&mut self, pressure_mpa: f64, gap_mm: f64) -> Point;
    /// Pressures that the model knows, MPa.
    fn range_mpa(&self) -> [f64; 2];
    /// Whether the observable grows with the pressure.
    fn observable_grows(&self) -> bool;
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// The contact force, N: grows with the pressure, from the onset on.
    Force,
    /// The model's observable: falls or grows with the pressure.
    Observable,
    /// The pressure itself, MPa.
    Pressure,
}

impl Quantity {
    /// Value and derivative with respect to pressure.
    pub fn of(self, point: &Point, pressure_mpa: f64) -> (f64, f64) {
        match self {
            Self::Force => (point.force_n, point.force_by_pressure),
            Self::Observable => (point.observable, point.observable_by_pressure),
            Self::Pressure => (pressure_mpa, 1.0),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inverse {
    /// The pressure, MPa; an end of the model's range where the value lies beyond it.
    pub pressure_mpa: f64,
    /// Derivative of the quantity with respect to pressure there.
    pub slope: f64,
    /// Requested value minus the model's, in the quantity's unit, before the last correction.
    pub residual: f64,
    /// Contact force there before the last correction, N.
    pub force_n: f64,
    /// The value is within the model's range.
    pub is_reached: bool,
}

/// Most evaluations of one search; a search that begins near its end takes one or two.
const MAX_EVALUATIONS: usize = 24;
/// The first correction below this is the last, MPa: what Newton's method leaves after it is of its square.
const TOLERANCE_MPA: f64 = 1e-5;
/// Tolerance of a value at an end of the range, as a fraction of it.
const ROUNDING: f64 = 1e-12;

/// The pressure at which `quantity` has `value` at this gap, searched from `start_mpa`. Never allocates; at most
/// `MAX_EVALUATIONS` evaluations.
pub fn inverse(
    model: &mut impl Model,
    quantity: Quantity,
    gap_mm: f64,
    value: f64,
    start_mpa: f64,
) -> Inverse {
    let range_mpa = model.range_mpa();
    let [mut low, mut high] = range_mpa;
    let mut pressure_mpa = start_mpa.clamp(low, high);
    let mut found =
        Inverse { pressure_mpa, slope: 0.0, residual: f64::NAN, force_n: f64::NAN, is_reached: false };
    let grows = quantity != Quantity::Observable || model.observable_grows();
    let mut is_known = [false; 2]; // whether the model was asked at the bracket's ends
    for _ in 0..MAX_EVALUATIONS {
        let point = model.at(pressure_mpa, gap_mm);
        if quantity == Quantity::Force && value <= 0.0 {
            // Every pressure up to the onset has no force; the onset is where one begins.
            let pressure_mpa = point.onset_mpa.clamp(low, high);
            let is_reached = point.onset_mpa <= high;
            return Inverse { pressure_mpa, slope: 0.0, residual: 0.0, force_n: 0.0, is_reached };
        }
        let (now, slope) = quantity.of(&point, pressure_mpa);
        let error = value - now;
        let force_n = point.force_n;
        found = Inverse { pressure_mpa, slope, residual: error, force_n, is_reached: false };
        let is_above = (error > 0.0) == grows;
        if is_above {
            (low, is_known[0]) = (pressure_mpa, true);
        } else {
            (high, is_known[1]) = (pressure_mpa, true);
        }
        // Without contact there is no slope; the onset is as near as a force can be, and no step to it is the last.
        let is_flat = quantity == Quantity::Force && point.force_n == 0.0 && point.onset_mpa > pressure_mpa;
        let newton = if is_flat { point.onset_mpa + 1e-9 } else { pressure_mpa + error / slope };
        // A value at an end of the range is found there, not at the end of a bisection.
        let next = match newton {
            inside if inside > low && inside < high => inside,
            beyond if beyond <= low && !is_known[0] => low,
            beyond if beyond >= high && !is_known[1] => high,
            _ => 0.5 * (low + high),
        };
        let step = next - pressure_mpa;
        if error == 0.0 || (step.abs() < TOLERANCE_MPA && !is_flat) {
            found.pressure_mpa = if error == 0.0 { pressure_mpa } else { next };
            // The last correction is what a search within the range ends with. At its ends there is none: the residual stays, and a value
            // that lies beyond by more than rounding is not reached.
            let is_beyond = pressure_mpa == range_mpa[usize::from(is_above)]
                && error.abs() > ROUNDING * value.abs().max(1.0);
            found.is_reached =
                !is_beyond && error.abs() <= 2.0 * (slope * TOLERANCE_MPA).abs() || error == 0.0;
            return found;
        }
        pressure_mpa = next;
    }
    found
}
