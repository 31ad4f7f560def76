//! Sealed evaluation: test states that are evaluated once and not stored.

use super::Args;
use super::fresh::random_states;
use crate::failure::usage;
use crate::jumps::jumps;
use crate::{files, output};
use formats::database::ObstacleKind;
use rom::inputs::{GAP, PARAMETERS, PRESSURE};
use rom::model::Model;
use rom::snapshots::RegimeKind;
use serde::Serialize;
use std::path::Path;
use train::evaluate::{CaseReport, Covered, Report, evaluate};

/// One of this number of states is free: there is one input then.
const FREE_SHARE: usize = 10;
/// Gaps at which both sides of the onset are compared.
const ONSET_GAPS: usize = 100;
/// The contact states below this pressure are counted apart: weight and pressure are of one size there.
const LOW_MPA: f64 = 0.005;

/// Figures of test states besides their errors.
#[derive(Debug, Serialize)]
struct Sealed {
    seed: u64,
    /// Contact states below 5 kPa.
    below_5_kpa: usize,
    /// Contact states within the half-widths, by half of the pressure range and half of the gap range.
    quarters: Vec<Quarter>,
    /// Largest jumps at the onset of contact: of a coordinate, of stress over the state's largest, of the force.
    jump_mm: f64,
    stress_jump: f64,
    jump_n: f64,
}

#[derive(Debug, Serialize)]
struct Quarter {
    pressure: &'static str,
    gap: &'static str,
    states: usize,
    /// Share within the half-widths: displacement, stress, force; none without states.
    coverage: Option<[f64; 3]>,
}

impl Args {
    /// Draws, simulates, evaluates, removes.
    pub(super) fn sealed(&self, model: &Model, count: usize) -> anyhow::Result<()> {
        if model.header.inputs.len() > PARAMETERS {
            return Err(usage(
                "--sealed: expected a model of pressure and gap, found further inputs; draw a list with `softtwin sample \
                 --parameter`, `softtwin simulate` it and evaluate on that folder",
            ));
        }
        let beside = self.model.with_file_name("actuator.toml");
        let actuator = self.actuator.as_deref().unwrap_or(&beside);
        if !actuator.is_file() {
            return Err(usage(format!(
                "--sealed: expected the actuator that the model is of, found no {}; name it by --actuator",
                actuator.display()
            )));
        }
        let (seed, scene) = (self.seed.unwrap_or(1), ObstacleKind::from(self.scene));
        let free = if model.regime(RegimeKind::Free).is_some() { count / FREE_SHARE } else { 0 };
        let mut cases = random_states(model, RegimeKind::Contact, count - free, seed, scene)?;
        if free > 0 {
            cases.extend(random_states(model, RegimeKind::Free, free, seed, scene)?);
        }
        // A killed run continues where it was: the folder is named by what is asked for.
        let hash = wire::layout::hex(&files::model_and_hash(&self.model)?.1[..8]);
        let folder = std::env::temp_dir().join(format!("softtwin-sealed-{hash}-{seed}-{count}"));
        self.solve(model, &cases, &folder, actuator)?;
        let report = self.judge(model, &folder)?;
        let found = Sealed::of(model, &report, seed)?;
        std::fs::remove_dir_all(&folder)?;
        self.show(model, &report, Some(&serde_json::to_value(&found)?))?;
        if self.json { Ok(()) } else { found.print() }
    }

    fn judge(&self, model: &Model, folder: &Path) -> anyhow::Result<Report> {
        let database = files::database(folder, ObstacleKind::from(self.scene))?;
        let all: Vec<usize> = (0..database.cases.len()).collect();
        Ok(evaluate(model, &database, &all, self.floor)?)
    }
}

impl Sealed {
    fn of(model: &Model, report: &Report, seed: u64) -> anyhow::Result<Self> {
        let range = model.header.onset.as_ref().map_or([0.0; 2], |onset| [onset.sag_mm(), onset.reach_mm()]);
        let jumps = jumps(model, range, ONSET_GAPS)?;
        let contact: Vec<&CaseReport> = report.cases.iter().filter(|c| c.gap_mm.is_some()).collect();
        let middle = |input| {
            let range = model.regime(RegimeKind::Contact).and_then(|regime| regime.inputs.range(input));
            range.map_or(f64::INFINITY, |[low, high]| 0.5 * (low + high))
        };
        let middles = [middle(PRESSURE), middle(GAP)];
        let quarter = |(pressure, gap): (bool, bool)| {
            let within = |c: &&&CaseReport| {
                [c.pressure_mpa > middles[0], c.gap_mm.is_some_and(|gap| gap > middles[1])] == [pressure, gap]
            };
            let cases: Vec<&Covered> = contact.iter().filter(within).map(|c| &c.covered).collect();
            let share =
                |of: fn(&Covered) -> bool| cases.iter().filter(|c| of(c)).count() as f64 / cases.len() as f64;
            let name = |upper: bool| if upper { "upper" } else { "lower" };
            Quarter {
                pressure: name(pressure),
                gap: name(gap),
                states: cases.len(),
                coverage: (!cases.is_empty())
                    .then(|| [share(|c| c.displacement), share(|c| c.stress), share(|c| c.force)]),
            }
        };
        let quarters = [(false, false), (false, true), (true, false), (true, true)].map(quarter).into();
        Ok(Self {
            seed,
            below_5_kpa: contact.iter().filter(|c| c.pressure_mpa < LOW_MPA).count(),
            quarters,
            jump_mm: jumps.length_mm,
            stress_jump: jumps.stress_share,
            jump_n: jumps.force_n,
        })
    }

    fn print(&self) -> anyhow::Result<()> {
        output!("\nsealed states of seed {}; {} contact states below 5 kPa", self.seed, self.below_5_kpa)?;
        output!(
            "within the half-widths by half of the pressure and gap range (displacement, stress, force):"
        )?;
        for quarter in &self.quarters {
            let shares = quarter.coverage.map_or("-".into(), |shares| {
                shares.map(|share| format!("{:.0} %", 100.0 * share)).join(", ")
            });
            output!(
                "  {} pressures, {} gaps: {} states: {shares}",
                quarter.pressure,
                quarter.gap,
                quarter.states
            )?;
        }
        output!(
            "largest jump at the onset: {:.4} mm, stress {:.3} % of the state's largest, {:.1e} N",
            self.jump_mm,
            100.0 * self.stress_jump,
            self.jump_n
        )?;
        Ok(())
    }
}
