//! A twin of states that another program solved: model, its errors, and a scene that replays a sweep of the first input that varies.

use super::folder::{Folder, QualityReport, quality_report};
use crate::files::{self, quoted, refusal, save};
use crate::progress::Doing;
use crate::{output, report};
use anyhow::{Context, Result};
use formats::database::obstacle_kinds;
use rom::inputs::{GAP, InputSpec, PARAMETERS};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Rows of the sweep, there and back, and the time between two (s).
const ROWS: usize = 200;
const PERIOD_S: f64 = 0.05;

/// A twin of imported states.
#[derive(Serialize)]
struct ImportedReport {
    model: PathBuf,
    scene: PathBuf,
    sweep: PathBuf,
    inputs: Vec<String>,
    notes: Vec<String>,
    quality: QualityReport,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    remarks: Vec<String>,
}

/// Trains on an existing database, reports the model's errors and how the twin is started.
///
/// # Errors
/// The database cannot be read or trained on; I/O errors.
pub fn build(folder: &Folder<'_>, database: &Path) -> Result<()> {
    let kinds = obstacle_kinds(database).map_err(refusal)?;
    let kind = kinds.first().copied().with_context(|| format!("{}: no states", database.display()))?;
    let doing = Doing::default();
    let _heartbeat = doing.heartbeat();
    let (model, notes, data) = folder.train(database, kind, &doing)?;
    let quality = folder.quality(&model, &data)?;
    let header = files::model(&model)?.header;
    // An input without a range is one that no state had.
    let inputs: Vec<(usize, &InputSpec)> = header
        .inputs
        .iter()
        .enumerate()
        .filter(|(_, input)| input.range.iter().all(|end| end.is_finite()))
        .collect();
    let (scene, sweep) = (folder.path.join("scene.toml"), folder.path.join("sweep.csv"));
    save(&sweep, sweep_text(&inputs).as_bytes())?;
    folder.replace("scene", &scene, &scene_text(&header.actuator, &inputs))?;
    let more_states = "more simulations near these states: softtwin import results";
    let (quality, mut remarks) = quality_report(quality, more_states, folder.json);
    if !folder.json {
        let options: String = inputs.iter().map(option).collect();
        let (model, scene, name) = (quoted(&model), quoted(&scene), &header.actuator);
        remarks.push(format!(
            "start it, with the readings of {} until the scene has a sensor:\n  softtwind twin --scene {scene}\n  softtwind bridge \
             --scene {scene} --loop\n  softtwin view --scene {scene}      in a browser; or: softtwin echo 'softtwin/{name}/state'\nask it \
             without starting it:\n  softtwin predict {model}{options}",
            sweep.display()
        ));
        output!("")?;
    }
    let inputs = inputs.iter().map(|(_, input)| input.key()).collect();
    report::print(&ImportedReport { model, scene, sweep, inputs, notes, quality, remarks }, folder.json)
}

/// Place of the input that is swept: the first that varies.
fn swept(inputs: &[(usize, &InputSpec)]) -> usize {
    inputs.iter().position(|(_, input)| input.range[0] < input.range[1]).unwrap_or(0)
}

fn middle(input: &InputSpec) -> f64 {
    0.5 * (input.range[0] + input.range[1])
}

/// How `softtwin predict` is given the middle of an input's range.
fn option((at, input): &(usize, &InputSpec)) -> String {
    match *at {
        at if at < PARAMETERS => format!(" --{} {:.4}", ["pressure", "gap"][at], middle(input)),
        _ => format!(" --set {}={:.4}", input.key(), middle(input)),
    }
}

/// The first input that varies, through its range and back; also pressure and gap if the model has them.
fn sweep_text(inputs: &[(usize, &InputSpec)]) -> String {
    let swept = swept(inputs);
    let is_column = |(place, (at, _)): &(usize, &(usize, &InputSpec))| *place == swept || *at < PARAMETERS;
    let columns: Vec<(usize, &(usize, &InputSpec))> = inputs.iter().enumerate().filter(is_column).collect();
    let mut text = String::from(
        "# A sweep of the first input, made by `softtwin build`; further inputs are in the scene.\nt_s",
    );
    columns.iter().for_each(|(_, (_, input))| text.extend([",", &input.key()]));
    text.push('\n');
    for row in 0..ROWS {
        let share = 1.0 - (1.0 - 2.0 * row as f64 / (ROWS - 1) as f64).abs();
        let _ = write!(text, "{:.2}", row as f64 * PERIOD_S); // into memory
        for (place, (_, input)) in &columns {
            let [low, high] = input.range;
            let value = if *place == swept { low + share * (high - low) } else { middle(input) };
            let _ = write!(text, ",{value}");
        }
        text.push('\n');
    }
    text
}

/// The scene: the swept input is measured, other parameters are given.
fn scene_text(name: &str, inputs: &[(usize, &InputSpec)]) -> String {
    let swept = swept(inputs);
    let parameter = |(place, (_, input)): (usize, &(usize, &InputSpec))| {
        let [low, high] = input.range;
        match place == swept {
            true => format!("{} = {{ min = {low:?}, max = {high:?} }}   # measured\n", input.key()),
            false => format!("{} = {:?}   # given; {low} to {high}\n", input.key(), middle(input)),
        }
    };
    let parameters = inputs.iter().enumerate().filter(|(_, (at, _))| *at > GAP);
    let parameters: String = parameters.map(parameter).collect();
    let table =
        if parameters.is_empty() { String::new() } else { format!("\n[actuator.inputs]\n{parameters}") };
    format!(
        "# Scene of {name}, made by `softtwin build`. Every key is explained in OPERATIONS.md, sensors in docs/sensors.md.\n\
         #   softtwind twin --scene scene.toml, and softtwind bridge --scene scene.toml --loop\n\
         name = \"{name}\"\n\n\
         [[actuator]]\n\
         name = \"{name}\"\n\
         model = \"{name}.twin\"\n\
         queries = \"fields\"\n{table}\n\
         [actuator.source]                # a sweep; for a device: [actuator.sensors.NAME]\n\
         kind = \"replay\"\n\
         trace = \"sweep.csv\"\n\n\
         [[actuator.output]]              # softtwin/{name}/field\n\
         nodes = \"all\"\n"
    )
}
