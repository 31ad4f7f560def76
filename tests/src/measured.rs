//! A small model learned from measurements, which has lags, reservoirs and two outputs.

use rom::model::Model;
use rom::rng::Rng;
use train::measured::{Measured, Run, learn};

/// 400 rows of a bench with a pressure, an outlet, a marker and an angle.
///
/// # Panics
/// If it cannot be learned.
#[must_use]
pub fn learned_model() -> Model {
    let mut rng = Rng::new(11);
    let mut run = Run { inputs: vec![Vec::new(); 2], outputs: vec![Vec::new(); 2], ..Run::default() };
    let mut behind = 0.0;
    for row in 0..400 {
        let t_s = 0.02 * f64::from(row);
        let inputs = [0.05 - 0.05 * (1.3 * t_s).cos(), 0.03 - 0.03 * (2.9 * t_s).cos()];
        behind += (1.0 - f64::exp(-0.02 / 0.3)) * (inputs[0] - inputs[1] - behind);
        run.time_s.push(t_s);
        run.inputs.iter_mut().zip(inputs).for_each(|(column, value)| column.push(value));
        run.outputs[0].push(200.0 * behind + 0.05 * rng.normal());
        run.outputs[1].push(900.0 * behind * behind + 0.02 * rng.normal());
    }
    let data = Measured {
        inputs: vec!["pressure_mpa".into(), "outlet_mpa".into()],
        outputs: vec!["tip_y_mm".into(), "angle_deg".into()],
        runs: vec![run],
    };
    learn("bench", &data).expect("learns").model
}
