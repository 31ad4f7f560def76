//! Motion with two inertial loads, against a closed form.

use crate::inertia::{LOAD, along_one, coordinates, reading, settings};
use rom::inertia::manifold::{Equilibrium, InertialLoad, Manifold};
use rom::inertia::stepper::Motion;
use rom::inputs::Inputs;
use rom::snapshots::RegimeKind;

/// Unit mass on a spring in a plane, softer along the second load, with stiffness `[[A, B], [B, C]]`; exact with two loads.
struct Plane {
    loads: Vec<InertialLoad>,
}

/// Stiffness, mJ/mm2, and place of the second load in the inputs.
const PLANE: [f64; 3] = [900.0, 200.0, 400.0];
const ACROSS: usize = LOAD + 1;

impl Plane {
    fn new() -> Self {
        let range = [-40_000.0, 40_000.0];
        let of = |input, unit: &[f64]| InertialLoad { input, unit: coordinates(unit), range };
        Self { loads: vec![of(LOAD, &[1.0]), of(ACROSS, &[0.0, 1.0])] }
    }
}

impl Manifold for Plane {
    fn loads(&self) -> &[InertialLoad] {
        &self.loads
    }

    fn equilibrium(&mut self, _: RegimeKind, inputs: &Inputs) -> Equilibrium {
        let ([a, b, c], [_, _, first, second, ..]) = (PLANE, *inputs.values());
        let inverse = [[c, -b], [-b, a]].map(|row| row.map(|v| v / (a * c - b * b)));
        let x = inverse.map(|row| row[0] * first + row[1] * second);
        let mut tangents = along_one(&inverse[0]);
        tangents[1] = coordinates(&inverse[1]);
        let by_pressure = coordinates(&[1000.0]);
        Equilibrium {
            position: coordinates(&[x[0] + 1000.0 * inputs.pressure_mpa(), x[1]]),
            tangents,
            by_pressure,
        }
    }
}

#[test]
fn two_loads_swing_as_the_two_modes_of_a_plane() {
    let mut motion = Motion::new(Plane::new(), settings(250_000, 0.0));
    let at = |second: f64| reading(0.0, f64::INFINITY).with(LOAD, 0.0).with(ACROSS, second);
    motion.advance(0, &at(0.0)).unwrap();
    // The base is accelerated across from the first reading on: x'' + K (x - x_end) = 0.
    motion.advance(1, &at(5000.0)).unwrap();
    let [a, b, c] = PLANE;
    let end = Plane::new().equilibrium(RegimeKind::Free, &at(5000.0)).position;
    let spread = (0.25 * (a - c).powi(2) + b * b).sqrt();
    let squares = [0.5 * (a + c) + spread, 0.5 * (a + c) - spread];
    let length = (b * b + (squares[0] - a).powi(2)).sqrt();
    let upper = [b / length, (squares[0] - a) / length];
    let shapes = [upper, [-upper[1], upper[0]]];
    let mut worst = 0.0_f64;
    for i in 1..=500_u64 {
        let moved = motion.advance(1 + i * 4_000_000, &at(5000.0)).unwrap();
        assert!(moved.load_distance == 0.0 && !moved.at_rest, "{moved:?}");
        let found = motion.manifold().equilibrium(RegimeKind::Free, &moved.state.inputs).position;
        for axis in 0..2 {
            let along = |shape: &[f64; 2]| end[0] * shape[0] + end[1] * shape[1];
            let swings = shapes
                .iter()
                .zip(squares)
                .map(|(shape, square)| // The jump of the load takes one inner step.
                shape[axis] * along(shape) * (square.sqrt() * (i as f64 * 4e-3 - 0.5 * 250e-6)).cos());
            worst = worst.max((found[axis] - (end[axis] - swings.sum::<f64>())).abs());
        }
    }
    assert!(worst < 0.002 * end[1], "{worst} of {end:?}");
}
