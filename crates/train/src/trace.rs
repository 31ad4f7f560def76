//! A model along a trace of inputs: the series that the finite elements write of a motion, or the outputs of a model of measurements; and the
//! errors of such a series against the finite elements' own.

use crate::measured::{self, MeasuredOutput};
use formats::table::Table;
use formats::trace::{self, SERIES, SERIES_COLUMNS, around, series_column};
use formats::{Diagnostic, FormatError};
use rom::branch::{Follower, VOLUME, pressure_field, volume_input};
use rom::evaluation::Evaluation;
use rom::hull::DomainStatus;
use rom::inertia::stepper::ReadingError;
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::{BlockKind, Model, ModelError, ModelFileError, Selection};
use rom::probe::model_tip;
use rom::reconstructor::{ReconstructError, Reconstructor};
use rom::session::{Gaps, Session};
use rom::statistics::{mean, range};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Most instants of a trace with those between its rows: some 0.5 GB of answers. An hour at 1 ms has 3.6 million.
const MAX_INSTANTS: u64 = 5_000_000;
/// Columns of a series.
const TIME: usize = series_column("t_s");
const SERIES_PRESSURE: usize = series_column("pressure_mpa");
const TIP_Y: usize = series_column("tip_y_mm");
const TIP: [usize; 3] = [series_column("tip_x_mm"), TIP_Y, series_column("tip_z_mm")];
const FORCE: usize = series_column("contact_force_n");
const STRESS: usize = series_column("max_stress_mpa");
/// First quantity of a series that is predicted.
const FIRST_PREDICTED: usize = series_column("lowest_y_mm");
/// Width of the mean of the contact force, s.
const FORCE_WINDOW_S: f64 = 0.01;
/// Smallest swing that has a frequency, as a fraction of the range of the tip's height.
const LEAST_SWING: f64 = 0.01;
/// Instants of a spectrum, and its lines that are shown.
const SAMPLES: usize = 512;
const LINES: usize = 64;

/// Why a model cannot be followed along a trace.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the messages say what the values are
pub enum TraceError {
    #[error(transparent)]
    File(#[from] FormatError),
    /// More instants than there can be answers: a wrong unit of time, or a pause that is two recordings.
    #[error(
        "expected at most {MAX_INSTANTS} instants, found {count} with one every {step_ms} ms at least; the longest gap, {gap_s:.3} s, is between rows {} and {} (is t_s in seconds?); \
         cut the trace there, or take longer steps",
        row, row + 1
    )]
    TooLong { count: u64, step_ms: f64, gap_s: f64, row: usize },
    /// The model does not know where its tip is.
    #[error("the model has no coordinate along axis {axis}")]
    NoCoordinate { axis: u8 },
    #[error("the model has no undeformed coordinates, which define the tip")]
    NoTip,
    /// The model has no answer at an instant.
    #[error("at {t_s} s: {why}")]
    Refused { t_s: f64, why: String },
    #[error(transparent)]
    Reading(#[from] ReadingError),
    #[error(transparent)]
    Reconstruct(#[from] ReconstructError),
    #[error(transparent)]
    ModelFile(#[from] ModelFileError),
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Inputs over time, straight lines between the rows.
pub struct InputTrace {
    rows: Vec<(u64, Inputs)>,
    begin_s: f64,
}

impl InputTrace {
    /// Reads `t_s` and the inputs of a model by their keys; those with a value of the model, and the gap, may be left out. Results in a
    /// series are ignored.
    ///
    /// # Errors
    /// All errors: I/O, missing or unknown columns, times that do not rise.
    pub fn read(path: &Path, model: &Model) -> Result<Self, TraceError> {
        let wrong = |diagnostics| FormatError::Content { path: path.into(), diagnostics };
        let table = Table::read(path, true)?;
        let read = trace::TraceTable::of_table(&table, &|_| None).map_err(wrong)?;
        let known = &model.header.inputs;
        let mut diagnostics = Vec::new();
        let mut places = Vec::new();
        for name in &read.names {
            let found = known.iter().position(|input| input.key() == *name);
            if found.is_none() && name != VOLUME && !SERIES_COLUMNS.contains(&name.as_str()) {
                diagnostics.push(Diagnostic::new("header", "inputs of the model", format!("`{name}`")));
            }
            places.push(found);
        }
        let is_open = |index: usize, value: Option<f64>| value.is_none() && index != GAP;
        for (index, input) in
            model.header.taken_inputs().filter(|(index, input)| is_open(*index, input.value))
        {
            if !places.contains(&Some(index)) {
                let expected = format!("a column `{}`", input.key());
                diagnostics.push(Diagnostic::new("header", expected, "none of that name"));
            }
        }
        if volume_input(&model.header).is_some_and(|volume| !places.contains(&Some(volume))) {
            let follows = Follower::of(model)?.is_some();
            if !(follows && places.contains(&Some(PRESSURE))) {
                let or = if follows { " or `pressure_mpa`" } else { "" };
                diagnostics.push(Diagnostic::new(
                    "header",
                    format!("a column `{VOLUME}`{or}"),
                    "none of that name",
                ));
            }
        }
        if !diagnostics.is_empty() {
            return Err(wrong(diagnostics).into());
        }
        let begin_s = read.rows.first().map_or(f64::NAN, |(t_s, _)| *t_s);
        let row = |(t_s, values): &(f64, Vec<f64>)| {
            let both = places.iter().zip(values).filter_map(|(place, value)| Some(((*place)?, *value)));
            let inputs = Inputs::new(f64::NAN, f64::INFINITY);
            (
                ((t_s - begin_s) * 1e9).round() as u64,
                both.fold(inputs, |inputs, (at, value)| inputs.with(at, value)),
            )
        };
        Ok(Self { rows: read.rows.iter().map(row).collect(), begin_s })
    }

    /// Its rows: time after the first one, ns, and inputs.
    pub fn rows(&self) -> impl Iterator<Item = (u64, Inputs)> + '_ {
        self.rows.iter().copied()
    }

    /// Duration, s.
    pub fn length_s(&self) -> f64 {
        1e-9 * self.rows.last().map_or(0, |(t_ns, _)| *t_ns) as f64
    }

    /// Refuses more instants than there can be answers.
    fn check(&self, step_ns: u64) -> Result<(), TraceError> {
        let gaps = || self.rows.windows(2).map(|pair| pair[1].0 - pair[0].0);
        let count = gaps().fold(1_u64, |sum, gap_ns| sum.saturating_add(gap_ns.div_ceil(step_ns)));
        if count <= MAX_INSTANTS {
            return Ok(());
        }
        let (row, gap_ns) = gaps().enumerate().max_by_key(|(_, gap_ns)| *gap_ns).unwrap_or_default();
        let (step_ms, gap_s) = (1e-6 * step_ns as f64, 1e-9 * gap_ns as f64);
        Err(TraceError::TooLong { count, step_ms, gap_s, row: row + 1 })
    }

    /// Instants of the rows and in between at least every `step_ns`.
    fn instants(&self, step_ns: u64) -> impl Iterator<Item = (u64, Inputs)> + '_ {
        let between = move |pair: &[(u64, Inputs)]| {
            let [(from_ns, from), (to_ns, to)] = [pair[0], pair[1]];
            let parts = (to_ns - from_ns).div_ceil(step_ns);
            (1..=parts).map(move |part| {
                let t_ns =
                    from_ns + (u128::from(to_ns - from_ns) * u128::from(part) / u128::from(parts)) as u64;
                (t_ns, from.between(&to, part as f64 / parts as f64))
            })
        };
        self.rows.iter().take(1).copied().chain(self.rows.windows(2).flat_map(between))
    }
}

/// A model along a trace.
pub struct PredictedSeries {
    /// Names of the columns: for a model of a shape [`SERIES_COLUMNS`], and the injected volume where it is an input; for a model of
    /// measurements the time, the inputs, and each output with its half-width.
    pub columns: Vec<String>,
    /// Values at each instant; NaN where there is none.
    pub rows: Vec<Vec<f64>>,
    /// Half-widths of displacement, contact force and stress at each instant.
    pub half_widths: Vec<[f64; 3]>,
    /// The first instant outside the training range, as a sentence.
    pub first_outside: Option<String>,
    /// What the command prints.
    pub summary: SeriesSummary,
}

/// Figures of a [`PredictedSeries`].
#[derive(Clone, Debug, Serialize)]
pub struct SeriesSummary {
    /// Instants that were answered.
    pub rows: usize,
    /// Length of the trace, s.
    pub seconds: f64,
    /// The model moves with inertia.
    pub moves: bool,
    /// Instants outside of the training range.
    pub outside_training_range: usize,
    /// Instants since whose predecessor the inertial load left its training range.
    pub load_outside_range: usize,
    /// Restarts at rest because the motion could not be continued.
    pub restarts: usize,
    /// Times at which the pressure passed a limit and the state left a branch or came back to the first.
    pub limits_passed: usize,
    /// Time of computation of all states without their fields, by the trace's time.
    pub state_us_per_ms: f64,
}

/// Follows a trace with at least one row every `step_ns`.
///
/// # Errors
/// [`TraceError`]: too many instants, a model whose tip is unknown, an instant at which the model has no answer.
pub fn predict_series(
    model: &Model,
    trace: &InputTrace,
    step_ns: u64,
) -> Result<PredictedSeries, TraceError> {
    trace.check(step_ns)?;
    let mut session = Session::new(model, Gaps::Recorded)?;
    let mut evaluation = session.evaluation();
    let mut columns = SeriesColumns::new(model)?;
    let seconds = trace.length_s();
    let mut series = PredictedSeries {
        columns: columns.names(),
        rows: Vec::new(),
        half_widths: Vec::new(),
        first_outside: None,
        summary: SeriesSummary {
            rows: 0,
            seconds,
            moves: session.has_inertia(),
            outside_training_range: 0,
            load_outside_range: 0,
            restarts: 0,
            limits_passed: 0,
            state_us_per_ms: 0.0,
        },
    };
    let (mut state_s, mut has_snapped) = (0.0, false);
    for (t_ns, inputs) in trace.instants(step_ns) {
        let began = Instant::now();
        let step = session.step(t_ns, inputs, &mut evaluation)?;
        state_s += began.elapsed().as_secs_f64();
        let t_s = trace.begin_s + 1e-9 * t_ns as f64;
        if let Some(why) = session.evaluator().refusal(&evaluation) {
            return Err(TraceError::Refused { t_s, why });
        }
        if evaluation.domain != DomainStatus::Inside {
            let why = || session.evaluator().outside(&evaluation).unwrap_or_default();
            series.first_outside.get_or_insert_with(|| format!("{t_s} s: {}", why()));
            series.summary.outside_training_range += 1;
        }
        series.summary.load_outside_range += usize::from(step.load_distance > 0.0);
        series.summary.restarts += usize::from(step.at_rest && !series.rows.is_empty());
        series.summary.limits_passed += usize::from(evaluation.flags.snapped != has_snapped);
        has_snapped = evaluation.flags.snapped;
        let widths = evaluation.halfwidths;
        series.half_widths.push([widths.displacement_mm, widths.force_n, widths.stress_mpa]);
        series.rows.push(columns.row(t_s, &inputs, &evaluation)?);
    }
    series.summary.rows = series.rows.len();
    series.summary.state_us_per_ms = 1e3 * state_s / seconds;
    Ok(series)
}

/// Makes the rows of a series.
struct SeriesColumns {
    reconstructor: Reconstructor,
    fields: Vec<f32>,
    nodes: usize,
    kind: SeriesKind,
}

enum SeriesKind {
    /// Places of the coordinates, the pressure and the injected volume of a body with a tip.
    Shape {
        axes: [usize; 3],
        tip: usize,
        pressure: Option<usize>,
        volume: Option<usize>,
    },
    Measured {
        inputs: Vec<(usize, String)>,
        outputs: Vec<MeasuredOutput>,
    },
}

impl SeriesColumns {
    fn new(model: &Model) -> Result<Self, TraceError> {
        let reconstructor = Reconstructor::new(model, &Selection::default())?;
        let header = &model.header;
        let kind = if model.is_measured() {
            let inputs = header.taken_inputs().map(|(index, input)| (index, input.key())).collect();
            SeriesKind::Measured { inputs, outputs: measured::outputs(model) }
        } else {
            let coordinate =
                |axis: u8| header.coordinate_field(axis).ok_or(TraceError::NoCoordinate { axis });
            SeriesKind::Shape {
                axes: [coordinate(0)?, coordinate(1)?, coordinate(2)?],
                tip: model_tip(model).ok_or(TraceError::NoTip)?,
                pressure: pressure_field(header),
                volume: volume_input(header),
            }
        };
        let fields = vec![0.0; reconstructor.entries()];
        Ok(Self { nodes: reconstructor.rows(), reconstructor, fields, kind })
    }

    fn names(&self) -> Vec<String> {
        match &self.kind {
            SeriesKind::Shape { volume, .. } => {
                SERIES_COLUMNS.into_iter().chain(volume.map(|_| VOLUME)).map(str::to_owned).collect()
            }
            SeriesKind::Measured { inputs, outputs } => {
                let inputs = inputs.iter().map(|(_, key)| key.clone());
                let outputs = outputs.iter().flat_map(|o| [o.name.clone(), format!("{}_half_width", o.name)]);
                std::iter::once("t_s".to_owned()).chain(inputs).chain(outputs).collect()
            }
        }
    }

    fn row(&mut self, t_s: f64, inputs: &Inputs, evaluation: &Evaluation) -> Result<Vec<f64>, TraceError> {
        let peaks = self.reconstructor.reconstruct_into(evaluation, &mut self.fields)?;
        let value = |field: usize, node: usize| f64::from(self.fields[field * self.nodes + node]);
        Ok(match &self.kind {
            SeriesKind::Shape { axes: [x, y, z], tip, pressure, volume } => {
                // The pressure follows from the volume unless the trace gives the pressure.
                let gives_pressure = volume.is_some_and(|at| inputs.values()[at].is_nan());
                let pressure = pressure.filter(|_| !gives_pressure);
                let lowest = (0..self.nodes).map(|node| value(*y, node)).fold(f64::INFINITY, f64::min);
                let columns: [f64; SERIES] = [
                    t_s,
                    pressure.map_or(inputs.pressure_mpa(), |field| value(field, *tip)),
                    inputs.values()[GAP],
                    lowest,
                    value(*x, *tip),
                    value(*y, *tip),
                    evaluation.contact_force_n,
                    peaks.stress_mpa.map_or(f64::NAN, |peak| f64::from(peak.value)),
                    value(*z, *tip),
                ];
                columns.into_iter().chain(volume.map(|at| evaluation.inputs.values()[at])).collect()
            }
            SeriesKind::Measured { inputs: taken, outputs } => {
                let inputs = taken.iter().map(|(index, _)| inputs.values()[*index]);
                let outputs =
                    outputs.iter().flat_map(|o| [value(o.field, o.node), o.half_width_of(evaluation)]);
                std::iter::once(t_s).chain(inputs).chain(outputs).collect()
            }
        })
    }
}

/// Errors along one motion of the finite elements.
#[derive(Debug, Serialize)]
pub struct MotionErrors {
    /// File of the finite elements' motion.
    pub series: PathBuf,
    /// `free`, `contact` (throughout) or `landing`.
    pub class: &'static str,
    /// Instants that the model answers outside of its training range.
    pub outside_training_range: usize,
    /// Frequencies of the swing after the last change of pressure, finite elements and model.
    pub frequency_hz: Option<[f64; 2]>,
    /// Errors of each predicted quantity.
    pub quantities: Vec<QuantityErrors>,
    /// The motion itself: of the finite elements, of the model and of the static model.
    #[serde(skip)]
    pub motion: [Vec<Vec<f64>>; 3],
}

/// Root mean square errors of a quantity along a motion, in % of its range; of positions, in % of the length of the tip's range, because an
/// obstacle holds single coordinates. The contact force is its mean over 10 ms. `None` for a quantity that does not move.
#[derive(Debug, Serialize)]
pub struct QuantityErrors {
    /// Column of the series.
    pub quantity: &'static str,
    /// Error of the model.
    pub inertia: Option<f64>,
    /// Error of the same model without inertia and memory.
    pub statics: Option<f64>,
    /// Values within the half-widths of the motion, %.
    pub coverage: Option<f64>,
}

/// Compares a model with the `series.csv` of a motion of the finite elements.
///
/// # Errors
/// [`TraceError`].
pub fn motion_errors(model: &Model, series: &Path) -> Result<MotionErrors, TraceError> {
    let truth = trace::read_series(series)?;
    let trace = InputTrace::read(series, model)?;
    let mut without = model.clone();
    without.blocks.retain(|(kind, _)| !matches!(kind, BlockKind::Inertia | BlockKind::Memory));
    let moving = predict_series(model, &trace, u64::MAX)?;
    let still = predict_series(&without, &trace, u64::MAX)?.rows;
    let class = match truth.iter().filter(|row| row[FORCE] > 0.0).count() {
        0 => "free",
        all if all == truth.len() => "contact",
        _ => "landing",
    };
    let both = frequency_hz(&truth).zip(frequency_hz(&moving.rows));
    let tip = TIP.map(|at| range(column(&truth, at)).powi(2)).iter().sum::<f64>().sqrt();
    let errors = |index: usize| {
        let values = column(&truth, index);
        let scale = if matches!(index, FORCE | STRESS) { range(&values) } else { tip };
        let error = |rows: &[Vec<f64>]| {
            let square = mean(values.iter().zip(column(rows, index)).map(|(a, b)| (a - b) * (a - b)));
            (scale > 0.0).then(|| 100.0 * square.sqrt() / scale)
        };
        QuantityErrors {
            quantity: SERIES_COLUMNS[index],
            inertia: error(&moving.rows),
            statics: error(&still),
            coverage: coverage(&values, &moving, index),
        }
    };
    Ok(MotionErrors {
        series: series.into(),
        class,
        outside_training_range: moving.summary.outside_training_range,
        frequency_hz: both.filter(|_| class != "landing").map(<[f64; 2]>::from),
        quantities: (FIRST_PREDICTED..SERIES).map(errors).collect(),
        motion: [truth, moving.rows, still],
    })
}

/// Values of a quantity within their half-widths, %.
fn coverage(truth: &[f64], found: &PredictedSeries, quantity: usize) -> Option<f64> {
    let width = |[displacement, force, stress]: &[f64; 3]| match quantity {
        FORCE => *force,
        STRESS => *stress,
        _ => *displacement,
    };
    let rows = truth.iter().zip(column(&found.rows, quantity)).zip(found.half_widths.iter().map(width));
    let known = rows.filter(|(_, width)| width.is_finite());
    let share = mean(known.map(|((a, b), width)| f64::from((a - b).abs() <= width)));
    Some(100.0 * share).filter(|share| range(truth) > 0.0 && share.is_finite())
}

/// Values of a quantity at all instants; of the contact force its mean over a window.
fn column(rows: &[Vec<f64>], quantity: usize) -> Vec<f64> {
    if quantity == FORCE { means(rows) } else { rows.iter().map(|row| row[quantity]).collect() }
}

/// Mean of the force over a window about each instant; forces are straight lines between the rows.
fn means(rows: &[Vec<f64>]) -> Vec<f64> {
    let mut impulse = vec![0.0];
    for pair in rows.windows(2) {
        let last = impulse[impulse.len() - 1];
        impulse.push(last + 0.5 * (pair[0][FORCE] + pair[1][FORCE]) * (pair[1][TIME] - pair[0][TIME]));
    }
    let (begin, end) = (rows[0][TIME], rows[rows.len() - 1][TIME]);
    let until = |t: f64| {
        let i = rows.partition_point(|row| row[TIME] <= t).clamp(1, rows.len() - 1) - 1;
        let part = (t - rows[i][TIME]) / (rows[i + 1][TIME] - rows[i][TIME]);
        let force = rows[i][FORCE] + part * (rows[i + 1][FORCE] - rows[i][FORCE]);
        impulse[i] + 0.5 * (rows[i][FORCE] + force) * (t - rows[i][TIME])
    };
    let mean = |row: &Vec<f64>| {
        let (from, to) =
            ((row[TIME] - 0.5 * FORCE_WINDOW_S).max(begin), (row[TIME] + 0.5 * FORCE_WINDOW_S).min(end));
        (until(to) - until(from)) / (to - from)
    };
    rows.iter().map(mean).collect()
}

/// Frequency of the tip's swing after the last change of the pressure, Hz, by its extrema, refined by parabolas. `None` with fewer than two, or
/// where it hardly swings.
fn frequency_hz(rows: &[Vec<f64>]) -> Option<f64> {
    let last = rows.last()?[SERIES_PRESSURE];
    let begin = rows.iter().rposition(|row| row[SERIES_PRESSURE] != last).map_or(0, |at| at + 1);
    let span = |rows: &[Vec<f64>]| range(column(rows, TIP_Y));
    if span(&rows[begin..]) < LEAST_SWING * span(rows) {
        return None;
    }
    let mut extrema = Vec::new();
    for three in rows[begin..].windows(3) {
        let [before, after] = [three[1][TIP_Y] - three[0][TIP_Y], three[2][TIP_Y] - three[1][TIP_Y]];
        if before * after < 0.0 {
            // The slope passes 0 between the middles of both intervals.
            let [from_s, to_s] = [three[1][TIME] - three[0][TIME], three[2][TIME] - three[1][TIME]];
            let (first, second) = (before / from_s, after / to_s);
            let middle_s = three[1][TIME] - 0.5 * from_s;
            extrema.push(middle_s + 0.5 * (from_s + to_s) * first / (first - second));
        }
    }
    let (first, end) = (extrema.first()?, extrema.last()?);
    (end > first).then(|| 0.5 * (extrema.len() - 1) as f64 / (end - first))
}

/// Height of the tip (mm) and its rate (mm/s) between neighbouring instants of a series.
pub fn phase(rows: &[Vec<f64>]) -> Vec<(f64, f64)> {
    let between = |pair: &[Vec<f64>]| {
        let [a, b] = [&pair[0], &pair[1]];
        (0.5 * (a[TIP_Y] + b[TIP_Y]), (b[TIP_Y] - a[TIP_Y]) / (b[TIME] - a[TIME]))
    };
    rows.windows(2).map(between).collect()
}

/// Frequencies (Hz) and amplitudes (mm) of the tip's height about its straight line between the ends, with a Hann window.
pub fn spectrum(rows: &[Vec<f64>]) -> Vec<(f64, f64)> {
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else { return Vec::new() };
    let length_s = last[TIME] - first[TIME];
    let windowed = |k: usize| {
        let t_s = first[TIME] + length_s * k as f64 / SAMPLES as f64;
        let ([a, b], part) = around(rows, |row| row[TIME], t_s);
        let share = k as f64 / SAMPLES as f64;
        let line = first[TIP_Y] + share * (last[TIP_Y] - first[TIP_Y]);
        let window = 1.0 - (std::f64::consts::TAU * share).cos();
        window * (a[TIP_Y] + part * (b[TIP_Y] - a[TIP_Y]) - line)
    };
    let values: Vec<f64> = (0..SAMPLES).map(windowed).collect();
    let line = |n: usize| {
        let turn = std::f64::consts::TAU * n as f64 / SAMPLES as f64;
        let sums = values.iter().enumerate().fold((0.0, 0.0), |(re, im), (k, v)| {
            let (sin, cos) = (turn * k as f64).sin_cos();
            (re + v * cos, im + v * sin)
        });
        (n as f64 / length_s, 2.0 * sums.0.hypot(sums.1) / SAMPLES as f64)
    };
    (1..LINES).map(line).collect()
}
