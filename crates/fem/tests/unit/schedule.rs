//! Starts of cases.

use super::{Start, starts};
use crate::cases::Case;

fn case(pressure_mpa: f64, gap_mm: Option<f64>, stiffness: f64) -> Case {
    Case {
        name: String::new(),
        regime: String::new(),
        split: String::new(),
        pressure_mpa,
        volume_mm3: None,
        gap_mm,
        settings: vec![("elastomer.law.mu_mpa".to_owned(), stiffness)],
    }
}

#[test]
fn case_starts_from_the_nearest_case_of_its_body() {
    let cases = [
        case(0.06, None, 0.7),
        case(0.05, Some(30.0), 0.7),
        case(0.05, Some(30.0), 1.0),
        case(0.05, Some(26.0), 0.7),
        // The same body has a state at half the pressure; the other body's at the same pressure is not nearer.
        case(0.02, Some(20.0), 1.0),
        case(0.06, Some(30.0), 0.8),
    ];
    let first: Vec<Start> = starts(&cases, &[0.8]).into_iter().map(|starts| starts[0]).collect();
    let expected =
        [Start::Rest, Start::Case(0), Start::Case(1), Start::Case(1), Start::Case(2), Start::Case(1)];
    assert_eq!(first, expected);
}

/// Distances count by the list's own extents: with units of a stiff actuator, every contact state of a soft one would start from the
/// nearest gap, whatever its pressure.
#[test]
fn case_of_a_soft_actuator_starts_from_the_nearest_pressure() {
    let cases = [case(0.0004, Some(21.0), 0.8), case(0.0068, Some(26.0), 0.8), case(0.007, Some(20.0), 0.8)];
    assert_eq!(starts(&cases, &[0.8])[2][0], Start::Case(1));
}
