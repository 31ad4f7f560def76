//! Motion along a trace of inputs: `series.csv`, `energy.csv` and fields of chosen instants.

use crate::failure::{configuration, usage};
use crate::files::refusal;
use crate::{report, resources};
use fem::Family;
use fem::transient::{
    MotionError, MotionEvent, MotionOptions, MotionSummary, Trace, TransientError, run_motion,
};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::io::IsTerminal;
use std::path::Path;
use std::time::Instant;

#[derive(Serialize)]
struct MotionReport {
    #[serde(flatten)]
    motion: MotionSummary,
    seconds: f64,
    peak_memory_mb: Option<u64>,
}

/// Moves the actuator along the trace, or continues an interrupted run, and reports.
pub fn run(family: &Family, trace: &Path, options: MotionOptions, as_json: bool) -> anyhow::Result<()> {
    let began = Instant::now();
    let trace = Trace::read(trace, &family.actuator).map_err(refusal)?;
    for (begin_s, length_s) in trace.long_intervals() {
        tracing::warn!(
            "no row of the trace for {length_s} s after t = {begin_s} s: inputs are interpolated linearly"
        );
    }
    let bar = ProgressBar::new(0);
    bar.set_style(ProgressStyle::with_template(
        "{bar:30} {pos}/{len} instants, {elapsed} elapsed, about {eta} left  {msg}",
    )?);
    let lines = !std::io::stderr().is_terminal();
    let mut show = |event| match event {
        MotionEvent::OtherRun(path) => tracing::warn!("{} is of another run; starting again", path.display()),
        MotionEvent::Advanced { done, instants, t_s, work } => {
            if bar.length() != Some(instants as u64) {
                bar.set_length(instants as u64);
                bar.reset_eta();
            }
            bar.set_position(done as u64);
            bar.set_message(format!("t = {t_s:.4} s"));
            if lines && done.is_multiple_of(instants.div_ceil(10)) {
                let (steps, factorisations) = (work.steps, work.factorisations);
                tracing::info!(
                    "t = {t_s:.4} s, {done} of {instants} instants, {steps} steps, {factorisations} factorisations"
                );
            }
        }
    };
    let motion = run_motion(family, trace, options, &mut show);
    bar.finish_and_clear();
    let report = MotionReport {
        motion: motion.map_err(sorted)?,
        seconds: began.elapsed().as_secs_f64(),
        peak_memory_mb: resources::status("self", "VmHWM").map(|kb| kb * 1024 / 1_000_000),
    };
    report::print(&report, as_json)
}

/// Density, step lengths and frequency are the user's mistakes; a motion that cannot be solved is not.
fn sorted(error: MotionError) -> anyhow::Error {
    use TransientError::{Density, Setting, Unresolved};
    match error {
        MotionError::Outside { .. } => usage(format!("--fields-s: {error}")),
        MotionError::TooLong { .. } => usage(format!("--trace: {error} (--step-ms)")),
        MotionError::Variant(_) | MotionError::Motion(Density(_) | Setting { .. } | Unresolved { .. }) => {
            configuration(error)
        }
        MotionError::File(error) => refusal(error),
        _ => error.into(),
    }
}
