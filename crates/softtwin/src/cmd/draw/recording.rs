//! A recording over time: one panel a quantity, one line an actuator.

use crate::picture::{Axis, Figure, Panel, Series};
use crate::{failure::configuration, files};
use anyhow::Result;
use recording::{RecordedState, RecordingData};
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use rom::reconstructor::{Peaks, ReconstructError};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// States the model is asked for: each costs a whole field.
const MAX_SHAPES: usize = 400;

/// A quantity that states themselves carry.
type StateQuantity = (&'static str, fn(&RecordedState) -> f64);

const QUANTITIES: [StateQuantity; 4] = [
    ("pressure [MPa]", |state| state.values.pressure_mpa),
    ("gap [mm]", |state| state.values.gap_mm),
    ("contact force [N]", |state| state.values.contact_force_n),
    (LATENCY, RecordedState::latency_ms),
];

/// Drawn over decades: what matters is the rare slow one.
const LATENCY: &str = "latency, sensor to published [ms]";

/// The figure of a recording; with a model also the largest displacement and stress.
///
/// # Errors
/// An invalid recording or model.
pub fn figure(path: &Path, model: Option<&Model>) -> Result<Figure> {
    let data = RecordingData::read(&files::recording(path)?, None, &AtomicBool::new(false));
    let data = data.map_err(configuration)?;
    data.remarks.iter().for_each(|remark| tracing::warn!("{remark}"));
    let mut panels: Vec<Panel> = Vec::new();
    for (label, value) in QUANTITIES {
        let series = data.tracks.iter().enumerate().map(|(colour, (name, track))| {
            let points = track.states.iter().map(|state| (state.t_s, value(state)));
            Series::line(name, colour, points)
        });
        panels.push(panel(label, series.collect()));
    }
    let states: Vec<(&str, &[RecordedState])> =
        data.tracks.iter().map(|(name, track)| (name.as_str(), track.states.as_slice())).collect();
    panels.extend(observed(&states));
    if let Some(model) = model {
        let mut peaks = [Vec::new(), Vec::new()];
        for (colour, (name, track)) in data.tracks.iter().enumerate() {
            for (series, points) in peaks.iter_mut().zip(largest(model, track.thinned(MAX_SHAPES))?) {
                series.push(Series::line(name, colour, points));
            }
        }
        let [displacement, stress] = peaks;
        panels.insert(3, panel("largest displacement [mm]", displacement));
        panels.insert(4, panel("largest von Mises stress [MPa]", stress));
    }
    Ok(Figure { title: format!("{}, {:.1} s", data.name, data.duration_s), panels, columns: 2 })
}

/// One panel per observable of any actuator.
fn observed(tracks: &[(&str, &[RecordedState])]) -> Vec<Panel> {
    let names: BTreeSet<String> = (tracks.iter().flat_map(|(_, states)| states.iter()))
        .flat_map(|state| state.values.observables().map(|(name, ..)| name))
        .collect();
    let of_name = |name: &String| {
        let of_track = |(colour, (actuator, states)): (usize, &(&str, &[RecordedState]))| {
            let value = |state: &RecordedState| state.values.observables().find(|(own, ..)| own == name);
            let points = states.iter().filter_map(|state| Some((state.t_s, value(state)?.1)));
            Series::line(*actuator, colour, points)
        };
        panel(name, tracks.iter().enumerate().map(of_track).filter(|line| !line.points.is_empty()).collect())
    };
    names.iter().map(of_name).collect()
}

fn panel(label: &str, series: Vec<Series>) -> Panel {
    let y = if label == LATENCY { Axis::log(label) } else { Axis::linear(label) };
    Panel::new("", "time [s]", y, series)
}

/// Largest displacement (mm) and von Mises stress (MPa) of each state that stands for a reading, over time (s).
fn largest<'a>(
    model: &Model,
    states: impl Iterator<Item = &'a RecordedState>,
) -> Result<[Vec<(f64, f64)>; 2]> {
    let mut body = ModelState::new(model, &Selection::default())?;
    let mut found = [Vec::new(), Vec::new()];
    for (t_s, inputs) in states.filter_map(|state| Some((state.t_s, state.inputs(&model.header.inputs)?))) {
        let peaks = match body.update(inputs) {
            // No point where this model has no answer: the recording may be of another one.
            Err(ReconstructError::Refused(_)) => Peaks::default(),
            peaks => peaks?,
        };
        for (points, peak) in found.iter_mut().zip([peaks.displacement_mm, peaks.stress_mpa]) {
            points.push((t_s, peak.map_or(f64::NAN, |peak| peak.value.into())));
        }
    }
    Ok(found)
}

#[cfg(test)]
#[path = "../../../tests/unit/cmd_draw_recording.rs"]
mod tests;
