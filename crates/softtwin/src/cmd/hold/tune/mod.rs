//! `softtwin tune`: a bounded experiment on the valve, and the settings that follow from it.

mod live;
mod scene;

use super::held;
use super::simulate;
use crate::failure::{configuration, usage};
use crate::live::DomainArgs;
use crate::picture::{Figure, Panel, Series};
use crate::{output, report};
use control::experiment::Experiment;
use control::held::Held;
use control::inverse::{Model, Quantity};
use control::law::{Controller, Target};
use control::plant::Plant;
use control::settings::{GaugeAt, Settings, table_of};
use control::trial::{Loop, Trial, step_figures};
use control::twin_model::OUT_OF_REACH_MM;
use runtime::config::Scene;
use serde_json::{Value, json};
use std::io::{BufRead, IsTerminal};
use std::path::PathBuf;
use std::time::Duration;
use train::actuation::{Actuation, ActuationCycle, identify_actuation};

const EXAMPLES: &str = "\
Examples:
  Identify line, delay, the valve's rate, play and swing on the running scene, and write them to it:
    softtwin tune --scene config/scenes/rig.toml --out tune.svg
  The same on a simulated actuator that has the settings of the scene; nothing is written:
    softtwin tune --scene config/scenes/rig.toml --simulate";

const NOTES: &str = "\
The experiment: steps up and down at three pressures, then a ramp up and down, within the range of [actuator.valve], at most at its rate, and up to 80 % of the \
force limit. It is shown and asked for first. A step that a late reading has disturbed is repeated, up to five times. Ctrl-C, a closed terminal, an override, an interlock \
or a device that does not answer end it at the safe value, and nothing is written.";

/// Identify line, delay, the valve's rate, play and swing by a bounded experiment on the valve, and set the controller.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    /// Scene of the running twin and bridge; its [actuator.control] is changed, and in it the table of what is held.
    #[arg(long, value_name = "FILE")]
    scene: PathBuf,
    /// Actuator; default: the scene's first.
    #[arg(long, value_name = "NAME")]
    actuator: Option<String>,
    /// Gap that is assumed if the twin's states have none, mm.
    #[arg(long = "gap", value_name = "MM", value_parser = crate::range::gap_mm)]
    gap_mm: Option<f64>,
    /// Validity of each setpoint, ms: a reading that comes later closes the valve. At most valid_max_ms of the valve counts.
    #[arg(long, value_name = "MS", default_value_t = 50.0, value_parser = crate::range::number(1.0, 60_000.0))]
    valid_ms: f64,
    /// Does not ask.
    #[arg(long)]
    yes: bool,
    /// Runs on a simulated actuator with the settings of the scene, and writes nothing.
    #[arg(long)]
    simulate: bool,
    /// Picture (.svg, .png).
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    out: Option<PathBuf>,
    /// One JSON object.
    #[arg(long, help_heading = "Output")]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

/// Control cycles per second of the simulation, and the gap without another, mm.
const RATE_HZ: f64 = 200.0;
const GAP_MM: f64 = 40.0;
/// Begin and end of the predicted steps, as fractions of the experiment's pressures.
const PREDICTED: [f64; 2] = [0.3, 0.7];
/// Duration of each predicted step, s.
const PREDICTED_S: f64 = 5.0;

impl Args {
    /// Asks, experiments, identifies, predicts, writes.
    pub fn run(self) -> anyhow::Result<()> {
        let scene = Scene::load(&self.scene).map_err(configuration)?;
        let (position, spec) = super::actuator(&scene, self.actuator.as_deref())?;
        let held = held::of_column(spec, held::column(&spec.control.hold))?;
        let (rows, experiment, gap_mm) = if self.simulate {
            self.simulated(&held)?
        } else {
            let valid = Duration::from_secs_f64(1e-3 * self.valid_ms);
            let consent = |experiment: &Experiment| self.consent(experiment);
            live::run(&self.domain.join()?, self.gap_mm, valid, spec, &held, consent)?
        };
        let sees_line = held.settings.gauge_at == GaugeAt::Cavity;
        let is_measured = held.quantity != Quantity::Pressure;
        let found = identify_actuation(&rows, &experiment.holds_s, sees_line, is_measured);
        let settings = settings(&held.settings, &found);
        let predicted = predicted(&held, &settings, &experiment, gap_mm)?;
        if let Some(out) = &self.out {
            picture(&held, &rows).save(out)?;
        }
        if !self.simulate {
            scene::write(&self.scene, position, table_of(&held.name), &settings)?;
        }
        let report = json!({
            "held": held.name, "unit": held.unit, "seconds": experiment.end_s(), "rows": rows.len(), "found": found,
            "control": control_keys(&settings), "predicted": predicted, "unknown": found.remarks,
            "scene": (!self.simulate).then(|| self.scene.display().to_string()),
        });
        report::print(&report, self.json)
    }

    fn simulated(&self, held: &Held) -> anyhow::Result<(Vec<ActuationCycle>, Experiment, f64)> {
        let gap_mm =
            self.gap_mm.unwrap_or(if held.quantity == Quantity::Force { GAP_MM } else { OUT_OF_REACH_MM });
        let experiment = Experiment::of(held, &mut held.model()?, gap_mm);
        let mut plant = Plant::new(simulate::plant(held, gap_mm, [1.0; 3]), held.model()?);
        let count = (experiment.end_s() * RATE_HZ) as usize;
        let row = |index: usize| {
            let (time_s, command_mpa) = (index as f64 / RATE_HZ, experiment.at(index as f64 / RATE_HZ));
            // The command answers the reading, as on the actuator.
            let shown = plant.step(1.0 / RATE_HZ);
            plant.command(command_mpa);
            let measured = if held.settings.is_measured { shown.of(held.quantity)[0] } else { f64::NAN };
            ActuationCycle { time_s, command_mpa, gauge_mpa: shown.pressure_mpa, measured }
        };
        Ok(((0..count).map(row).collect(), experiment, gap_mm))
    }

    /// Shows the experiment and asks for it.
    fn consent(&self, experiment: &Experiment) -> anyhow::Result<()> {
        let shown = experiment.text();
        if self.yes {
            return Ok(());
        }
        if !std::io::stdin().is_terminal() {
            return Err(usage(format!("expected --yes without a terminal; the experiment: {shown}")));
        }
        output!("{shown}\ndrive the valve? [y/N]")?;
        let mut answer = String::new();
        std::io::stdin().lock().read_line(&mut answer)?;
        if answer.trim() == "y" { Ok(()) } else { Err(usage("not agreed; nothing was driven")) }
    }
}

/// Steps up and down with the settings, on the plant that they describe.
fn predicted(
    held: &Held,
    settings: &Settings,
    experiment: &Experiment,
    gap_mm: f64,
) -> anyhow::Result<Value> {
    let (quantity, [low, high]) = (held.quantity, experiment.range_mpa());
    let mut body = held.model()?;
    let targets = PREDICTED.map(|share| {
        let pressure_mpa = low + share * (high - low);
        quantity.of(&body.at(pressure_mpa, gap_mm), pressure_mpa).0
    });
    let held = held.with(settings.clone());
    let controller = Controller::new(held.model()?, quantity, held.settings.clone(), held.limits);
    let trial =
        Trial { quantity, is_measured: held.settings.is_measured, gap_error_mm: 0.0, rate_hz: RATE_HZ };
    let mut under_way =
        Loop::new(controller, Plant::new(simulate::plant(&held, gap_mm, [1.0; 3]), body), trial);
    let mut steps = Vec::new();
    let mut moments = Vec::new();
    under_way.follow(|_| Target::step(targets[0]), 2.0 * PREDICTED_S, &mut moments);
    for (from, to) in [(targets[0], targets[1]), (targets[1], targets[0])] {
        moments.clear();
        under_way.hold(to, PREDICTED_S, &mut moments);
        steps.extend(step_figures(from, &moments, |moment| moment.truth));
    }
    Ok(json!({ "steps": steps }))
}

/// The settings with what the experiment shows; the others stay. What nothing measures stays too.
fn settings(old: &Settings, found: &Actuation) -> Settings {
    let mut new = old.clone();
    if let Some(line) = &found.line {
        (new.line, new.delay_s) = (line.line, line.delay.value);
        new.valve_mpa_per_s = line.valve_rate.map(|rate| rate.value);
    }
    if found.noise.is_none() {
        return new;
    }
    new.play = found.play.as_ref().map_or_else(Vec::new, |play| play.operators.clone());
    match found.swing {
        Some(swing) => new.with_swing(swing.hz, swing.damping),
        None => Settings { swing_hz: 0.0, ..new },
    }
}

/// The keys that are written.
fn control_keys(settings: &Settings) -> Value {
    let (of_line, of_quantity) = scene::keys(settings);
    of_line
        .into_iter()
        .chain(of_quantity)
        .map(|(key, value)| (key.to_owned(), value))
        .collect::<serde_json::Map<_, _>>()
        .into()
}

/// Command and gauge over time, and the quantity over the gauge.
fn picture(held: &Held, rows: &[ActuationCycle]) -> Figure {
    let series = |name: &str, colour: usize, point: fn(&ActuationCycle) -> (f64, f64)| {
        Series::line(name, colour, rows.iter().map(point))
    };
    let pressures = vec![
        series("command", 1, |row| (row.time_s, row.command_mpa)),
        series("gauge", 0, |row| (row.time_s, row.gauge_mpa)),
    ];
    let loops = vec![series("measured", 0, |row| (row.gauge_mpa, row.measured))];
    let quantity = format!("{} ({})", held.name, held.unit);
    Figure {
        title: "Experiment on the valve".into(),
        panels: vec![
            Panel::new("pressure", "time (s)", "pressure (MPa)", pressures),
            Panel::new("play", "gauge (MPa)", quantity.as_str(), loops),
        ],
        columns: 1,
    }
}

#[cfg(test)]
#[path = "../../../../tests/unit/cmd_tune.rs"]
mod tests;
