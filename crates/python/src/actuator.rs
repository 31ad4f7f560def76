//! Actuators described by a file, and their finite-element states.

use crate::progress::{Progress, long_call};
use crate::{named, refused};
use fem::actuator::{NewActuator, NewBoxes, NewMaterial, NewShape, Setting};
use fem::build::{BuildNotice, BuildSettings};
use fem::material::silicone::{self, HardnessFigure};
use fem::run::Event;
use fem::{Family, Problem, Solver, State};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
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
    solver: Arc<Mutex<(Solver, State)>>,
}

/// Makes the folder of a new actuator. Its mesh is copied from `mesh` (the file, and the name of the surface that is held) or, without one, made
/// from the boxes' figures. Gives the report of `softtwin new` as JSON. `hardness` is the name and the value of a data sheet's figure.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // named by the caller in Python
pub fn new_actuator(
    folder: PathBuf,
    name: &str,
    mesh: Option<(PathBuf, String)>,
    chambers: usize,
    length_mm: Option<f64>,
    width_mm: f64,
    wall_mm: f64,
    hanging: bool,
    silicone: &str,
    material: Option<&str>,
    shear_modulus_mpa: Option<f64>,
    hardness: Option<(String, f64)>,
    elongation_percent: Option<f64>,
) -> PyResult<String> {
    let material = match (material, shear_modulus_mpa, hardness) {
        (Some(text), ..) => NewMaterial::File(text),
        (None, Some(mpa), _) => NewMaterial::Shear(mpa),
        (None, None, Some((figure, value))) => {
            let figure = match figure.as_str() {
                "shore_a" => HardnessFigure::ShoreA(value),
                "shore_00" => HardnessFigure::Shore00(value),
                _ => HardnessFigure::Modulus100(value),
            };
            NewMaterial::DataSheet(figure, elongation_percent)
        }
        (None, None, None) => NewMaterial::Published(silicone::named(silicone).map_err(refused)?),
    };
    let shape = match &mesh {
        Some((file, fixed)) => NewShape::Mesh { file, fixed },
        None => NewShape::Boxes(NewBoxes { chambers, length_mm, width_mm, wall_mm }),
    };
    let new = NewActuator { name, shape, hanging, material };
    let (report, actuator) = new.create(&folder).map_err(|error| named(&error))?;
    if mesh.is_none() {
        let grid = actuator.write_grid(actuator.mesh.size_mm, &folder.join(&actuator.mesh.file));
        grid.map_err(|error| named(&error))?;
    }
    serde_json::to_string(&report).map_err(refused)
}

/// Builds the twin of a folder, as `softtwin build` does. Gives its report as JSON.
#[pyfunction]
pub fn build(
    py: Python<'_>,
    folder: PathBuf,
    quick: bool,
    size_mm: Option<f64>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let settings = BuildSettings { quick, size_mm, threads };
    let work = move |progress: &Progress| {
        let (states, ended) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let notify = |notice: BuildNotice<'_>| match notice {
            BuildNotice::Done { step, text } => progress.tell(format!("{step}: {text}")),
            BuildNotice::Begins(what) => progress.tell(what),
            BuildNotice::Solving(cases) => {
                states.store(cases, Ordering::Relaxed);
                ended.store(0, Ordering::Relaxed);
            }
            BuildNotice::State(Event::Started(_) | Event::Failed { again: true, .. })
            | BuildNotice::Solved => {}
            BuildNotice::State(_) => {
                let ended = ended.fetch_add(1, Ordering::Relaxed) + 1;
                progress.tell(format!("{ended} of {} states", states.load(Ordering::Relaxed)));
            }
        };
        fem::build::build(&folder, &settings, &process_time_s, &notify)
    };
    let built = long_call(py, progress.as_ref(), work)?.map_err(|error| named(&error))?;
    serde_json::to_string(&built).map_err(refused)
}

/// Processor time of the process.
fn process_time_s() -> Option<f64> {
    let time = |py: Python<'_>| py.import("time")?.call_method0("process_time")?.extract();
    Python::attach(|py| time(py).ok())
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
        let family = Arc::clone(&self.family);
        let begin = move || -> Result<Simulation, String> {
            let variant = family.variant(&settings).map_err(|error| error.to_string())?;
            let problem = family.problem_of(&variant).map_err(|error| error.to_string())?;
            let actuator = family.actuator_of(&variant).map_err(|error| error.to_string())?;
            let mut solver = Solver::new(Arc::clone(&problem)).map_err(|error| error.to_string())?;
            let rest = solver.gravity_equilibrium(actuator.loads.gravity_mm_s2);
            let (state, _) = rest.map_err(|error| error.to_string())?;
            Ok(Simulation { actuator, problem, solver: Arc::new(Mutex::new((solver, state))) })
        };
        long_call(py, None, move |_| begin())?.map_err(refused)
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
        let (solver, problem) = (Arc::clone(&self.solver), Arc::clone(&self.problem));
        let solve = move || {
            let mut held = solver.lock().unwrap_or_else(PoisonError::into_inner);
            let (solver, state) = &mut *held;
            let (next, _) = solver.solve_to(state, &load)?;
            *state = next;
            let output = solver.output(state);
            Ok((output, solver.injected_mm3(state), problem.stretches(state)))
        };
        let found = long_call(py, None, move |_| solve())?;
        let (output, injected_mm3, stretches) = found.map_err(|error: fem::SolveError| refused(error))?;
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
