//! The named runs: steps of the force with and without a load cell, a plate that moves, a step of the tip, noise at rest.

use super::bench::{Bench, trial};
use super::trial::{Moment, StepFigures, step_figures};
use crate::plant::PlantSpec;
use control::inverse::Quantity;
use serde_json::{Value, json};

/// Model errors of every named run: the plate is 3 mm nearer than shown, the body 10 % stiffer, the valve has an offset of 0.5 kPa.
const WRONG: PlantSpec = PlantSpec {
    valve_s: 0.02,
    line_s: 0.06,
    delay_s: 0.01,
    supply_mpa: 0.09,
    valve_offset_mpa: 5e-4,
    true_gap_mm: 37.0,
    stiffness: 1.1,
    gauge_noise_mpa: 5e-5,
    cell_noise_n: 2e-3,
    seed: 7,
};
/// Shown less true, mm.
const GAP_ERROR_MM: f64 = 3.0;
/// Targets of the force runs, N, each held so long, s.
const TARGETS_N: [f64; 3] = [0.3, 0.45, 0.15];
const HOLD_S: f64 = 2.0;
/// Targets of the tip's height, mm.
const TARGETS_MM: [f64; 3] = [-40.0, -55.0, -45.0];
/// Displacement of the plate in the middle of a hold, mm.
const MOVE_MM: f64 = 4.0;

/// One run.
pub struct Run {
    /// Name.
    pub name: &'static str,
    /// Unit of its quantity.
    pub unit: &'static str,
    /// Its turns.
    pub moments: Vec<Moment>,
    /// Its steps, by the truth.
    pub steps: Vec<StepFigures>,
}

/// All runs, with what is read off them.
pub struct Figures {
    /// The runs.
    pub runs: Vec<Run>,
    /// After the plate moved: largest error, N; time until it is below 5 % of the target for good, s.
    disturbance: (f64, Option<f64>),
    /// At rest on the nominal plant: root mean square of the true force's deviation (N) and of the command's (MPa).
    noise: (f64, f64),
}

pub fn measure(bench: &Bench) -> anyhow::Result<Figures> {
    let mut runs = Vec::new();
    for (name, is_measured) in [("force, load cell", true), ("force, no load cell", false)] {
        runs.push(stepped(bench, name, Quantity::Force, is_measured, WRONG, &TARGETS_N)?);
    }
    // Out of reach of any plate: the tip moves freely.
    let free = PlantSpec { true_gap_mm: f64::INFINITY, ..WRONG };
    for (name, is_measured) in [("tip, camera", true), ("tip, no camera", false)] {
        runs.push(stepped(bench, name, Quantity::Tip, is_measured, free, &TARGETS_MM)?);
    }
    let (moved, disturbance) = disturbed(bench)?;
    runs.push(moved);
    Ok(Figures { runs, disturbance, noise: noise(bench)? })
}

fn stepped(
    bench: &Bench,
    name: &'static str,
    quantity: Quantity,
    is_measured: bool,
    spec: PlantSpec,
    targets: &[f64],
) -> anyhow::Result<Run> {
    let (gap_error_mm, unit) = match quantity {
        Quantity::Force => (GAP_ERROR_MM, "N"),
        Quantity::Tip => (f64::NAN, "mm"),
    };
    let mut under_way = bench.start(spec, trial(quantity, is_measured, gap_error_mm))?;
    let (mut moments, mut steps) = (Vec::new(), Vec::new());
    for target in targets {
        let begin = moments.len();
        under_way.hold(*target, HOLD_S, &mut moments);
        let from = moments.get(begin.saturating_sub(1)).map_or(0.0, |moment: &Moment| moment.truth);
        steps.extend(step_figures(from, &moments[begin..], |moment| moment.truth));
    }
    Ok(Run { name, unit, moments, steps })
}

fn disturbed(bench: &Bench) -> anyhow::Result<(Run, (f64, Option<f64>))> {
    let target = TARGETS_N[0];
    let mut under_way = bench.start(WRONG, trial(Quantity::Force, true, GAP_ERROR_MM))?;
    let mut moments = Vec::new();
    under_way.hold(target, HOLD_S, &mut moments);
    let begin = moments.len();
    under_way.plant.spec.true_gap_mm -= MOVE_MM;
    // The gap sensor sees nothing of it: the error of the shown gap grows.
    under_way.show_gap_error(GAP_ERROR_MM + MOVE_MM);
    under_way.hold(target, HOLD_S, &mut moments);
    let after = &moments[begin..];
    let off = |moment: &Moment| (moment.truth - target).abs();
    let largest = after.iter().map(off).fold(0.0, f64::max);
    let recovery = step_figures(0.0, after, |moment| moment.truth).and_then(|figures| figures.settling_s);
    let run = Run { name: "force, plate moves by 4 mm", unit: "N", moments, steps: Vec::new() };
    Ok((run, (largest, recovery)))
}

fn noise(bench: &Bench) -> anyhow::Result<(f64, f64)> {
    let mut under_way = bench
        .start(PlantSpec { true_gap_mm: 40.0, ..PlantSpec::default() }, trial(Quantity::Force, true, 0.0))?;
    let mut moments = Vec::new();
    under_way.hold(TARGETS_N[0], 10.0, &mut moments);
    let rest = &moments[moments.len() / 2..];
    let deviation = |value: &dyn Fn(&Moment) -> f64| {
        let mean = rest.iter().map(value).sum::<f64>() / rest.len() as f64;
        (rest.iter().map(|moment| (value(moment) - mean).powi(2)).sum::<f64>() / rest.len() as f64).sqrt()
    };
    Ok((deviation(&|moment| moment.truth), deviation(&|moment| moment.command_mpa)))
}

impl Figures {
    /// As lines for people.
    pub fn text(&self) -> String {
        let mut out = format!(
            "named runs: plate {GAP_ERROR_MM} mm nearer than shown, body {:.0} % stiffer, valve off by {:.1} kPa; of the truth\n",
            100.0 * (WRONG.stiffness - 1.0),
            1e3 * WRONG.valve_offset_mpa
        );
        for run in &self.runs {
            for step in &run.steps {
                let settled =
                    step.settling_s.map_or("not settled".into(), |s| format!("settled after {s:.3} s"));
                out += &format!(
                    "  {}, {:.3} to {:.3} {}: {settled}, overshoot {:.2} %, error at the end {:.2} %\n",
                    run.name,
                    step.step[0],
                    step.step[1],
                    run.unit,
                    100.0 * step.overshoot,
                    100.0 * step.final_error
                );
            }
        }
        let (largest, recovery) = self.disturbance;
        let recovered = recovery.map_or("not again".into(), |s| format!("again after {s:.3} s"));
        out += &format!(
            "  plate moves by {MOVE_MM} mm: off by {largest:.4} N at most, within 5 % {recovered}\n"
        );
        let (force_n, command_mpa) = self.noise;
        out += &format!(
            "  noise of 2 mN and 50 Pa at rest: true force {:.3} mN, command {:.1} Pa (root mean square)\n",
            1e3 * force_n,
            1e6 * command_mpa
        );
        out
    }

    /// As one JSON object.
    pub fn json(&self) -> Value {
        let step = |step: &StepFigures| {
            json!({ "from": step.step[0], "to": step.step[1], "settling_s": step.settling_s, "overshoot": step.overshoot,
                    "final_error": step.final_error })
        };
        let runs = self
            .runs
            .iter()
            .map(|run| json!({ "name": run.name, "steps": run.steps.iter().map(step).collect::<Vec<_>>() }));
        json!({
            "runs": runs.collect::<Vec<_>>(),
            "disturbance": { "largest_error_n": self.disturbance.0, "recovery_s": self.disturbance.1 },
            "noise": { "force_n": self.noise.0, "command_mpa": self.noise.1 },
        })
    }
}
