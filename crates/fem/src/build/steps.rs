//! The steps before the states are solved: mesh, pressures, plan.

use super::folder::Folder;
use super::report::{BuildError, BuildNotice, BuildSettings};
use crate::actuator::Actuator;
use crate::cases::{Case, to_csv};
use crate::family::Family;
use crate::plan::{Budget, Counts, Notice, Plan, PlanError, Pressures, find, landing_cases};
use crate::run::{self, Outcome, Run, Store, fingerprint};
use formats::file;
use std::path::Path;

/// The mesh file that this command makes; one of another name is the user's.
const OWN_MESH: &str = "mesh.vtu";
/// Longest edge of an element by the thinnest wall of a chamber: elements that are longer and flatter fold before they bend.
const COARSEST: f64 = 5.0;

impl Folder<'_> {
    /// Makes the mesh, unless the actuator names one of the user's own.
    pub(super) fn mesh(&self, actuator: &Actuator, size_mm: Option<f64>) -> Result<(), BuildError> {
        let path = self.path.join(&actuator.mesh.file);
        if actuator.mesh.file != Path::new(OWN_MESH) {
            if size_mm.is_some() {
                return Err(BuildError::Argument(format!(
                    "--size-mm: the mesh is your own ({}); set mesh.file = \"{OWN_MESH}\" to have one made",
                    path.display()
                )));
            }
            self.say("mesh", &format!("{}, unchanged", path.display()));
            return Ok(());
        }
        let size = size_mm.unwrap_or(actuator.mesh.size_mm);
        let Some(wall) = actuator.thinnest_wall_mm() else {
            let expected =
                "another name: this one is made of base, body and chambers, which the actuator has not";
            let found = format!("mesh.file: expected {expected}, found {OWN_MESH}");
            return Err(PlanError::Refused(found).into());
        };
        if size > COARSEST * wall {
            return Err(BuildError::Argument(format!(
                "mesh.size_mm (--size-mm): expected at most {:.1} mm, {COARSEST} times the thinnest wall of a chamber, found {size} mm; \
                 flatter elements fold before they bend. {:.1} mm suits this wall",
                COARSEST * wall,
                2.0 * wall
            )));
        }
        let mesh = actuator.write_grid(size, &path)?;
        let (nodes, tets) = (mesh.nodes_mm.len(), mesh.tets.len());
        self.say(
            "mesh",
            &format!(
                "{}: {nodes} nodes, {tets} elements of at most {size} mm (thinnest wall {wall:.2} mm)",
                path.display()
            ),
        );
        Ok(())
    }

    /// Solves what is not there yet and writes the database.
    pub(super) fn solve(
        &self,
        family: &Family,
        cases: &[Case],
        database: &Path,
        threads: usize,
    ) -> Result<Outcome, PlanError> {
        (self.notify)(BuildNotice::Solving(cases.len()));
        let outcome = run::solve_into(database, family, cases, (threads, false), &|event| {
            (self.notify)(BuildNotice::State(event));
        });
        (self.notify)(BuildNotice::Solved);
        Ok(outcome?)
    }

    pub(super) fn pressures(&self, family: &Family, database: &Path) -> Result<Pressures, BuildError> {
        let store = Store::new(&database.join("states"), fingerprint(&family.problem))?;
        let run = Run { family, store, threads: 1, sensitivities: false, searches_behind_limits: false };
        let mut notice = |notice| match notice {
            Notice::Begins(what) => self.begin(&what),
            Notice::Found(text) => self.say("pressures", &text),
        };
        let found = find(&run, &mut notice)?;
        let (largest_mpa, stretch) = (found.largest_mpa(), found.stretch);
        self.say(
            "pressures",
            &format!("0 to {largest_mpa} MPa, stretches to {stretch:.2}: {}", found.reason),
        );
        let elastomer = &family.actuator.elastomer;
        if let (Some([low, high]), Some([softest, stiffest])) =
            (found.interval_mpa(elastomer), elastomer.shear_interval_mpa)
        {
            self.say(
                "material",
                &format!(
                    "no constants of this silicone were measured: {:.0} mm need anything from {low:.2e} to {high:.2e} MPa (shear modulus \
                     {softest} to {stiffest} MPa); a tension test narrows it most (softtwin material fit)",
                    found.displacement_mm
                ),
            );
        }
        Ok(found)
    }

    /// The states to solve, and how many may be added to them.
    pub(super) fn plan(
        &self,
        family: &Family,
        pressures: &Pressures,
        database: &Path,
        settings: &BuildSettings,
    ) -> Result<(Plan, Budget), BuildError> {
        let counts = if settings.quick { Counts::QUICK } else { Counts::FULL };
        let mut plan = Plan::new(&family.actuator, pressures, counts)?;
        if let (false, Some(gaps_mm)) = (plan.cavities.is_empty(), plan.gaps_mm) {
            let free: Vec<Case> = plan.cases.iter().filter(|case| case.gap_mm.is_none()).cloned().collect();
            let solved = self.solve(family, &free, database, settings.threads)?.solved;
            let (free, clearances_mm): (Vec<Case>, Vec<f64>) =
                solved.iter().map(|(index, solved)| (free[*index].clone(), solved.clearance_mm)).unzip();
            plan.cases.extend(landing_cases(&free, &clearances_mm, gaps_mm));
        }
        let list = self.path.join("cases.csv");
        file::replace(&list, to_csv(&plan.cases).as_bytes())?;
        // States over the pressures of several cavities are a sample of the whole range; nothing is added to them.
        let further =
            if plan.cavities.is_empty() { counts.further } else { Budget { states: 0, cpu_s: 0.0 } };
        let more = match further.states {
            0 => String::new(),
            states => format!(", and at most {states} more where the errors ask for them"),
        };
        let gaps =
            plan.gaps_mm.map_or("no obstacle".into(), |[low, high]| format!("gaps {low} to {high} mm"));
        self.say("states", &format!("{}{more}, in {}, {gaps}", plan.cases.len(), list.display()));
        Ok((plan, further))
    }
}
