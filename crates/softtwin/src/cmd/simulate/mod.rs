//! `softtwin simulate`: finite-element states of an actuator, one, a path, or a whole database; and its motion in time.

pub mod batch;
mod path;
mod single;
mod transient;

use crate::failure::usage;
use crate::files;
use crate::options::{ActuatorFile, setting};
use fem::MM3_PER_MG;
use fem::actuator::Setting;
use fem::cases::MAX_MM3;
use fem::transient::{MotionOptions, StepSettings};
use single::Driven;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  One state as an array, nodes x (x, y, z, displacement, von Mises); force and volume as JSON:
    softtwin simulate --actuator models/pneunet/actuator.toml \\
      --pressure 0.05 --gap 40 --out state.npy
  No obstacle, for ParaView:
    softtwin simulate --actuator models/pneunet/actuator.toml \\
      --pressure 0.05 --out state.vtu
  A path from rest in 10 steps, one JSON line a step:
    softtwin simulate --actuator models/pneunet/actuator.toml \\
      --pressure 0.07 --gap 40 --steps 10
  A given injected volume, the pressure being a result; and the whole path, through its limits of pressure:
    softtwin simulate --actuator block/actuator.toml --volume-mm3 900
    softtwin simulate --actuator block/actuator.toml --volume-mm3 9000 --path --out path
  Softer silicone and a thinner wall:
    softtwin simulate --actuator models/pneunet/actuator.toml \\
      --set elastomer.law.mu_mpa=0.7 --set chambers.length_mm=3.2 \\
      --pressure 0.05 --out state.npy
  A whole database, two cases at a time; stop it and start it again as you like:
    softtwin simulate --actuator models/pneunet/actuator.toml \\
      --cases models/pneunet/cases.csv --out database
    softtwin train --database database --out finger.twin

  A list with a column volume_mm3 in place of pressure_mpa gives volumes; the pressure is then a field of the database.

  Motion in time along a trace (t_s, pressure_mpa; gap_mm and keys of actuator.toml if given):
    softtwin simulate --actuator models/pneunet/actuator.toml \\
      --trace swing.csv --out swing

A motion starts from the static equilibrium of the trace's first row; inputs are linear between the rows. OUT/series.csv has a row for each
row of the trace and in between at least every --step-ms. Stopped and started again, it continues.

A database run keeps every solved state in OUT/states: what is there is not computed again. Needs about 1 GB a thread.

Several machines: config/batch has a SLURM array and a Snakefile that split the list.";

/// Compute states of an actuator with the finite-element solver.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    geometry: ActuatorFile,
    /// Cavity pressure in MPa, at least 0.
    #[arg(long = "pressure", value_name = "MPA", allow_negative_numbers = true, required_unless_present_any = ["cases", "trace", "volume_mm3", "gas_mg"], value_parser = crate::range::pressure_mpa, help_heading = "State")]
    pressure_mpa: Option<f64>,
    /// Injected volume in mm3 in place of the pressure, which is then a result: that of the cavity minus that of the undeformed one.
    #[arg(long, value_name = "MM3", allow_negative_numbers = true, conflicts_with_all = ["pressure_mpa", "cases", "trace"], value_parser = crate::range::number(0.0, MAX_MM3), help_heading = "State")]
    volume_mm3: Option<f64>,
    /// Air added to the cavity and its supply in mg, at 20 degrees Celsius, in place of the pressure, which is then a result.
    #[arg(long, value_name = "MG", allow_negative_numbers = true, requires = "dead_volume_mm3", conflicts_with_all = ["pressure_mpa", "volume_mm3", "cases", "trace"], value_parser = crate::range::number(0.0, MAX_MM3 / MM3_PER_MG), help_heading = "State")]
    gas_mg: Option<f64>,
    /// Volume of the supply connected to the cavity: tube, syringe, tank (mm3).
    #[arg(long, value_name = "MM3", allow_negative_numbers = true, requires = "gas_mg", value_parser = crate::range::number(0.0, MAX_MM3), help_heading = "State")]
    dead_volume_mm3: Option<f64>,
    /// Follow the equilibrium path from rest to --volume-mm3 through limits of pressure and volume: a table with the stability of each
    /// state, then the limits and the next stable state beyond each. --out is a folder for path.csv and path.png.
    #[arg(long, requires = "volume_mm3", help_heading = "State")]
    path: bool,
    /// Gap from the underside of the undeformed base to the obstacle in mm; no obstacle when left out.
    #[arg(long = "gap", value_name = "MM", allow_negative_numbers = true, conflicts_with_all = ["cases", "trace"], value_parser = crate::range::gap_mm, help_heading = "State")]
    gap_mm: Option<f64>,
    /// Another value of a quantity of the actuator: its dotted key in actuator.toml, such as elastomer.law.mu_mpa=0.72. Geometry
    /// moves the existing mesh. A list of cases has a column for each parameter; this sets the others.
    #[arg(long, value_name = "NAME=VALUE", value_parser = setting, help_heading = "State")]
    set: Vec<Setting>,
    /// Steps from rest to the pressure, volume or gas; each is printed (1 to 100000). Default: 1; 40 with --path.
    #[arg(long, value_name = "N", conflicts_with_all = ["cases", "trace"], value_parser = clap::value_parser!(u32).range(1..=100_000), help_heading = "State")]
    steps: Option<u32>,
    /// Coarser meshes of the same body, the coarsest first: the first state is solved on each from that of the one before, and is the
    /// start on the actuator's own mesh. For meshes of more than about 50,000 nodes.
    #[arg(long, value_name = "FILE,FILE,...", value_delimiter = ',', conflicts_with_all = ["cases", "trace", "path"], help_heading = "State")]
    coarse_mesh: Vec<PathBuf>,
    /// List of cases: case,regime,split,pressure_mpa,gap_mm.
    #[arg(long, value_name = "FILE.csv", conflicts_with = "pressure_mpa", requires = "out")]
    cases: Option<PathBuf>,
    /// Inputs over time: t_s, pressure_mpa; gap_mm and dotted keys of numbers in actuator.toml, if given.
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["pressure_mpa", "cases"], requires = "out", help_heading = "Motion")]
    trace: Option<PathBuf>,
    /// Largest step of a motion in ms, and the largest time between two rows of its series (0.001 to 100).
    #[arg(long, value_name = "MS", default_value_t = 2.0, allow_negative_numbers = true, requires = "trace", value_parser = crate::range::number(0.001, 100.0), help_heading = "Motion")]
    step_ms: f64,
    /// Largest estimated error of a step in displacement, mass-weighted root mean square in mm. Steps with a larger one are
    /// halved, down to 1/16 of --step-ms.
    #[arg(long, value_name = "MM", default_value_t = StepSettings::default().tolerance_mm, allow_negative_numbers = true, requires = "trace", value_parser = crate::range::number(1.0e-9, 1000.0), help_heading = "Motion")]
    step_error_mm: f64,
    /// Instants in s whose fields are written to OUT/fields as .vtu.
    #[arg(long, value_name = "S,S,...", value_delimiter = ',', requires = "trace", allow_negative_numbers = true, value_parser = crate::range::number(-1.0e9, 1.0e9), help_heading = "Motion")]
    fields_s: Vec<f64>,
    /// One state: .npy, .csv or .vtu. A list of cases: the database's folder. A motion: the folder of its series.
    #[arg(long, value_name = "FILE|DIR", help_heading = "Output")]
    out: Option<PathBuf>,
    /// Cases solved at the same time (1 to 256).
    #[arg(long, value_name = "N", default_value_t = 2, requires = "cases", value_parser = crate::range::threads, help_heading = "Computing")]
    threads: usize,
    /// Keep derivatives of coordinates, stress and force by pressure, gap and every parameter with each state.
    #[arg(long, requires = "cases")]
    sensitivities: bool,
    /// The report of a database run or a motion as one JSON object. One state or a path is JSON anyway: adds the nodes that touch.
    #[arg(long, help_heading = "Output")]
    json: bool,
}

impl Args {
    /// Reads actuator and mesh, then computes.
    pub fn run(self) -> anyhow::Result<()> {
        let family = files::family(&self.geometry.actuator)?;
        if let (Some(trace), Some(out)) = (&self.trace, &self.out) {
            let largest_s = 1.0e-3 * self.step_ms;
            let steps =
                StepSettings { largest_s, smallest_s: largest_s / 16.0, tolerance_mm: self.step_error_mm };
            let options =
                MotionOptions { out: out.clone(), steps, fields_s: self.fields_s, settings: self.set };
            return transient::run(&family, trace, options, self.json);
        }
        if let (Some(volume_mm3), true) = (self.volume_mm3, self.path) {
            let points = self.steps.unwrap_or(path::POINTS) as usize;
            let target = path::PathEnd { volume_mm3, gap_mm: self.gap_mm, points, settings: self.set };
            return path::run(&family, &target, self.out.as_deref(), self.json);
        }
        let gas = self.gas_mg.zip(self.dead_volume_mm3).map(|(mg, dead_mm3)| Driven::Gas(mg, dead_mm3));
        let driven = self.pressure_mpa.map(Driven::Pressure).or(self.volume_mm3.map(Driven::Volume)).or(gas);
        match (&self.cases, driven, &self.out) {
            (Some(cases), _, Some(out)) => {
                let (threads, sensitivities) = (self.threads, self.sensitivities);
                let options = batch::Options { threads, sensitivities, settings: self.set };
                batch::run(&family, cases, out, &options, self.json)
            }
            (_, Some(driven), out) => {
                let (gap_mm, steps, node_sets) = (self.gap_mm, self.steps.unwrap_or(1), self.json);
                let target = single::StaticLoad { driven, gap_mm, steps, node_sets, settings: self.set };
                let coarse =
                    self.coarse_mesh.iter().map(|mesh| files::family_on(&self.geometry.actuator, mesh));
                single::run(&family, &coarse.collect::<anyhow::Result<Vec<_>>>()?, &target, out.as_deref())
            }
            _ => {
                Err(usage("expected --pressure, --volume-mm3 or --gas-mg, or --cases or --trace with --out"))
            }
        }
    }
}
