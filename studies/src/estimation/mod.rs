//! Hidden truths: inflations with unknown gap, gauge bias and stiffness, and what the filter makes of their readings.

mod cost;
mod truth;
mod unscented;

use crate::stats::median;
use estimate::{MAX_INPUTS, Measurement, Model as _, Predicted, Setup, Status};
use rom::halfwidths::HALFWIDTH_SIGMAS;
use runtime::config::Scene;
use runtime::estimation::SensorModel;
use serde_json::{Value, json};
use softtwin::unknowns::Unknowns;
use softtwin::{files, output, progress::Progress, range};
use std::path::PathBuf;
use truth::{Readings, Truth};
use unscented::Unscented;

const EXAMPLES: &str = "\
Examples:
  100 truths of a model of another mesh; a truth takes a few seconds:
    softtwin-studies estimation --scene config/scenes/estimate.toml --truth second-mesh.twin
  The readings of one truth as a trace:
    softtwin-studies estimation --truth second-mesh.twin --truths 1 --trace config/traces/estimate.csv
  Truths of the scene's own model, which have no error of the mesh:
    softtwin-studies estimation --scene config/scenes/estimate.toml --truths 20
  What an update costs with more unknowns and markers than the scene has, of a model with five parameters:
    softtwin-studies estimation --model models/pneunet-design/pneunet-design.twin --unknowns 5 --markers 8 --truths 10";

const NOTES: &str = "\
A truth is an inflation in 10 s at 200 Hz, to the largest pressure that both models have samples at, with hidden unknowns: gap
within 10 mm of its prior, gauge bias within 2 kPa, every other unknown within 20 % of its prior, but inside the truth's samples. Noise 0.5 kPa, 5 mN, 0.2 mm; 10 % of the markers' readings
missing, 1 % outliers. The truth's model must have the inputs of the scene's model that are estimated; others take its own values. The
medians are of absolute errors at the end of the inflation. The time of an update is the fastest of three passes over the readings, so
that what the system does meanwhile does not count. Prints one JSON object.";

/// Estimates hidden truths: errors, coverage, consistency, cost, beside an unscented filter and believing the readings.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    /// Scene with `[actuator.estimate]`.
    #[arg(long, value_name = "FILE.toml", default_value = "config/scenes/estimate.toml")]
    scene: PathBuf,
    /// Model that estimates, in place of the scene's.
    #[arg(long, value_name = "FILE.twin")]
    model: Option<PathBuf>,
    /// Model that the truths are taken from; default: the one that estimates.
    #[arg(long, value_name = "FILE.twin")]
    truth: Option<PathBuf>,
    /// Truths (1 to 10000).
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = range::count(1, 10_000))]
    truths: usize,
    /// Unknowns: those of the scene, then the model's other parameters and the load cell's bias; default: those of the scene
    #[arg(long, value_name = "N", value_parser = range::count(1, 12))]
    unknowns: Option<usize>,
    /// Markers: those of the scene, then nodes all over the mesh; default: those of the scene
    #[arg(long, value_name = "N", value_parser = range::count(1, 8))]
    markers: Option<usize>,
    /// Begin of the random numbers.
    #[arg(long, value_name = "N", default_value_t = 20)]
    seed: u64,
    /// Also write the readings of the first truth as a trace that a bridge replays and `softtwin calibrate` reads.
    #[arg(long, value_name = "FILE.csv")]
    trace: Option<PathBuf>,
}

/// Names of the sets of sensors, and whether load cell and markers are in them.
const SENSORS: [(&str, [bool; 2]); 3] =
    [("force_and_markers", [true, true]), ("markers", [false, true]), ("force", [true, false])];
/// A gap off by less counts as converged, mm.
const CONVERGED_MM: f64 = 0.5;

/// Result of one filter for one truth.
struct Outcome {
    /// Error, standard deviation and identifiability per unknown.
    unknowns: Vec<(f64, f64, bool)>,
    /// Predicted less true contact force at the end, N.
    force_n: f64,
    /// Share of the readings used whose NIS lies in its 95 % band.
    consistent: f64,
    /// From the first contact until the gap stays near the truth, s.
    converged_s: f64,
    /// Time of the update, us, and its evaluations of the model, per reading.
    cost: Vec<[f64; 2]>,
    /// Readings whose search had not ended within its predictions, and those not used at all.
    tangents: usize,
    unused: usize,
}

impl Args {
    /// Simulates, estimates, prints.
    pub fn run(self) -> anyhow::Result<()> {
        let mut scene = Scene::load(&self.scene)?;
        if let (Some(model), Some(spec)) = (&self.model, scene.actuators.first_mut()) {
            spec.model = std::path::absolute(model)?;
        }
        cost::extend(&mut scene, self.unknowns, self.markers)?;
        let mut of = Unknowns::load(&scene, &self.scene, None)?;
        let path = self.truth.clone().unwrap_or_else(|| of.spec.model.clone());
        let model = files::model(&path)?;
        let mut world = truth::World::new(&of, &model)?;
        let (mut found, mut unscented, mut unscented_us) = ([vec![], vec![], vec![]], vec![], vec![]);
        let mut unscented_left_out = 0;
        let (mut believed_n, mut mesh_n, mut progress) = (Vec::new(), Vec::new(), Progress::new(false));
        for number in 0..self.truths {
            progress.step(&format!("truth {} of {}", number + 1, self.truths));
            let truth = world.draw(&of.setup, self.seed + number as u64);
            let readings = world.inflate(&of, &truth);
            if let (0, Some(path)) = (number, &self.trace) {
                truth::write_trace(path, &of.setup, &truth, &readings)?;
            }
            let mut touches = Vec::new();
            for (found, (_, sensors)) in found.iter_mut().zip(SENSORS).rev() {
                let outcome;
                (outcome, touches) = filtered(&of.setup, &mut of.sensors, &truth, &readings, sensors);
                found.push(outcome);
            }
            mesh_n.push(force_n(&of.setup, &mut of.sensors, &readings.inputs) - readings.force_n);
            // All sensors came last.
            let (errors, cost, left_out) =
                Unscented::run(&of.setup, &mut of.sensors, &truth, &readings, &touches);
            unscented.push(errors);
            unscented_us.extend(cost);
            unscented_left_out += left_out;
            let prior: Vec<f64> = of.setup.unknowns.iter().map(|unknown| unknown.prior).collect();
            if let Some(last) = readings.measured.last() {
                let inputs = of.setup.inputs(last, &prior);
                believed_n.push(force_n(&of.setup, &mut of.sensors, &inputs) - readings.force_n);
            }
        }
        drop(progress);
        let names: Vec<&str> = of.setup.unknowns.iter().map(|unknown| unknown.name.as_str()).collect();
        let mut out = json!({
            "truths": self.truths, "seed": self.seed, "scene": self.scene, "truth": path,
            "unknowns": names, "measured_values": of.setup.rows.len(),
            "scene_model_at_the_truth": { "force_n": median(mesh_n.iter().map(|e| e.abs())) },
            "believing_the_readings": { "force_n": median(believed_n.iter().map(|e| e.abs())) },
            "unscented": {
                "median_error": medians(&names, &unscented),
                "update_us": cost::quantiles(unscented_us.into_iter()),
                "readings_not_used": unscented_left_out,
            },
        });
        for ((name, _), outcomes) in SENSORS.iter().zip(&found) {
            out[*name] = summary(&names, outcomes);
        }
        output::json(&out)
    }
}

/// Runs the filter over the readings of some sensors; also says by reading whether it touches.
fn filtered(
    setup: &Setup,
    model: &mut SensorModel,
    truth: &Truth,
    readings: &Readings,
    [force, markers]: [bool; 2],
) -> (Outcome, Vec<bool>) {
    let blank = |measured: &Measurement| {
        let mut measured = *measured;
        for (value, row) in measured.rows.iter_mut().zip(&setup.rows) {
            if !(if row.block == 0 { force } else { markers }) {
                *value = f64::NAN;
            }
        }
        measured
    };
    let seen: Vec<Measurement> = readings.measured.iter().map(blank).collect();
    let fastest_us = cost::fastest_us(setup, &seen, model);
    let mut ours = cost::filter(setup);
    let gap = setup.unknowns.iter().position(|unknown| unknown.name == "gap_mm");
    let (mut used, mut consistent, mut since_s) = (0_u32, 0_u32, None);
    let (mut inputs, mut cost, mut touches) = ([f64::NAN; MAX_INPUTS], Vec::new(), Vec::new());
    let (mut tangents, mut unused) = (0, 0);
    for (measured, fastest_us) in seen.iter().zip(fastest_us) {
        let (update, us, calls) = cost::counted(&mut ours, measured, model);
        cost.push([us.min(fastest_us), f64::from(calls)]);
        tangents += usize::from(update.status == Status::Used && !update.converged);
        unused += usize::from(update.status != Status::Used);
        inputs = update.inputs;
        touches.push(update.in_contact);
        if update.status == Status::Used && update.used > 0 {
            used += 1;
            consistent += u32::from((update.nis_band[0]..=update.nis_band[1]).contains(&update.nis));
        }
        let near = gap.is_some_and(|gap| {
            ours.estimates().nth(gap).is_some_and(|e| (e.value - truth.unknowns[gap]).abs() < CONVERGED_MM)
        });
        since_s = if near { since_s.or(Some(measured.t_s)) } else { None };
    }
    let off =
        ours.estimates().zip(&truth.unknowns).map(|(e, truth)| (e.value - truth, e.sigma, e.identifiable));
    let outcome = Outcome {
        unknowns: off.collect(),
        force_n: force_n(setup, model, &inputs) - readings.force_n,
        consistent: f64::from(consistent) / f64::from(used.max(1)),
        converged_s: since_s.map_or(f64::INFINITY, |since| (since - readings.contact_s).max(0.0)),
        cost,
        tangents,
        unused,
    };
    (outcome, touches)
}

fn force_n(setup: &Setup, model: &mut SensorModel, inputs: &[f64; MAX_INPUTS]) -> f64 {
    let mut rows = vec![Predicted::default(); setup.rows.len()];
    model.predict(inputs, &mut rows);
    rows[0].value
}

fn medians(names: &[&str], errors: &[Vec<f64>]) -> Value {
    let of = |index: usize| median(errors.iter().map(|error| error[index].abs()));
    names.iter().enumerate().map(|(index, name)| ((*name).to_owned(), json!(of(index)))).collect()
}

fn summary(names: &[&str], outcomes: &[Outcome]) -> Value {
    let errors: Vec<Vec<f64>> = outcomes.iter().map(|o| o.unknowns.iter().map(|u| u.0).collect()).collect();
    let all = || outcomes.iter().flat_map(|outcome| &outcome.unknowns);
    let share = |of: &dyn Fn(&(f64, f64, bool)) -> bool| {
        all().filter(|unknown| of(unknown)).count() as f64 / all().count().max(1) as f64
    };
    let identifiable = |name: usize| outcomes.iter().filter(|outcome| outcome.unknowns[name].2).count();
    let identifiable: Value = names
        .iter()
        .enumerate()
        .map(|(index, name)| ((*name).to_owned(), json!(identifiable(index))))
        .collect();
    json!({
        "median_error": medians(names, &errors),
        "median_force_error_n": median(outcomes.iter().map(|outcome| outcome.force_n.abs())),
        "coverage_of_90_percent_bands": share(&|(off, sigma, _)| off.abs() <= HALFWIDTH_SIGMAS * sigma),
        "beyond_3_sigma": share(&|(off, sigma, _)| off.abs() > 3.0 * sigma),
        "identifiable_and_beyond_3_sigma": share(&|(off, sigma, known)| *known && off.abs() > 3.0 * sigma),
        "identifiable_truths": identifiable,
        "readings_by_the_tangent": outcomes.iter().map(|outcome| outcome.tangents).sum::<usize>(),
        "readings_not_used": outcomes.iter().map(|outcome| outcome.unused).sum::<usize>(),
        "median_share_of_nis_in_band": median(outcomes.iter().map(|outcome| outcome.consistent)),
        "update_us": cost::quantiles(outcomes.iter().flat_map(|outcome| outcome.cost.iter().map(|cost| cost[0]))),
        "evaluations": cost::quantiles(outcomes.iter().flat_map(|outcome| outcome.cost.iter().map(|cost| cost[1]))),
        "median_s_from_contact_to_gap_within_0.5_mm": median(outcomes.iter().map(|outcome| outcome.converged_s)),
    })
}
