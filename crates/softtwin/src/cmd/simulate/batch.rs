//! A list of cases to a database folder, with progress, checkpoints and a report.

use crate::failure::{configuration, usage};
use crate::files::refusal;
use crate::{output, resources};
use fem::Family;
use fem::actuator::Setting;
use fem::cases::{self, Case};
use fem::run::{self, Event, Outcome, Run, RunError, Store, fingerprint};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

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
    let outcome = solve(family, &cases, out, options)?;
    let seconds = began.elapsed().as_secs_f64();
    let report = report(&cases, &outcome, seconds);
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
pub fn solve(family: &Family, cases: &[Case], out: &Path, options: &Options) -> anyhow::Result<Outcome> {
    let store = Store::new(&out.join("states"), fingerprint(&family.problem))?;
    // A log gets lines instead of a bar.
    let bar = ProgressBar::new(cases.len() as u64);
    let lines = Lines::new(cases.len(), !std::io::stderr().is_terminal());
    bar.set_style(ProgressStyle::with_template(
        "{bar:30} {pos}/{len} cases, {elapsed} elapsed, about {eta} left  {msg}",
    )?);
    let run = Run { family, store, threads: options.threads, sensitivities: options.sensitivities };
    let outcome = run.solve(cases, &|event| {
        show(&bar, &event);
        lines.show(&event);
    });
    let outcome = outcome.map_err(|error| match error {
        RunError::Variant { .. } => configuration(error),
        _ => error.into(),
    })?;
    bar.finish_and_clear();
    let derivatives = |case: &Case| run.derivatives(case);
    let derivatives: Option<&dyn Fn(&Case) -> _> =
        if options.sensitivities { Some(&derivatives) } else { None };
    run::write(out, family, cases, &outcome.solved, derivatives).map_err(refusal)?;
    Ok(outcome)
}

fn show(bar: &ProgressBar, event: &Event<'_>) {
    match event {
        Event::Reused(_) => {
            bar.inc(1);
            bar.reset_eta(); // what was there already says nothing about the time the rest takes
        }
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

/// A line on standard error for about every tenth of the work: how far it is, and how long the rest takes.
struct Lines {
    cases: usize,
    wanted: bool,
    began: Instant,
    /// Reused and solved.
    done: Mutex<[usize; 2]>,
}

impl Lines {
    fn new(cases: usize, wanted: bool) -> Self {
        Self { cases, wanted, began: Instant::now(), done: Mutex::new([0; 2]) }
    }

    fn show(&self, event: &Event<'_>) {
        let mut done = self.done.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            Event::Reused(_) => return done[0] += 1,
            Event::Solved(..) => done[1] += 1,
            Event::Failed { again: true, .. } => return,
            Event::Failed { .. } => {}
        }
        let ([reused, solved], every) = (*done, self.cases.div_ceil(10));
        let left = self.cases.saturating_sub(reused + solved);
        if self.wanted && solved > 0 && (solved % every == 0 || left == 0) {
            let rest_s = self.began.elapsed().as_secs_f64() / solved as f64 * left as f64;
            // Progress that cannot be written must not end the work.
            let _ = writeln!(
                std::io::stderr(),
                "{} of {} cases, about {rest_s:.0} s left",
                reused + solved,
                self.cases
            );
        }
    }
}

fn report(cases: &[Case], outcome: &Outcome, seconds: f64) -> Value {
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
        "{} load steps, {} factorisations (one a Newton iteration), {} steps cut{}",
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
    for (index, reason) in &outcome.failed {
        output!("failed: {}: {reason}", cases[*index].name)?;
    }
    Ok(())
}
