//! States of finite elements from a folder or from arrays, and training on them.

use crate::model::Model;
use crate::progress::{Progress, long_call};
use crate::refused;
use formats::cells::{Block, KINDS, surface};
use formats::database::ObstacleKind;
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyFileNotFoundError;
use pyo3::prelude::*;
use rom::inputs::Parameter;
use rom::observable::Definition;
use rom::snapshots::{Case, FieldSpec, Footprint, NodeSet, RegimeKind, Split};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use train::config::TrainConfig;

/// States with their inputs, and what the database's folder says about training.
#[pyclass(frozen, module = "softtwin._native")]
pub struct Database {
    database: Arc<rom::snapshots::Database>,
    config: TrainConfig,
}

/// Names of fields in a database of displacements and, with five, stresses.
fn fields(with_stress: bool) -> Vec<FieldSpec> {
    let mut fields = FieldSpec::of_the_paper();
    fields.truncate(if with_stress { 5 } else { 4 });
    fields
}

#[pymethods]
impl Database {
    /// Reads a folder: the cases with the plate or those with the block.
    #[staticmethod]
    fn read(py: Python<'_>, folder: PathBuf, obstacle: &str) -> PyResult<Self> {
        let obstacle = match obstacle {
            "plate" => ObstacleKind::Plate,
            "block" => ObstacleKind::Block,
            found => return Err(refused(format!("obstacle: expected plate or block, found {found}"))),
        };
        if !folder.is_dir() {
            return Err(PyFileNotFoundError::new_err(format!("{}: no such folder", folder.display())));
        }
        let config = TrainConfig::of_database(&folder).map_err(refused)?;
        let database = py.detach(|| formats::database::read(&folder, obstacle)).map_err(refused)?;
        Ok(Self { database: Arc::new(database), config })
    }

    /// Makes a database of arrays: undeformed points (mm), cells by meshio's name, inputs (pressure, gap with infinity for no obstacle, then
    /// the parameters with their nominal values), displacements (mm), stresses (MPa) and contact forces (N) by state.
    #[staticmethod]
    #[allow(clippy::too_many_arguments)] // one array each, named by the caller in Python
    fn of_arrays(
        actuator: &str,
        points_mm: PyReadonlyArray2<'_, f64>,
        cells: Vec<(String, PyReadonlyArray2<'_, u32>)>,
        node_sets: Vec<(String, PyReadonlyArray1<'_, u32>)>,
        inputs: PyReadonlyArray2<'_, f64>,
        parameters: Vec<(String, f64)>,
        forces_n: PyReadonlyArray1<'_, f64>,
        displacement_mm: PyReadonlyArray3<'_, f64>,
        von_mises_mpa: Option<PyReadonlyArray2<'_, f64>>,
        names: Vec<String>,
    ) -> PyResult<Self> {
        let points: Vec<[f64; 3]> =
            points_mm.as_array().outer_iter().map(|row| [row[0], row[1], row[2]]).collect();
        let mut blocks = Vec::new();
        for (name, cells) in &cells {
            let cells = cells.as_array();
            let kind = KINDS.iter().find(|kind| kind.meshio == name && kind.nodes == cells.ncols());
            let kind = kind.ok_or_else(|| {
                let known: Vec<&str> = KINDS.iter().map(|kind| kind.meshio).collect();
                refused(format!(
                    "cells: expected {}, found {name} with {} nodes",
                    known.join(", "),
                    cells.ncols()
                ))
            })?;
            if let Some(node) = cells.iter().find(|node| **node as usize >= points.len()) {
                return Err(refused(format!("cells: {name} names node {node} of {}", points.len())));
            }
            blocks.push(Block {
                kind: kind.number,
                nodes_per_cell: kind.nodes,
                nodes: cells.iter().copied().collect(),
            });
        }
        let (displacement, stress) =
            (displacement_mm.as_array(), von_mises_mpa.as_ref().map(|all| all.as_array()));
        let (states, given, forces) = (displacement.shape()[0], inputs.as_array(), forces_n.as_array());
        let case = |index: usize| {
            let row = given.row(index);
            Case {
                name: names[index].clone(),
                regime: if forces[index] > 0.0 { RegimeKind::Contact } else { RegimeKind::Free },
                split: Split::Train,
                pressure_mpa: row[0],
                gap_mm: row[1].is_finite().then_some(row[1]),
                contact_force_n: forces[index],
                parameters: row.iter().skip(2).copied().collect(),
            }
        };
        let mut snapshots = Vec::with_capacity(states * points.len() * 5);
        for state in 0..states {
            for (node, point) in points.iter().enumerate() {
                let u = [0, 1, 2].map(|axis| displacement[[state, node, axis]]);
                snapshots.extend([0, 1, 2].map(|axis| (point[axis] + u[axis]) as f32));
                snapshots.push(u.iter().map(|u| u * u).sum::<f64>().sqrt() as f32);
                snapshots.extend(stress.map(|stress| stress[[state, node]] as f32));
            }
        }
        let nodes_mm: Vec<[f32; 3]> = points.iter().map(|p| p.map(|v| v as f32)).collect();
        let parameter = |(name, nominal): (String, f64)| {
            let unit = name.rsplit('_').next().unwrap_or_default().to_owned();
            Parameter { name, unit, nominal }
        };
        let sets = node_sets.into_iter();
        let mut database = rom::snapshots::Database {
            actuator: actuator.to_owned(),
            fields: fields(stress.is_some()),
            node_count: points.len(),
            cases: (0..states).map(case).collect(),
            snapshots,
            surface_triangles: surface(&points, &blocks),
            undeformed_mm: Some(points),
            node_sets: sets.map(|(name, nodes)| NodeSet { name, nodes: nodes.as_array().to_vec() }).collect(),
            obstacle: Footprint::plate_below(&nodes_mm).unwrap_or_default(),
            parameters: parameters.into_iter().map(parameter).collect(),
            ..rom::snapshots::Database::default()
        };
        database.hash = database.content_hash();
        let problems = database.problems();
        if !problems.is_empty() {
            return Err(refused(problems.join("\n")));
        }
        Ok(Self { database: Arc::new(database), config: TrainConfig::default() })
    }

    /// States of the training split, and all.
    #[getter]
    fn states(&self) -> (usize, usize) {
        (self.database.of_split(Split::Train).count(), self.database.cases.len())
    }

    #[getter]
    fn node_count(&self) -> usize {
        self.database.node_count
    }

    /// Trains: the model, and the data sheet as JSON. `observables` are definitions as in `[observables]`, as JSON.
    fn train(
        &self,
        py: Python<'_>,
        observables: Option<&str>,
        is_paper: bool,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Model, String)> {
        let mut config = if is_paper {
            let TrainConfig { observables, limit, .. } = self.config.clone();
            TrainConfig { observables, limit, ..TrainConfig::paper() }
        } else {
            self.config.clone()
        };
        if let Some(text) = observables {
            let given: BTreeMap<String, Definition> =
                serde_json::from_str(text).map_err(|error| refused(format!("observables: {error}")))?;
            config.observables = given;
        }
        let database = Arc::clone(&self.database);
        let train =
            move |progress: &Progress| train::train(&database, &config, &mut |step| progress.tell(step));
        let trained = long_call(py, progress.as_ref(), train)?;
        let (model, sheet) = trained.map_err(refused)?;
        Ok((Model::of(model)?, serde_json::to_string(&sheet).map_err(refused)?))
    }
}
