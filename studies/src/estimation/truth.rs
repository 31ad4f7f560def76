//! Inflations of a model with hidden inputs, read by noisy sensors.

use estimate::{InputRole, MAX_INPUTS, Measurement, Model as _, Predicted, Setup};
use rom::inputs::{GAP, InputSpec, PRESSURE};
use rom::model::Model;
use rom::rng::Rng;
use runtime::estimation::SensorModel;
use softtwin::unknowns::Unknowns;
use std::fmt::Write as _;
use std::path::Path;

const RATE_HZ: f64 = 200.0;
const SECONDS: f64 = 10.0;
/// Noise of a pressure, a force, a marker's coordinate.
const NOISE: [f64; 3] = [0.0005, 0.005, 0.2];
const MISSING: f64 = 0.1;
const OUTLIERS: f64 = 0.01;
/// How far an outlier lies off, mm.
const OUTLIER_MM: f64 = 20.0;

/// Hidden true values.
pub(super) struct Truth {
    /// In the order of the scene's unknowns.
    pub(super) unknowns: Vec<f64>,
    seed: u64,
}

/// Readings of the true values.
pub(super) struct Readings {
    pub(super) measured: Vec<Measurement>,
    /// First contact of the truth, s.
    pub(super) contact_s: f64,
    /// Contact force of the truth at the end, N.
    pub(super) force_n: f64,
    /// True inputs of the scene's model at the end.
    pub(super) inputs: [f64; MAX_INPUTS],
}

/// The model that the truths are taken from.
pub(super) struct World {
    sensors: SensorModel,
    /// Position and range in this model, per input of the scene's model.
    places: Vec<Option<(usize, [f64; 2])>>,
    /// This model's own values.
    values: [f64; MAX_INPUTS],
    /// Where inflations end: the largest pressure that both models have samples at.
    highest_mpa: f64,
}

impl World {
    pub(super) fn new(of: &Unknowns, model: &Model) -> anyhow::Result<Self> {
        let sensors =
            SensorModel::new(&of.spec, model).map_err(|errors| anyhow::anyhow!("{}", errors.join("\n")))?;
        let mut places = Vec::new();
        for (own, role) in of.header.inputs.iter().zip(&of.setup.inputs) {
            let place = model.header.inputs.iter().position(|input| input.key() == own.key());
            if place.is_none() && matches!(role, InputRole::Estimated(_)) {
                anyhow::bail!(
                    "{}: estimated by the scene, no input of the truth's model; train one with it",
                    own.key()
                );
            }
            places.push(place.map(|place| (place, model.header.inputs[place].range)));
        }
        let mut values = [f64::NAN; MAX_INPUTS];
        values.iter_mut().zip(&model.header.inputs).for_each(|(v, i)| *v = i.value.unwrap_or(f64::NAN));
        let highest = |inputs: &[InputSpec]| inputs[PRESSURE].range[1];
        let highest_mpa = highest(&of.header.inputs).min(highest(&model.header.inputs));
        Ok(Self { sensors, places, values, highest_mpa })
    }

    /// Hidden values within the study's bounds.
    pub(super) fn draw(&self, setup: &Setup, seed: u64) -> Truth {
        let mut random = Rng::new(seed);
        let mut within = |low: f64, high: f64| low + (high - low) * random.uniform();
        let mut one = |(index, unknown): (usize, &estimate::Unknown)| {
            let is_input = |role: &InputRole| *role == InputRole::Estimated(index);
            let input = setup.inputs.iter().position(is_input);
            match (input, input.and_then(|input| self.places[input])) {
                (Some(GAP), _) => within(unknown.prior - 10.0, unknown.prior + 10.0),
                (_, Some((_, [low, high]))) => {
                    within((0.8 * unknown.prior).max(low), (1.2 * unknown.prior).min(high))
                }
                _ => unknown.prior + within(-unknown.sigma, unknown.sigma),
            }
        };
        let unknowns = setup.unknowns.iter().enumerate().map(&mut one).collect();
        Truth { unknowns, seed }
    }

    /// The readings of one inflation.
    pub(super) fn inflate(&mut self, of: &Unknowns, truth: &Truth) -> Readings {
        let (setup, mut random) = (&of.setup, Rng::new(truth.seed ^ 0x5eed));
        let unset = [f64::NAN; MAX_INPUTS];
        let mut out =
            Readings { measured: Vec::new(), contact_s: f64::INFINITY, force_n: 0.0, inputs: unset };
        let mut predicted = vec![Predicted::default(); setup.rows.len()];
        let [noise_mpa, noise_n, noise_mm] = NOISE;
        for k in 0..(SECONDS * RATE_HZ) as usize {
            let t_s = k as f64 / RATE_HZ;
            let (mut inputs, mut reading) = (self.values, Measurement::at(t_s));
            for ((input, role), place) in setup.inputs.iter().enumerate().zip(&self.places) {
                let value = match *role {
                    InputRole::Given(value) => value,
                    InputRole::Estimated(unknown) => truth.unknowns[unknown],
                    InputRole::Measured { bias, .. } if input == PRESSURE => {
                        let value = self.highest_mpa * t_s / SECONDS;
                        let bias = bias.map_or(0.0, |bias| truth.unknowns[bias]);
                        reading.inputs[input] = value + bias + noise_mpa * random.normal();
                        value
                    }
                    InputRole::Measured { .. } => f64::NAN,
                };
                out.inputs[input] = value;
                if let Some((place, _)) = place {
                    inputs[*place] = value;
                }
            }
            let touches = self.sensors.predict(&inputs, &mut predicted);
            out.contact_s = if touches { out.contact_s.min(t_s) } else { out.contact_s };
            out.force_n = predicted[0].value;
            let (mut block, mut missing, mut shift_mm) = (0, false, 0.0);
            for (index, (row, predicted)) in setup.rows.iter().zip(&predicted).enumerate() {
                if row.block > block {
                    block = row.block;
                    missing = random.uniform() < MISSING;
                    shift_mm = if random.uniform() < OUTLIERS { OUTLIER_MM } else { 0.0 };
                }
                let bias = row.bias.map_or(0.0, |bias| truth.unknowns[bias]);
                let (sigma, shift) = if row.block == 0 { (noise_n, 0.0) } else { (noise_mm, shift_mm) };
                let value = predicted.value + bias + shift + sigma * random.normal();
                reading.rows[index] = if missing && row.block > 0 { f64::NAN } else { value };
            }
            out.measured.push(reading);
        }
        out
    }
}

/// Writes readings as a trace; comments say what is hidden.
pub(super) fn write_trace(
    path: &Path,
    setup: &Setup,
    truth: &Truth,
    readings: &Readings,
) -> anyhow::Result<()> {
    let mut text = String::new();
    for (unknown, value) in setup.unknowns.iter().zip(&truth.unknowns) {
        writeln!(text, "# hidden: {} = {value:.6}", unknown.name)?;
    }
    text.push_str("t_s,pressure_mpa,measured_force_n");
    for marker in 1..=setup.rows.len() / 3 {
        ["x", "y", "z"].iter().try_for_each(|axis| write!(text, ",marker{marker}_{axis}_mm"))?;
    }
    text.push('\n');
    for measured in &readings.measured {
        write!(text, "{:.3},{:.5}", measured.t_s, measured.inputs[PRESSURE])?;
        for (row, value) in measured.rows.iter().enumerate().take(setup.rows.len()) {
            match (value.is_finite(), row) {
                (true, 0) => write!(text, ",{value:.4}")?,
                (true, _) => write!(text, ",{value:.2}")?,
                (false, _) => text.push(','),
            }
        }
        text.push('\n');
    }
    formats::file::replace(path, text.as_bytes())?;
    Ok(())
}
