//! The answer of a design once more, by finite elements.

use crate::failure::configuration;
use crate::files;
use fem::Solver;
use fem::actuator::Setting;
use rom::goal::Objective;
use rom::inputs::{Inputs, PARAMETERS};
use rom::model::Model;
use rom::probe::MeshPoint;
use std::path::Path;
use std::sync::Arc;

/// Values of the objectives from one solved state.
pub fn confirm(
    model: &Model,
    actuator: &Path,
    objectives: &[Objective],
    inputs: &Inputs,
) -> anyhow::Result<Vec<f64>> {
    let family = files::family(actuator)?;
    let nodes = family.problem.mesh().nodes_mm.len();
    if nodes != model.header.node_count {
        return Err(configuration(anyhow::anyhow!(
            "--actuator: the mesh has {nodes} nodes, the model {}; expected the actuator that it was trained on",
            model.header.node_count
        )));
    }
    let parameters = model.header.inputs.iter().zip(inputs.values()).skip(PARAMETERS);
    let settings: Vec<Setting> = parameters.map(|(spec, value)| (spec.name.clone(), *value)).collect();
    let variant = family.variant(&settings).map_err(configuration)?;
    let problem = family.problem_of(&variant).map_err(configuration)?;
    let actuator = family.actuator_of(&variant).map_err(configuration)?;
    let mut solver = Solver::new(Arc::clone(&problem))?;
    let (rest, _) = solver.gravity_equilibrium(actuator.loads.gravity_mm_s2)?;
    let gap_mm = Some(inputs.gap_mm()).filter(|gap| gap.is_finite());
    let (state, _) = solver.solve_to(&rest, &actuator.load(inputs.pressure_mpa(), gap_mm))?;
    let output = solver.output(&state);
    let value = |objective: &Objective| match objective {
        Objective::Force(_) => Ok(output.contact_force_n),
        Objective::Place(axis, at, _) => {
            let point = MeshPoint::at(model, *at)?;
            let place = |(node, weight): &(u32, f64)| weight * output.coordinates_mm[*node as usize][*axis];
            Ok(point.weights.iter().map(place).sum())
        }
        Objective::Stress(_) => Ok(output.von_mises_mpa.iter().copied().fold(0.0, f64::max)),
    };
    objectives.iter().map(value).collect()
}
