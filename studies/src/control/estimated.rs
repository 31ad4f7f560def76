//! The force without a load cell: the model's force is held, at the stiffness and the gap that are estimated from a marker at the tip.

use super::compare::{Bench, Case, HOLD_S, RATE_HZ, TARGETS_N, cases, changed, known};
use crate::plant::Truth;
use anyhow::{Context, anyhow};
use control::inverse::Model as _;
use control::inverse::Quantity;
use control::law::{Controller, Reading, Target};
use control::plant::{Plant, RestingBody};
use control::settings::{Limits, Settings};
use control::twin_model::{Tip, TwinModel};
use estimate::{Filter, Measurement};
use rom::inputs::{Inputs, PRESSURE};
use rom::memory::{InputMemory, Memory, MemorySpec, Slopes};
use rom::model::BlockKind;
use runtime::config::Scene;
use runtime::estimation::{SensorModel, setup};
use serde::Serialize;

/// A model with the stiffness among its inputs.
const MODEL: &str = "models/pneunet-design/pneunet-design.twin";
/// The model itself as the body, of another stiffness: what is left is the estimation's error.
struct Family {
    model: TwinModel,
    /// Inputs of a state, with the stiffness at `at`.
    inputs: Vec<f64>,
    at: usize,
    nominal_mpa: f64,
}

impl Family {
    fn new(model: &rom::model::Model) -> anyhow::Result<Self> {
        let parameter = model.header.parameter(STIFFNESS)?;
        let nominal_mpa = model.header.inputs[parameter].value.context("a nominal stiffness")?;
        let taken: Vec<usize> = model.header.taken_inputs().map(|(index, _)| index).collect();
        let at = taken.iter().position(|at| *at == parameter).context("a position")?;
        let inputs = vec![f64::NAN; taken.len()];
        Ok(Self { model: TwinModel::new(model, Tip::REFERENCE)?, inputs, at, nominal_mpa })
    }
}

impl RestingBody for Family {
    fn answer(&mut self, pressure_mpa: f64, gap_mm: f64, stiffness: f64) -> [f64; 2] {
        self.inputs[self.at] = stiffness * self.nominal_mpa;
        self.model.set_inputs(&self.inputs);
        let point = self.model.at(pressure_mpa, gap_mm);
        [point.force_n, point.observable]
    }
}

const STIFFNESS: &str = "elastomer.law.mu_mpa";
/// Row of the marker's height: force, x, y, z.
const HEIGHT: usize = 2;
/// Steps after which stiffness and gap count as estimated.
const LEARNING: usize = 2;

/// Unknowns of each variant: gap, relative stiffness, bias of the gauge.
const VARIANTS: [(&str, [bool; 3]); 5] = [
    ("none", [false; 3]),
    ("gap", [true, false, false]),
    ("stiffness", [false, true, false]),
    ("gap, stiffness", [true, true, false]),
    ("gap, stiffness, bias", [true; 3]),
];

/// Figures of a plant with one set of unknowns.
#[derive(Debug, Serialize)]
pub struct Row {
    /// Plant.
    pub plant: &'static str,
    /// Its body: another mesh, or the model itself.
    pub body: &'static str,
    /// Estimated quantities.
    pub estimated: &'static str,
    /// Largest error at the end of the steps relative to the target, after the first two.
    pub error: f64,
    /// Relative stiffness and gap in mm at the end, and the true ones.
    pub found: [f64; 2],
    /// True relative stiffness and gap.
    pub truth: [f64; 2],
}

/// All plants and variants.
pub fn measure(bench: &Bench) -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for case in cases() {
        for (estimated, unknowns) in VARIANTS {
            let truth = [case.spec.stiffness, case.spec.true_gap_mm];
            let mut add = |body, (error, found)| {
                rows.push(Row { plant: case.name, body, estimated, error, found, truth });
            };
            add("another mesh", run(&case, unknowns, |_| Ok(Truth::Table(bench.table.clone())))?);
            add("the model", run(&case, unknowns, Family::new)?);
        }
    }
    Ok(rows)
}

/// Largest relative error, then stiffness and gap at the end.
fn run<B: RestingBody>(
    case: &Case,
    [of_gap, of_stiffness, of_bias]: [bool; 3],
    body: impl FnOnce(&rom::model::Model) -> anyhow::Result<B>,
) -> anyhow::Result<(f64, [f64; 2])> {
    let spec = changed(&case.spec, [1.0; 3]);
    let shown_mm = spec.true_gap_mm + case.gap_error_mm;
    let mut model = softtwin::files::model(MODEL.as_ref())?;
    let stiffness = model.header.parameter(STIFFNESS)?;
    let nominal_mpa = model.header.inputs[stiffness].value.context("a nominal stiffness")?;
    let of = InputMemory {
        input: PRESSURE,
        range: model.header.inputs[PRESSURE].range,
        line: None,
        orifice: None,
        play: spec.play.clone(),
        creep: Vec::new(),
        slopes: Slopes::default(),
    };
    let memory = MemorySpec { inputs: vec![of], max_gap_s: 1.0 };
    model.set_record(BlockKind::Memory, &memory)?;
    let mut memory = Memory::new(memory).map_err(|error| anyhow!(error))?;
    let unknown = |is_one: bool, text: String| if is_one { text } else { String::new() };
    let unknowns =
        unknown(of_gap, format!("gap_mm = {{ prior = {shown_mm:?}, sigma = 4.0, drift = 0.0 }}\n"))
            + &unknown(
                of_stiffness,
                format!("\"elastomer.law.mu_mpa\" = {{ prior = {nominal_mpa:?}, sigma = 0.12 }}\n"),
            )
            + &unknown(of_bias, "pressure_bias_mpa = { prior = 0.0, sigma = 0.001, drift = 0.0 }\n".into());
    let scene: Scene = toml::from_str(&format!(
        "name = \"estimated\"\n[[actuator]]\nname = \"finger\"\nmodel = \"{MODEL}\"\n[actuator.estimate]\n{unknowns}\
         [[actuator.marker]]\nname = \"tip\"\nat_mm = {:?}\n[actuator.sigma]\nmodel_mm = 0.2\nmarker_mm = 0.1\n",
        Tip::REFERENCE.at_mm
    ))?;
    let actuator = scene.actuators.first().context("an actuator")?;
    let joined = |errors: Vec<String>| anyhow!(errors.join("; "));
    let mut filter =
        Filter::new(setup(actuator, &model).map_err(joined)?).map_err(|error| anyhow!("{error:?}"))?;
    let mut sensors = SensorModel::new(actuator, &model).map_err(joined)?;
    let taken: Vec<usize> = model.header.taken_inputs().map(|(index, _)| index).collect();
    let settings = Settings { is_measured: false, ..known(&spec) };
    let held = TwinModel::new(&model, Tip::REFERENCE)?;
    let mut law = Controller::new(held, Quantity::Force, settings, Limits::default());
    let mut plant = Plant::new(spec, body(&model)?);
    let (mut found, mut worst, mut cycle) = ([nominal_mpa, shown_mm], 0.0_f64, 0_u64);
    for (index, target) in TARGETS_N.iter().enumerate() {
        let count = (HOLD_S * RATE_HZ) as usize;
        let (mut sum_n, mut bias_mpa) = (0.0, 0.0);
        for step in 0..count {
            let shown = plant.step(1.0 / RATE_HZ);
            cycle += 1;
            let inputs = Inputs::new(shown.pressure_mpa, shown_mm);
            memory.advance((1e9 * cycle as f64 / RATE_HZ) as u64, &inputs);
            if of_gap || of_stiffness {
                let mut measurement = Measurement::at(cycle as f64 / RATE_HZ);
                measurement.inputs = *memory.effective(&inputs).values();
                measurement.spread = memory.spreads();
                measurement.rows[HEIGHT] = shown.observable;
                let update = filter.update(&measurement, &mut sensors);
                let values: Vec<f64> = taken.iter().map(|index| update.inputs[*index]).collect();
                if of_bias {
                    bias_mpa = measurement.inputs[PRESSURE] - update.inputs[PRESSURE];
                }
                found = [update.inputs[stiffness], update.inputs[rom::inputs::GAP]];
                law.model_mut().set_inputs(&values);
            }
            let reading = Reading {
                pressure_mpa: shown.pressure_mpa - bias_mpa,
                gap_mm: found[1],
                measured: f64::NAN,
                written_mpa: f64::NAN,
            };
            let answer = law.update(&|_| Target::step(*target), reading, 1.0 / RATE_HZ);
            if let Some(fault) = answer.fault {
                return Err(anyhow!("{}: {}", case.name, fault.name()));
            }
            plant.command(answer.pressure_mpa);
            if step >= count - RATE_HZ as usize {
                sum_n += shown.true_force_n / RATE_HZ;
            }
        }
        if index >= LEARNING {
            worst = worst.max((sum_n / target - 1.0).abs());
        }
    }
    Ok((worst, [found[0] / nominal_mpa, found[1]]))
}

/// As a table.
pub fn text(rows: &[Row]) -> String {
    let line = |row: &Row| {
        let Row { plant, body, estimated, error, found: [k, gap_mm], truth: [true_k, true_gap_mm] } = row;
        let error = 100.0 * error;
        format!(
            "| {plant} | {body} | {estimated} | {error:.1} | {k:.3} ({true_k}) | {gap_mm:.1} ({true_gap_mm}) |\n"
        )
    };
    let head = "| plant, no load cell | its body | estimated by a marker | error at the end, % of the target | stiffness (true) | gap, mm |\n| --- | --- | --- | --- | --- | --- |\n";
    rows.iter().fold(head.to_owned(), |text, row| text + &line(row))
}
