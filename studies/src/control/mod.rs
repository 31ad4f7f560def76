//! `softtwin-studies control`: the controller on a plant of a second mesh: steps, disturbance, noise, its own time.

mod bench;
mod figures;
mod picture;
mod random;
mod table;
mod timing;
mod trial;

use crate::plant::table::PlantTable;
use bench::Bench;
use control::law::Settings;
use serde_json::json;
use softtwin::failure::configuration;
use softtwin::output;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  Everything, with a picture:
    softtwin-studies control --model models/pneunet/pneunet.twin --out docs/images/control.png
  1,000 random steps only:
    softtwin-studies control --model models/pneunet/pneunet.twin --steps 1000
  A new table of the plant, on another mesh:
    softtwin mesh --actuator second.toml --size-mm 9            (second.toml: models/pneunet/actuator.toml with mesh.file =
                                                                 \"second.vtu\" and mesh.nodes = 0)
    softtwin simulate --actuator second.toml --cases studies/data/plant_cases.csv --out target/plant
    softtwin-studies control --database target/plant --out studies/data/plant.csv";

const NOTES: &str = "\
The plant is studies/data/plant.csv behind a valve (20 ms), a line (60 ms) and a delay (10 ms); the controller's model
is --model. Its own time is that of this build: measure a release build on a quiet machine.";

/// Try the controller: step response, disturbance, noise, random steps with a wrong model, time of a control cycle.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    /// The controller's model.
    #[arg(long, value_name = "FILE.twin", default_value = "models/pneunet/pneunet.twin")]
    model: PathBuf,
    /// Random steps (10 to 1000000).
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(10..=1_000_000))]
    steps: u32,
    /// Seed of the random steps.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Make the plant's table of this database of a second mesh instead.
    #[arg(long, value_name = "DIR", requires = "out")]
    database: Option<PathBuf>,
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
        if let (Some(database), Some(out)) = (&self.database, &self.out) {
            return table::write(database, out);
        }
        let model = softtwin::files::model(&self.model)?;
        let table = PlantTable::shipped().map_err(configuration)?;
        let bench = Bench { model, table, settings: Settings::default() };
        let figures = figures::measure(&bench)?;
        if let Some(out) = &self.out {
            picture::draw(&figures).save(out)?;
        }
        let random = random::measure(&bench, self.steps as usize, self.seed)?;
        let times = timing::measure(&bench)?;
        if self.json {
            return output::json(&json!({ "figures": figures.json(), "random": random, "turn": times }));
        }
        output!("{}{}{}", figures.text(), random::text(&random), timing::text(&times))?;
        Ok(())
    }
}
