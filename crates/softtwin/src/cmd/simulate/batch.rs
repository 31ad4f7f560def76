//! A list of cases to a database folder, with progress, checkpoints and a report.

use crate::failure::usage;
use crate::files::{not_planned, refusal};
use crate::progress::Heartbeat;
use crate::{output, resources};
use fem::Family;
use fem::actuator::Setting;
use fem::cases::{self, Case};
use fem::plan::PlanError;
use fem::run::{self, Event, Outcome, Run, Store, fingerprint};
use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use serde_json::{Value, json};
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
    let report = report(&cases, &outcome, &Reached::of(family, &cases, &outcome)?, seconds);
    if as_json {
        output::json(&report)?;
    } else {
        print(&report, &cases, &outcome, out)?;
    }
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
    let store = Store::new(&out.join("states"), fingerprint(&family.problem))?;
    // A log gets lines instead of a bar.
    let bar = ProgressBar::new(cases.len() as u64);
    let pace = Arc::new(Mutex::new(Pace::new(cases.len())));
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
    let wants_lines = !std::io::stderr().is_terminal();
    let of_lines = Arc::clone(&pace);
    let _heartbeat = wants_lines.then(|| Heartbeat::new(move || Some(held(&of_lines).line())));
    let run = Run {
        family,
        store,
        threads: options.threads,
        sensitivities: options.sensitivities,
        searches_behind_limits: true,
    };
    let outcome = run.solve(cases, &|event| {
        show(&bar, &event);
        let mut pace = held(&pace);
        if let (true, Some(line)) = (wants_lines, pace.take(&event)) {
            // Progress that cannot be written must not end the work.
            let _ = writeln!(std::io::stderr(), "{line}");
        }
    });
    let outcome = outcome?;
    bar.finish_and_clear();
    let derivatives = |case: &Case| run.derivatives(case);
    let derivatives: Option<&dyn Fn(&Case) -> _> =
        if options.sensitivities { Some(&derivatives) } else { None };
    run::write(out, family, cases, &outcome.solved, derivatives)?;
    Ok(outcome)
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
/// Mean times per case after which a case that is still in work withdraws the estimate of the time left.
const OVERDUE: f64 = 2.0;

fn held(pace: &Mutex<Pace>) -> MutexGuard<'_, Pace> {
    pace.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Progress of a list.
struct Pace {
    cases: usize,
    began: Instant,
    /// Last time a case ended.
    last: Instant,
    reused: usize,
    ended: usize,
    /// Cases in work.
    running: Vec<String>,
}

impl Pace {
    fn new(cases: usize) -> Self {
        let now = Instant::now();
        Self { cases, began: now, last: now, reused: 0, ended: 0, running: Vec::new() }
    }

    /// Takes an event; a line for about every tenth of the work.
    fn take(&mut self, event: &Event<'_>) -> Option<String> {
        let case = match event {
            Event::Reused(_) => {
                self.reused += 1;
                return None;
            }
            Event::Started(case) => {
                self.running.push(case.name.clone());
                return None;
            }
            Event::Solved(case, _) | Event::Failed { case, .. } => case,
        };
        self.running.retain(|name| *name != case.name);
        if matches!(event, Event::Failed { again: true, .. }) {
            return None;
        }
        self.last = Instant::now();
        self.ended += 1;
        let is_tenth = self.ended.is_multiple_of(self.cases.div_ceil(10)) || self.left() == 0;
        is_tenth.then(|| self.line())
    }

    fn left(&self) -> usize {
        self.cases.saturating_sub(self.reused + self.ended)
    }

    fn line(&self) -> String {
        let running = if self.running.is_empty() {
            String::new()
        } else {
            format!(", in work: {}", self.running.join(", "))
        };
        format!("{} of {} cases{}{running}", self.reused + self.ended, self.cases, self.rest())
    }

    /// Estimate of the remaining time; withdrawn while the present case takes much longer than the mean.
    fn rest(&self) -> String {
        let mean_s = (self.last - self.began).as_secs_f64() / self.ended.max(1) as f64;
        let since_s = self.last.elapsed().as_secs_f64();
        if self.ended == 0 || since_s > OVERDUE * mean_s.max(1.0) {
            return format!(", none ended for {since_s:.0} s");
        }
        format!(", about {:.0} s left", (mean_s * self.left() as f64 - since_s).max(0.0))
    }
}

/// Stretches of all states.
struct Reached {
    largest: f64,
    /// Cases with a part of the elastomer beyond the range of its law.
    beyond: Vec<String>,
}

impl Reached {
    fn of(family: &Family, cases: &[Case], outcome: &Outcome) -> anyhow::Result<Self> {
        let mut this = Self { largest: 1.0, beyond: Vec::new() };
        for (index, solved) in &outcome.solved {
            let case = &cases[*index];
            let problem = family.problem_of(&family.variant(&case.settings)?)?;
            let stretches = problem.stretches(&solved.state);
            this.largest = this.largest.max(stretches.largest);
            if stretches.is_beyond() {
                this.beyond.push(case.name.clone());
            }
        }
        Ok(this)
    }
}

fn report(cases: &[Case], outcome: &Outcome, stretches: &Reached, seconds: f64) -> Value {
    let mut contact: Vec<usize> = outcome
        .solved
        .iter()
        .filter(|(index, _)| cases[*index].gap_mm.is_some())
        .map(|(_, solved)| solved.report.factorisations)
        .collect();
    contact.sort_unstable();
    let sum = |f: fn(&fem::Report) -> usize| outcome.solved.iter().map(|(_, s)| f(&s.report)).sum::<usize>();
    json!({
        "cases": cases.len(),
        "solved": outcome.solved.len() - outcome.reused,
        "reused": outcome.reused,
        "failed": outcome.failed.iter().map(|(i, reason)| json!({"case": cases[*i].name, "reason": reason})).collect::<Vec<_>>(),
        "steps": sum(|r| r.steps),
        "factorisations": sum(|r| r.factorisations),
        "cuts": sum(|r| r.cuts),
        "median_factorisations_contact": contact.get(contact.len() / 2),
        "seconds": seconds,
        "solver_seconds": outcome.solved.iter().map(|(_, s)| s.report.seconds).sum::<f64>(),
        "cpu_seconds": resources::cpu_s("self"),
        "peak_memory_mb": resources::status("self", "VmHWM").map(|kb| kb * 1024 / 1_000_000),
        "largest_stretch": stretches.largest,
        "beyond_law": stretches.beyond,
        "largest_residual": outcome.solved.iter().map(|(_, s)| s.report.residual).fold(0.0, f64::max),
        "largest_residual_n": outcome.solved.iter().map(|(_, s)| s.report.residual_n).fold(0.0, f64::max),
    })
}

fn print(report: &Value, cases: &[Case], outcome: &Outcome, out: &Path) -> anyhow::Result<()> {
    output!(
        "{}: {} cases, {} solved now, {} reused, {} failed",
        out.display(),
        report["cases"],
        report["solved"],
        report["reused"],
        outcome.failed.len()
    )?;
    output!(
        "{} load steps, {} factorisations, {} steps cut{}",
        report["steps"],
        report["factorisations"],
        report["cuts"],
        match report["median_factorisations_contact"].as_u64() {
            Some(median) => format!("; median of a contact case: {median} factorisations"),
            None => String::new(),
        }
    )?;
    output!(
        "{:.0} s elapsed, {:.0} s of processor time, {} MB at most; {:.0} s of solver time in all cases",
        report["seconds"].as_f64().unwrap_or(0.0),
        report["cpu_seconds"].as_f64().unwrap_or(f64::NAN),
        report["peak_memory_mb"],
        report["solver_seconds"].as_f64().unwrap_or(0.0)
    )?;
    output!(
        "largest force out of balance at a node: {:.1e} N",
        report["largest_residual_n"].as_f64().unwrap_or(f64::NAN)
    )?;
    let beyond = report["beyond_law"].as_array().map_or(0, Vec::len);
    output!(
        "largest stretch {:.2}; {beyond} states with more than 1 % of the elastomer beyond the range of its law",
        report["largest_stretch"].as_f64().unwrap_or(f64::NAN)
    )?;
    for (index, reason) in &outcome.failed {
        output!("failed: {}: {reason}", cases[*index].name)?;
    }
    Ok(())
}
