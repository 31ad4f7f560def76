//! Derivatives of a state with respect to the inputs of its list, stored next to its checkpoint.

use super::store::{Sizes, Store};
use crate::cases::Case;
use crate::config::Load;
use crate::family::{Family, Variant, VariantError};
use crate::newton::NewtonError;
use crate::sensitivity::Change;
use crate::solver::Solver;
use crate::state::State;
use formats::{FormatError, file};
use std::sync::Arc;
use thiserror::Error;

/// First bytes of a file, before the checksum of the rest.
const MAGIC: [u8; 8] = *b"STWNSEN1";
/// Fields of a row: x, y, z and von Mises stress.
pub(crate) const FIELDS: [&str; 4] = ["x", "y", "z", "von_mises"];
/// Steps of the differences of the residual: MPa, mm, and the fraction of a parameter.
const PRESSURE_STEP_MPA: f64 = 1.0e-5;
const GAP_STEP_MM: f64 = 1.0e-6;
const PARAMETER_STEP: f64 = 1.0e-6;

/// Derivative of a state with respect to one input.
#[derive(Clone, Debug, PartialEq)]
pub struct Derivative {
    /// Derivative of the force on the obstacle (N per unit of the input).
    pub contact_force_n: f64,
    /// Derivatives of coordinates and stress, node by node: x, y, z, von Mises.
    pub values: Vec<f32>,
}

/// Error of the derivatives.
#[derive(Debug, Error)]
pub enum DerivativeError {
    /// A variant one step away is invalid.
    #[error(transparent)]
    Variant(#[from] VariantError),
    /// The state is not an equilibrium.
    #[error(transparent)]
    Newton(#[from] NewtonError),
    /// The file could not be written.
    #[error(transparent)]
    Store(#[from] FormatError),
}

/// Names of a case's inputs, in the order of its derivatives: pressure, gap unless free, parameters.
pub(crate) fn inputs(case: &Case) -> Vec<&str> {
    let gap = case.gap_mm.map(|_| "gap_mm");
    let parameters = case.settings.iter().map(|(name, _)| name.as_str());
    ["pressure_mpa"].into_iter().chain(gap).chain(parameters).collect()
}

/// Computes and stores a state's derivatives; empty if the set of touching nodes is about to change. `solver` has the state's
/// body.
pub(crate) fn compute(
    family: &Family,
    solver: &mut Solver,
    (case, variant): (&Case, &Variant),
    state: &State,
    store: &Store,
) -> Result<Vec<Derivative>, DerivativeError> {
    let changes = inputs(case).into_iter().map(|input| change(family, solver, variant, &state.load, input));
    let changes = changes.collect::<Result<Vec<Change>, _>>()?;
    let found = solver.sensitivities(state, &changes)?.unwrap_or_default();
    let rows: Vec<Derivative> = found
        .into_iter()
        .map(|s| {
            let nodes = s.coordinates_mm.iter().zip(&s.von_mises_mpa);
            let values = nodes.flat_map(|(x, v)| [x[0], x[1], x[2], *v]).map(|v| v as f32).collect();
            Derivative { contact_force_n: s.contact_force_n, values }
        })
        .collect();
    file::replace(&path(store, case, &state.load), &encode(&rows))?;
    Ok(rows)
}

fn change(
    family: &Family,
    solver: &Solver,
    variant: &Variant,
    load: &Load,
    input: &str,
) -> Result<Change, VariantError> {
    let body = solver.problem();
    let loads = |step: f64, at: &dyn Fn(f64) -> Load| Change {
        step,
        below: (Arc::clone(body), at(-step)),
        above: (Arc::clone(body), at(step)),
    };
    let gap_mm = load.obstacle.gap_mm().unwrap_or_default();
    match input {
        "pressure_mpa" => {
            Ok(loads(PRESSURE_STEP_MPA, &|d| Load { pressure_mpa: load.pressure_mpa + d, ..*load }))
        }
        "gap_mm" => Ok(loads(GAP_STEP_MM, &|d| Load { obstacle: load.obstacle.at(gap_mm + d), ..*load })),
        name => {
            let step = PARAMETER_STEP * family.value(variant, name).abs().max(1.0e-3);
            let side = |step: f64| -> Result<_, VariantError> {
                let stepped = family.stepped(variant, name, step);
                let gravity_mm_s2 = family.actuator_of(&stepped)?.loads.gravity_mm_s2;
                Ok((family.problem_of(&stepped)?, Load { gravity_mm_s2, ..*load }))
            };
            Ok(Change { step, below: side(-step)?, above: side(step)? })
        }
    }
}

/// Stored derivatives of a case; `None` without a complete file. An empty list means that the derivatives are undefined.
pub(crate) fn load(store: &Store, case: &Case, load: &Load, sizes: Sizes) -> Option<Vec<Derivative>> {
    let bytes = file::read_bytes(&path(store, case, load), file::MAX_DATA_BYTES).ok()?;
    let rest = bytes.strip_prefix(&MAGIC)?;
    let (hash, body) = rest.split_first_chunk::<32>()?;
    let row = 8 + sizes.nodes * FIELDS.len() * 4;
    if blake3::hash(body).as_bytes() != hash || body.len() % row != 0 {
        return None;
    }
    let rows = body.chunks_exact(row).filter_map(|row| {
        let (force, values) = row.split_first_chunk::<8>()?;
        let values = values.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        Some(Derivative { contact_force_n: f64::from_le_bytes(*force), values })
    });
    Some(rows.collect())
}

fn encode(rows: &[Derivative]) -> Vec<u8> {
    let mut body = Vec::new();
    for row in rows {
        body.extend(row.contact_force_n.to_le_bytes());
        row.values.iter().for_each(|v| body.extend(v.to_le_bytes()));
    }
    let hash = blake3::hash(&body);
    [&MAGIC, &hash.as_bytes()[..], &body].concat()
}

/// File of the derivatives, named by the state and its inputs: a list with other parameters has other derivatives.
fn path(store: &Store, case: &Case, load: &Load) -> std::path::PathBuf {
    let inputs = blake3::hash(inputs(case).join(",").as_bytes()).to_hex();
    store.beside(load, &format!("{}.derivatives", &inputs[..8]))
}
