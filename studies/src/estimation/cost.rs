//! Cost of an update: its time and its evaluations of the model, also with more unknowns and markers than a scene has.

use estimate::{Filter, MAX_INPUTS, Measurement, Model, Predicted, Setup, Update};
use rom::inputs::{InputSpec, PARAMETERS};
use runtime::config::{MarkerSpec, Scene, UnknownSpec};
use runtime::estimation::SensorModel;
use serde_json::{Value, json};
use softtwin::files;
use std::time::Instant;

/// Updates of which the fastest counts.
const REPEATS: usize = 3;
/// Standard deviation of a parameter before any reading, by its range.
const PARAMETER_SHARE: f64 = 0.25;
/// That of the load cell's bias, N.
const FORCE_BIAS_N: f64 = 0.01;

/// Adds unknowns and markers to the only actuator of a scene, up to the requested numbers.
pub(super) fn extend(
    scene: &mut Scene,
    unknowns: Option<usize>,
    markers: Option<usize>,
) -> anyhow::Result<()> {
    let Some(spec) = scene.actuators.first() else { return Ok(()) };
    let model = files::model(&spec.model)?;
    let Some(spec) = scene.actuators.first_mut() else { return Ok(()) };
    let of_parameter = |input: &InputSpec| {
        let [low, high] = input.range;
        let prior = input.value.unwrap_or(0.5 * (low + high));
        (input.key(), UnknownSpec { prior, sigma: PARAMETER_SHARE * (high - low), drift: None })
    };
    let parameters = model.header.inputs.iter().skip(PARAMETERS).map(of_parameter);
    let bias = ("force_bias_n".to_owned(), UnknownSpec { prior: 0.0, sigma: FORCE_BIAS_N, drift: None });
    for (name, unknown) in parameters.chain([bias]) {
        if spec.estimate.len() < unknowns.unwrap_or(0) && !spec.estimate.contains_key(&name) {
            spec.inputs.remove(&name);
            spec.estimate.insert(name, unknown);
        }
    }
    let wanted = markers.unwrap_or(0);
    for at in spec.markers.len()..wanted {
        let node = (at * model.header.node_count / wanted) as u32;
        spec.markers.push(MarkerSpec { name: format!("node {node}"), node: Some(node), at_mm: None });
    }
    Ok(())
}

/// A model that counts how often it is asked.
struct Counted<'a> {
    model: &'a mut SensorModel,
    calls: u32,
}

impl Model for Counted<'_> {
    fn predict(&mut self, inputs: &[f64; MAX_INPUTS], out: &mut [Predicted]) -> bool {
        self.calls += 1;
        self.model.predict(inputs, out)
    }

    fn predict_free(&mut self, inputs: &[f64; MAX_INPUTS], out: &mut [Predicted]) {
        self.calls += 1;
        self.model.predict_free(inputs, out);
    }

    fn onset_gap_mm(&mut self, inputs: &[f64; MAX_INPUTS]) -> Option<f64> {
        self.calls += 1;
        self.model.onset_gap_mm(inputs)
    }

    fn inside_contact_mm(&self, inputs: &[f64; MAX_INPUTS]) -> Option<f64> {
        self.model.inside_contact_mm(inputs)
    }
}

/// A filter before any reading.
pub(super) fn filter(setup: &Setup) -> Filter {
    let Ok(filter) = Filter::new(setup.clone()) else {
        unreachable!("the setup was checked when it was made")
    };
    filter
}

/// Time of the fastest of several updates per reading, us. Each starts from filter and model after the previous readings.
pub(super) fn fastest_us(setup: &Setup, readings: &[Measurement], model: &mut SensorModel) -> Vec<f64> {
    let mut fastest_us = vec![f64::INFINITY; readings.len()];
    for _ in 1..REPEATS {
        let mut filter = filter(setup);
        for (measured, fastest_us) in readings.iter().zip(&mut fastest_us) {
            let begin = Instant::now();
            filter.update(measured, model);
            *fastest_us = fastest_us.min(begin.elapsed().as_secs_f64() * 1e6);
        }
    }
    fastest_us
}

/// One update, with its time, us, and the evaluations of the model in it.
pub(super) fn counted(
    filter: &mut Filter,
    measured: &Measurement,
    model: &mut SensorModel,
) -> (Update, f64, u32) {
    let (mut counted, begin) = (Counted { model, calls: 0 }, Instant::now());
    let update = filter.update(measured, &mut counted);
    (update, begin.elapsed().as_secs_f64() * 1e6, counted.calls)
}

/// Median, 99th percentile and largest.
pub(super) fn quantiles(values: impl Iterator<Item = f64>) -> Value {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted.get((share * sorted.len() as f64) as usize).or(sorted.last()).copied();
    json!({ "median": at(0.5), "p99": at(0.99), "max": at(1.0) })
}
