//! A closed amount of gas in a cavity and its supply, at constant temperature.
//!
//! ```text
//! (P + P_a) (V + V_d) = P_a (V_0 + V_d + n)     n = m R T / P_a: gas added, as its volume at atmospheric pressure
//! ```

/// Atmospheric pressure (MPa).
pub const ATMOSPHERE_MPA: f64 = 0.101_325;
/// Volume of a milligram of air at 20 degrees Celsius and atmospheric pressure (mm3): R = 287.05 J/(kg K).
pub const MM3_PER_MG: f64 = 287.05e-3 * 293.15 / ATMOSPHERE_MPA;

/// Gas in a cavity of the volume `cavity_mm3` (mm3 at atmospheric pressure), with that of its supply.
pub(crate) fn amount_mm3(pressure_mpa: f64, cavity_mm3: f64, dead_mm3: f64) -> f64 {
    (1.0 + pressure_mpa / ATMOSPHERE_MPA) * (cavity_mm3 + dead_mm3)
}
