//! Tests of `src/quality.rs`.

use super::{shares, too_large};
use rom::halfwidths::Errors;
use rom::snapshots::{Case, RegimeKind, Split};

fn case(name: &str, contact_force_n: f64) -> Case {
    Case {
        name: name.into(),
        regime: RegimeKind::Contact,
        split: Split::Check,
        pressure_mpa: 0.01,
        gap_mm: Some(9.0),
        parameters: Vec::new(),
        contact_force_n,
    }
}

fn values(displacement_mm: f64, stress_mpa: f64, force_n: f64) -> Errors {
    Errors { displacement_mm, stress_mpa, force_n }
}

#[test]
fn errors_are_shares_of_the_largest_value_and_of_the_range() {
    let cases = [case("a", 0.2), case("b", 0.6)];
    let largest = [values(20.0, 0.1, 0.2), values(30.0, 0.3, 0.6)];
    let errors = [(0, values(0.2, 0.002, 0.006)), (1, values(0.6, 0.018, 0.012))];
    let found = shares(RegimeKind::Contact, &cases, &largest, &errors).expect("two states");
    let close = |a: [f64; 2], b: [f64; 2]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
    let displacement = found.displacement.as_ref().expect("measured");
    assert!(close(displacement.percent, [1.5, 2.0]), "{displacement:?}");
    assert!(close(displacement.percent_of_range, [4.0, 6.0]), "{displacement:?}");
    let force = found.force.as_ref().expect("measured");
    assert!(close(force.percent, [1.5, 2.0]) && force.worst_case == "b", "{force:?}");
    assert!(close(force.percent_of_range, [2.25, 3.0]), "{force:?}");
    // 6 % of the stress is said, with the state.
    let said: Vec<String> = too_large(&found).collect();
    assert!(said.len() == 1 && said[0].contains("stress") && said[0].contains('b'), "{said:?}");
    // A model without stress has no share of it.
    let without = [(0, values(0.2, f64::NAN, 0.006))];
    let found = shares(RegimeKind::Contact, &cases, &largest, &without).expect("a state");
    assert!(found.stress.is_none() && found.force.is_some(), "{found:?}");
}
