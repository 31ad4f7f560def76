//! A twin of states that another program solved: model, its errors, and a scene that replays a sweep of the first input that varies.

use super::folder::Folder;
use super::report::{BuildError, BuildNotice, Built, Notify};
use formats::database::obstacle_kinds;
use formats::{FormatError, file};
use rom::inputs::{GAP, InputSpec, PARAMETERS};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Rows of the sweep, there and back, and the time between two (s).
const ROWS: usize = 200;
const PERIOD_S: f64 = 0.05;

/// A twin of imported states.
#[derive(Debug, Serialize)]
pub struct ImportedReport {
    /// The model.
    pub model: PathBuf,
    /// The scene, which replays the sweep until it has a sensor.
    pub scene: PathBuf,
    /// The readings that it replays.
    pub sweep: PathBuf,
    /// Names of the model's inputs.
    pub inputs: Vec<String>,
    /// What the training found.
    pub notes: Vec<String>,
    /// The inputs as options of `softtwin predict`, in the middle of their ranges.
    #[serde(skip)]
    pub middle: String,
}

/// Trains on the database of a folder, measures the model and writes a scene with a sweep.
///
/// # Errors
/// The database cannot be read or trained on; I/O errors.
pub fn build_imported(path: &Path, notify: Notify<'_>) -> Result<Built<ImportedReport>, BuildError> {
    let (folder, database) = (Folder { path, notify }, path.join("database"));
    let kind = obstacle_kinds(&database)?.first().copied();
    let kind = kind.ok_or_else(|| FormatError::refused(&database, "no states"))?;
    let trained = folder.train(&database, kind)?;
    (folder.notify)(BuildNotice::Begins("measuring the model"));
    let (quality, held_out) = trained.quality()?;
    let header = &trained.model.header;
    // An input without a range is one that no state had.
    let has_range = |(_, input): &(usize, &InputSpec)| input.range.iter().all(|end| end.is_finite());
    let inputs: Vec<(usize, &InputSpec)> = header.inputs.iter().enumerate().filter(has_range).collect();
    let (scene, sweep) = (path.join("scene.toml"), path.join("sweep.csv"));
    file::replace(&sweep, sweep_text(&inputs).as_bytes())?;
    folder.replace("scene", &scene, &scene_text(&header.actuator, &inputs))?;
    let report = ImportedReport {
        model: trained.path.clone(),
        scene,
        sweep,
        inputs: inputs.iter().map(|(_, input)| input.key()).collect(),
        notes: trained.sheet.remarks.clone(),
        middle: inputs.iter().map(option).collect(),
    };
    Ok(Built { report, quality, held_out, remarks: Vec::new() })
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
