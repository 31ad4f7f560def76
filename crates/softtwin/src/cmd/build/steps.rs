//! The steps before the states are solved: mesh, pressures, plan.

use super::Args;
use super::folder::Folder;
use crate::cmd::mesh::write_grid;
use crate::cmd::simulate::batch;
use crate::failure::{configuration, usage};
use crate::files::{not_planned, save};
use crate::progress::Doing;
use anyhow::Result;
use fem::Family;
use fem::actuator::Actuator;
use fem::cases::{Case, to_csv};
use fem::plan::{Budget, Counts, Notice, Plan, Pressures, find, landing_cases};
use fem::run::{Run, Store, fingerprint};
use std::path::Path;

/// The mesh file that this command makes; one of another name is the user's.
const OWN_MESH: &str = "mesh.vtu";
/// Longest edge of an element by the thinnest wall of a chamber: elements that are longer and flatter fold before they bend.
const COARSEST: f64 = 5.0;

impl Args {
    /// Makes the mesh, unless the actuator names one of the user's own.
    pub(super) fn mesh(&self, actuator: &Actuator) -> Result<String> {
        let file = self.folder.join(&actuator.mesh.file);
        if actuator.mesh.file != Path::new(OWN_MESH) {
            if self.size_mm.is_some() {
                return Err(usage(format!(
                    "--size-mm: the mesh is your own ({}); set mesh.file = \"{OWN_MESH}\" to have one made",
                    file.display()
                )));
            }
            return Ok(format!("{}, unchanged", file.display()));
        }
        let size = self.size_mm.unwrap_or(actuator.mesh.size_mm);
        let Some(wall) = actuator.thinnest_wall_mm() else {
            let expected =
                "another name: this one is made of base, body and chambers, which the actuator has not";
            return Err(configuration(anyhow::anyhow!("mesh.file: expected {expected}, found {OWN_MESH}")));
        };
        if size > COARSEST * wall {
            return Err(usage(format!(
                "mesh.size_mm (--size-mm): expected at most {:.1} mm, {COARSEST} times the thinnest wall of a chamber, found {size} mm; \
                 flatter elements fold before they bend. {:.1} mm suits this wall",
                COARSEST * wall,
                2.0 * wall
            )));
        }
        let mesh = write_grid(actuator, size, &file)?;
        let (nodes, tets) = (mesh.nodes_mm.len(), mesh.tets.len());
        Ok(format!(
            "{}: {nodes} nodes, {tets} elements of at most {size} mm (thinnest wall {wall:.2} mm)",
            file.display()
        ))
    }

    pub(super) fn pressures(&self, folder: &Folder<'_>, family: &Family, doing: &Doing) -> Result<Pressures> {
        let store = Store::new(&self.folder.join("database/states"), fingerprint(&family.problem))?;
        let run = Run { family, store, threads: 1, sensitivities: false, searches_behind_limits: false };
        let mut notice = |notice| match notice {
            Notice::Begins(what) => doing.begin(what),
            // What a reader of the output misses when it is closed is a progress line.
            Notice::Found(text) => drop(folder.say("pressures", &text)),
        };
        let found = find(&run, &mut notice).map_err(not_planned)?;
        doing.end();
        let (largest_mpa, stretch) = (found.largest_mpa(), found.stretch);
        folder.say(
            "pressures",
            &format!("0 to {largest_mpa} MPa, stretches to {stretch:.2}: {}", found.reason),
        )?;
        let elastomer = &family.actuator.elastomer;
        if let (Some([low, high]), Some([softest, stiffest])) =
            (found.interval_mpa(elastomer), elastomer.shear_interval_mpa)
        {
            folder.say(
                "material",
                &format!(
                    "no constants of this silicone were measured: {:.0} mm need anything from {low:.2e} to {high:.2e} MPa (shear modulus \
                     {softest} to {stiffest} MPa); a tension test narrows it most (softtwin material fit)",
                    found.displacement_mm
                ),
            )?;
        }
        Ok(found)
    }

    /// The states to solve, and how many may be added to them.
    pub(super) fn plan(
        &self,
        folder: &Folder<'_>,
        family: &Family,
        pressures: &Pressures,
        (database, options): (&Path, &batch::Options),
    ) -> Result<(Plan, Budget)> {
        let counts = if self.quick { Counts::QUICK } else { Counts::FULL };
        let mut plan = Plan::new(&family.actuator, pressures, counts).map_err(not_planned)?;
        if let (false, Some(gaps_mm)) = (plan.cavities.is_empty(), plan.gaps_mm) {
            let free: Vec<Case> = plan.cases.iter().filter(|case| case.gap_mm.is_none()).cloned().collect();
            let solved = batch::solve(family, &free, database, options).map_err(not_planned)?.solved;
            let (free, clearances_mm): (Vec<Case>, Vec<f64>) =
                solved.iter().map(|(at, solved)| (free[*at].clone(), solved.clearance_mm)).unzip();
            plan.cases.extend(landing_cases(&free, &clearances_mm, gaps_mm));
        }
        let list = self.folder.join("cases.csv");
        save(&list, to_csv(&plan.cases).as_bytes())?;
        // States over the pressures of several cavities are a sample of the whole range; nothing is added to them.
        let further =
            if plan.cavities.is_empty() { counts.further } else { Budget { states: 0, cpu_s: 0.0 } };
        let more = match further.states {
            0 => String::new(),
            states => format!(", and at most {states} more where the errors ask for them"),
        };
        let gaps =
            plan.gaps_mm.map_or("no obstacle".into(), |[low, high]| format!("gaps {low} to {high} mm"));
        folder.say("states", &format!("{}{more}, in {}, {gaps}", plan.cases.len(), list.display()))?;
        Ok((plan, further))
    }
}
