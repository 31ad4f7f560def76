//! `softtwin-studies trace`: what a pressure gauge reads while the simulated actuator is filled at constant flow.

mod inflation;

use fem::Solver;
use formats::table::{Table, TableRow};
use formats::{Diagnostic, FormatError};
use indicatif::{ProgressBar, ProgressStyle};
use inflation::{Inflation, to_csv};
use softtwin::failure::usage;
use softtwin::files::{self, refusal, save};
use softtwin::options::ActuatorFile;
use softtwin::output;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  Simulate the volumes, then make the trace:
    softtwin-studies trace --gap-mm 40 --out gap40.csv
  The three traces of the paper's scenes, from one run of the simulator (scripts/make_model.sh traces):
    softtwin simulate --actuator models/pneunet/actuator.toml --cases models/pneunet/trace_cases.csv --out target/traces
    softtwin-studies trace --volumes target/traces/volumes.csv --gap-mm 40 --seed 2 --out config/traces/gap40.csv
  Half the flow through a long tube:
    softtwin-studies trace --gap-mm 40 --flow-ml-per-min 62.5 --dead-volume-mm3 3000 --out slow.csv";

const NOTES: &str = "\
The cavity's volume is simulated at --states pressures; the ideal gas law at constant temperature does the rest.";

/// Make a pressure trace: constant-flow inflation of the simulated actuator, read by a gauge.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    #[command(flatten)]
    geometry: ActuatorFile,
    /// Gap from the underside of the undeformed base to the obstacle in mm.
    #[arg(long, value_name = "MM", allow_negative_numbers = true, value_parser = softtwin::range::gap_mm)]
    gap_mm: f64,
    /// The trace: t_s,pressure_mpa,gap_mm.
    #[arg(long, value_name = "FILE.csv")]
    out: PathBuf,
    /// Volumes of a `softtwin simulate` run (its volumes.csv) instead of simulating here; rows with this gap are taken.
    #[arg(long, value_name = "FILE.csv", conflicts_with = "states")]
    volumes: Option<PathBuf>,
    /// States simulated above rest; the volume is interpolated between them.
    #[arg(long, value_name = "N", default_value_t = 14, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    states: u32,
    #[command(flatten)]
    pump: Inflation,
}

impl Args {
    /// Simulates the volumes and writes the trace.
    pub fn run(self) -> anyhow::Result<()> {
        self.pump.check().map_err(usage)?; // before the work, not after it
        let volumes = match &self.volumes {
            Some(table) => self.tabulated(table)?,
            None => self.simulated()?,
        };
        let readings = self.pump.readings(&volumes)?;
        save(&self.out, to_csv(&readings, self.gap_mm, &self.made_by(&volumes)).as_bytes())?;
        let seconds = readings.last().map_or(0.0, |r| r.t_s);
        output!("{}: {} readings, {seconds:.2} s", self.out.display(), readings.len())?;
        Ok(())
    }

    /// Cavity volumes (MPa, mm3) at this gap from a table, by rising pressure.
    fn tabulated(&self, table: &Path) -> anyhow::Result<Vec<(f64, f64)>> {
        let found = Table::read(table, false).map_err(refusal)?;
        let refused = |diagnostics| refusal(FormatError::Content { path: table.into(), diagnostics });
        let columns = found.columns(["pressure_mpa", "gap_mm", "cavity_volume_mm3"]).map_err(refused)?;
        let row = |row: TableRow<'_>| -> Result<Option<(f64, f64)>, Diagnostic> {
            let [pressure, gap, volume] = columns;
            let is_here = row.optional_number(gap)? == Some(self.gap_mm);
            Ok(is_here.then_some((row.number(pressure)?, row.number(volume)?)))
        };
        let rows: Result<Vec<_>, _> = found.rows().map(row).collect();
        let rows = rows.map_err(|diagnostic| refused(vec![diagnostic]))?;
        let mut volumes: Vec<(f64, f64)> = rows.into_iter().flatten().collect();
        volumes.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(volumes)
    }

    /// Cavity volumes (MPa, mm3) along the path from rest at the gap.
    fn simulated(&self) -> anyhow::Result<Vec<(f64, f64)>> {
        let (actuator, problem) = files::actuator(&self.geometry.actuator)?;
        let mut solver = Solver::new(problem)?;
        let (mut state, _) = solver.gravity_equilibrium(actuator.loads.gravity_mm_s2)?;
        let bar = ProgressBar::new(u64::from(self.states) + 1);
        bar.set_style(ProgressStyle::with_template("{bar:30} {pos}/{len} states, about {eta} left")?);
        let mut volumes = Vec::new();
        for k in 0..=self.states {
            let pressure_mpa = self.pump.end_pressure_mpa * f64::from(k) / f64::from(self.states);
            (state, _) = solver.solve_to(&state, &actuator.load(pressure_mpa, Some(self.gap_mm)))?;
            volumes.push((pressure_mpa, solver.output(&state).cavity_volume_mm3));
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(volumes)
    }

    fn made_by(&self, volumes: &[(f64, f64)]) -> String {
        let (first, last) = (volumes.first().map_or(0.0, |v| v.1), volumes.last().map_or(0.0, |v| v.1));
        let (actuator, gap_mm, states) = (self.geometry.actuator.display(), self.gap_mm, volumes.len());
        let Inflation {
            flow_ml_per_min,
            dead_volume_mm3,
            end_pressure_mpa,
            rate_hz,
            resolution_mpa,
            noise_mpa,
            seed,
        } = self.pump;
        format!(
            "Simulated gauge trace, made by `softtwin-studies trace`: actuator {actuator}, gap {gap_mm} mm, 0 to {end_pressure_mpa} MPa\n\
             at {flow_ml_per_min} mL/min of air at atmospheric pressure (isothermal ideal gas, dead volume {dead_volume_mm3} mm3).\n\
             Cavity volume simulated at {states} pressures: {first:.1} mm3 at rest, {last:.1} mm3 at the end.\n\
             Gauge: {rate_hz} Hz, resolution {resolution_mpa} MPa, noise {noise_mpa} MPa (seed {seed})."
        )
    }
}
