//! Random steps on plants whose stiffness and gap are not those of the controller's model. With a load cell the figures are
//! those of the true force; without one those of the followed force, the model's at the gauge's pressure, and its error.

use super::bench::{Bench, trial};
use super::trial::{Moment, StepFigures, step_figures};
use crate::plant::PlantSpec;
use control::inverse::{Model, Quantity};
use rom::rng::Rng;
use serde_json::{Value, json};

/// Steps on one plant.
const STEPS_A_PLANT: usize = 10;
/// Seconds of one step.
const HOLD_S: f64 = 1.5;
/// True gaps, mm.
const GAPS_MM: [f64; 2] = [32.5, 47.5];
/// Largest error of the shown gap, mm.
const GAP_ERROR_MM: f64 = 5.0;
/// Largest error of the stiffness, share.
const STIFFNESS_ERROR: f64 = 0.2;
/// Largest error of the valve, MPa.
const VALVE_ERROR_MPA: f64 = 0.001;
/// Smallest target, N, and smallest height of a step, N.
const LEAST_N: f64 = 0.05;

/// Steps with and without a load cell.
pub fn measure(bench: &Bench, steps: usize, seed: u64) -> anyhow::Result<Value> {
    let mut all = Vec::new();
    for is_measured in [true, false] {
        let mut rng = Rng::new(seed);
        let (mut followed, mut truth) = (Vec::new(), Vec::new());
        while truth.len() < steps {
            plant(bench, is_measured, &mut rng, &mut followed, &mut truth)?;
        }
        let name = if is_measured { "load cell" } else { "no load cell" };
        let of = if is_measured { "the true force" } else { "the model's force" };
        all.push(json!({
            "with": name, "of": of, "force_limit_n": bench.settings.force_max_n,
            "figures": summary(if is_measured { &truth } else { &followed }),
            "true_error": summary(&truth)["final_error"],
        }));
    }
    Ok(Value::Array(all))
}

fn plant(
    bench: &Bench,
    is_measured: bool,
    rng: &mut Rng,
    followed: &mut Vec<StepFigures>,
    truth: &mut Vec<StepFigures>,
) -> anyhow::Result<()> {
    let mut between = |low: f64, high: f64| low + (high - low) * rng.uniform();
    let true_gap_mm = between(GAPS_MM[0], GAPS_MM[1]);
    let gap_error_mm = between(-GAP_ERROR_MM, GAP_ERROR_MM);
    let stiffness = 1.0 + between(-STIFFNESS_ERROR, STIFFNESS_ERROR);
    let valve_offset_mpa = between(-VALVE_ERROR_MPA, VALVE_ERROR_MPA);
    let seed = between(0.0, 1e9) as u64;
    let spec = PlantSpec { true_gap_mm, stiffness, valve_offset_mpa, seed, ..PlantSpec::default() };
    // What both supply and model have here; targets beyond the force limit are asked for too.
    let can_n = bench.table.at(spec.supply_mpa, true_gap_mm, stiffness).0;
    let knows_n = bench.model()?.at(spec.supply_mpa, true_gap_mm + gap_error_mm).force_n;
    let most_n = (0.9 * can_n.min(knows_n)).min(1.1 * bench.settings.force_max_n);
    let mut under_way = bench.start(spec, trial(Quantity::Force, is_measured, gap_error_mm))?;
    let (mut from_n, mut target_n) = (0.0, 0.0_f64);
    for _ in 0..STEPS_A_PLANT {
        while (target_n - from_n).abs() < LEAST_N {
            target_n = between(LEAST_N, most_n);
        }
        let mut moments: Vec<Moment> = Vec::new();
        under_way.hold(target_n, HOLD_S, &mut moments);
        // The limited target; two targets beyond the limit are no step.
        let reached_n = moments.last().map_or(target_n, |moment| moment.target);
        if (reached_n - from_n).abs() >= LEAST_N {
            truth.extend(step_figures(from_n, &moments, |moment| moment.truth));
            followed.extend(step_figures(from_n, &moments, |moment| moment.followed));
        }
        from_n = reached_n;
    }
    Ok(())
}

fn summary(steps: &[StepFigures]) -> Value {
    let sorted = |value: &dyn Fn(&StepFigures) -> f64| {
        let mut values: Vec<f64> = steps.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let at = |values: &[f64], share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
    let overshoot = sorted(&|step| step.overshoot);
    let settling = sorted(&|step| step.settling_s.unwrap_or(f64::INFINITY));
    let error = sorted(&|step| step.final_error.abs());
    let worst = steps.iter().max_by(|a, b| a.overshoot.total_cmp(&b.overshoot)).map(|step| step.step);
    json!({
        "steps": steps.len(),
        "overshoot": { "p50": at(&overshoot, 0.5), "p99": at(&overshoot, 0.99), "max": at(&overshoot, 1.0), "worst_step_n": worst },
        "settling_s": { "p50": at(&settling, 0.5), "p99": at(&settling, 0.99), "max": at(&settling, 1.0) },
        "final_error": { "p50": at(&error, 0.5), "p99": at(&error, 0.99), "max": at(&error, 1.0) },
        "largest_force_n": steps.iter().map(|step| step.force_n).fold(0.0, f64::max),
    })
}

/// As lines for people.
pub fn text(random: &Value) -> String {
    let mut out = format!(
        "random steps: stiffness off by up to {:.0} %, gap by {GAP_ERROR_MM} mm, valve by {:.0} kPa; shares of the step's height (overshoot) or of the target\n",
        100.0 * STIFFNESS_ERROR,
        1e3 * VALVE_ERROR_MPA
    );
    for row in random.as_array().into_iter().flatten() {
        let number = |group: &str, key: &str| row["figures"][group][key].as_f64().unwrap_or(f64::INFINITY);
        let percent = |group: &str, key: &str| 100.0 * number(group, key);
        let true_error = |key: &str| 100.0 * row["true_error"][key].as_f64().unwrap_or(f64::NAN);
        out += &format!(
            "  {}, {} steps, of {}: overshoot at most {:.2} % (99 of 100: {:.2} %), settled after {:.3} s (99 of 100: {:.3} s, \
             slowest {:.3} s)\n    true force off at the end by {:.2} % (99 of 100: {:.2} %, worst {:.2} %); largest true force \
             {:.4} N, limit {} N\n",
            row["with"].as_str().unwrap_or_default(),
            row["figures"]["steps"],
            row["of"].as_str().unwrap_or_default(),
            percent("overshoot", "max"),
            percent("overshoot", "p99"),
            number("settling_s", "p50"),
            number("settling_s", "p99"),
            number("settling_s", "max"),
            true_error("p50"),
            true_error("p99"),
            true_error("max"),
            row["figures"]["largest_force_n"].as_f64().unwrap_or(f64::NAN),
            row["force_limit_n"],
        );
    }
    out
}
