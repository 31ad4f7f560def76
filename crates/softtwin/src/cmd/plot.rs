//! `softtwin plot`.

mod recording;
mod sweep;

use crate::bench;
use crate::failure::usage;
use crate::files;
use crate::output;
use crate::picture::{Axis, Figure, Map, Mark, Panel, Series};
use formats::database::ObstacleKind;
use rom::evaluator::Evaluator;
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::Model;
use rom::regime::OnsetTable;
use rom::snapshots::{Database, RegimeKind, Split};
use std::path::PathBuf;
use sweep::CELLS;
pub use sweep::observables;

const EXAMPLES: &str = "\
Examples:
  Contact force over pressure and gap, with the onset curve and the training states:
    softtwin plot force-map --model finger.twin \\
      --database models/pneunet/database --out force.png
  How fast the singular values fall, by regime and group:
    softtwin plot singular-values --model finger.twin --out modes.svg
  The leading modal coefficients over each input, the others at the middle of their ranges:
    softtwin plot coefficients --model finger.twin --out coefficients.svg
  Angles, lengths, positions, or the outputs of a measured model, with half-widths:
    softtwin plot observables --model finger.twin --out observables.svg
  A recording: pressure, gap, force, observables, displacement, stress and latency over time (displacement and stress by the model):
    softtwin plot recording --recording run.mcap --model finger.twin \\
      --out run.png
  A table of a bench: its inputs and outputs over time:
    softtwin plot recording --recording run1.csv --log log.toml --out run.png
The modes themselves are drawn by `softtwin render --modes`.";

/// Draw what a model has learnt, or what a recording holds.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Quantities to draw.
    #[arg(value_enum)]
    kind: Kind,
    /// Model file.
    #[arg(long, value_name = "FILE.twin", required_unless_present = "recording")]
    model: Option<PathBuf>,
    /// Recording to draw: MCAP, or a table with --log.
    #[arg(long, value_name = "FILE", required_if_eq("kind", "recording"))]
    recording: Option<PathBuf>,
    /// Mapping of the columns of a bench's table.
    #[arg(long, value_name = "FILE.toml", requires = "recording", conflicts_with = "model")]
    log: Option<PathBuf>,
    /// Picture: .svg or .png.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Database whose states are marked in the force map.
    #[arg(long, value_name = "DIR")]
    database: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Kind {
    /// Contact force over pressure and gap.
    ForceMap,
    /// Singular values by regime and group.
    SingularValues,
    /// Leading modal coefficients of the free regime over its inputs.
    Coefficients,
    /// Observables of the free regime, outputs of a measured model, over the inputs.
    Observables,
    /// A recording over time.
    Recording,
}

impl Args {
    /// Draws the picture and prints its name.
    pub fn run(self) -> anyhow::Result<()> {
        let figure = match self.kind {
            Kind::Recording => self.recording()?,
            _ => self.of_model()?,
        };
        figure.save(&self.out)?;
        output!("{}", self.out.display())?;
        Ok(())
    }

    fn recording(&self) -> anyhow::Result<Figure> {
        let path = self.recording.as_ref().ok_or_else(|| usage("which recording? --recording FILE.mcap"))?;
        if let Some(log) = &self.log {
            let recording = bench::read(path, &bench::mapping(log)?)?;
            return Ok(bench::figure(&recording, &path.display().to_string()));
        }
        let model = self.model.as_ref().map(|path| files::model(path)).transpose()?;
        recording::figure(path, model.as_ref())
    }

    fn of_model(&self) -> anyhow::Result<Figure> {
        let path = self.model.as_ref().ok_or_else(|| usage("which model? --model FILE.twin"))?;
        let model = files::model(path)?;
        Ok(match self.kind {
            Kind::ForceMap => {
                let database = self
                    .database
                    .as_ref()
                    .map(|dir| files::database(dir, ObstacleKind::Plate))
                    .transpose()?;
                force_map(&model, database.as_ref())?
            }
            Kind::SingularValues => singular_values(&model),
            Kind::Observables => observables(&model)?,
            Kind::Coefficients | Kind::Recording => sweep::coefficients(&model)?,
        })
    }
}

fn force_map(model: &Model, database: Option<&Database>) -> anyhow::Result<Figure> {
    let contact = model.regime(RegimeKind::Contact).filter(|regime| regime.inputs.dimensions() == 2);
    let range = |input| contact.and_then(|regime| regime.inputs.range(input));
    let (Some(pressures), Some(gaps)) = (range(PRESSURE), range(GAP)) else {
        return Err(usage(
            "force-map: expected a model with a contact regime over pressure and gap; `softtwin inspect` shows its regimes",
        ));
    };
    let (x, y) = ([0.0, pressures[1]], gaps);
    let evaluator = Evaluator::new(&model.header)?;
    let mut evaluation = evaluator.evaluation();
    let mut values = Vec::with_capacity(CELLS * CELLS);
    for row in 0..CELLS {
        for column in 0..CELLS {
            let centre = |range: [f64; 2], i: usize| {
                range[0] + (i as f64 + 0.5) / CELLS as f64 * (range[1] - range[0])
            };
            evaluator.evaluate(Inputs::new(centre(x, column), centre(y, row)), &mut evaluation);
            values.push(evaluation.contact_force_n);
        }
    }
    let mut series: Vec<Series> = model.header.onset.iter().map(|table| onset_curve(table, x, y)).collect();
    for (name, split, colour) in
        [("training states", Split::Train, 4), ("test and check states", Split::Test, 5)]
    {
        let same = |s: Split| (s == Split::Train) == (split == Split::Train);
        let cases = database
            .iter()
            .flat_map(|d| &d.cases)
            .filter(|c| c.regime == RegimeKind::Contact && same(c.split));
        let seen = cases.filter_map(|c| Some((c.pressure_mpa, c.gap_mm?)));
        let points: Vec<(f64, f64)> = seen.filter(|(p, g)| *p <= x[1] && (y[0]..=y[1]).contains(g)).collect();
        if !points.is_empty() {
            series.push(Series { name: name.into(), colour, mark: Mark::Dots, points });
        }
    }
    let map = Map { label: "contact force [N]".into(), x, y, columns: CELLS, values };
    let panel = Panel {
        title: String::new(),
        x: Axis::linear("pressure [MPa]"),
        y: Axis::linear("gap [mm]"),
        series,
        map: Some(map),
    };
    Ok(Figure::one(&format!("Contact force of {}", model.header.actuator), panel))
}

fn onset_curve(table: &OnsetTable, x: [f64; 2], y: [f64; 2]) -> Series {
    let points = table.pressure_mpa.iter().copied().zip(table.gap_mm.iter().copied());
    let inside = points.filter(|(p, g)| (x[0]..=x[1]).contains(p) && (y[0]..=y[1]).contains(g));
    Series { name: "onset pressure".into(), colour: 1, mark: Mark::Line, points: inside.collect() }
}

fn singular_values(model: &Model) -> Figure {
    let panel = |regime: &rom::model::RegimeModel| Panel {
        title: format!("Regime {}", regime.kind.name()),
        x: Axis::linear("mode"),
        y: Axis::log("singular value / largest"),
        series: regime
            .groups
            .iter()
            .enumerate()
            .map(|(i, group)| {
                let largest = group.singular_values.first().copied().unwrap_or(1.0);
                let values = group.singular_values.iter().enumerate().filter(|(_, s)| **s > 1e-14 * largest);
                Series {
                    name: format!("{} ({} kept)", group.name, group.coefficients.len()),
                    colour: i,
                    mark: Mark::LineDots,
                    points: values.map(|(k, s)| (k as f64 + 1.0, s / largest)).collect(),
                }
            })
            .collect(),
        map: None,
    };
    let panels: Vec<Panel> = model.header.regimes.iter().map(panel).collect();
    Figure {
        title: format!("Singular values of {}", model.header.actuator),
        columns: panels.len().max(1),
        panels,
    }
}
