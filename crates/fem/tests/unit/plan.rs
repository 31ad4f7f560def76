//! Tests of `src/plan/states.rs`.

use super::*;
use std::collections::HashSet;

/// A search that found these states: pressure (MPa) and the gap (mm) that it closes.
fn found(states: Vec<(f64, f64)>) -> Pressures {
    Pressures {
        touching: states.len(),
        states,
        displacement_mm: 40.0,
        angle_deg: 100.0,
        stretch: 1.5,
        reason: String::new(),
    }
}

#[test]
fn names_and_states_are_unique_and_contact_states_are_beyond_the_onset() {
    for sag in [0.05, 3.0, 27.0] {
        let states: Vec<(f64, f64)> =
            (0..8).map(|k| (0.01 * f64::from(k), sag + 5.0 * f64::from(k))).collect();
        let pressures = found(states);
        for counts in [Counts::FULL, Counts::QUICK] {
            let plan = Plan::with_contact(&pressures, counts).unwrap();
            let text = crate::cases::to_csv(&plan.cases);
            assert_eq!(crate::cases::parse(&text).unwrap(), plan.cases, "names or loads collide");
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

/// An actuator that comes down ever faster: straight lines between its free states put states before the onset.
#[test]
fn contact_states_are_beyond_a_bent_onset_and_fill_the_region() {
    let largest_mpa = 0.06;
    let clearance = |mpa: f64| 1.0 + 60.0 * (mpa / largest_mpa).powi(3);
    let states: Vec<(f64, f64)> =
        (0..8).map(|k| largest_mpa * f64::from(k) / 7.0).map(|mpa| (mpa, clearance(mpa))).collect();
    let pressures = found(states);
    for counts in [Counts::FULL, Counts::QUICK] {
        let plan = Plan::with_contact(&pressures, counts).unwrap();
        let [lowest, highest] = plan.gaps_mm.unwrap();
        let onset_mpa = |gap: f64| largest_mpa * ((gap - 1.0) / 60.0).max(0.0).cbrt();
        let contact: Vec<(f64, f64)> =
            plan.cases.iter().filter_map(|case| Some((case.gap_mm?, case.pressure_mpa))).collect();
        assert!(contact.iter().all(|(gap, mpa)| *mpa > onset_mpa(*gap)), "{contact:?}");
        // Middle pressures at either end of the gaps, where the other states do not reach.
        for gap in [lowest, highest] {
            let shares = contact.iter().filter(|state| state.0 == gap);
            let shares = shares.map(|(_, mpa)| (mpa - onset_mpa(gap)) / (largest_mpa - onset_mpa(gap)));
            assert!(shares.filter(|share| (0.2..0.8).contains(share)).count() >= 2, "gap {gap}: {contact:?}");
        }
    }
}

/// States without force move towards the largest pressure; one that is there already is left out.
#[test]
fn states_that_touch_nothing_are_pressed_further() {
    let case =
        |name: &str, pressure_mpa: f64| Case { gap_mm: Some(9.0), ..Case::new(name, pressure_mpa, None) };
    let mut cases = vec![case("a", 0.01), case("b", 0.02), case("c", 0.05)];
    press_further(&mut cases, &["a".to_owned(), "c".to_owned()], 0.05);
    assert_eq!(cases, [case("a", 0.014), case("b", 0.02)]);
}

/// Free states touch at 3 mm + 100 mm/MPa p - 50 mm/MPa q, of which the plate is tried within 2 to 6 mm.
#[test]
fn landings_are_below_the_gap_at_which_all_pressures_together_touch() {
    let free = cavity_cases(&["pressure_mpa.lower".into()], 0.08, Counts::QUICK);
    let touches = |case: &Case| 3.0 + 100.0 * case.pressure_mpa - 50.0 * case.settings[0].1;
    let clearances: Vec<f64> = free.iter().map(touches).collect();
    let landings = landing_cases(&free, &clearances, [2.0, 6.0]);
    let expected = free.iter().filter(|case| case.settings[0].1 > 0.0 && touches(case) > 2.0);
    let names: Vec<String> = expected.map(|case| format!("landing-{}", case.name)).collect();
    assert_eq!(landings.iter().map(|case| case.name.clone()).collect::<Vec<_>>(), names);
    assert!(landings.len() > 15 && landings.len() < free.len(), "{} of {}", landings.len(), free.len());
    for case in &landings {
        let gap_mm = case.gap_mm.expect("a plate");
        assert!(case.regime == "contact" && (2.0..touches(case).min(6.0)).contains(&gap_mm), "{case:?}");
    }
    assert!(landings.iter().any(|case| case.split == "check"));
}
