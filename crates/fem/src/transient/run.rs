//! A motion along a trace into a folder: `series.csv`, `energy.csv`, fields of chosen instants, and a checkpoint from which an interrupted run
//! continues.

use super::motion::{Energy, StepSettings, Work};
use super::record::{Checkpoint, Record, energy_csv, run_mark, series_csv};
use super::trace::Trace;
use super::{Transient, TransientError};
use crate::actuator::{Actuator, Setting};
use crate::family::{Family, VariantError};
use crate::linear::LinearError;
use crate::problem::Problem;
use crate::solver::{SolveError, Solver};
use formats::export::Label;
use formats::{FormatError, file};
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;
use thiserror::Error;

/// Records between two checkpoints.
const CHECKPOINT_EVERY: usize = 25;
/// Most instants of a motion: days of computing, and what memory and the written series hold.
const MAX_INSTANTS: f64 = 1e6;

/// Options of a motion.
pub struct MotionOptions {
    /// Folder of the results.
    pub out: PathBuf,
    /// Step control.
    pub steps: StepSettings,
    /// Instants (s) whose fields are written.
    pub fields_s: Vec<f64>,
    /// Quantities of the actuator with other values than its file's.
    pub settings: Vec<Setting>,
}

/// Why a motion could not be computed.
#[derive(Debug, Error)]
#[allow(missing_docs)] // the messages say what the values are
pub enum MotionError {
    #[error("expected an instant of the trace, {first_s} to {last_s} s, found {found_s} s")]
    Outside { found_s: f64, first_s: f64, last_s: f64 },
    /// A wrong unit of time, or a pause.
    #[error(
        "expected at most {MAX_INSTANTS:e} instants, found {count:.0} with one every {step_s} s at least{longest}; cut the trace, or take longer steps"
    )]
    TooLong { count: f64, step_s: f64, longest: String },
    #[error(transparent)]
    Variant(#[from] VariantError),
    #[error("the start of the motion: {0}")]
    Start(#[from] SolveError),
    #[error(transparent)]
    Memory(#[from] LinearError),
    #[error(transparent)]
    Motion(#[from] TransientError),
    #[error("{} is damaged; remove it", .0.display())]
    Damaged(PathBuf),
    #[error(transparent)]
    File(#[from] FormatError),
}

/// What happens during a motion.
#[allow(missing_docs)] // the names say what the values are
pub enum MotionEvent {
    /// The folder has the checkpoint of another run, which is replaced.
    OtherRun(PathBuf),
    /// So many of all instants are computed, the last one at `t_s`.
    Advanced { done: usize, instants: usize, t_s: f64, work: Work },
}

/// A motion along a trace.
#[derive(Debug, Serialize)]
#[allow(missing_docs)] // the names say what the values are
pub struct MotionSummary {
    pub series: PathBuf,
    pub instants: usize,
    /// Instants of an interrupted run.
    pub reused: usize,
    pub steps: usize,
    pub steps_rejected: usize,
    pub steps_beyond_tolerance: usize,
    pub iterations: usize,
    pub factorisations: usize,
    /// At the start; `None` for a motion that was continued.
    pub lowest_frequency_hz: Option<f64>,
    pub long_intervals: Vec<LongInterval>,
    /// Largest work of the loads, and largest energy that the time integration dissipated.
    pub largest_external_mj: f64,
    pub largest_numerical_mj: f64,
}

/// Time without a row of the trace.
#[derive(Debug, Serialize)]
#[allow(missing_docs)]
pub struct LongInterval {
    pub t_s: f64,
    pub length_s: f64,
}

/// Moves the actuator along the trace, or continues an interrupted run.
///
/// # Errors
/// [`MotionError`]; what was computed until then is in the folder.
pub fn run_motion(
    family: &Family,
    trace: Trace,
    options: MotionOptions,
    notify: &mut dyn FnMut(MotionEvent),
) -> Result<MotionSummary, MotionError> {
    let settings = [options.settings.clone(), trace.settings.clone()].concat();
    let variant = family.variant(&settings)?;
    let (actuator, problem) = (family.actuator_of(&variant)?, family.problem_of(&variant)?);
    let [first_s, last_s] = trace.ends_s();
    if let Some(found_s) = options.fields_s.iter().copied().find(|t| !(first_s..=last_s).contains(t)) {
        return Err(MotionError::Outside { found_s, first_s, last_s });
    }
    let step_s = options.steps.largest_s;
    let count = (last_s - first_s) / step_s;
    if count > MAX_INSTANTS {
        let longest = trace.long_intervals().into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        let longest = longest.map_or(String::new(), |(begin_s, length_s)| {
            format!("; the longest gap, {length_s} s, begins at t = {begin_s} s (is t_s in seconds?)")
        });
        return Err(MotionError::TooLong { count, step_s, longest });
    }
    let instants = trace.instants(&options.fields_s, step_s);
    file::create_folder(&options.out)?;
    let mark = run_mark(&problem, &actuator.dynamics, &options.steps, &trace, &instants);
    let run = Run { actuator, problem, trace, instants, options, mark };
    let (mut motion, mut records, lowest_frequency_hz) = run.start(notify)?;
    let reused = records.len();
    let outcome = run.continue_to_end(&mut motion, &mut records, notify);
    run.save(&mut motion, &records)?;
    outcome?;
    Ok(run.summary(&motion, &records, reused, lowest_frequency_hz))
}

struct Run {
    actuator: Actuator,
    problem: Arc<Problem>,
    trace: Trace,
    instants: Vec<f64>,
    options: MotionOptions,
    mark: [u8; 32],
}

impl Run {
    fn checkpoint(&self) -> PathBuf {
        self.options.out.join("checkpoint.state")
    }

    /// Motion at the last record of a checkpoint, or at rest in the equilibrium of the first row; and the lowest frequency there.
    fn start(
        &self,
        notify: &mut dyn FnMut(MotionEvent),
    ) -> Result<(Transient, Vec<Record>, Option<f64>), MotionError> {
        let mut solver = Solver::new(Arc::clone(&self.problem))?;
        let first = self.trace.load(&self.actuator, self.instants[0]);
        let (problem, steps) = (Arc::clone(&self.problem), self.options.steps);
        let checked = |state| {
            Transient::from_equilibrium(problem, &self.actuator.dynamics, steps, self.instants[0], state)
        };
        if let Some(checkpoint) = Checkpoint::load(&self.checkpoint(), &self.mark) {
            let mut motion = checked(solver.undeformed())?;
            let load_at = |t_s| self.trace.load(&self.actuator, t_s);
            if motion.restore(&checkpoint.motion, &load_at) {
                return Ok((motion, checkpoint.records, None));
            }
            return Err(MotionError::Damaged(self.checkpoint()));
        }
        if self.checkpoint().exists() {
            notify(MotionEvent::OtherRun(self.checkpoint()));
        }
        let (rest, _) = solver.gravity_equilibrium(first.gravity_mm_s2)?;
        let (state, _) = solver.solve_to(&rest, &first)?;
        let mut motion = checked(state)?;
        let frequency_hz = motion.check_resolution()?;
        self.fields(&mut motion)?;
        let record = Record::new(&self.trace.at(self.instants[0]), motion.figures()?);
        Ok((motion, vec![record], frequency_hz))
    }

    fn continue_to_end(
        &self,
        motion: &mut Transient,
        records: &mut Vec<Record>,
        notify: &mut dyn FnMut(MotionEvent),
    ) -> Result<(), MotionError> {
        let load_at = |t_s| self.trace.load(&self.actuator, t_s);
        while let Some(instant) = self.instants.get(records.len()) {
            motion.advance(&load_at, *instant)?;
            records.push(Record::new(&self.trace.at(*instant), motion.figures()?));
            self.fields(motion)?;
            let (done, instants, work) = (records.len(), self.instants.len(), motion.work());
            notify(MotionEvent::Advanced { done, instants, t_s: *instant, work });
            if done.is_multiple_of(CHECKPOINT_EVERY) {
                self.save(motion, records)?;
            }
        }
        Ok(())
    }

    /// Writes series, energies and checkpoint of the records so far.
    fn save(&self, motion: &mut Transient, records: &[Record]) -> Result<(), FormatError> {
        let out = &self.options.out;
        file::replace(&out.join("series.csv"), series_csv(records, &self.trace).as_bytes())?;
        file::replace(&out.join("energy.csv"), energy_csv(records).as_bytes())?;
        // After an error the motion may be between two records, from which no series continues.
        if records.last().is_some_and(|last| last.t_s.total_cmp(&motion.t_s()).is_eq()) {
            let checkpoint = Checkpoint { records: records.to_vec(), motion: motion.checkpoint() };
            checkpoint.save(&self.checkpoint(), &self.mark)?;
        }
        Ok(())
    }

    /// Writes the fields of the present instant if it is one of those chosen.
    fn fields(&self, motion: &mut Transient) -> Result<(), FormatError> {
        let t_s = motion.t_s();
        if !self.options.fields_s.iter().any(|chosen| (chosen - t_s).abs() < 1.0e-6) {
            return Ok(());
        }
        let inputs = self.trace.at(t_s);
        let output = motion.output();
        let time = [("t_s".to_owned(), t_s)];
        let label = Label::of_state(inputs.pressure_mpa, inputs.gap_mm, time, output.contact_force_n);
        let folder = self.options.out.join("fields");
        file::create_folder(&folder)?;
        output.write(&self.problem, label, &folder.join(format!("{t_s:.6}.vtu")))
    }

    fn summary(
        &self,
        motion: &Transient,
        records: &[Record],
        reused: usize,
        lowest_frequency_hz: Option<f64>,
    ) -> MotionSummary {
        let energy = records.iter().map(|record| record.figures.energy);
        let largest =
            |part: fn(&Energy) -> f64| energy.clone().map(|energy| part(&energy).abs()).fold(0.0, f64::max);
        let work = motion.work();
        let intervals = self.trace.long_intervals().into_iter();
        MotionSummary {
            series: self.options.out.join("series.csv"),
            instants: records.len(),
            reused,
            steps: work.steps,
            steps_rejected: work.rejected,
            steps_beyond_tolerance: work.beyond_tolerance,
            iterations: work.iterations,
            factorisations: work.factorisations,
            lowest_frequency_hz,
            long_intervals: intervals.map(|(t_s, length_s)| LongInterval { t_s, length_s }).collect(),
            largest_external_mj: largest(|energy| energy.external_mj),
            largest_numerical_mj: largest(Energy::numerical_mj),
        }
    }
}
