use super::*;
use wire::layout::set_slot;

#[test]
fn inputs_have_the_pressures_of_all_cavities_in_pascals() {
    let mut state = State { input_count: 4, ..State::default() };
    state.inputs[..4].copy_from_slice(&[0.02, 30.0, 0.01, 0.8]);
    let names = ["pressure_mpa", "gap_mm", "pressure_mpa.lower", "elastomer.law.jm"];
    names.iter().enumerate().for_each(|(at, name)| set_slot(&mut state.input_names, at, name));
    let message = inputs(&state, "two", 0).unwrap();
    let values = [2.0e4, 0.03, 1.0e4, 0.8];
    let expected =
        Cdr::new().header(0, "two").strings(&names).word(4).doubles(&values).word(0).word(0).finish();
    assert_eq!(message, expected);
    assert_eq!(inputs(&State::default(), "two", 0), None);
}
