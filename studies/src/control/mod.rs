//! `softtwin-studies control`: the controller and other laws on plants of a second mesh; time of a control cycle.

mod compare;
mod estimated;
mod laws;
mod table;
mod timing;

use crate::plant::table::PlantTable;
use compare::{Bench, Row, Runs};
use serde_json::json;
use softtwin::failure::configuration;
use softtwin::output;
use softtwin::picture::{Axis, Figure, Mark, Panel, Series};
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  Everything, with a picture:
    softtwin-studies control --model models/pneunet/pneunet.twin --out docs/images/control.png
  A new table of the plants' body, on another mesh:
    softtwin mesh --actuator second.toml --size-mm 9            (second.toml: models/pneunet/actuator.toml with mesh.file =
                                                                 \"second.vtu\" and mesh.nodes = 0)
    softtwin simulate --actuator second.toml --cases studies/data/plant_cases.csv --out target/plant
    softtwin-studies control --database 1=target/plant --database 0.9=target/softer --out studies/data/plant.csv       (0.9: another mu_mpa)";

const NOTES: &str = "\
The plants' body is studies/data/plant.csv; the controller's model is --model, its settings are the plants' line, play, delay and swing as known. \
The time of a cycle is that of this build: measure a release build on a quiet machine.";

/// Compare the controller with other laws on three plants, and time a control cycle.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    /// The controller's model.
    #[arg(long, value_name = "FILE.twin", default_value = "models/pneunet/pneunet.twin")]
    model: PathBuf,
    /// Make the plants' table of these databases of a second mesh instead, each with its relative shear modulus.
    #[arg(long, value_name = "STIFFNESS=DIR", requires = "out")]
    database: Vec<String>,
    /// The picture (.svg, .png), or with --database the table.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// One JSON object.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        if let (false, Some(out)) = (self.database.is_empty(), &self.out) {
            return table::write(&self.database, out);
        }
        let model = softtwin::files::model(&self.model)?;
        let bench = Bench { model, table: PlantTable::shipped().map_err(configuration)? };
        let (rows, runs) = compare::measure(&bench)?;
        if let Some(out) = &self.out {
            draw(&runs).save(out)?;
        }
        let estimated = estimated::measure(&bench)?;
        let times = timing::measure(&bench)?;
        if self.json {
            return output::json(&json!({ "rows": rows, "without_load_cell": estimated, "cycle": times }));
        }
        let lines: String = rows.iter().map(Row::text).collect();
        output!("{}{lines}\n{}\n{}", Row::HEAD, estimated::text(&estimated), timing::text(&times))?;
        Ok(())
    }
}

/// Interval of the drawn control cycles.
const EVERY: usize = 5;

/// Target and truth of the force over time on the first plant, one panel a law.
fn draw(runs: &Runs) -> Figure {
    let panel = |(law, moments): &(&'static str, Vec<control::trial::Moment>)| {
        let series = |name: &str, colour: usize, value: fn(&control::trial::Moment) -> f64| Series {
            name: name.into(),
            colour,
            mark: Mark::Line,
            points: moments.iter().step_by(EVERY).map(|moment| (moment.time_s, value(moment))).collect(),
        };
        Panel {
            title: (*law).into(),
            x: Axis::linear("time (s)"),
            y: Axis::linear("contact force (N)"),
            series: vec![
                series("target", 2, |moment| moment.target),
                series("truth", 0, |moment| moment.truth),
            ],
            map: None,
        }
    };
    Figure {
        title: "Steps of the force on the first plant".into(),
        panels: runs.iter().map(panel).collect(),
        columns: 1,
    }
}
