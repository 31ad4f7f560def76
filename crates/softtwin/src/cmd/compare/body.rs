//! The body with predicted and measured markers at some instants.

use crate::cmd::draw::{DrawnState, Group, Look, Shown, View, draw};
use crate::files;
use crate::picture::canvas::Canvas;
use crate::picture::scene::Block;
use crate::picture::skin::{Body, distances, marker_mm};
use crate::picture::theme::ThemeName;
use crate::picture::visible::visible_facets;
use formats::log::Recording;
use rom::model::{Model, Selection};
use rom::reconstructor::Reconstructor;
use rom::snapshots::FieldKind;
use rom::statistics::ends;
use train::comparison::RecordedInputs;

/// Fractions of the range of the input that moves most.
const INSTANTS: [f64; 3] = [0.0, 0.5, 1.0];
const PANEL_PX: u16 = 520;
const AXES: [&str; 3] = ["x", "y", "z"];

/// Names and measured positions (mm) of the markers in a row; coordinates that were not measured are those of the model.
fn measured(
    recording: &Recording,
    row: usize,
    predicted: impl Fn(&str) -> Option<[f32; 3]>,
) -> Vec<[f32; 3]> {
    let value = |name: &str, axis: &str| {
        let series = recording.outputs.iter().find(|series| series.name == format!("{name}_{axis}_mm"));
        series.map(|series| series.values[row])
    };
    let mut names: Vec<&str> = recording.outputs.iter().filter_map(|series| marker(&series.name)).collect();
    names.dedup();
    let of = |name: &str| {
        let own = predicted(name)?;
        let mut place = own;
        for (k, axis) in AXES.iter().enumerate() {
            place[k] = value(name, axis).map_or(own[k], |v| v as f32);
        }
        Some(place).filter(|place| place.iter().all(|v| v.is_finite()))
    };
    let mut seen = std::collections::BTreeSet::new();
    names.into_iter().filter(|name| seen.insert(*name)).filter_map(of).collect()
}

fn marker(name: &str) -> Option<&str> {
    AXES.iter().find_map(|axis| name.strip_suffix(&format!("_{axis}_mm")))
}

/// The nearest rows to the wanted times, or the default ones.
fn rows(recording: &Recording, inputs: &RecordedInputs<'_>, at_s: &[f64]) -> Vec<usize> {
    let nearest = |distance: &dyn Fn(usize) -> f64| {
        let all = (0..recording.time_s.len())
            .filter(|row| distance(*row).is_finite() && inputs.row(*row).is_some());
        all.min_by(|a, b| distance(*a).total_cmp(&distance(*b)))
    };
    if !at_s.is_empty() {
        return at_s.iter().filter_map(|t| nearest(&|row| (recording.time_s[row] - t).abs())).collect();
    }
    let Some(main) = inputs.widest() else { return Vec::new() };
    let [low, high] = ends(&main.values);
    let wanted = INSTANTS.map(|part| low + part * (high - low));
    wanted.iter().filter_map(|wanted| nearest(&|row| (main.values[row] - wanted).abs())).collect()
}

/// The picture; none without markers that the model has, or without coordinates.
pub fn picture(
    model: &Model,
    inputs: &RecordedInputs<'_>,
    recording: &Recording,
    at_s: &[f64],
) -> anyhow::Result<Option<Canvas>> {
    let Some(columns) = coordinates(model) else { return Ok(None) };
    let set =
        |name: &str| model.header.node_sets.iter().find(|set| set.name == name && !set.nodes.is_empty());
    if !recording.outputs.iter().filter_map(|series| marker(&series.name)).any(|name| set(name).is_some()) {
        return Ok(None);
    }
    let rest = model.undeformed_nodes_mm().unwrap_or_default();
    let facets = visible_facets(&rest, model.facets());
    let reconstructor = Reconstructor::new(model, &Selection::default())?;
    let mut fields = vec![0.0; reconstructor.entries()];
    let wanted = rows(recording, inputs, at_s);
    let mut states = Vec::new();
    inputs
        .follow(model, |row, evaluation| {
            if !wanted.contains(&row) {
                return Ok(());
            }
            reconstructor.reconstruct_into(evaluation, &mut fields)?;
            let count = model.header.node_count;
            let place = |node: usize| columns.map(|column| fields[column * count + node]);
            let nodes: Vec<[f32; 3]> = (0..count).map(place).collect();
            let mean = |name: &str| {
                let nodes_of = &set(name)?.nodes;
                let sum = |k: usize| nodes_of.iter().map(|node| nodes[*node as usize][k]).sum::<f32>();
                Some([0, 1, 2].map(|k| sum(k) / nodes_of.len() as f32))
            };
            let size = marker_mm(&rest);
            let block = |at: [f32; 3]| Block { min_mm: at.map(|v| v - size), max_mm: at.map(|v| v + size) };
            let blocks = measured(recording, row, mean).into_iter().map(block).collect();
            let body = if facets.is_empty() {
                Body::of_markers(&nodes, &rest)
            } else {
                Body { values: distances(&nodes, &rest), nodes_mm: nodes, facets: facets.clone() }
            };
            states.push(DrawnState {
                body,
                plate: None,
                blocks,
                force_n: 0.0,
                outside: evaluation.flags.extrapolated,
                title: format!("{:.2} s", recording.time_s[row]),
            });
            Ok(())
        })
        .map_err(files::not_compared)?;
    if states.is_empty() {
        return Ok(None);
    }
    let look = Look {
        field: Shown::Displacement,
        range: None,
        view: View::Oblique,
        theme: ThemeName::Light,
        width: Some(PANEL_PX),
    };
    let group = Group { heading: String::new(), states };
    draw(&look, &[group], Some("Model and measured markers"), "Blocks: measured markers.".into()).map(Some)
}

/// Fields of x, y and z.
fn coordinates(model: &Model) -> Option<[usize; 3]> {
    let of = |axis: u8| {
        let is_axis = |field: &rom::model::OutputField| field.spec.kind == FieldKind::Coordinate(axis);
        model.header.fields.iter().position(is_axis)
    };
    Some([of(0)?, of(1)?, of(2)?])
}
