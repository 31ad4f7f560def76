//! Tests of `src/cmd/build/plan.rs`.

use super::*;
use std::collections::HashSet;

#[test]
fn names_and_states_are_unique_and_contact_states_are_beyond_the_onset() {
    for sag in [0.05, 3.0, 27.0] {
        let states: Vec<(f64, f64)> =
            (0..8).map(|k| (0.01 * f64::from(k), sag + 5.0 * f64::from(k))).collect();
        let pressures = Pressures {
            touching: states.len(),
            states,
            displacement_mm: 40.0,
            angle_deg: 100.0,
            stretch: 1.5,
            reason: String::new(),
        };
        for counts in [Counts::FULL, Counts::QUICK] {
            let plan = Plan::touching(&pressures, counts).unwrap();
            let text = fem::cases::to_csv(&plan.cases);
            assert_eq!(fem::cases::parse(&text).unwrap(), plan.cases, "names or loads collide");
            let names: HashSet<&str> = plan.cases.iter().map(|case| case.name.as_str()).collect();
            assert!(names.contains("rest") && names.contains("largest") && names.contains("check01"));
            for case in plan.cases.iter().filter(|case| case.gap_mm.is_some()) {
                let onset_mpa = 0.002 * (case.gap_mm.unwrap() - sag);
                let touches = case.pressure_mpa > onset_mpa && case.pressure_mpa <= 0.07 + 1e-12;
                assert!(touches, "sag {sag}: {case:?} has its onset at {onset_mpa}");
            }
        }
    }
}
