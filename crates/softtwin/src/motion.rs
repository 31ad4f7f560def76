//! A model along a trace of inputs: the series that the finite elements write of a motion, or the outputs of a model of measurements.

use crate::failure::usage;
use crate::files::refusal;
use anyhow::{Result, bail};
use formats::table::Table;
use formats::trace::SERIES;
use formats::{Diagnostic, FormatError, trace};
use rom::branch::{Follower, VOLUME, pressure_field, volume_input};
use rom::evaluation::Evaluation;
use rom::hull::DomainStatus;
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::{Model, Selection};
use rom::probe::model_tip;
use rom::reconstructor::{BasisOptions, Reconstructor};
use rom::session::{Gaps, Session};
use rom::snapshots::FieldKind;
use std::path::Path;
use std::time::Instant;
use train::measured::MeasuredOutput;

/// Most instants of a trace with those between its rows: some 0.5 GB of answers. An hour at 1 ms has 3.6 million.
const MAX_INSTANTS: u64 = 5_000_000;

/// Inputs over time, straight lines between the rows.
pub struct Trace {
    rows: Vec<(u64, Inputs)>,
    begin_s: f64,
}

impl Trace {
    /// Reads `t_s` and the inputs of a model by their keys; those with a value of the model, and the gap, may be left out. Results in a
    /// series are ignored.
    ///
    /// # Errors
    /// All errors: I/O, missing or unknown columns, times that do not rise.
    pub fn read(path: &Path, model: &Model) -> Result<Self> {
        let wrong = |diagnostics| refusal(FormatError::Content { path: path.into(), diagnostics });
        let table = Table::read(path, true).map_err(refusal)?;
        let read = trace::Trace::of_table(&table, &|_| None).map_err(wrong)?;
        let known = &model.header.inputs;
        let mut diagnostics = Vec::new();
        let mut places = Vec::new();
        for name in &read.names {
            let found = known.iter().position(|input| input.key() == *name);
            if found.is_none() && name != VOLUME && !trace::SERIES_COLUMNS.contains(&name.as_str()) {
                diagnostics.push(Diagnostic::new("header", "inputs of the model", format!("`{name}`")));
            }
            places.push(found);
        }
        let is_open = |at: usize, value: Option<f64>| value.is_none() && at != GAP;
        for (at, input) in model.header.taken_inputs().filter(|(at, input)| is_open(*at, input.value)) {
            if !places.contains(&Some(at)) {
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
            return Err(wrong(diagnostics));
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

    /// Duration, s.
    pub fn length_s(&self) -> f64 {
        1e-9 * self.rows.last().map_or(0, |(t_ns, _)| *t_ns) as f64
    }

    /// Refuses more instants than there can be answers, with the longest gap: it is a wrong unit of time, or a pause that is two recordings.
    fn check(&self, step_ns: u64) -> Result<()> {
        let gaps = || self.rows.windows(2).map(|pair| pair[1].0 - pair[0].0);
        let count = gaps().fold(1_u64, |sum, gap_ns| sum.saturating_add(gap_ns.div_ceil(step_ns)));
        if count <= MAX_INSTANTS {
            return Ok(());
        }
        let (at, gap_ns) = gaps().enumerate().max_by_key(|(_, gap_ns)| *gap_ns).unwrap_or_default();
        Err(usage(format!(
            "--trace: expected at most {MAX_INSTANTS} instants, found {count} with one every {} ms at least; the longest gap, {:.3} s, is between rows {} and {} (is t_s in seconds?); \
             cut the trace there, or give a larger --step-ms",
            1e-6 * step_ns as f64,
            1e-9 * gap_ns as f64,
            at + 1,
            at + 2
        )))
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

/// Positions of one field in the reconstruction, and of the tip in it.
struct Places {
    rows: usize,
    axes: [usize; 3],
    tip: usize,
}

impl Places {
    fn new(model: &Model, rows: usize) -> Result<Self> {
        let field = |axis: u8| {
            let kind = FieldKind::Coordinate(axis);
            let found = model.header.fields.iter().position(|field| field.spec.kind == kind);
            found.ok_or_else(|| usage(format!("--trace: the model has no coordinate along axis {axis}")))
        };
        let no_mesh = || usage("--trace: the model has no undeformed coordinates, which define the tip");
        let tip = model_tip(model).ok_or_else(no_mesh)?;
        Ok(Self { rows, axes: [field(0)?, field(1)?, field(2)?], tip })
    }
}

/// A model along a trace.
pub struct Followed<Row> {
    /// Answers at each instant; NaN where there is none.
    pub rows: Vec<Row>,
    /// Half-widths of displacement, contact force and stress at each instant.
    pub half_widths: Vec<[f64; 3]>,
    /// Instants outside of the training range.
    pub outside: usize,
    /// The first of them, as a sentence.
    pub first_outside: Option<String>,
    /// Instants since whose predecessor the inertial load left its training range.
    pub load_outside: usize,
    /// Restarts at rest because the motion could not be continued.
    pub restarts: usize,
    /// Injected volume at each instant, mm3; empty if it is no input of the model.
    pub volumes_mm3: Vec<f64>,
    /// Times at which the pressure passed a limit and the state left a branch or came back to the first.
    pub snaps: usize,
    /// Time of all states without their fields, s.
    pub state_s: f64,
    /// The model moves with inertia.
    pub moves: bool,
}

/// Follows a trace with at least one row every `step_ns`; `row` makes the answer of an instant.
fn follow<Row>(
    model: &Model,
    trace: &Trace,
    step_ns: u64,
    mut row: impl FnMut(f64, &Inputs, &Evaluation, &Session) -> Result<Row>,
) -> Result<Followed<Row>> {
    trace.check(step_ns)?;
    let mut session = Session::new(model, Gaps::Recorded)?;
    let mut evaluation = session.evaluation();
    let mut followed = Followed {
        rows: Vec::new(),
        half_widths: Vec::new(),
        outside: 0,
        first_outside: None,
        load_outside: 0,
        restarts: 0,
        volumes_mm3: Vec::new(),
        snaps: 0,
        state_s: 0.0,
        moves: session.has_inertia(),
    };
    let (volume, mut has_snapped) = (volume_input(&model.header), false);
    for (t_ns, inputs) in trace.instants(step_ns) {
        let began = Instant::now();
        let stepped = session.step(t_ns, inputs, &mut evaluation)?;
        followed.state_s += began.elapsed().as_secs_f64();
        let t_s = trace.begin_s + 1e-9 * t_ns as f64;
        if let Some(why) = session.evaluator().refusal(&evaluation) {
            bail!("at {t_s} s: {why}");
        }
        followed.load_outside += usize::from(stepped.load_distance > 0.0);
        followed.restarts += usize::from(stepped.at_rest && !followed.rows.is_empty());
        followed.outside += usize::from(evaluation.domain != DomainStatus::Inside);
        if followed.outside == 1 && followed.first_outside.is_none() {
            let why = session.evaluator().outside(&evaluation).unwrap_or_default();
            followed.first_outside = Some(format!("{t_s} s: {why}"));
        }
        followed.volumes_mm3.extend(volume.map(|at| evaluation.inputs.values()[at]));
        followed.snaps += usize::from(evaluation.flags.snapped != has_snapped);
        has_snapped = evaluation.flags.snapped;
        let widths = evaluation.halfwidths;
        followed.half_widths.push([widths.displacement_mm, widths.force_n, widths.stress_mpa]);
        followed.rows.push(row(t_s, &inputs, &evaluation, &session)?);
    }
    Ok(followed)
}

fn reconstructor(model: &Model) -> Result<Reconstructor> {
    let options = BasisOptions::all_modes(BasisOptions::default().precision);
    Ok(Reconstructor::with_options(model, &Selection::default(), options)?)
}

/// Follows a trace with a model of an actuator's shape: values of [`trace::SERIES_COLUMNS`].
///
/// # Errors
/// A model without coordinates or mesh; a regime that the model was not trained in.
pub fn follow_shape(model: &Model, trace: &Trace, step_ns: u64) -> Result<Followed<[f64; SERIES]>> {
    let reconstructor = reconstructor(model)?;
    let places = Places::new(model, reconstructor.rows())?;
    let pressure = pressure_field(&model.header);
    let follows =
        |inputs: &Inputs| volume_input(&model.header).is_some_and(|at| inputs.values()[at].is_nan());
    let mut fields = vec![0.0; reconstructor.entries()];
    follow(model, trace, step_ns, |t_s, inputs, evaluation, _| {
        let peaks = reconstructor.reconstruct_into(evaluation, &mut fields)?;
        let values = |field: usize| &fields[field * places.rows..(field + 1) * places.rows];
        let [x, y, z] = places.axes;
        let tip = |field: usize| f64::from(values(field)[places.tip]);
        let lowest = values(y).iter().copied().fold(f32::INFINITY, f32::min);
        Ok([
            t_s,
            pressure.filter(|_| !follows(inputs)).map_or(inputs.pressure_mpa(), tip),
            inputs.values()[GAP],
            f64::from(lowest),
            tip(x),
            tip(y),
            evaluation.contact_force_n,
            peaks.stress_mpa.map_or(f64::NAN, |peak| f64::from(peak.value)),
            tip(z),
        ])
    })
}

/// Follows a trace with a model of measurements: time, the inputs given, and each output with its half-width. Returns the names of the
/// columns as well.
///
/// # Errors
/// A regime that the model was not trained in.
pub fn follow_measured(
    model: &Model,
    trace: &Trace,
    step_ns: u64,
) -> Result<(Vec<String>, Followed<Vec<f64>>)> {
    let outputs: Vec<MeasuredOutput> = train::measured::outputs(model);
    let taken: Vec<(usize, String)> =
        model.header.taken_inputs().map(|(at, input)| (at, input.key())).collect();
    let named =
        outputs.iter().flat_map(|output| [output.name.clone(), format!("{}_half_width", output.name)]);
    let inputs_named = taken.iter().map(|(_, key)| key.clone());
    let columns = std::iter::once("t_s".to_owned()).chain(inputs_named).chain(named).collect();
    let reconstructor = reconstructor(model)?;
    let nodes = model.header.node_count;
    let mut fields = vec![0.0; reconstructor.entries()];
    let followed = follow(model, trace, step_ns, |t_s, inputs, evaluation, _| {
        reconstructor.reconstruct_into(evaluation, &mut fields)?;
        let value = |output: &MeasuredOutput| f64::from(fields[output.field * nodes + output.node]);
        let mut row = vec![t_s];
        row.extend(taken.iter().map(|(at, _)| inputs.values()[*at]));
        row.extend(outputs.iter().flat_map(|output| [value(output), output.half_width_of(evaluation)]));
        Ok(row)
    })?;
    Ok((columns, followed))
}
