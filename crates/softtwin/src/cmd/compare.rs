//! `softtwin compare`.

use crate::failure::{configuration, usage};
use crate::picture::canvas::Canvas;
use crate::picture::scene::Block;
use crate::picture::skin::{DrawnBody, distances, marker_mm};
use crate::picture::states::{DrawnState, Group, Look, ShownField, View, draw};
use crate::picture::theme::ThemeName;
use crate::picture::visible::visible_facets;
use crate::picture::{Figure, Panel, Series as Line};
use crate::{files, output, report};
use anyhow::Context;
use formats::log::{LogColumn, Recording};
use formats::table::to_text;
use rom::model::Model;
use runtime::config::{BIASES, Scene};
use std::path::{Path, PathBuf};
use train::comparison::{ComparedOutput, RecordedBody, RecordedInputs, SensorBiases, compare};

/// Width of a body in the picture.
const PANEL_PX: u16 = 520;

const EXAMPLES: &str = "\
Examples:
  A model against a run that it has not seen, as a table and as pictures:
    softtwin compare mine.twin --recording run2.csv --log log.toml \\
      --out compared
  The same as one JSON object:
    softtwin compare mine.twin --recording run2.csv --log log.toml \\
      --out compared --json

  A scene before and after its calibration, on one page:
    softtwin compare calibrated.toml --before finger.toml \\
      --recording run2.csv --log log.toml --out compared

A scene stands for its actuator's model with the inputs that it gives, or the priors that it estimates. Outputs are named as in the mapping: `tip_x_mm` is the coordinate x at the node set `tip`; `contact_force_n` is the contact force; \
observables have their name. \
Coverage is the fraction of the values within the model's half-widths.";

/// Say how far a model is from a recording of a bench: errors, coverage, pictures.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Model file, or a scene with one actuator.
    #[arg(value_name = "FILE")]
    model: PathBuf,
    /// Another model file or scene, shown beside it; default: none.
    #[arg(long, value_name = "FILE")]
    before: Option<PathBuf>,
    /// Times of the body with its markers, s; default: where the input that moves most has 0, 50 and 100 % of its range.
    #[arg(long, value_name = "S,...", value_delimiter = ',', value_parser = crate::range::number(0.0, 1e6))]
    at_s: Vec<f64>,
    /// Recording.
    #[arg(long, value_name = "FILE")]
    recording: PathBuf,
    /// Mapping of the columns.
    #[arg(long, value_name = "FILE.toml")]
    log: PathBuf,
    /// Folder for the pictures and the table.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Correct a model learned from measurements by an offset that follows the measured outputs, known up to this time ago, s; default: none.
    #[arg(long, value_name = "S", value_parser = crate::range::number(0.0, 1e6))]
    follow: Option<f64>,
    /// One JSON object instead of text.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Compares and writes pictures and table.
    pub fn run(self) -> anyhow::Result<()> {
        let (model, biases) = subject(&self.model)?;
        let recording = files::bench_run(&self.recording, &self.log)?;
        let mut found = compare(&model, &recording, biases, self.follow).map_err(files::not_compared)?;
        let mut earlier = Vec::new();
        if let Some(path) = &self.before {
            let (model, biases) = subject(path)?;
            let before = compare(&model, &recording, biases, None).map_err(files::not_compared);
            let before = before.with_context(|| format!("--before {}", path.display()))?;
            (found.before, earlier) = (Some(before.outputs), before.series);
        }
        formats::file::create_folder(&self.out)?;
        let inputs = RecordedInputs::new(&model.header, &recording, biases, &mut Vec::new());
        let inputs = inputs.map_err(files::not_compared)?;
        figure(&recording, inputs.widest(), &found.series, &earlier).save(&self.out.join("compare.svg"))?;
        files::save(&self.out.join("compare.csv"), table(&recording, &found.series).as_bytes())?;
        let bodies = inputs.bodies(&model, &self.at_s).map_err(files::not_compared)?;
        if !bodies.is_empty() {
            body(&model, bodies)?.write_png(&self.out.join("body.png"))?;
        }
        report::print(&found, self.json)?;
        if !self.json {
            output!("pictures and table: {}", self.out.display())?;
        }
        Ok(())
    }
}

/// A model file, or a scene with one actuator: its model with the inputs that it gives or estimates, and the biases of its sensors.
fn subject(path: &Path) -> anyhow::Result<(Model, SensorBiases)> {
    if path.extension().is_none_or(|ending| ending != "toml") {
        return Ok((files::model(path)?, SensorBiases::default()));
    }
    let scene = Scene::load(path).map_err(configuration)?;
    let [spec] = scene.actuators.as_slice() else {
        let found = scene.actuators.len();
        return Err(usage(format!("{}: expected a scene with one actuator, found {found}", path.display())));
    };
    let mut model = files::model(&spec.model)?;
    let estimated = spec.estimate.iter().map(|(name, unknown)| (name.as_str(), unknown.prior));
    let of_model = estimated.filter(|(name, _)| !BIASES.contains(name) && *name != "gap_mm");
    let given = model.header.set_parameters(spec.given_inputs().chain(of_model));
    given.map_err(configuration).with_context(|| path.display().to_string())?;
    let bias = |name: &str| spec.estimate.get(name).map_or(0.0, |unknown| unknown.prior);
    Ok((model, SensorBiases { pressure_mpa: bias(BIASES[0]), force_n: bias(BIASES[1]) }))
}

/// The body with its measured markers, instants side by side.
fn body(model: &Model, bodies: Vec<RecordedBody>) -> anyhow::Result<Canvas> {
    let rest = model.undeformed_nodes_mm().unwrap_or_default();
    let (facets, size) = (visible_facets(&rest, model.facets()), marker_mm(&rest));
    let block = |at: &[f32; 3]| Block { min_mm: at.map(|v| v - size), max_mm: at.map(|v| v + size) };
    let state = |recorded: RecordedBody| DrawnState {
        body: if facets.is_empty() {
            DrawnBody::of_markers(&recorded.nodes_mm, &rest)
        } else {
            DrawnBody {
                values: distances(&recorded.nodes_mm, &rest),
                nodes_mm: recorded.nodes_mm,
                facets: facets.clone(),
            }
        },
        plate: None,
        blocks: recorded.markers_mm.iter().map(block).collect(),
        force_n: 0.0,
        outside: recorded.is_outside,
        title: format!("{:.2} s", recorded.time_s),
    };
    let group = Group { heading: String::new(), states: bodies.into_iter().map(state).collect() };
    let look = Look {
        field: ShownField::Displacement,
        range: None,
        view: View::Oblique,
        theme: ThemeName::Light,
        width: Some(PANEL_PX),
    };
    draw(&look, &[group], Some("Model and measured markers"), "Blocks: measured markers.".into())
}

fn figure(
    recording: &Recording,
    main: Option<&LogColumn>,
    outputs: &[ComparedOutput],
    before: &[ComparedOutput],
) -> Figure {
    let mut panels = Vec::new();
    let time_s = || recording.time_s.iter().copied();
    for output in outputs {
        let name = output.name.as_str();
        let earlier = before.iter().find(|earlier| earlier.name == output.name);
        let over = |x: &[f64]| {
            let line = |name: &str, colour, y: &[f64]| {
                Line::line(name, colour, x.iter().copied().zip(y.iter().copied()))
            };
            let mut lines =
                vec![line("measured", 0, &output.measured), line("predicted", 1, &output.predicted)];
            lines.extend(earlier.map(|earlier| line("before", 2, &earlier.predicted)));
            lines
        };
        panels.push(Panel::new(name, "time [s]", name, over(&recording.time_s)));
        if let Some(main) = main {
            panels.push(Panel::new("loops", main.name.as_str(), name, over(&main.values)));
        }
        let residuals = |name: &str, colour, predicted: &[f64]| {
            let errors = output.measured.iter().zip(predicted).map(|(m, p)| m - p);
            Line::line(name, colour, time_s().zip(errors))
        };
        let band = |sign: f64| Line::line("", 4, time_s().zip(output.half_width.iter().map(|h| sign * h)));
        let earlier = earlier.map(|earlier| residuals("before", 2, &earlier.predicted));
        let own = residuals("measured minus predicted", 0, &output.predicted);
        let lines = earlier.into_iter().chain([own, band(1.0), band(-1.0)]).collect();
        panels.push(Panel::new("residuals and half-widths", "time [s]", name, lines));
    }
    Figure { title: "model and measurement".into(), panels, columns: if main.is_some() { 3 } else { 2 } }
}

fn table(recording: &Recording, outputs: &[ComparedOutput]) -> String {
    let columns = ["measured", "predicted", "half_width"];
    let named = outputs.iter().flat_map(|output| columns.map(|column| format!("{}_{column}", output.name)));
    let header: Vec<String> = std::iter::once("t_s".to_owned()).chain(named).collect();
    let row = |(row, t_s): (usize, &f64)| {
        let values =
            |output: &ComparedOutput| [output.measured[row], output.predicted[row], output.half_width[row]];
        std::iter::once(*t_s).chain(outputs.iter().flat_map(values)).collect::<Vec<_>>()
    };
    to_text(
        &header.iter().map(String::as_str).collect::<Vec<_>>(),
        recording.time_s.iter().enumerate().map(row),
    )
}
