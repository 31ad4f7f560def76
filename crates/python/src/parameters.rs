//! All parameters of a model, for whoever writes its equations in another language: the small ones as text, the modes as arrays. What is in
//! the file is known here alone; `clients/python/src/softtwin/equations.py` reads names.

use crate::refused;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use rom::memory::MemorySpec;
use rom::model::{BlockData, BlockKind, Model};
use rom::observable::Observables;
use rom::reconstructor::Reconstructor;

/// Regime, position of the field, first of its coefficients, mean over the nodes, and modes, shape (nodes, modes).
pub type FieldRow<'py> = (String, usize, usize, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);
/// Position of an input that moves the undeformed mesh, the value at which it is the model's, axis, and mm per unit of the input by node.
pub type ShiftRow<'py> = (u32, f64, u8, Bound<'py, PyArray1<f64>>);

/// Everything small, as JSON: Python reads the same numbers from it. Regimes, kernels and kinds have their names.
pub fn small(model: &Model, observables: &Observables) -> PyResult<String> {
    let header = &model.header;
    let text = serde_json::json!({
        "header": header,
        "differences": header.regimes.iter().map(|regime| &regime.difference).collect::<Vec<_>>(),
        "learned": header.learned.as_deref(),
        "observables": observables,
        "memory": MemorySpec::of(model).map_err(refused)?,
        "has_forces": header.has_forces(),
        "has_stress": header.has_stress(),
        "has_inertia": model.blocks.iter().any(|(kind, _)| *kind == BlockKind::Inertia),
    });
    Ok(text.to_string())
}

/// What the reconstructor sums, in 64 bits.
pub fn fields<'py>(
    py: Python<'py>,
    model: &Model,
    reconstructor: &Reconstructor,
    nodes: &[u32],
) -> PyResult<Vec<FieldRow<'py>>> {
    let mut rows = Vec::new();
    for regime in &model.header.regimes {
        for modes_of_field in reconstructor.field_modes(regime.kind) {
            let mean = model.mean(regime.kind, modes_of_field.field as u32).unwrap_or_default();
            let mean = at_nodes(mean, nodes);
            let values =
                (0..nodes.len()).flat_map(|node| (0..modes_of_field.count).map(move |mode| (mode, node)));
            let values: Vec<f64> =
                values.map(|(mode, node)| modes_of_field.modes.value(mode, node)).collect();
            let modes = values.into_pyarray(py).reshape([nodes.len(), modes_of_field.count])?;
            rows.push((
                regime.kind.name().to_owned(),
                modes_of_field.field,
                modes_of_field.first,
                mean.into_pyarray(py),
                modes,
            ));
        }
    }
    Ok(rows)
}

/// How inputs move the undeformed mesh.
pub fn shifts<'py>(py: Python<'py>, model: &Model, nodes: &[u32]) -> Vec<ShiftRow<'py>> {
    let shift = |(kind, data): &(BlockKind, BlockData)| match (kind, data) {
        (BlockKind::UndeformedBy { input, axis, from_bits }, BlockData::F32(values)) => {
            Some((*input, f64::from_bits(*from_bits), *axis, at_nodes(values, nodes).into_pyarray(py)))
        }
        _ => None,
    };
    model.blocks.iter().filter_map(shift).collect()
}

fn at_nodes(values: &[f32], nodes: &[u32]) -> Vec<f64> {
    nodes.iter().map(|node| values.get(*node as usize).map_or(f64::NAN, |v| f64::from(*v))).collect()
}
