//! How far a model is from a recording of a bench: errors of each output, the share of them within the half-widths, and what in the
//! mapping of the recording looks wrong.
//!
//! The model follows the rows of the recording as the twin would have, with the model's memory and motion. Outputs are found by name:
//! an observable, a coordinate `tip_x_mm` at the node set `tip`, or the contact force.

use crate::measured::{MeasuredStates, place};
use formats::log::{LogColumn, Recording};
use rom::evaluation::Evaluation;
use rom::inertia::stepper::ReadingError;
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::{Model, ModelError, ModelFileError, ModelHeader, Selection};
use rom::observable::Observables;
use rom::reconstructor::{ReconstructError, Reconstructor};
use rom::session::{Gaps, Session};
use rom::snapshots::{AXES, FieldKind, NodeSet, marker_axis};
use rom::statistics::{ends, mean, quantile, range};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Ratios of units that are taken for one another, in either direction.
const KNOWN_RATIOS: [(f64, &str); 7] = [
    (6.895, "psi and kPa"),
    (10.0, "bar and MPa, or mm and cm"),
    (57.3, "degrees and radians"),
    (100.0, "bar and kPa"),
    (145.04, "psi and MPa"),
    (1000.0, "kPa and MPa, or m and mm"),
    (1e6, "Pa and MPa"),
];
/// Ratio of a column's largest value to that of the model's range from which the unit is refused.
const REFUSED_RATIO: f64 = 3.0;
/// The same ratio, and that of an output's measured to its predicted range, below which the unit is remarked.
const SMALL_RATIO: f64 = 1.0 / 5.0;
/// Correlation of measured and predicted values from which they have the same shape.
const SAME_SHAPE: f64 = 0.9;
/// Rows of a recording from which swapped inputs are found.
const PROBE_ROWS: usize = 200;
/// Error from which inputs may be swapped: mean squares over the squared range.
const SUSPECT: f64 = 0.03 * 0.03;
/// Fraction of an error that is left if two columns were swapped.
const LEFT_BY_SWAP: f64 = 0.25;

/// Why a model and a recording cannot be compared.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the messages say what the values are
pub enum ComparisonError {
    /// The recording lacks an input that the model needs.
    #[error("expected an input `{key}` of the model in the mapping, found {found}")]
    MissingInput { key: String, found: String },
    /// An input's values are far beyond the model's range, by a factor as between two units.
    #[error("{0}; correct its unit in the mapping")]
    WrongUnit(String),
    /// The model has none of the recording's outputs.
    #[error(
        "the mapping names no output of the model: its observables are {observables}, its fields {fields}, its node sets {node_sets}"
    )]
    NoOutput { observables: String, fields: String, node_sets: String },
    /// No row has all inputs.
    #[error("no row of the recording has all inputs of the model")]
    NoRow,
    /// Only a model learned from measurements can follow measured outputs.
    #[error(
        "expected a model learned from measurements, which can follow measured outputs; found another one"
    )]
    NotLearned,
    #[error("the model has no answer: {0}")]
    Reading(#[from] ReadingError),
    #[error("the model has no answer: {0}")]
    Reconstruct(#[from] ReconstructError),
    #[error(transparent)]
    File(#[from] ModelFileError),
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Constant sensor errors that a calibration has found; they are subtracted from the readings.
#[derive(Clone, Copy, Debug, Default)]
#[allow(missing_docs)] // the names say what the values are
pub struct SensorBiases {
    pub pressure_mpa: f64,
    pub force_n: f64,
}

/// The inputs of a model in a recording.
pub struct RecordedInputs<'a> {
    recording: &'a Recording,
    /// By input of the model, which of the recording's inputs it is.
    columns: Vec<Option<usize>>,
    biases: SensorBiases,
}

impl<'a> RecordedInputs<'a> {
    /// Finds the inputs by their names. The gap is not needed where nothing is touched, nor an input with a value of the model, which a
    /// remark then names.
    ///
    /// # Errors
    /// Inputs that the recording lacks, or whose values are in another unit.
    pub fn new(
        header: &ModelHeader,
        recording: &'a Recording,
        biases: SensorBiases,
        remarks: &mut Vec<String>,
    ) -> Result<Self, ComparisonError> {
        let needs = header.needs();
        let mut columns = Vec::new();
        for (index, spec) in header.inputs.iter().enumerate() {
            let key = spec.key();
            let is_needed = match index {
                PRESSURE => needs.pressure,
                GAP => needs.gap,
                // An inertial load at rest, a parameter of the scene: as along a trace of `predict`.
                _ => spec.value.is_none() && spec.range[0] < spec.range[1],
            };
            let column = recording.inputs.iter().position(|series| series.name == key);
            columns.push(column);
            let Some(column) = column else {
                if is_needed {
                    let found = names(recording.inputs.iter().map(|series| series.name.as_str()));
                    return Err(ComparisonError::MissingInput { key, found });
                }
                if let Some(value) = spec.value.filter(|_| spec.range[0] < spec.range[1]) {
                    remarks.push(format!("{key}: not in the recording; taken as {value} {}", spec.unit));
                }
                continue;
            };
            let values = recording.inputs[column].values.iter().filter(|v| v.is_finite());
            let largest = values.fold(0.0, |most: f64, v| most.max(v.abs()));
            let of_model = spec.range[0].abs().max(spec.range[1].abs());
            let ratio = largest / of_model;
            if is_needed && of_model.is_finite() && ratio.is_finite() {
                let message = format!(
                    "{key}: the model's range is {:.4} .. {:.4} {}, the recording's values go up to {largest:.4}: a factor {ratio:.3} ({})",
                    spec.range[0],
                    spec.range[1],
                    spec.unit,
                    confusion(ratio)
                );
                if ratio > REFUSED_RATIO {
                    return Err(ComparisonError::WrongUnit(message));
                }
                if ratio < SMALL_RATIO {
                    remarks.push(message);
                }
            }
        }
        Ok(Self { recording, columns, biases })
    }

    /// Inputs of a row without the gauge's bias; `None` if one is missing.
    #[must_use]
    pub fn row(&self, row: usize) -> Option<Inputs> {
        let mut inputs = Inputs::new(f64::NAN, f64::INFINITY);
        for (index, column) in self.columns.iter().enumerate() {
            if let Some(column) = column {
                let value = self.recording.inputs[*column].values[row];
                if !value.is_finite() {
                    return None;
                }
                inputs = inputs.with(index, value);
            }
        }
        // A pressure that no answer depends on is not in the recording.
        let pressure_mpa = if inputs.pressure_mpa().is_nan() { 0.0 } else { inputs.pressure_mpa() };
        Some(inputs.with(PRESSURE, pressure_mpa - self.biases.pressure_mpa))
    }

    /// The input that moves most.
    #[must_use]
    pub fn widest(&self) -> Option<&'a LogColumn> {
        let inputs = self.columns.iter().flatten().map(|at| &self.recording.inputs[*at]);
        inputs.max_by(|a, b| range(&a.values).total_cmp(&range(&b.values)))
    }

    /// Follows the rows that have all inputs, by the rule of [`Gaps::Recorded`]. `at_row` gets what each row came to: a row of the time
    /// of the one before has the same state. A row at which the model has no answer is left out. Returns remarks about the rows.
    ///
    /// # Errors
    /// A row that the model does not take, and those of `at_row`.
    pub fn follow(
        &self,
        model: &Model,
        mut at_row: impl FnMut(usize, &Evaluation) -> Result<(), ComparisonError>,
    ) -> Result<Vec<String>, ComparisonError> {
        self.follow_in(&mut Session::new(model, Gaps::Recorded)?, |row, evaluation, _| {
            at_row(row, evaluation)
        })
    }

    /// As [`Self::follow`], in a session, which `at_row` gets too.
    fn follow_in(
        &self,
        session: &mut Session,
        mut at_row: impl FnMut(usize, &Evaluation, &mut Session) -> Result<(), ComparisonError>,
    ) -> Result<Vec<String>, ComparisonError> {
        let mut evaluation = session.evaluation();
        let begin_s = self.recording.time_s.first().copied().unwrap_or_default();
        let (mut restarts, mut has_begun) = (0, false);
        let (mut refused, mut first_refused) = (0_usize, None);
        for (row, t_s) in self.recording.time_s.iter().enumerate() {
            let Some(inputs) = self.row(row) else { continue };
            let t_ns = (1e9 * (t_s - begin_s)).round().max(0.0) as u64;
            match session.step(t_ns, inputs, &mut evaluation) {
                Ok(step) => restarts += usize::from(step.at_rest && has_begun),
                Err(ReadingError::NotLater { .. }) => {}
                Err(error) => return Err(error.into()),
            }
            has_begun = true;
            if let Some(why) = session.evaluator().refusal(&evaluation) {
                refused += 1;
                first_refused.get_or_insert_with(|| format!("{t_s} s: {why}"));
                continue;
            }
            at_row(row, &evaluation, session)?;
        }
        let mut remarks = Vec::new();
        if restarts > 0 {
            remarks.push(format!("the motion could not be continued and restarted at rest {restarts} times"));
        }
        if let Some(first) = first_refused {
            remarks.push(format!("{refused} rows are left out, the first at {first}"));
        }
        Ok(remarks)
    }
}

impl MeasuredStates {
    /// The states of a model at the rows of a recording, and what was measured there; remarks say what was left out.
    ///
    /// # Errors
    /// As [`RecordedInputs::new`] and [`RecordedInputs::follow`].
    pub fn of(
        model: &Model,
        recording: &Recording,
        remarks: &mut Vec<String>,
    ) -> Result<Self, ComparisonError> {
        let inputs = RecordedInputs::new(&model.header, recording, SensorBiases::default(), remarks)?;
        let mut states = vec![None; recording.time_s.len()];
        remarks.extend(inputs.follow(model, |row, evaluation| {
            states[row] = Some(evaluation.inputs);
            Ok(())
        })?);
        Ok(Self { states, outputs: recording.outputs.iter().map(|series| series.values.clone()).collect() })
    }
}

/// The body at an instant of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedBody {
    /// Time in the recording, s.
    pub time_s: f64,
    /// Predicted nodes, mm.
    pub nodes_mm: Vec<[f32; 3]>,
    /// Measured markers that the model has as node sets, mm; a coordinate that was not measured is the model's.
    pub markers_mm: Vec<[f32; 3]>,
    /// The state is outside the model's training range.
    pub is_outside: bool,
}

/// Fractions of the range of the input that moves most, at which a body is looked at.
const INSTANTS: [f64; 3] = [0.0, 0.5, 1.0];

impl RecordedInputs<'_> {
    /// The body at the rows nearest to these times; without times at the smallest, middle and largest value of the input that moves most.
    /// Empty without coordinates or without measured markers that the model has.
    ///
    /// # Errors
    /// As [`Self::follow`], and those of reconstructing the fields.
    pub fn bodies(&self, model: &Model, at_s: &[f64]) -> Result<Vec<RecordedBody>, ComparisonError> {
        let header = &model.header;
        let [Some(x), Some(y), Some(z)] = [0, 1, 2].map(|axis| header.coordinate_field(axis)) else {
            return Ok(Vec::new());
        };
        let measured = self.recording.outputs.iter().filter_map(|series| marker_axis(&series.name));
        let names: BTreeSet<&str> = measured.map(|(marker, _)| marker).collect();
        let is_measured = |set: &&NodeSet| names.contains(set.name.as_str()) && !set.nodes.is_empty();
        let sets: Vec<&NodeSet> = header.node_sets.iter().filter(is_measured).collect();
        if sets.is_empty() {
            return Ok(Vec::new());
        }
        let (wanted, mut bodies) = (self.rows_at(at_s), Vec::new());
        let reconstructor = Reconstructor::new(model, &Selection::default())?;
        let mut fields = vec![0.0; reconstructor.entries()];
        self.follow(model, |row, evaluation| {
            if wanted.contains(&row) {
                reconstructor.reconstruct_into(evaluation, &mut fields)?;
                let node = |node: usize| [x, y, z].map(|field| fields[field * header.node_count + node]);
                let nodes_mm: Vec<[f32; 3]> = (0..header.node_count).map(node).collect();
                let marker = |set: &&NodeSet| self.marker_mm(row, set, &nodes_mm);
                bodies.push(RecordedBody {
                    time_s: self.recording.time_s[row],
                    markers_mm: sets
                        .iter()
                        .map(marker)
                        .filter(|at| at.iter().all(|v| v.is_finite()))
                        .collect(),
                    nodes_mm,
                    is_outside: evaluation.flags.extrapolated,
                });
            }
            Ok(())
        })?;
        Ok(bodies)
    }

    /// Measured position of a marker; along an axis that was not measured the mean of its nodes.
    fn marker_mm(&self, row: usize, set: &NodeSet, nodes_mm: &[[f32; 3]]) -> [f32; 3] {
        [0, 1, 2].map(|axis| {
            let is_of = |series: &&LogColumn| marker_axis(&series.name) == Some((set.name.as_str(), axis));
            let measured = self.recording.outputs.iter().find(is_of);
            let sum = || set.nodes.iter().map(|node| nodes_mm[*node as usize][axis]).sum::<f32>();
            measured.map_or_else(|| sum() / set.nodes.len() as f32, |series| series.values[row] as f32)
        })
    }

    fn rows_at(&self, at_s: &[f64]) -> Vec<usize> {
        let nearest = |distance: &dyn Fn(usize) -> f64| {
            let rows = 0..self.recording.time_s.len();
            let known = rows.filter(|row| distance(*row).is_finite() && self.row(*row).is_some());
            known.min_by(|a, b| distance(*a).total_cmp(&distance(*b)))
        };
        if !at_s.is_empty() {
            let times = &self.recording.time_s;
            return at_s.iter().filter_map(|t_s| nearest(&|row| (times[row] - t_s).abs())).collect();
        }
        let Some(main) = self.widest() else { return Vec::new() };
        let [low, high] = ends(&main.values);
        let wanted = INSTANTS.map(|part| low + part * (high - low));
        wanted.iter().filter_map(|wanted| nearest(&|row| (main.values[row] - wanted).abs())).collect()
    }
}

/// Measured and predicted values of an output, by row; NaN where there is none.
pub struct ComparedOutput {
    /// Name in the mapping.
    pub name: String,
    /// Values of the recording.
    pub measured: Vec<f64>,
    /// Values of the model.
    pub predicted: Vec<f64>,
    /// Half-widths of the model.
    pub half_width: Vec<f64>,
    /// Rows outside the model's training range.
    pub is_outside: Vec<bool>,
}

/// Statistics of an output over the rows with a measured and a predicted value. Errors are measured minus predicted.
#[derive(Clone, Debug, Serialize)]
pub struct OutputStatistics {
    /// Root mean square of the errors.
    pub rms: f64,
    /// 95 % of the errors are smaller.
    pub p95: f64,
    /// Largest error.
    pub max: f64,
    /// Largest minus smallest measured value.
    pub range: f64,
    /// Fraction of the errors within the half-widths, where there are any.
    pub coverage: f64,
    /// Mean of predicted minus measured.
    pub bias: f64,
    /// Slope of the measured over the predicted values.
    pub gain: f64,
    /// Correlation of measured and predicted values.
    #[serde(skip)]
    correlation: f64,
}

/// Position error of a marker, and its share of the diagonal of its range.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)] // the names say what the values are
pub struct MarkerError {
    pub rms_mm: f64,
    pub range_mm: f64,
    pub share: f64,
}

/// Result of [`compare`].
#[derive(Serialize)]
pub struct Comparison {
    /// What the model was made of.
    pub source: &'static str,
    /// Rows at which the model has an answer.
    pub rows: usize,
    /// Those outside the training range; `inside` and `outside` tell both apart.
    pub rows_outside: usize,
    /// Statistics by output.
    pub outputs: BTreeMap<String, OutputStatistics>,
    /// The same of the rows inside the training range; empty if all are.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub inside: BTreeMap<String, OutputStatistics>,
    /// The same of those outside.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub outside: BTreeMap<String, OutputStatistics>,
    /// Statistics of another model, if one is shown beside it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub before: Option<BTreeMap<String, OutputStatistics>>,
    /// Errors of the markers with three coordinates.
    pub markers: BTreeMap<String, MarkerError>,
    /// What looks wrong.
    pub remarks: Vec<String>,
    /// Values behind the statistics.
    #[serde(skip)]
    pub series: Vec<ComparedOutput>,
}

/// Compares a model with a recording. With `follow_s`, the predictions of a learned model get the offset that measured values of at least
/// this time ago suggest. Cost: one evaluation and reconstruction a row.
///
/// # Errors
/// [`ComparisonError`].
pub fn compare(
    model: &Model,
    recording: &Recording,
    biases: SensorBiases,
    follow_s: Option<f64>,
) -> Result<Comparison, ComparisonError> {
    let mut remarks = recording.remarks.clone();
    let inputs = RecordedInputs::new(&model.header, recording, biases, &mut remarks)?;
    let series = compared(model, &inputs, follow_s, &mut remarks)?;
    let rows = series.first().map_or(0, |output| output.predicted.iter().filter(|v| v.is_finite()).count());
    if rows == 0 {
        return Err(ComparisonError::NoRow);
    }
    let outputs: BTreeMap<_, _> = series.iter().map(|o| (o.name.clone(), o.statistics())).collect();
    remarks.extend(suspicions(&series, &outputs));
    remarks.extend(swapped_inputs(model, &inputs, &series)?);
    let part = |outside: bool| {
        series.iter().filter_map(|o| Some((o.name.clone(), o.part(outside)?.statistics()))).collect()
    };
    Ok(Comparison {
        source: if model.is_measured() { "measured" } else { "finite elements" },
        rows,
        rows_outside: series[0].is_outside.iter().filter(|is_outside| **is_outside).count(),
        inside: part(false),
        outside: part(true),
        before: None,
        markers: markers(&outputs),
        outputs,
        remarks,
        series,
    })
}

/// Where the predicted value of an output comes from.
enum Origin {
    /// `output`: which of those of a learned map it is.
    Node {
        field: usize,
        node: usize,
        output: Option<usize>,
    },
    Observable(usize),
    Force,
}

/// Measured and predicted values of the outputs that the model has; the others are remarked.
fn compared(
    model: &Model,
    inputs: &RecordedInputs<'_>,
    follow_s: Option<f64>,
    remarks: &mut Vec<String>,
) -> Result<Vec<ComparedOutput>, ComparisonError> {
    let mut answers = Answers::new(model, inputs.biases.force_n)?;
    let origins = answers.origins(inputs.recording, remarks)?;
    let mut outputs: Vec<ComparedOutput> =
        origins.iter().map(|(column, _)| ComparedOutput::unanswered(column)).collect();
    let mut session = Session::new(model, Gaps::Recorded)?;
    let mut late = match follow_s {
        Some(behind_s) if session.start_following() => {
            Some(LateErrors::new(inputs.recording, behind_s, &origins))
        }
        Some(_) => return Err(ComparisonError::NotLearned),
        None => None,
    };
    let of_rows = inputs.follow_in(&mut session, |row, evaluation, session| {
        answers.reconstructor.reconstruct_into(evaluation, &mut answers.fields)?;
        for (output, (_, origin)) in outputs.iter_mut().zip(&origins) {
            (output.predicted[row], output.half_width[row]) = answers.value_and_width(evaluation, origin);
            output.is_outside[row] = evaluation.flags.extrapolated;
        }
        late.iter_mut().for_each(|late| late.take(row, evaluation, session));
        Ok(())
    })?;
    remarks.extend(of_rows);
    let outside = outputs[0].is_outside.iter().filter(|is_outside| **is_outside).count();
    if outside > 0 {
        let widths =
            if model.header.learned.is_some() { "wider half-widths or none" } else { "no half-width" };
        let remark = format!(
            "{outside} rows are outside the model's training range, with {widths}; they are also reported apart"
        );
        remarks.insert(0, remark);
    }
    Ok(outputs)
}

impl ComparedOutput {
    /// A column whose predictions are to come.
    fn unanswered(column: &LogColumn) -> Self {
        let nan = vec![f64::NAN; column.values.len()];
        Self {
            name: column.name.clone(),
            measured: column.values.clone(),
            predicted: nan.clone(),
            half_width: nan,
            is_outside: vec![false; column.values.len()],
        }
    }
}

/// What a model answers to the rows of a recording.
struct Answers<'a> {
    model: &'a Model,
    observables: Observables,
    reconstructor: Reconstructor,
    /// All fields at all nodes for the present row.
    fields: Vec<f32>,
    /// Offset of the load cell.
    force_bias_n: f64,
}

impl<'a> Answers<'a> {
    fn new(model: &'a Model, force_bias_n: f64) -> Result<Self, ComparisonError> {
        let reconstructor = Reconstructor::new(model, &Selection::default())?;
        let fields = vec![0.0; reconstructor.entries()];
        Ok(Self { model, observables: Observables::of(model)?, reconstructor, fields, force_bias_n })
    }

    /// The recording's outputs that the model has, with the origin of each; the others are remarks.
    fn origins<'r>(
        &self,
        recording: &'r Recording,
        remarks: &mut Vec<String>,
    ) -> Result<Vec<(&'r LogColumn, Origin)>, ComparisonError> {
        let mut origins = Vec::new();
        for column in &recording.outputs {
            match self.origin(&column.name) {
                Some(origin) => origins.push((column, origin)),
                None => remarks.push(format!("{}: the model has no such output", column.name)),
            }
        }
        if origins.is_empty() {
            let header = &self.model.header;
            return Err(ComparisonError::NoOutput {
                observables: names(self.observables.names()),
                fields: names(header.fields.iter().map(|field| field.spec.name.as_str())),
                node_sets: names(header.node_sets.iter().map(|set| set.name.as_str())),
            });
        }
        Ok(origins)
    }

    fn origin(&self, name: &str) -> Option<Origin> {
        let header = &self.model.header;
        let has_force = header.regimes.iter().any(|regime| regime.force.is_some());
        if has_force && matches!(name, "contact_force_n" | "measured_force_n") {
            return Some(Origin::Force);
        }
        let observable = self.observables.names().position(|known| known == name).map(Origin::Observable);
        observable.or_else(|| {
            let (field, node) = place(header, name)?;
            Some(Origin::Node { field, node, output: self.model.learned_output(field, node) })
        })
    }

    /// Value and half-width of an output for the present row.
    fn value_and_width(&self, evaluation: &Evaluation, origin: &Origin) -> (f64, f64) {
        let widths = evaluation.halfwidths;
        match *origin {
            Origin::Observable(at) => {
                let found = self.observables.value(at, evaluation);
                (found.value, found.halfwidth)
            }
            Origin::Force => (evaluation.contact_force_n + self.force_bias_n, widths.force_n),
            Origin::Node { field, node, output } => {
                let width = match (output, self.model.header.fields[field].spec.kind) {
                    (Some(output), _) => {
                        evaluation.output_half_widths.get(output).copied().unwrap_or(f64::NAN)
                    }
                    (None, FieldKind::Coordinate(_) | FieldKind::Magnitude) => widths.displacement_mm,
                    (None, FieldKind::Stress) => widths.stress_mpa,
                    (None, FieldKind::Other) => f64::NAN,
                };
                (f64::from(self.fields[field * self.model.header.node_count + node]), width)
            }
        }
    }
}

fn names<'a>(all: impl Iterator<Item = &'a str>) -> String {
    all.collect::<Vec<_>>().join(", ")
}

/// Errors of a learned model's outputs that a session follows once they are some time old.
struct LateErrors<'a> {
    recording: &'a Recording,
    behind_s: f64,
    /// Column of the recording's outputs, and the model's output.
    columns: Vec<(&'a LogColumn, usize)>,
    /// Time, s, and errors of rows that are not old enough.
    waiting: VecDeque<(f64, Vec<f64>)>,
}

impl<'a> LateErrors<'a> {
    fn new(recording: &'a Recording, behind_s: f64, origins: &[(&'a LogColumn, Origin)]) -> Self {
        let columns = origins.iter().filter_map(|(series, origin)| match origin {
            Origin::Node { output: Some(output), .. } => Some((*series, *output)),
            _ => None,
        });
        Self { recording, behind_s, columns: columns.collect(), waiting: VecDeque::new() }
    }

    /// Takes the errors of a row, and lets the session follow those that are old enough at the next.
    fn take(&mut self, row: usize, evaluation: &Evaluation, session: &mut Session) {
        let mut errors = vec![f64::NAN; evaluation.coefficients.len()];
        for (series, output) in &self.columns {
            errors[*output] = session.free_error(*output, series.values[row], evaluation);
        }
        let time_s = &self.recording.time_s;
        self.waiting.push_back((time_s[row], errors));
        let next_s = time_s.get(row + 1).copied().unwrap_or(f64::NEG_INFINITY);
        while let Some((t_s, errors)) = self.waiting.pop_front_if(|(t_s, _)| *t_s <= next_s - self.behind_s) {
            session.follow((1e9 * (t_s - time_s[0])).round().max(0.0) as u64, &errors);
        }
    }
}

impl ComparedOutput {
    /// The rows outside the training range, or those inside; `None` if all are inside.
    fn part(&self, outside: bool) -> Option<Self> {
        let pick = |values: &[f64]| -> Vec<f64> {
            values.iter().zip(&self.is_outside).filter(|(_, is)| **is == outside).map(|(v, _)| *v).collect()
        };
        let part = Self {
            name: self.name.clone(),
            measured: pick(&self.measured),
            predicted: pick(&self.predicted),
            half_width: pick(&self.half_width),
            is_outside: Vec::new(),
        };
        (self.is_outside.contains(&true) && part.rows().next().is_some()).then_some(part)
    }

    /// Measured value, predicted value and half-width of the rows with both values.
    fn rows(&self) -> impl Iterator<Item = (f64, f64, f64)> + '_ {
        let all = self.measured.iter().zip(&self.predicted).zip(&self.half_width);
        all.map(|((m, p), h)| (*m, *p, *h)).filter(|(m, p, _)| m.is_finite() && p.is_finite())
    }

    fn statistics(&self) -> OutputStatistics {
        let errors = || self.rows().map(|(m, p, _)| (m - p).abs());
        let (mean_m, mean_p) = (mean(self.rows().map(|row| row.0)), mean(self.rows().map(|row| row.1)));
        let variance_m = mean(self.rows().map(|(m, ..)| (m - mean_m).powi(2)));
        let variance_p = mean(self.rows().map(|(_, p, _)| (p - mean_p).powi(2)));
        let covariance = mean(self.rows().map(|(m, p, _)| (m - mean_m) * (p - mean_p)));
        let within = self.rows().filter(|(.., h)| h.is_finite()).map(|(m, p, h)| (m - p).abs() <= h);
        OutputStatistics {
            rms: mean(errors().map(|error| error * error)).sqrt(),
            p95: quantile(errors(), 0.95),
            max: quantile(errors(), 1.0),
            range: range(&self.measured),
            coverage: mean(within.map(f64::from)),
            bias: mean_p - mean_m,
            gain: covariance / variance_p,
            correlation: covariance / (variance_m * variance_p).sqrt(),
        }
    }
}

fn markers(outputs: &BTreeMap<String, OutputStatistics>) -> BTreeMap<String, MarkerError> {
    let marker = |name: &String| {
        let (marker, _) = marker_axis(name).filter(|(_, axis)| *axis == 0)?;
        let axes = AXES.map(|axis| outputs.get(&format!("{marker}_{axis}_mm")));
        let norm = |value: fn(&OutputStatistics) -> f64| {
            axes.iter().flatten().map(|axis| value(axis).powi(2)).sum::<f64>().sqrt()
        };
        let (rms_mm, range_mm) = (norm(|axis| axis.rms), norm(|axis| axis.range));
        Some((marker.to_owned(), MarkerError { rms_mm, range_mm, share: rms_mm / range_mm }))
    };
    outputs.keys().filter_map(marker).collect()
}

/// The confusion of units that a ratio fits within 30 %.
fn confusion(ratio: f64) -> &'static str {
    let ratio = if ratio < 1.0 { 1.0 / ratio } else { ratio };
    let near = KNOWN_RATIOS.iter().find(|(known, _)| (0.77..1.3).contains(&(ratio / known)));
    near.map_or("no known confusion of units", |(_, name)| name)
}

/// Ranges that differ by a factor, and columns that fit one another's prediction.
fn suspicions(outputs: &[ComparedOutput], statistics: &BTreeMap<String, OutputStatistics>) -> Vec<String> {
    let mut remarks = Vec::new();
    for output in outputs {
        let ratio = range(&output.measured) / range(&output.predicted);
        // Only a curve of the same shape can have another unit.
        let is_same_shape = statistics[&output.name].correlation > SAME_SHAPE;
        if is_same_shape
            && ratio.is_finite()
            && ratio > 0.0
            && !(SMALL_RATIO..=1.0 / SMALL_RATIO).contains(&ratio)
        {
            remarks.push(format!(
                "{}: the measured range is {ratio:.3} times the predicted one ({}); is its unit right?",
                output.name,
                confusion(ratio)
            ));
        }
    }
    let error = |a: &ComparedOutput, b: &ComparedOutput| -> f64 {
        let both = a.measured.iter().zip(&b.predicted).filter(|(m, p)| m.is_finite() && p.is_finite());
        both.map(|(m, p)| (m - p) * (m - p)).sum()
    };
    for (index, a) in outputs.iter().enumerate() {
        for b in &outputs[index + 1..] {
            let (own, swapped) = (error(a, a) + error(b, b), error(a, b) + error(b, a));
            if swapped < LEFT_BY_SWAP * own {
                remarks.push(format!("{} and {}: swapped? Each fits the other's prediction", a.name, b.name));
            }
        }
    }
    remarks
}

/// Pairs of inputs that explain the outputs better when exchanged. Inputs with the same effect are undecidable and not named.
fn swapped_inputs(
    model: &Model,
    inputs: &RecordedInputs<'_>,
    outputs: &[ComparedOutput],
) -> Result<Vec<String>, ComparisonError> {
    let error = |all: &[ComparedOutput]| -> f64 {
        let shares = all.iter().map(|output| (output.statistics().rms / range(&output.measured)).powi(2));
        shares.filter(|v| v.is_finite()).sum::<f64>() / all.len() as f64
    };
    if error(outputs) < SUSPECT {
        return Ok(Vec::new());
    }
    let thin = inputs.recording.every(inputs.recording.time_s.len().div_ceil(PROBE_ROWS));
    let error_with = |columns: Vec<Option<usize>>| -> Result<f64, ComparisonError> {
        let inputs = RecordedInputs { recording: &thin, columns, ..*inputs };
        Ok(error(&compared(model, &inputs, None, &mut Vec::new())?))
    };
    let columns = &inputs.columns;
    let own = error_with(columns.clone())?;
    let unit = |index: usize| model.header.inputs[index].unit.as_str();
    let moves = |column: usize| range(&thin.inputs[column].values) > 0.0;
    let mut remarks = Vec::new();
    for a in 0..columns.len() {
        for b in a + 1..columns.len() {
            let (Some(first), Some(second)) = (columns[a], columns[b]) else { continue };
            if unit(a) != unit(b) || !(moves(first) || moves(second)) {
                continue;
            }
            let mut swapped = columns.clone();
            swapped.swap(a, b);
            if error_with(swapped)? < LEFT_BY_SWAP * own {
                let [a, b] = [first, second].map(|at| &thin.inputs[at].name);
                remarks
                    .push(format!("inputs {a} and {b}: swapped? Exchanged, they explain the outputs better"));
            }
        }
    }
    Ok(remarks)
}
