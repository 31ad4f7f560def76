//! Actuators described by a file, and their finite-element states.

use crate::refused;
use fem::actuator::Setting;
use fem::{Family, Problem, Solver, State};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// An actuator with its mesh.
#[pyclass(frozen, module = "softtwin._native")]
pub struct Actuator {
    family: Arc<Family>,
}

/// Solver of a variant of an actuator, and the state from which the next one is sought.
#[pyclass(frozen, module = "softtwin._native")]
pub struct Simulation {
    actuator: fem::actuator::Actuator,
    problem: Arc<Problem>,
    solver: Mutex<(Solver, State)>,
}

#[pymethods]
impl Actuator {
    /// Reads an actuator file and its mesh, which must have been made.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let read = || -> Result<Family, String> {
            let actuator = fem::actuator::Actuator::read(&path).map_err(|error| error.to_string())?;
            let mesh = actuator.read_mesh(&path).map_err(|error| error.to_string())?;
            let problem = Problem::new(mesh, actuator.problem_config()).map_err(|error| error.to_string())?;
            Ok(Family { actuator, problem: Arc::new(problem) })
        };
        Ok(Self { family: Arc::new(py.detach(read).map_err(refused)?) })
    }

    /// Undeformed nodes (mm), shape (nodes, 3).
    #[getter]
    fn points_mm<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.family.problem.mesh().nodes_mm)
    }

    /// Nodes of the tetrahedra, shape (cells, 10).
    #[getter]
    fn cells<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let tets = &self.family.problem.mesh().tets;
        PyArray1::from_slice(py, tets.as_flattened()).reshape([tets.len(), 10])
    }

    /// A solver with other values of some quantities, in equilibrium with gravity.
    fn simulation(&self, py: Python<'_>, settings: Vec<Setting>) -> PyResult<Simulation> {
        let begin = || -> Result<Simulation, String> {
            let variant = self.family.variant(&settings).map_err(|error| error.to_string())?;
            let problem = self.family.problem_of(&variant).map_err(|error| error.to_string())?;
            let actuator = self.family.actuator_of(&variant).map_err(|error| error.to_string())?;
            let mut solver = Solver::new(Arc::clone(&problem)).map_err(|error| error.to_string())?;
            let rest = solver.gravity_equilibrium(actuator.loads.gravity_mm_s2);
            let (state, _) = rest.map_err(|error| error.to_string())?;
            Ok(Simulation { actuator, problem, solver: Mutex::new((solver, state)) })
        };
        py.detach(begin).map_err(refused)
    }
}

#[pymethods]
impl Simulation {
    /// The equilibrium at a pressure and a gap, sought from the state before.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        pressure_mpa: f64,
        gap_mm: Option<f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let load = self.actuator.load(pressure_mpa, gap_mm);
        let (output, injected_mm3, stretches) = py
            .detach(|| {
                let mut held = self.solver.lock().unwrap_or_else(PoisonError::into_inner);
                let (solver, state) = &mut *held;
                let (next, _) = solver.solve_to(state, &load)?;
                *state = next;
                let output = solver.output(state);
                Ok((output, solver.injected_mm3(state), self.problem.stretches(state)))
            })
            .map_err(|error: fem::SolveError| refused(error))?;
        let found = PyDict::new(py);
        found.set_item("coordinates_mm", matrix(py, &output.coordinates_mm)?)?;
        found.set_item("displacement_mm", output.displacement_mm.into_pyarray(py))?;
        found.set_item("von_mises_mpa", output.von_mises_mpa.into_pyarray(py))?;
        found.set_item("contact_nodes", output.contact_nodes.into_pyarray(py))?;
        for (name, number) in [
            ("contact_force_n", output.contact_force_n),
            ("cavity_volume_mm3", output.cavity_volume_mm3),
            ("injected_mm3", injected_mm3),
            ("residual_n", output.residual_n),
            ("largest_stretch", stretches.largest),
            ("beyond_law_percent", 100.0 * stretches.beyond),
        ] {
            found.set_item(name, number)?;
        }
        Ok(found)
    }
}

fn matrix<'py>(py: Python<'py>, rows: &[[f64; 3]]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), 3])
}
