//! Stress from the model's modes against stress recovered from its coordinates by the material's law, and the price of the second.

use super::twin::print;
use anyhow::Context;
use fem::StressRecovery;
use formats::database::ObstacleKind;
use rom::hull::DomainStatus;
use rom::model::Selection;
use rom::model_state::ModelState;
use rom::snapshots::{FieldKind, RegimeKind, Split};
use serde_json::json;
use softtwin::files;
use std::path::PathBuf;
use std::time::Instant;
use train::evaluate::spread;

/// Nodes of the small set: as `softtwin-studies bench` has it.
const SET: u32 = 500;
/// Calls that are timed; the median counts.
const CALLS: usize = 51;

/// Errors of stress from modes and from mechanics on held-out states, and the cost of the second.
#[derive(clap::Args)]
pub struct Args {
    /// Model file.
    #[arg(long, value_name = "FILE.twin", default_value = "models/pneunet/pneunet.twin")]
    model: PathBuf,
    /// Its actuator, with the mesh.
    #[arg(long, value_name = "FILE.toml", default_value = "models/pneunet/actuator.toml")]
    actuator: PathBuf,
    /// Database with contact states of split check.
    #[arg(long, value_name = "DIR", default_value = "models/pneunet/database")]
    database: PathBuf,
}

impl Args {
    /// Measures and prints: worst node over the state's largest stress, mean / 95th percentile / largest.
    pub fn run(self) -> anyhow::Result<()> {
        let (model, problem) = (files::model(&self.model)?, files::actuator(&self.actuator)?.1);
        let database = files::database(&self.database, ObstacleKind::Plate)?;
        let stress = database.fields.iter().position(|field| field.kind == FieldKind::Stress);
        let stress = stress.context("the database has no stress")?;
        let mut state = ModelState::new(&model, &Selection::default())?;
        let whole = StressRecovery::new(problem.clone(), None);
        let nodes = database.node_count;
        let mut recovered_mpa = vec![0.0; nodes];
        let (mut modes, mut mechanics, mut peaks) = (Vec::new(), Vec::new(), [Vec::new(), Vec::new()]);
        for case in database.of_split(Split::Check) {
            state.update(database.cases[case].inputs())?;
            let evaluation = state.evaluation();
            if (evaluation.regime, evaluation.domain) != (RegimeKind::Contact, DomainStatus::Inside) {
                continue;
            }
            let fields = state.fields();
            whole.evaluate(&positions(&whole, fields, nodes), &mut recovered_mpa);
            let truth: Vec<f64> = database.field(case, stress).map(f64::from).collect();
            let predicted: Vec<f64> =
                fields[stress * nodes..][..nodes].iter().copied().map(f64::from).collect();
            let largest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
            let top = largest(&truth);
            let worst = |values: &[f64]| {
                values.iter().zip(&truth).map(|(a, b)| (a - b).abs() / top).fold(0.0, f64::max)
            };
            modes.push(worst(&predicted));
            mechanics.push(worst(&recovered_mpa));
            peaks[0].push((largest(&predicted) / top - 1.0).abs());
            peaks[1].push((largest(&recovered_mpa) / top - 1.0).abs());
        }
        let all: Vec<u32> = (0..SET).map(|i| i * nodes as u32 / SET).collect();
        let set = StressRecovery::new(problem, Some(&all));
        let fields = state.fields();
        let price = [&whole, &set].map(|recovery| microseconds(recovery, fields, nodes));
        let percent = |mut shares: Vec<f64>| spread(&mut shares).map(|share| 100.0 * share);
        let [peak_modes, peak_mechanics] = peaks;
        print(
            "stress",
            json!({
                "states": modes.len(),
                "modes_percent": percent(modes),
                "mechanics_percent": percent(mechanics),
                "peak_modes_percent": percent(peak_modes),
                "peak_mechanics_percent": percent(peak_mechanics),
                "whole_field_us": price[0],
                "set": SET,
                "set_us": price[1],
                "set_needs_nodes": set.needed().len(),
            }),
        )
    }
}

fn positions(recovery: &StressRecovery, fields: &[f32], nodes: usize) -> Vec<[f64; 3]> {
    let position = |node: &u32| [0, 1, 2].map(|axis| fields[axis * nodes + *node as usize].into());
    recovery.needed().iter().map(position).collect()
}

/// Median of [`CALLS`].
fn microseconds(recovery: &StressRecovery, fields: &[f32], nodes: usize) -> f64 {
    let (mut out, positions) = (vec![0.0; nodes], positions(recovery, fields, nodes));
    let mut times: Vec<f64> = (0..CALLS)
        .map(|_| {
            let began = Instant::now();
            recovery.evaluate(&positions, &mut out);
            began.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[CALLS / 2]
}
