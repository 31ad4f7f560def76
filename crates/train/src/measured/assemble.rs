//! A fitted map as a model: markers are nodes, and each output is a coefficient with a mode of its own.

use super::data::{COVERAGE, Learned, MIN_EXPLAINED, Measured, MeasuredError, OutputReport};
use super::layout::{Layout, unit_of};
use super::maps::{ChosenMaps, FittedRows, MemberFeatures, positions};
use super::motion::noise_of;
use super::segments::{centres, directions, loop_size, turns};
use super::widths::Places;
use faer::Mat;
use rom::halfwidths::HalfWidths;
use rom::hull::TrainingRange;
use rom::inputs::{InputMap, InputSpec, Inputs, Parameter, Point};
use rom::interpolant::{Interpolant, Metric};
use rom::kernel::{Modes, Precision};
use rom::learned::{
    Drift, KernelMap, Kernels, Lag, LearnedMap, LinearMap, OutputWidth, Polynomial, Reservoir, Support,
};
use rom::model::{BlockData, BlockKind, GroupModel, Model, ModelHeader, OutputField, RegimeModel};
use rom::radial::{KernelKind, Tail};
use rom::session::{Gaps, Session};
use rom::snapshots::{Database, FieldKind, FieldSpec, NodeSet, RegimeKind};
use rom::statistics::{mean, median};
use std::sync::Arc;

/// Figures of the outputs, without half-widths.
pub(super) fn reports(data: &Measured, rows: &FittedRows, found: &ChosenMaps) -> Vec<OutputReport> {
    let run: Vec<usize> = rows.fitted.iter().map(|at| at.0).collect();
    let report = |(k, name): (usize, &String)| {
        let values: Vec<f64> = rows.y.col(k).iter().copied().collect();
        let predicted: Vec<f64> = found.left_out.col(k).iter().copied().collect();
        let square = mean(values.iter().zip(&predicted).map(|(y, p)| (y - p).powi(2)));
        let (range, centre) = (rom::statistics::range(values.iter().copied()), mean(values.iter().copied()));
        let noise = rows.measured.chunk_by(|a, b| a.0 == b.0).map(|of_run| {
            noise_of(&of_run.iter().map(|(_, outputs)| outputs[k]).collect::<Vec<_>>()).powi(2)
        });
        OutputReport {
            name: name.clone(),
            range,
            noise: mean(noise).sqrt(),
            rms: square.sqrt(),
            half_width: f64::NAN,
            loop_share: loop_size(&run, &values, &predicted) / range,
            explained: 1.0 - square / mean(values.iter().map(|y| (y - centre).powi(2))),
        }
    };
    data.outputs.iter().enumerate().map(report).collect()
}

/// Lags of a model, each once.
#[derive(Default)]
struct Lags(Vec<Lag>);

impl Lags {
    fn places(&mut self, lags: &[Lag]) -> Vec<u32> {
        let place = |lag: &Lag| {
            let known = self.0.iter().position(|other| other == lag);
            known.unwrap_or_else(|| {
                self.0.push(*lag);
                self.0.len() - 1
            }) as u32
        };
        lags.iter().map(place).collect()
    }
}

/// Entries row after row.
fn flat(weights: &Mat<f64>) -> Vec<f64> {
    let places = (0..weights.nrows()).flat_map(|i| (0..weights.ncols()).map(move |k| (i, k)));
    places.map(|at| weights[at]).collect()
}

fn map(
    rows: &FittedRows,
    found: ChosenMaps,
    places: Places,
    widths: Vec<OutputWidth>,
    drifts: Vec<Drift>,
) -> LearnedMap {
    let mut lags = Lags::default();
    let base = LinearMap { lags: lags.places(&found.base.lags), weights: flat(&found.base.fit.weights) };
    let support = Support { lags: lags.places(&places.lags), ..places.support };
    let (mut polynomials, mut kernels, mut reservoirs) = (Vec::new(), Vec::<Kernels>::new(), Vec::new());
    for member in found.members {
        let weights = flat(&member.fit.weights);
        match member.features {
            MemberFeatures::Polynomial { lags: own, degree } => {
                polynomials.push(Polynomial {
                    share: member.share,
                    lags: lags.places(&own),
                    degree,
                    weights,
                });
            }
            MemberFeatures::Reservoir(reservoir) => {
                reservoirs.push(Reservoir { share: member.share, weights, ..reservoir })
            }
            MemberFeatures::Kernel { lags: own, centres, radius } => {
                let places = lags.places(&own);
                let map = KernelMap { share: member.share, radius, weights };
                match kernels.iter_mut().find(|known| known.lags == places) {
                    Some(known) => known.maps.push(map),
                    None => {
                        kernels.push(Kernels { lags: places, centres: centres.concat(), maps: vec![map] })
                    }
                }
            }
        }
    }
    let bare = rows.bare(lags.0, reservoirs);
    LearnedMap { base, polynomials, kernels, support, widths, drifts, ..bare }
}

/// The model with its report.
#[allow(clippy::too_many_arguments, reason = "all that was found, once")]
pub(super) fn model(
    actuator: &str,
    data: &Measured,
    rows: &FittedRows,
    found: ChosenMaps,
    places: Places,
    (widths, drifts): (Vec<OutputWidth>, Vec<Drift>),
    mut reports: Vec<OutputReport>,
    mut remarks: Vec<String>,
) -> Result<Learned, MeasuredError> {
    let layout = Layout::of(&data.outputs.iter().map(String::as_str).collect::<Vec<_>>());
    let errors = found.errors;
    let mut shares = [0.0; 3];
    for member in &found.members {
        let family = match member.features {
            MemberFeatures::Polynomial { .. } => 0,
            MemberFeatures::Kernel { .. } => 1,
            MemberFeatures::Reservoir(_) => 2,
        };
        shares[family] += member.share;
    }
    let common = found.common.first().and_then(|lag| lag.line);
    let mut learned = map(rows, found, places, widths, drifts);
    let marker = |node: usize| {
        let is_coordinate = |spec: &FieldSpec| matches!(spec.kind, FieldKind::Coordinate(_));
        let coordinates = layout.fields.iter().filter(|(spec, _)| is_coordinate(spec));
        coordinates.filter_map(|(_, places)| places[node].map(|output| output as u32)).collect()
    };
    learned.markers = (0..layout.nodes.len()).map(marker).collect();
    let header = header(actuator, data, rows, &layout, Arc::new(learned));
    let mut model = Model { blocks: blocks(rows, &layout)?, header };
    typical_half_widths(rows, &mut model, &mut reports)?;
    for (field, (_, places)) in layout.fields.iter().enumerate() {
        let width = |place: &Option<usize>| place.map_or(0.0, |output| reports[output].half_width as f32);
        let widths = BlockData::F32(places.iter().map(width).collect());
        model.blocks.push((BlockKind::HalfWidth { field: field as u32 }, widths));
    }
    let sum: Vec<f64> = rows
        .fitted
        .iter()
        .map(|(run, row)| {
            let values = rows.runs[*run].inputs[*row];
            rows.inputs
                .iter()
                .map(|input| {
                    (values.values()[input.input as usize] - input.mean) / (input.deviation * input.range)
                })
                .sum()
        })
        .collect();
    let turns = turns(&directions(&rows.fitted.iter().map(|at| at.0).collect::<Vec<_>>(), &sum));
    if turns < 4 {
        remarks.push(format!(
            "{turns} changes between rising and falling inputs, less than two periods: the half-widths rest on few repeats"
        ));
    }
    for report in reports.iter().filter(|report| report.explained < MIN_EXPLAINED) {
        remarks.push(format!("{} does not follow the inputs; its half-width says so", report.name));
    }
    match rows.runs.len() {
        1 if rows.are_dealt => remarks.push("successive rows have nothing in common: settled states, learned without lags".into()),
        1 => remarks.push("one run says nothing about the next: the half-widths contain some 3 % of the range for it, and more where this one drifts; learn from several runs to measure it".into()),
        _ if rows.have_own_inputs => remarks.push("each run has an input of its own, and no run says how far its repetition would differ: the half-widths contain some 3 % of the range for it".into()),
        _ => {}
    }
    Ok(Learned {
        error_share: errors.members / length(&reports, data),
        memoryless_share: errors.without_lags / length(&reports, data),
        model,
        inputs: data.inputs.clone(),
        outputs: reports,
        remarks,
        lag_s: common.map(|line| [line.fill_s, line.empty_s]),
        shares,
        turns,
        rows: rows.measured.len(),
    })
}

/// Length of the ranges over their units: what an error share refers to.
fn length(reports: &[OutputReport], data: &Measured) -> f64 {
    let units = super::data::scales(&data.outputs, &data.runs);
    reports.iter().zip(units).map(|(report, unit)| (report.range / unit).powi(2)).sum::<f64>().sqrt()
}

/// Median half-widths over the training, as a session gives them.
fn typical_half_widths(
    rows: &FittedRows,
    model: &mut Model,
    reports: &mut [OutputReport],
) -> Result<(), MeasuredError> {
    let mut session = Session::new(model, Gaps::Recorded)?;
    let mut evaluation = session.evaluation();
    let mut found: Vec<Vec<f64>> = vec![Vec::new(); reports.len()];
    let mut displacements = Vec::new();
    let mut next = rows.fitted.iter().peekable();
    for (index, run) in rows.runs.iter().enumerate() {
        session.restart();
        for (row, (t_ns, inputs)) in run.time_ns.iter().zip(&run.inputs).enumerate() {
            let Ok(filtered) = session.take(*t_ns, *inputs) else { continue };
            if next.next_if(|fitted| **fitted == (index, row)).is_some()
                && session.answer(&filtered, &mut evaluation).is_ok()
            {
                displacements.push(evaluation.halfwidths.displacement_mm);
                found
                    .iter_mut()
                    .zip(&evaluation.output_half_widths)
                    .for_each(|(all, width)| all.push(*width));
            }
        }
    }
    let typical = |widths: Vec<f64>| median(widths.into_iter().filter(|w| w.is_finite())).unwrap_or(f64::NAN);
    for (report, widths) in reports.iter_mut().zip(found) {
        report.half_width = typical(widths);
    }
    for regime in &mut model.header.regimes {
        regime.halfwidths.displacement_mm = typical(std::mem::take(&mut displacements));
    }
    Ok(())
}

fn header(
    actuator: &str,
    data: &Measured,
    rows: &FittedRows,
    layout: &Layout,
    learned: Arc<LearnedMap>,
) -> ModelHeader {
    let states: Vec<Inputs> = rows.fitted.iter().map(|(run, row)| rows.runs[*run].inputs[*row]).collect();
    let varying = positions(&data.inputs);
    let mut sorted = varying.clone();
    sorted.sort_unstable();
    let inputs = InputMap::of_states(&states, &sorted);
    let further = data.inputs.iter().zip(&varying).filter(|(_, at)| **at >= rom::inputs::PARAMETERS);
    let declared: Vec<Parameter> = further
        .map(|(name, at)| Parameter {
            name: name.clone(),
            unit: unit_of(name),
            nominal: median(states.iter().map(|state| state.values()[*at])).unwrap_or(f64::NAN),
        })
        .collect();
    let x: Vec<Point> = states.iter().map(|state| inputs.scale(state)).collect();
    let dimensions = inputs.dimensions();
    // Centres of cells and the rows at the ends of the inputs: neighbours are a cell apart, while rows follow a path.
    let ends = (0..dimensions).flat_map(|axis| {
        let by = |a: &&Point, b: &&Point| a[axis].total_cmp(&b[axis]);
        x.iter().min_by(by).into_iter().chain(x.iter().max_by(by))
    });
    let points: Vec<Point> = centres(&x, dimensions).iter().chain(ends).copied().collect();
    let count = rows.outputs();
    let group = GroupModel {
        name: "outputs".into(),
        fields: (0..layout.fields.len()).collect(),
        coefficients: 0..count,
        // Not asked: the learned map answers.
        surrogate: Interpolant {
            kernel: KernelKind::Cubic,
            tail: Tail::Constant,
            dimensions,
            metric: Metric::IDENTITY,
            centres: vec![0.0; dimensions],
            weights: vec![0.0; count],
            tail_weights: vec![0.0; count],
            outputs: count,
            smoothing: 0.0,
            condition: f64::NAN,
            residual: 0.0,
            slopes: Vec::new(),
        },
        singular_values: vec![1.0; count],
    };
    let regime = RegimeModel {
        kind: RegimeKind::Free,
        domain: TrainingRange::of_points(inputs.operating(), dimensions, &points),
        groups: vec![group],
        force: None,
        halfwidths: HalfWidths { coverage: COVERAGE, ..HalfWidths::UNKNOWN },
        local_halfwidths: None,
        far_onset: None,
        difference: None,
        inputs,
    };
    let output = |spec: &FieldSpec| OutputField { spec: spec.clone(), magnitude_of: None };
    let set = |(node, name): (usize, &String)| NodeSet { name: name.clone(), nodes: vec![node as u32] };
    ModelHeader {
        actuator: actuator.into(),
        inputs: InputSpec::ranged(InputSpec::without_range(&declared), [&regime.inputs].into_iter()),
        fields: layout.fields.iter().map(|(spec, _)| output(spec)).collect(),
        node_count: layout.node_count(),
        regimes: vec![regime],
        onset: None,
        hysteresis_mpa: 0.0,
        node_sets: layout.nodes.iter().enumerate().map(set).collect(),
        database_hash: hash(data),
        clearance: None,
        limit: None,
        body: None,
        learned: Some(learned),
    }
}

type Blocks = Vec<(BlockKind, BlockData)>;

/// Means of 0 and a mode of each output where it is; positions of the markers at the smallest inputs, 0 where there are none. A scalar is the same
/// at all nodes.
fn blocks(rows: &FittedRows, layout: &Layout) -> Result<Blocks, MeasuredError> {
    let (nodes, regime) = (layout.node_count(), RegimeKind::Free);
    let mut blocks = Vec::new();
    for (field, (_, places)) in layout.fields.iter().enumerate() {
        let shape = |mode: usize, node: usize| if places[node] == Some(mode) { 1.0 } else { 0.0 };
        let shapes =
            Modes::new(Precision::F32, nodes, rows.outputs(), shape).map_err(|_| MeasuredError::Singular)?;
        let field = field as u32;
        blocks.push((BlockKind::Mean { regime, field }, BlockData::F32(vec![0.0; nodes])));
        blocks.push((BlockKind::Modes { regime, field }, BlockData::Modes(shapes)));
    }
    let sum = |row: usize| -> f64 {
        let (run, at) = rows.fitted[row];
        let values = rows.runs[run].inputs[at];
        rows.inputs.iter().map(|input| values.values()[input.input as usize] / input.deviation).sum()
    };
    let rest = (0..rows.fitted.len()).min_by(|a, b| sum(*a).total_cmp(&sum(*b))).unwrap_or(0);
    for axis in 0..3 {
        let found = layout.fields.iter().find(|(spec, _)| spec.kind == FieldKind::Coordinate(axis));
        let place = |node: usize| found.and_then(|(_, places)| places[node]);
        let value = |node: usize| place(node).map_or(0.0, |output| rows.y[(rest, output)] as f32);
        blocks.push((BlockKind::Undeformed(axis), BlockData::F32((0..nodes).map(value).collect())));
    }
    Ok(blocks)
}

/// blake3 of the measured values.
fn hash(data: &Measured) -> [u8; 32] {
    let field = |name: &String| FieldSpec { name: name.clone(), unit: String::new(), kind: FieldKind::Other };
    let times: Vec<f64> = data.runs.iter().flat_map(|run| run.time_s.iter().copied()).collect();
    let values = data.runs.iter().flat_map(|run| {
        let columns = || run.inputs.iter().chain(&run.outputs);
        (0..run.time_s.len()).flat_map(move |row| columns().map(move |column| column[row] as f32))
    });
    let fields = data.inputs.iter().chain(&data.outputs).map(field).collect();
    Database::free("measured", fields, &times, values.collect()).hash
}
