//! Values reported by the paper (Pu, Hu, Liu, Niu, An: Digital twins for soft pneumatic actuators via reduced-order surrogate
//! modeling, Int. J. Solids Struct. 2026, doi 10.1016/j.ijsoistr.2026.114190): sections 4.1, 4.2, appendices A and B.

/// Mean squared error (Eq. 15) on the test cases, free and contact.
pub const MSE: [f64; 2] = [3.56e-4, 4.18e-3];
/// Modes per regime.
pub const MODES: [usize; 2] = [4, 6];

/// A case the paper shows, with its largest errors in percent.
pub struct Case {
    /// Name in the paper.
    pub name: &'static str,
    pressure_mpa: f64,
    gap_mm: Option<f64>,
    /// Largest relative stress error.
    pub stress: f64,
    /// Largest relative displacement error.
    pub displacement: f64,
    /// Relative contact-force error.
    pub force: Option<f64>,
    /// Contact-force difference of the nearest training sample (appendix B).
    pub nearest_force: Option<f64>,
}

const fn case(
    name: &'static str,
    pressure_mpa: f64,
    gap_mm: Option<f64>,
    stress: f64,
    displacement: f64,
    force: Option<f64>,
    nearest_force: Option<f64>,
) -> Case {
    Case { name, pressure_mpa, gap_mm, stress, displacement, force, nearest_force }
}

const CASES: [Case; 8] = [
    case("A", 0.014352, None, 0.4, 0.2, None, None),
    case("B", 0.067412, None, 0.4, 0.2, None, None),
    case("C", 0.035154, Some(35.7634), 2.0, 0.24, Some(3.42), Some(22.6)),
    case("D", 0.070469, Some(29.744473), 1.0, 0.44, Some(2.21), Some(15.4)),
    case("E", 0.092, None, 28.5, 4.4, None, None),
    case("F", 0.1, None, 42.9, 15.0, None, None),
    case("G", 0.092, Some(8.0), 30.0, 15.0, Some(2.28), None),
    case("H", 0.1, Some(55.0), 40.0, 20.0, Some(14.23), None),
];

/// The paper's case at this state.
pub fn find(pressure_mpa: f64, gap_mm: Option<f64>) -> Option<&'static Case> {
    let near = |a: f64, b: f64| (a - b).abs() < 1e-5 * b.abs().max(1e-3);
    CASES.iter().find(|c| {
        near(pressure_mpa, c.pressure_mpa)
            && match (gap_mm, c.gap_mm) {
                (Some(a), Some(b)) => near(a, b),
                (None, None) => true,
                _ => false,
            }
    })
}
