use super::*;

#[test]
fn the_range_leaves_nan_out() {
    assert_eq!(range(&[2.0, f32::NAN, -1.0]), (-1.0, 2.0));
}

#[test]
fn inputs_show_where_they_come_from() {
    let input =
        |name: &str, source| InputValue { name: name.into(), value: 0.72, force_by: f64::NAN, source };
    let [measured, given] = [input_source::MEASURED, input_source::GIVEN];
    let all = |sources: [u8; 3]| {
        let [pressure, gap, mu] = sources;
        [input("pressure_mpa", pressure), input("gap_mm", gap), input("mu_mpa", mu)].into_iter()
    };
    assert_eq!(parameters(all([measured, measured, given])), "  mu_mpa 0.72000 (given)");
    assert_eq!(not_measured(all([measured, given, given])), "(gap_mm given)  ");
    assert_eq!(not_measured(all([measured, measured, given])), "");
    let unknown = all([input_source::UNKNOWN; 3]).map(|input| InputValue { force_by: 1.5, ..input });
    assert_eq!(parameters(unknown), "  mu_mpa 0.72000 (dF 1.5000 N per unit)");
}

#[test]
fn a_state_shows_nothing_that_its_model_does_not_have() {
    let mut known = State { pressure_mpa: 0.05, gap_mm: 40.0, contact_force_n: 0.2, ..State::default() };
    let parts = |state: &State| ["P ", "gap", "F ", "NaN"].map(|part| super::state(state).contains(part));
    assert_eq!(parts(&known), [true, true, true, false]);
    (known.pressure_mpa, known.gap_mm, known.contact_force_n) = (f64::NAN, f64::NAN, f64::NAN);
    assert_eq!(parts(&known), [false; 4]);
}

#[test]
fn a_grasp_is_one_sentence() {
    let held = Grasp {
        grasp_status: grasp_status::HELD,
        least_force_n: 0.5862,
        needed_force_n: 0.4169,
        stop_pressure_mpa: 0.0651,
        stop_pressure_halfwidth_mpa: 0.0012,
        ..Grasp::default()
    };
    assert_eq!(grasp(&held), "held, 0.586 of 0.417 N per finger, first held at 0.06510 +- 0.00120 MPa");
    assert!(grasp(&Grasp::default()).ends_with("no sampled pressure holds it"));
}
