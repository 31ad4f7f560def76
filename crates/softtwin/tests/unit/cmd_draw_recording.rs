//! Tests of `src/cmd/draw/recording.rs` that need its private parts.

use super::*;
use wire::State;
use wire::layout::set_slot;

/// State with these observables.
fn state(t_s: f64, observables: &[(&str, f64)]) -> RecordedState {
    let mut values = State { observable_count: observables.len() as u32, ..State::default() };
    for (at, (name, value)) in observables.iter().enumerate() {
        set_slot(&mut values.observable_names, at, name);
        values.observables[at] = *value;
    }
    RecordedState { t_s, values }
}

#[test]
fn each_observable_has_a_panel_with_a_line_per_actuator_that_has_it() {
    let left = [
        state(0.0, &[("angle_deg", 1.0), ("tip_x_mm", 90.0)]),
        state(1.0, &[("angle_deg", f64::NAN), ("tip_x_mm", 89.0)]),
        state(2.0, &[("angle_deg", 3.0), ("tip_x_mm", 88.0)]),
    ];
    let right = [state(0.5, &[("angle_deg", 2.0)])];
    let panels = observed(&[("left", &left), ("right", &right)]);
    let lines = |panel: &Panel| -> Vec<(String, Vec<(f64, f64)>)> {
        panel.series.iter().map(|line| (line.name.clone(), line.points.clone())).collect()
    };
    assert_eq!(panels.len(), 2);
    let expected = [("left", vec![(0.0, 1.0), (2.0, 3.0)]), ("right", vec![(0.5, 2.0)])];
    assert_eq!(lines(&panels[0]), expected.map(|(name, points)| (name.to_owned(), points)));
    assert_eq!(lines(&panels[1]), [("left".to_owned(), vec![(0.0, 90.0), (1.0, 89.0), (2.0, 88.0)])]);
    assert_eq!(panels[0].series[1].colour, 1, "an actuator keeps its colour");
}
