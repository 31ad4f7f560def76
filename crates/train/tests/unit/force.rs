//! Signs of a fitted contact force.

use super::ForceRegion;
use crate::config::{KernelKind, KernelSpec, Tail};
use crate::fit::{Samples, fit};
use rom::hull::TrainingRange;
use rom::inputs::{InputMap, InputSpec, Inputs, PRESSURE, Point};
use rom::interpolant::{Interpolant, Metric};

const PRESSURES_MPA: [f64; 7] = [0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06];

/// Inputs and training range of these pressures, at one gap, and the states with their forces (N).
fn region(forces: [f64; 7]) -> (InputMap, TrainingRange, Vec<Point>, Vec<(Inputs, f64)>) {
    let states = PRESSURES_MPA.map(|pressure_mpa| Inputs::new(pressure_mpa, 20.0)).to_vec();
    let inputs = InputMap::of_states(&states, &[PRESSURE]);
    let scaled: Vec<Point> = states.iter().map(|state| inputs.scale(state)).collect();
    let domain = TrainingRange::of_points(1, 1, &scaled);
    (inputs, domain, scaled, states.into_iter().zip(forces).collect())
}

fn fitted(kernel: KernelKind, tail: Tail, scaled: &[Point], values: &[f64]) -> Interpolant {
    let samples = Samples {
        dimensions: 1,
        inputs: scaled,
        values,
        outputs: 1,
        slopes: &[],
        slope_values: &[],
        exact: None,
    };
    fit(&samples, KernelSpec { kernel, tail }, Metric::IDENTITY, 0.0).expect("fits").interpolant
}

/// Forces that rise in one step: a cubic spline swings below zero before it and falls behind it, straight lines do neither.
#[test]
fn swing_of_a_spline_between_states_is_found_with_its_place() {
    let specs = InputSpec::without_range(&[]);
    let forces = [0.001, 0.002, 0.003, 0.004, 1.0, 1.001, 1.002];
    let (inputs, domain, scaled, with_forces) = region(forces);
    let rising = ForceRegion::new((&inputs, &domain), &with_forces, None);
    let straight = fitted(KernelKind::Linear, Tail::Constant, &scaled, &forces);
    assert_eq!(rising.violation(&straight, &specs), None);
    let spline = fitted(KernelKind::Cubic, Tail::Linear, &scaled, &forces);
    let found = rising.violation(&spline, &specs).expect("swings");
    let pressure_mpa = found.inputs["pressure_mpa"];
    assert!((0.02..0.06).contains(&pressure_mpa), "{found:?}");
    assert!(found.force_n < 0.0 || found.force_by_pressure_n_per_mpa < 0.0, "{found:?}");
    assert!(found.to_string().contains("pressure_mpa"), "{found}");
}

/// Where the states themselves fall, as those of a tip that slides off, a falling force is no fault; a negative one is.
#[test]
fn force_may_fall_where_the_states_fall() {
    let specs = InputSpec::without_range(&[]);
    let forces = [0.2, 0.4, 0.6, 0.7, 0.6, 0.4, 0.2];
    let (inputs, domain, scaled, with_forces) = region(forces);
    let region = ForceRegion::new((&inputs, &domain), &with_forces, None);
    let spline = |forces: &[f64]| fitted(KernelKind::Cubic, Tail::Linear, &scaled, forces);
    assert_eq!(region.violation(&spline(&forces), &specs), None);
    let pulls = spline(&forces.map(|force_n| force_n - 0.3));
    assert!(region.violation(&pulls, &specs).is_some_and(|found| found.force_n < 0.0));
}
