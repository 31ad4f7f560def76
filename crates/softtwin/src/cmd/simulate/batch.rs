//! A list of cases to a database folder, with progress, checkpoints and a report.

use crate::failure::usage;
use crate::files::{not_planned, refusal};
use crate::progress::{Heartbeat, Pace};
use crate::{report, resources};
use fem::Family;
use fem::actuator::Setting;
use fem::cases::{self, Case};
use fem::plan::PlanError;
use fem::run::{self, Event, Outcome};
use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use serde::Serialize;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How a list is solved.
pub struct Options {
    /// Cases at the same time.
    pub threads: usize,
    /// Whether derivatives are kept.
    pub sensitivities: bool,
    /// Quantities of the actuator that the list does not name.
    pub settings: Vec<Setting>,
}

/// Solves what is not yet there, writes the folder and reports. Fails at the end when a case has failed.
pub fn run(family: &Family, list: &Path, out: &Path, options: &Options, as_json: bool) -> anyhow::Result<()> {
    let mut cases = cases::read(list).map_err(refusal)?;
    for case in &mut cases {
        case.settings.extend(options.settings.iter().cloned());
    }
    if options.sensitivities && cases.iter().any(|case| case.volume_mm3.is_some()) {
        return Err(usage(
            "--sensitivities: expected a list with pressure_mpa, found volume_mm3; derivatives are at given pressure",
        ));
    }
    let began = Instant::now();
    let outcome = solve(family, &cases, out, options).map_err(not_planned)?;
    let seconds = began.elapsed().as_secs_f64();
    report::print(&BatchReport::new(family, &cases, &outcome, seconds)?, as_json)?;
    if outcome.failed.is_empty() {
        return Ok(());
    }
    anyhow::bail!(
        "{} of {} cases failed and are not in {}; correct or remove them in {} and run again",
        outcome.failed.len(),
        cases.len(),
        out.display(),
        list.display()
    )
}

/// Solves what is not yet there, under a progress bar, and writes the folder.
pub fn solve(family: &Family, cases: &[Case], out: &Path, options: &Options) -> Result<Outcome, PlanError> {
    let bar = CaseBar::new(cases.len());
    Ok(run::solve_into(out, family, cases, (options.threads, options.sensitivities), &|event| {
        bar.take(&event)
    })?)
}

/// Progress of a list of cases: a bar on a terminal, lines in a log.
pub struct CaseBar {
    bar: ProgressBar,
    pace: Arc<Mutex<Pace>>,
    /// Lines while no case ends; none on a terminal.
    heartbeat: Option<Heartbeat>,
}

impl CaseBar {
    pub fn new(cases: usize) -> Self {
        let bar = ProgressBar::new(cases as u64);
        let pace = Arc::new(Mutex::new(Pace::new(cases)));
        let of_bar = Arc::clone(&pace);
        let rest = move |_: &ProgressState, out: &mut dyn std::fmt::Write| {
            // A bar that cannot be written must not end the work.
            let _ = out.write_str(&held(&of_bar).rest());
        };
        if let Ok(style) =
            ProgressStyle::with_template("{bar:30} {pos}/{len} cases, {elapsed} elapsed{rest}  {msg}")
        {
            bar.set_style(style.with_key("rest", rest));
        }
        bar.enable_steady_tick(TICK);
        let of_lines = Arc::clone(&pace);
        let wants_lines = !std::io::stderr().is_terminal();
        let heartbeat = wants_lines.then(|| Heartbeat::new(move || Some(held(&of_lines).line())));
        Self { bar, pace, heartbeat }
    }

    /// Shows an event.
    pub fn take(&self, event: &Event<'_>) {
        show(&self.bar, event);
        let mut pace = held(&self.pace);
        if let (true, Some(line)) = (self.heartbeat.is_some(), pace.take(event)) {
            // Progress that cannot be written must not end the work.
            let _ = writeln!(std::io::stderr(), "{line}");
        }
    }
}

impl Drop for CaseBar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

fn show(bar: &ProgressBar, event: &Event<'_>) {
    match event {
        Event::Started(_) => {}
        Event::Reused(_) => bar.inc(1),
        Event::Solved(case, solved) => {
            bar.inc(1);
            let (factorisations, seconds) = (solved.report.factorisations, solved.report.seconds);
            bar.set_message(format!("{} in {factorisations} factorisations", case.name));
            tracing::info!("case {} solved in {factorisations} factorisations, {seconds:.1} s", case.name);
        }
        Event::Failed { case, reason, again } => {
            let next = if *again { "will be tried from another state" } else { "given up" };
            let line = format!("case {}: {reason} ({next})", case.name);
            if bar.is_hidden() { tracing::warn!("{line}") } else { bar.println(line) }
        }
    }
}

/// Time between two changes of the bar.
const TICK: Duration = Duration::from_secs(1);
fn held(pace: &Mutex<Pace>) -> MutexGuard<'_, Pace> {
    pace.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A run of a list of cases.
#[derive(Serialize)]
struct BatchReport {
    cases: usize,
    solved: usize,
    reused: usize,
    failed: Vec<FailedCase>,
    steps: usize,
    factorisations: usize,
    cuts: usize,
    median_factorisations_contact: Option<usize>,
    seconds: f64,
    solver_seconds: f64,
    cpu_seconds: Option<f64>,
    peak_memory_mb: Option<u64>,
    largest_stretch: f64,
    /// Cases with more than 1 % of the elastomer beyond the range of its law.
    beyond_law: Vec<String>,
    /// Largest force out of balance at a node, relative and in N.
    largest_residual: f64,
    largest_residual_n: f64,
}

#[derive(Serialize)]
struct FailedCase {
    case: String,
    reason: String,
}

impl BatchReport {
    fn new(family: &Family, cases: &[Case], outcome: &Outcome, seconds: f64) -> anyhow::Result<Self> {
        let (mut largest_stretch, mut beyond_law) = (1.0_f64, Vec::new());
        for (index, solved) in &outcome.solved {
            let case = &cases[*index];
            let problem = family.problem_of(&family.variant(&case.settings)?)?;
            let stretches = problem.stretches(&solved.state);
            largest_stretch = largest_stretch.max(stretches.largest);
            if stretches.is_beyond() {
                beyond_law.push(case.name.clone());
            }
        }
        let reports = || outcome.solved.iter().map(|(_, solved)| &solved.report);
        let contact = outcome.solved.iter().filter(|(index, _)| cases[*index].gap_mm.is_some());
        let mut contact: Vec<usize> = contact.map(|(_, solved)| solved.report.factorisations).collect();
        contact.sort_unstable();
        let failed = |(index, reason): &(usize, String)| FailedCase {
            case: cases[*index].name.clone(),
            reason: reason.clone(),
        };
        Ok(Self {
            cases: cases.len(),
            solved: outcome.solved.len() - outcome.reused,
            reused: outcome.reused,
            failed: outcome.failed.iter().map(failed).collect(),
            steps: reports().map(|report| report.steps).sum(),
            factorisations: reports().map(|report| report.factorisations).sum(),
            cuts: reports().map(|report| report.cuts).sum(),
            median_factorisations_contact: contact.get(contact.len() / 2).copied(),
            seconds,
            solver_seconds: reports().map(|report| report.seconds).sum(),
            cpu_seconds: resources::cpu_s("self"),
            peak_memory_mb: resources::status("self", "VmHWM").map(|kb| kb * 1024 / 1_000_000),
            largest_stretch,
            beyond_law,
            largest_residual: reports().map(|report| report.residual).fold(0.0, f64::max),
            largest_residual_n: reports().map(|report| report.residual_n).fold(0.0, f64::max),
        })
    }
}
