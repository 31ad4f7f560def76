//! Motion along a trace of inputs: `series.csv`, `energy.csv` and fields of chosen instants.

use crate::failure::{configuration, usage};
use crate::files::refusal;
use crate::{report, resources};
use anyhow::Context;
use fem::actuator::{Actuator, Setting};
use fem::transient::{
    Checkpoint, Energy, Record, StepSettings, Trace, Transient, TransientError, energy_csv, run_mark,
    series_csv,
};
use fem::{Family, Problem, Solver};
use formats::export::Label;
use formats::file;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Records between two checkpoints.
const CHECKPOINT_EVERY: usize = 25;

/// Most instants of a motion: days of computing, and what memory and the written series hold.
const MAX_INSTANTS: f64 = 1e6;

pub struct Options {
    /// The inputs.
    pub trace: PathBuf,
    /// Folder of the results.
    pub out: PathBuf,
    /// Step control.
    pub steps: StepSettings,
    /// Instants (s) whose fields are written.
    pub fields_s: Vec<f64>,
    /// Quantities of the actuator with other values than its file's.
    pub settings: Vec<Setting>,
}

/// Moves the actuator along the trace, or continues an interrupted run, and reports.
pub fn run(family: &Family, options: Options, as_json: bool) -> anyhow::Result<()> {
    let began = Instant::now();
    let trace = Trace::read(&options.trace, &family.actuator).map_err(refusal)?;
    let settings = [options.settings.clone(), trace.settings.clone()].concat();
    let variant = family.variant(&settings).map_err(configuration)?;
    let actuator = family.actuator_of(&variant).map_err(configuration)?;
    let problem = family.problem_of(&variant).map_err(configuration)?;
    let [first_s, last_s] = trace.ends_s();
    if let Some(bad) = options.fields_s.iter().find(|t| !(first_s..=last_s).contains(*t)) {
        return Err(usage(format!(
            "--fields-s {bad}: expected an instant of the trace, {first_s} to {last_s} s"
        )));
    }
    for (begin_s, length_s) in trace.long_intervals() {
        tracing::warn!(
            "no row of the trace for {length_s} s after t = {begin_s} s: inputs are interpolated linearly"
        );
    }
    let least = (last_s - first_s) / options.steps.largest_s;
    if least > MAX_INSTANTS {
        let longest = trace.long_intervals().into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        let longest = longest.map_or(String::new(), |(begin_s, length_s)| {
            format!("; the longest gap, {length_s} s, begins at t = {begin_s} s (is t_s in seconds?)")
        });
        return Err(usage(format!(
            "--trace: expected at most {MAX_INSTANTS:e} instants, found {least:.0} with one every {} s at least{longest}; cut the trace, or \
             give a larger --step-ms",
            options.steps.largest_s
        )));
    }
    let instants = trace.instants(&options.fields_s, options.steps.largest_s);
    file::create_folder(&options.out)?;
    let mark = run_mark(&problem, &actuator.dynamics, &options.steps, &trace, &instants);
    let mut run = Run { actuator, problem, trace, instants, options, mark };
    let (mut motion, mut records, frequency_hz) = run.start()?;
    let reused = records.len();
    let outcome = run.continue_to_end(&mut motion, &mut records);
    run.save(&mut motion, &records)?;
    outcome?;
    let report = MotionReport {
        lowest_frequency_hz: frequency_hz,
        seconds: began.elapsed().as_secs_f64(),
        ..MotionReport::new(&run, &motion, &records, reused)
    };
    report::print(&report, as_json)
}

struct Run {
    actuator: Actuator,
    problem: Arc<Problem>,
    trace: Trace,
    instants: Vec<f64>,
    options: Options,
    mark: [u8; 32],
}

impl Run {
    fn checkpoint(&self) -> PathBuf {
        self.options.out.join("checkpoint.state")
    }

    /// Motion at the last record of a checkpoint, or at rest in the equilibrium of the first row; and the lowest frequency there.
    fn start(&mut self) -> anyhow::Result<(Transient, Vec<Record>, Option<f64>)> {
        let mut solver = Solver::new(Arc::clone(&self.problem))?;
        let first = self.trace.load(&self.actuator, self.instants[0]);
        let (problem, steps) = (Arc::clone(&self.problem), self.options.steps);
        let checked = |state| {
            Transient::from_equilibrium(problem, &self.actuator.dynamics, steps, self.instants[0], state)
                .map_err(sorted)
        };
        if let Some(checkpoint) = Checkpoint::load(&self.checkpoint(), &self.mark) {
            let mut motion = checked(solver.undeformed())?;
            let load_at = |t_s| self.trace.load(&self.actuator, t_s);
            if motion.restore(&checkpoint.motion, &load_at) {
                return Ok((motion, checkpoint.records, None));
            }
            anyhow::bail!("{} is damaged; remove it", self.checkpoint().display());
        }
        if self.checkpoint().exists() {
            tracing::warn!("{} is of another run; starting again", self.checkpoint().display());
        }
        let (rest, _) = solver.gravity_equilibrium(first.gravity_mm_s2).context("the start of the motion")?;
        let (state, _) = solver.solve_to(&rest, &first).context("the start of the motion")?;
        let mut motion = checked(state)?;
        let frequency_hz = motion.check_resolution().map_err(sorted)?;
        self.fields(&mut motion)?;
        let record = Record::new(&self.trace.at(self.instants[0]), motion.figures()?);
        Ok((motion, vec![record], frequency_hz))
    }

    fn continue_to_end(&self, motion: &mut Transient, records: &mut Vec<Record>) -> anyhow::Result<()> {
        let bar = ProgressBar::new(self.instants.len() as u64);
        bar.set_style(ProgressStyle::with_template(
            "{bar:30} {pos}/{len} instants, {elapsed} elapsed, about {eta} left  {msg}",
        )?);
        bar.set_position(records.len() as u64);
        bar.reset_eta();
        let lines = !std::io::stderr().is_terminal();
        let load_at = |t_s| self.trace.load(&self.actuator, t_s);
        while let Some(instant) = self.instants.get(records.len()) {
            motion.advance(&load_at, *instant)?;
            records.push(Record::new(&self.trace.at(*instant), motion.figures()?));
            self.fields(motion)?;
            bar.inc(1);
            bar.set_message(format!("t = {instant:.4} s"));
            let done = records.len();
            if done.is_multiple_of(CHECKPOINT_EVERY) {
                self.save(motion, records)?;
            }
            if lines && done.is_multiple_of(self.instants.len().div_ceil(10)) {
                let work = motion.work();
                tracing::info!(
                    "t = {instant:.4} s, {done} of {} instants, {} steps, {} factorisations",
                    self.instants.len(),
                    work.steps,
                    work.factorisations
                );
            }
        }
        bar.finish_and_clear();
        Ok(())
    }

    /// Writes series, energies and checkpoint of the records so far.
    fn save(&self, motion: &mut Transient, records: &[Record]) -> anyhow::Result<()> {
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
    fn fields(&self, motion: &mut Transient) -> anyhow::Result<()> {
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
        super::single::write(&self.problem, &output, &label, &folder.join(format!("{t_s:.6}.vtu")))
    }
}

/// Density, step lengths and frequency are the user's mistakes; a motion that cannot be solved is not.
fn sorted(error: TransientError) -> anyhow::Error {
    match error {
        TransientError::Density(_) | TransientError::Setting { .. } | TransientError::Unresolved { .. } => {
            configuration(error)
        }
        _ => error.into(),
    }
}

/// A motion along a trace.
#[derive(Serialize)]
struct MotionReport {
    series: PathBuf,
    instants: usize,
    reused: usize,
    steps: usize,
    steps_rejected: usize,
    steps_beyond_tolerance: usize,
    iterations: usize,
    factorisations: usize,
    lowest_frequency_hz: Option<f64>,
    long_intervals: Vec<LongInterval>,
    /// Largest work of the loads, and largest energy that the time integration dissipated.
    largest_external_mj: f64,
    largest_numerical_mj: f64,
    seconds: f64,
    peak_memory_mb: Option<u64>,
}

/// Time without a row of the trace.
#[derive(Serialize)]
struct LongInterval {
    t_s: f64,
    length_s: f64,
}

impl MotionReport {
    fn new(run: &Run, motion: &Transient, records: &[Record], reused: usize) -> Self {
        let energy = records.iter().map(|record| record.figures.energy);
        let largest =
            |part: fn(&Energy) -> f64| energy.clone().map(|energy| part(&energy).abs()).fold(0.0, f64::max);
        let work = motion.work();
        let intervals = run.trace.long_intervals().into_iter();
        Self {
            series: run.options.out.join("series.csv"),
            instants: records.len(),
            reused,
            steps: work.steps,
            steps_rejected: work.rejected,
            steps_beyond_tolerance: work.beyond_tolerance,
            iterations: work.iterations,
            factorisations: work.factorisations,
            lowest_frequency_hz: None,
            long_intervals: intervals.map(|(t_s, length_s)| LongInterval { t_s, length_s }).collect(),
            largest_external_mj: largest(|energy| energy.external_mj),
            largest_numerical_mj: largest(Energy::numerical_mj),
            seconds: 0.0,
            peak_memory_mb: resources::status("self", "VmHWM").map(|kb| kb * 1024 / 1_000_000),
        }
    }
}
