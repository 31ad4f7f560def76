//! The loop on a simulated actuator: figures, sensitivities, picture.

use super::args::Args;
use super::goal::Goal;
use super::held::refuse_out_of_reach;
use crate::picture::{Figure, Panel, Series};
use crate::report;
use control::held::Held;
use control::inverse::{Model, Quantity};
use control::law::Controller;
use control::plant::{Plant, PlantSpec};
use control::trial::{Loop, Moment, StepFigures, Trial, step_figures};
use control::twin_model::OUT_OF_REACH_MM;
use rom::memory::Line;
use runtime::config::ActuatorSpec;
use serde_json::{Value, json};

/// Control cycles per second.
const RATE_HZ: f64 = 200.0;
/// Duration of each step, s.
const HOLD_S: f64 = 5.0;
/// Gap without another, mm.
const GAP_MM: f64 = 40.0;
/// Bias of the gauge, MPa, and relative stiffness of the simulated actuator: what the settings do not know of.
const BIAS_MPA: f64 = 1e-3;
const STIFFNESS: f64 = 0.9;

/// Changes of the plant: name, factors of stiffness, lag and play.
const CHANGES: [(&str, [f64; 3]); 5] = [
    ("as set", [1.0, 1.0, 1.0]),
    ("20 % stiffer", [1.2, 1.0, 1.0]),
    ("20 % softer", [0.8, 1.0, 1.0]),
    ("double lag", [1.0, 2.0, 1.0]),
    ("double play", [1.0, 1.0, 2.0]),
];

/// Runs every change of the plant and reports.
pub(super) fn run(args: &Args, spec: &ActuatorSpec, held: Held, goal: &Goal) -> anyhow::Result<()> {
    let (low_mm, high_mm) = spec.gap_mm.range_mm();
    let within_mm = if low_mm == high_mm { low_mm } else { GAP_MM.clamp(low_mm, high_mm) };
    let gap_mm = match held.quantity {
        Quantity::Force => args.gap_mm.unwrap_or(within_mm),
        _ => args.gap_mm.unwrap_or(OUT_OF_REACH_MM),
    };
    refuse_out_of_reach(&held, &mut held.model()?, goal.values(), gap_mm)?;
    let (mut rows, mut nominal) = (Vec::new(), Vec::new());
    for (name, factors) in CHANGES {
        let (moments, steps) = simulated(args, &held, goal, gap_mm, factors)?;
        rows.push((name, row(&held, &moments, &steps)));
        if nominal.is_empty() {
            nominal = moments;
        }
    }
    if let Some(out) = &args.out {
        picture(&held, &nominal).save(out)?;
    }
    let plants: serde_json::Map<String, Value> =
        rows.into_iter().map(|(name, row)| (name.into(), row)).collect();
    report::print(
        &json!({ "held": held.name, "unit": held.unit, "gap_mm": gap_mm, "plants": plants }),
        args.json,
    )
}

/// The plant that the settings describe, with errors and the factors of a change.
pub(super) fn plant(held: &Held, gap_mm: f64, [stiffness, lag, play]: [f64; 3]) -> PlantSpec {
    let settings = &held.settings;
    let mut spec = PlantSpec {
        valve_s: 0.0,
        line: Line { fill_s: lag * settings.line.fill_s, empty_s: lag * settings.line.empty_s },
        play: settings.play.clone(),
        swing_hz: settings.swing_hz * (STIFFNESS * stiffness).sqrt(),
        swing_damping: settings.swing_damping,
        delay_s: settings.delay_s,
        supply_mpa: held.limits.range_mpa[1],
        gauge_bias_mpa: BIAS_MPA,
        gauge_at: settings.gauge_at,
        true_gap_mm: gap_mm,
        stiffness: STIFFNESS * stiffness,
        ..PlantSpec::default()
    };
    spec.play.iter_mut().for_each(|operator| operator.threshold *= play);
    spec
}

/// Cycles and steps: a series unchanged; a value from rest, then half-way back to rest, and up again.
fn simulated(
    args: &Args,
    held: &Held,
    goal: &Goal,
    gap_mm: f64,
    factors: [f64; 3],
) -> anyhow::Result<(Vec<Moment>, Vec<StepFigures>)> {
    let quantity = held.quantity;
    let controller = Controller::new(held.model()?, quantity, held.settings.clone(), held.limits);
    let mut body = held.model()?;
    let rest = quantity.of(&body.at(held.limits.range_mpa[0], gap_mm), held.limits.range_mpa[0]).0;
    let trial =
        Trial { quantity, is_measured: held.settings.is_measured, gap_error_mm: 0.0, rate_hz: RATE_HZ };
    let mut under_way = Loop::new(controller, Plant::new(plant(held, gap_mm, factors), body), trial);
    let (mut moments, mut steps) = (Vec::new(), Vec::new());
    if goal.end_s().is_some() {
        under_way.follow(|t_s| goal.at(t_s), args.seconds(goal), &mut moments);
        return Ok((moments, steps));
    }
    let mut from = rest;
    for part in [1.0, 0.5, 1.0] {
        let (target, begin) = (rest + part * (goal.last() - rest), moments.len());
        under_way.hold(target, args.seconds.unwrap_or(HOLD_S), &mut moments);
        steps.extend(step_figures(from, &moments[begin..], |moment| moment.truth));
        from = target;
    }
    Ok((moments, steps))
}

fn row(held: &Held, moments: &[Moment], steps: &[StepFigures]) -> Value {
    let most = |value: fn(&Moment) -> f64| moments.iter().map(value).fold(0.0, f64::max);
    let square: f64 = moments.iter().map(|moment| (moment.truth - moment.target).powi(2)).sum();
    let [low, high] = held.limits.range_mpa;
    json!({
        "steps": steps,
        "rms_error": (square / moments.len().max(1) as f64).sqrt(),
        "force_below_limit_n": held.settings.force_max_n - most(|moment| moment.force_n),
        "pressure_below_limit_mpa": high - most(|moment| moment.pressure_mpa),
        "is_limited": moments.iter().any(|moment| moment.is_limited),
        "range_mpa": [low, high],
        "fault": moments.iter().find_map(|moment| moment.fault),
    })
}

fn picture(held: &Held, moments: &[Moment]) -> Figure {
    let series = |name: &str, colour: usize, value: fn(&Moment) -> f64| {
        Series::line(name, colour, moments.iter().map(|moment| (moment.time_s, value(moment))))
    };
    let quantity = format!("{} ({})", held.name, held.unit);
    let truth = vec![series("target", 2, |moment| moment.target), series("truth", 0, |moment| moment.truth)];
    let pressure = vec![
        series("command", 1, |moment| moment.command_mpa),
        series("cavity", 0, |moment| moment.pressure_mpa),
    ];
    Figure {
        title: "Closed loop on a simulated actuator".into(),
        panels: vec![
            Panel::new("quantity", "time (s)", quantity.as_str(), truth),
            Panel::new("pressure", "time (s)", "pressure (MPa)", pressure),
        ],
        columns: 1,
    }
}
