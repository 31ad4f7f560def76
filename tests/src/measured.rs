//! A small model learned from measurements, which has lags, reservoirs and some outputs.

use rom::model::Model;
use rom::rng::Rng;
use train::measured::{Measured, Run, learn};

/// Outputs of a bench: name, value over the lagged difference of the pressures, noise.
type BenchOutput = (&'static str, fn(f64) -> f64, f64);

/// A marker, an angle and a force.
const OUTPUTS: [BenchOutput; 3] = [
    ("tip_y_mm", |lagged_mpa| 200.0 * lagged_mpa, 0.05),
    ("angle_deg", |lagged_mpa| 900.0 * lagged_mpa * lagged_mpa, 0.02),
    ("force_n", |lagged_mpa| 30.0 * lagged_mpa, 0.01),
];

/// 400 rows of a bench with a pressure, an outlet, a marker and an angle.
///
/// # Panics
/// If it cannot be learned.
#[must_use]
pub fn learned_model() -> Model {
    learned(&OUTPUTS[..2])
}

/// As [`learned_model`], with a force too.
///
/// # Panics
/// If it cannot be learned.
#[must_use]
pub fn learned_model_with_force() -> Model {
    learned(&OUTPUTS)
}

fn learned(outputs: &[BenchOutput]) -> Model {
    let mut rng = Rng::new(11);
    let mut run =
        Run { inputs: vec![Vec::new(); 2], outputs: vec![Vec::new(); outputs.len()], ..Run::default() };
    let mut behind = 0.0;
    for row in 0..400 {
        let t_s = 0.02 * f64::from(row);
        let inputs = [0.05 - 0.05 * (1.3 * t_s).cos(), 0.03 - 0.03 * (2.9 * t_s).cos()];
        behind += (1.0 - f64::exp(-0.02 / 0.3)) * (inputs[0] - inputs[1] - behind);
        run.time_s.push(t_s);
        run.inputs.iter_mut().zip(inputs).for_each(|(column, value)| column.push(value));
        for (column, (_, value, noise)) in run.outputs.iter_mut().zip(outputs) {
            column.push(value(behind) + noise * rng.normal());
        }
    }
    let data = Measured {
        inputs: vec!["pressure_mpa".into(), "outlet_mpa".into()],
        outputs: outputs.iter().map(|(name, ..)| (*name).into()).collect(),
        runs: vec![run],
    };
    learn("bench", &data).expect("learns").model
}
