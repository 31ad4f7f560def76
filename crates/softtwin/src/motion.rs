//! A model along a trace of inputs: the series that the finite elements write of a motion.

use crate::failure::usage;
use crate::files::refusal;
use anyhow::Result;
use fem::transient::SERIES_COLUMNS;
use formats::table::Table;
use formats::{Diagnostic, FormatError};
use rom::evaluator::Evaluator;
use rom::hull::DomainStatus;
use rom::inertia::model_motion::ModelMotion;
use rom::inputs::{GAP, Inputs};
use rom::model::{Model, Selection};
use rom::probe::model_tip;
use rom::reconstructor::{BasisOptions, Reconstructor};
use rom::snapshots::FieldKind;
use std::path::Path;
use std::time::Instant;

/// Inputs over time, straight lines between the rows.
pub struct Trace {
    rows: Vec<(u64, Inputs)>,
    begin_s: f64,
}

impl Trace {
    /// Reads `t_s, pressure_mpa` and, if given, `gap_mm` and other inputs of the model. Results in a series are ignored.
    ///
    /// # Errors
    /// All errors: I/O, missing or unknown columns, times that do not rise.
    pub fn read(path: &Path, model: &Model) -> Result<Self> {
        let wrong = |diagnostics| refusal(FormatError::Content { path: path.into(), diagnostics });
        let table = Table::read(path, true).map_err(refusal)?;
        let [time, pressure] = table.columns(["t_s", "pressure_mpa"]).map_err(wrong)?;
        let gap = table.column("gap_mm").ok();
        let mut diagnostics = Vec::new();
        let mut others = Vec::new();
        for (column, name) in
            table.header().iter().enumerate().filter(|(_, name)| !SERIES_COLUMNS.contains(&name.as_str()))
        {
            match model.header.inputs.iter().position(|input| input.key() == *name) {
                Some(input) => others.push((column, input)),
                None => {
                    diagnostics.push(Diagnostic::new("header", "inputs of the model", format!("`{name}`")))
                }
            }
        }
        let (mut rows, mut begin_s): (Vec<(u64, Inputs)>, _) = (Vec::new(), f64::NAN);
        for row in table.rows() {
            let mut number = |column: usize| match row.number(column) {
                Ok(value) => Some(value),
                Err(diagnostic) => {
                    diagnostics.push(diagnostic);
                    None
                }
            };
            let (Some(t_s), Some(pressure_mpa)) = (number(time), number(pressure)) else { continue };
            let gap_mm =
                gap.filter(|gap| !row.text(*gap).is_empty()).map_or(Some(f64::INFINITY), &mut number);
            let mut inputs = Inputs::new(pressure_mpa, gap_mm.unwrap_or(f64::INFINITY));
            for (column, input) in &others {
                inputs = inputs.with(*input, number(*column).unwrap_or(f64::NAN));
            }
            if rows.is_empty() {
                begin_s = t_s;
            }
            let ns = ((t_s - begin_s) * 1e9).round();
            if rows.last().is_some_and(|(last, _)| ns <= *last as f64) || ns > 1e18 {
                diagnostics.push(row.diagnostic(time, "a time later than that of the row before, in s"));
                continue;
            }
            rows.push((ns as u64, inputs));
        }
        if rows.len() < 2 && diagnostics.is_empty() {
            diagnostics.push(Diagnostic::new("rows", "at least two instants", rows.len()));
        }
        if diagnostics.is_empty() { Ok(Self { rows, begin_s }) } else { Err(wrong(diagnostics)) }
    }

    /// Duration, s.
    pub fn length_s(&self) -> f64 {
        1e-9 * self.rows.last().map_or(0, |(t_ns, _)| *t_ns) as f64
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

/// Evaluation at each instant: a model without memory follows its inputs at once.
enum Follower {
    Static(Box<Evaluator>),
    Moving(Box<ModelMotion>),
}

/// Positions of one field in the reconstruction, and of the tip in it.
struct Places {
    rows: usize,
    x: usize,
    y: usize,
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
        Ok(Self { rows, x: field(0)?, y: field(1)?, tip })
    }
}

/// A model along a trace.
#[derive(Default)]
pub struct Followed {
    /// Values of [`SERIES_COLUMNS`] at each instant; NaN where there is none.
    pub rows: Vec<[f64; 8]>,
    /// Instants outside of the training range.
    pub outside: usize,
    /// Instants since whose predecessor the inertial load left its training range.
    pub load_outside: usize,
    /// Restarts at rest because the motion could not be continued.
    pub restarts: usize,
    /// Time of all states without their fields, s.
    pub state_s: f64,
    /// The model moves with inertia.
    pub moves: bool,
}

/// Follows a trace, with at least one row every `step_ns`.
///
/// # Errors
/// A model without coordinates or mesh; a regime that the model was not trained in.
pub fn follow(model: &Model, trace: &Trace, step_ns: u64) -> Result<Followed> {
    let options = BasisOptions::all_modes(BasisOptions::default().precision);
    let reconstructor = Reconstructor::with_options(model, &Selection::default(), options)?;
    let places = Places::new(model, reconstructor.rows())?;
    let mut follower = match ModelMotion::new(model)? {
        Some(motion) => Follower::Moving(Box::new(motion.as_recording())),
        None => Follower::Static(Box::new(Evaluator::new(&model.header)?)),
    };
    let mut evaluation = Evaluator::new(&model.header)?.evaluation();
    let mut fields = vec![0.0; reconstructor.entries()];
    let mut followed = Followed { moves: matches!(follower, Follower::Moving(_)), ..Followed::default() };
    for (t_ns, inputs) in trace.instants(step_ns) {
        let began = Instant::now();
        match &mut follower {
            Follower::Static(evaluator) => evaluator.evaluate(inputs, &mut evaluation),
            Follower::Moving(motion) => {
                let moved = motion.advance(t_ns, inputs, &mut evaluation)?;
                followed.load_outside += usize::from(moved.load_distance > 0.0);
                followed.restarts += usize::from(moved.at_rest && !followed.rows.is_empty());
            }
        }
        followed.state_s += began.elapsed().as_secs_f64();
        followed.outside += usize::from(evaluation.domain != DomainStatus::Inside);
        let peaks = reconstructor.reconstruct_into(&evaluation, &mut fields)?;
        let values = |field: usize| &fields[field * places.rows..(field + 1) * places.rows];
        let lowest = values(places.y).iter().copied().fold(f32::INFINITY, f32::min);
        followed.rows.push([
            trace.begin_s + 1e-9 * t_ns as f64,
            inputs.pressure_mpa(),
            inputs.values()[GAP],
            f64::from(lowest),
            f64::from(values(places.x)[places.tip]),
            f64::from(values(places.y)[places.tip]),
            evaluation.contact_force_n,
            peaks.stress_mpa.map_or(f64::NAN, |peak| f64::from(peak.value)),
        ]);
    }
    Ok(followed)
}
