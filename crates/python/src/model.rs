//! Models and sessions. A prediction is one row of numbers, whose names are [`Model::columns`], and one row of field values.

use crate::control::Control;
use crate::parameters::{self, FieldRow, ShiftRow};
use crate::refused;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1,
    PyReadwriteArray2, PyReadwriteArrayDyn,
};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyFloat, PyInt, PyString};
use rom::evaluation::{Evaluation, NUMBERS};
use rom::evaluator::{Evaluator, Query};
use rom::inputs::{GAP, PRESSURE};
use rom::model::{BlockKind, Nodes, Selection};
use rom::observable::Observables;
use rom::reconstructor::{Peak, Peaks, Reconstructor};
use rom::session::Gaps;
use std::borrow::Cow;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use train::measured::MeasuredOutput;

/// What a row has besides [`NUMBERS`], the gradient of the force, and three numbers for each observable.
const FURTHER: [(&str, &str); 6] = [
    ("coverage", "1"),
    ("force_clamped", ""),
    ("max_displacement_mm", "mm"),
    ("max_displacement_node", ""),
    ("max_von_mises_mpa", "MPa"),
    ("max_von_mises_node", ""),
];

/// Name, unit, smallest and largest training value, default.
type InputRow = (String, String, f64, f64, Option<f64>);

/// Fewest states for which another thread is started.
const STATES_PER_THREAD: usize = 256;

/// A model file with a selection of its fields and nodes.
#[pyclass(frozen, module = "softtwin._native")]
pub struct Model {
    shared: Arc<Loaded>,
}

struct Loaded {
    model: Arc<rom::model::Model>,
    evaluator: Evaluator,
    reconstructor: Reconstructor,
    observables: Observables,
    /// Outputs of a model that was learned from measurements.
    outputs: Vec<MeasuredOutput>,
    fields: Vec<usize>,
    /// Nodes of the selection; `None`: all.
    nodes: Option<Vec<u32>>,
    /// Place of each input that the model takes, by its name and by its keyword, with underscores for dots.
    places: HashMap<String, usize>,
}

impl Model {
    /// A model that was just made.
    pub fn of(model: rom::model::Model) -> PyResult<Self> {
        Ok(Self { shared: Arc::new(Loaded::new(Arc::new(model), &Selection::default())?) })
    }

    pub fn model(&self) -> &rom::model::Model {
        &self.shared.model
    }
}

impl Loaded {
    fn new(model: Arc<rom::model::Model>, selection: &Selection) -> PyResult<Self> {
        let evaluator = Evaluator::new(&model.header).map_err(refused)?;
        let taken = model.header.taken_inputs().map(|(index, input)| (input.key(), index));
        let places = taken.flat_map(|(name, at)| [(name.replace('.', "_"), at), (name, at)]).collect();
        Ok(Self {
            places,
            evaluator,
            reconstructor: Reconstructor::new(&model, selection).map_err(refused)?,
            observables: Observables::of(&model).map_err(refused)?,
            outputs: train::measured::outputs(&model),
            fields: model.header.resolve_fields(selection.fields.as_deref()).map_err(refused)?,
            nodes: model.header.resolve_nodes(&selection.nodes).map_err(refused)?,
            model,
        })
    }

    fn columns(&self) -> Vec<(String, String)> {
        let numbers = NUMBERS.iter().map(|number| (number.key, number.unit)).chain(FURTHER);
        let mut columns: Vec<_> = numbers.map(|(key, unit)| (key.to_owned(), unit.to_owned())).collect();
        for input in self.evaluator.inputs() {
            columns.push((format!("force_by_{}", input.key()), format!("N/({})", input.unit)));
        }
        for (name, unit) in self.observables.names().zip(self.observables.units()) {
            for part in ["", "_halfwidth", "_offset"] {
                columns.push((format!("{name}{part}"), unit.to_owned()));
            }
        }
        for output in &self.outputs {
            let unit = &self.model.header.fields[output.field].spec.unit;
            for part in ["", "_halfwidth"] {
                columns.push((format!("{}{part}", output.name), unit.clone()));
            }
        }
        columns
    }

    fn width(&self) -> usize {
        let of_outputs = 3 * self.observables.count() + 2 * self.outputs.len();
        NUMBERS.len() + FURTHER.len() + self.evaluator.inputs().len() + of_outputs
    }

    /// Writes an evaluation's row and, unless `values` is empty, its fields.
    fn write(
        &self,
        at: usize,
        evaluation: &Evaluation,
        row: &mut [f64],
        values: &mut [f32],
    ) -> Result<(), String> {
        let refuse =
            |why: String| Err(format!("state {at} belongs to regime {}: {why}", evaluation.regime.name()));
        if let Some(why) = self.evaluator.refusal(evaluation) {
            return refuse(why);
        }
        let peaks = match values.is_empty() {
            true => Peaks::default(),
            false => match self.reconstructor.reconstruct_into(evaluation, values) {
                Ok(peaks) => peaks,
                Err(error) => return refuse(error.to_string()),
            },
        };
        let peak =
            |found: Option<Peak>| found.map_or([f64::NAN; 2], |peak| [peak.value.into(), peak.node.into()]);
        let [displacement, stress] = [peak(peaks.displacement_mm), peak(peaks.stress_mpa)];
        let clamped = f64::from(u8::from(evaluation.flags.force_clamped));
        let further =
            [evaluation.halfwidths.coverage, clamped, displacement[0], displacement[1], stress[0], stress[1]];
        let gradient = &evaluation.force_gradient[..self.evaluator.inputs().len()];
        let observed = (0..self.observables.count()).flat_map(|at| {
            if evaluation.coefficients.is_empty() {
                return [f64::NAN; 3];
            }
            let observed = self.observables.value(at, evaluation);
            [observed.value, observed.halfwidth, observed.offset]
        });
        let numbers = NUMBERS.iter().map(|number| (number.value)(evaluation));
        let outputs = self
            .outputs
            .iter()
            .flat_map(|output| [output.value_of(evaluation), output.half_width_of(evaluation)]);
        let all = numbers.chain(further).chain(gradient.iter().copied()).chain(observed).chain(outputs);
        row.iter_mut().zip(all).for_each(|(to, value)| *to = value);
        Ok(())
    }

    /// All inputs of one state, NaN: default; `None` as of [`Model::predict_one`].
    fn state_of(
        &self,
        pressure_mpa: Option<Bound<'_, PyAny>>,
        gap_mm: Option<Bound<'_, PyAny>>,
        further: &Bound<'_, PyDict>,
    ) -> PyResult<Option<Vec<f64>>> {
        let needs = self.evaluator.needs();
        let mut state = vec![f64::NAN; self.evaluator.inputs().len()];
        if needs.gap {
            state[GAP] = f64::INFINITY;
        }
        let mut given: Vec<(usize, Bound<'_, PyAny>)> = Vec::new();
        match (pressure_mpa, needs.pressure) {
            (Some(value), true) => given.push((PRESSURE, value)),
            (None, false) => {}
            _ => return Ok(None),
        }
        match (gap_mm, needs.gap) {
            (Some(value), true) => given.push((GAP, value)),
            (Some(_), false) => return Ok(None),
            (None, _) => {}
        }
        for (name, value) in further {
            let Some(at) = self.places.get(&*name.cast::<PyString>()?.to_cow()?) else { return Ok(None) };
            given.push((*at, value));
        }
        for (index, value) in given {
            let is_number = value.is_instance_of::<PyFloat>() || value.is_instance_of::<PyInt>();
            let Some(value) = is_number.then(|| value.extract::<f64>().ok()).flatten() else {
                return Ok(None);
            };
            if value.is_nan() {
                return Ok(None);
            }
            state[index] = value;
        }
        Ok(Some(state))
    }

    /// Rows and fields of states, on as many threads as there are cores where it is worth it.
    fn predict(
        &self,
        states: &[f64],
        with_observables: bool,
        rows: &mut [f64],
        values: &mut [f32],
    ) -> Result<(), String> {
        let (width, columns) = (self.evaluator.inputs().len(), self.width());
        let count = states.len() / width;
        if count <= STATES_PER_THREAD {
            return self.predict_part(0, states, with_observables, rows, values);
        }
        // The system is asked only here: it takes longer to answer than the model.
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let each = count.div_ceil(cores).max(STATES_PER_THREAD);
        let entries = if values.is_empty() { 0 } else { self.reconstructor.entries() };
        std::thread::scope(|scope| {
            let (mut rest, mut started) = (values, Vec::new());
            let parts = states.chunks(each * width).zip(rows.chunks_mut(each * columns));
            for (part, (states, rows)) in parts.enumerate() {
                let (values, others) = std::mem::take(&mut rest).split_at_mut(states.len() / width * entries);
                rest = others;
                started.push(
                    scope.spawn(move || {
                        self.predict_part(part * each, states, with_observables, rows, values)
                    }),
                );
            }
            let mut ended = started.into_iter().map(|thread| thread.join());
            ended.try_for_each(|end| end.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
        })
    }

    /// Without observables and fields the coefficients are not interpolated, which are nine tenths of the cost. States are counted from `first`.
    fn predict_part(
        &self,
        first: usize,
        states: &[f64],
        with_observables: bool,
        rows: &mut [f64],
        values: &mut [f32],
    ) -> Result<(), String> {
        let has_coefficients = with_observables || !values.is_empty() || self.evaluator.learned().is_some();
        let (width, entries) = (self.evaluator.inputs().len(), self.reconstructor.entries());
        let entries = if values.is_empty() { 0 } else { entries };
        let mut evaluation = self.evaluator.evaluation();
        let mut evaluator = Cow::Borrowed(&self.evaluator);
        let places = states.chunks_exact(width).zip(rows.chunks_exact_mut(self.width()));
        for (index, (given, row)) in places.enumerate() {
            let number = first + index;
            let state = evaluator.state(given).map_err(|error| format!("state {number}: {error}"))?;
            if !evaluator.has_default_parameters(&state) {
                let set = evaluator.to_mut().set_parameters(&state, &mut evaluation);
                set.map_err(|error| format!("state {number}: {error}"))?;
            }
            let query = if has_coefficients { Query::COEFFICIENTS } else { Query::STATE };
            evaluator.answer(state, query, &mut evaluation);
            let values = values.get_mut(index * entries..(index + 1) * entries).unwrap_or_default();
            self.write(number, &evaluation, row, values)?;
        }
        Ok(())
    }
}

#[pymethods]
impl Model {
    /// Reads a model file.
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let read = py.detach(|| rom::model::Model::read(&path));
        let (model, _) = read.map_err(|error| refused(format!("{}: {error}", path.display())))?;
        Self::of(model)
    }

    /// A model from the bytes of its file.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, content: &[u8]) -> PyResult<Self> {
        Self::of(py.detach(|| rom::model::Model::from_bytes(content)).map_err(refused)?)
    }

    /// The bytes of its file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = py.detach(|| self.shared.model.to_bytes()).map_err(refused)?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// The same model with some of its fields on the nodes of a set or of a list.
    #[pyo3(signature = (fields, node_set, nodes))]
    fn select(
        &self,
        fields: Option<Vec<String>>,
        node_set: Option<String>,
        nodes: Option<PyReadonlyArray1<'_, u32>>,
    ) -> PyResult<Self> {
        let nodes = match (node_set, nodes) {
            (Some(set), _) => Nodes::Set(set),
            (None, Some(list)) => Nodes::List(list.as_array().to_vec()),
            (None, None) => Nodes::All,
        };
        let loaded = Loaded::new(self.shared.model.clone(), &Selection { fields, nodes })?;
        Ok(Self { shared: Arc::new(loaded) })
    }

    #[getter]
    fn actuator(&self) -> &str {
        &self.shared.model.header.actuator
    }

    /// Name, unit, smallest and largest training value and default of each input; an input that the model does not have is `None`.
    #[getter]
    fn inputs(&self) -> Vec<Option<InputRow>> {
        let needs = self.shared.evaluator.needs();
        let inputs = self.shared.evaluator.inputs().iter().enumerate();
        inputs
            .map(|(index, input)| {
                let is_taken = (index != PRESSURE || needs.pressure) && (index != GAP || needs.gap);
                is_taken
                    .then(|| (input.key(), input.unit.clone(), input.range[0], input.range[1], input.value))
            })
            .collect()
    }

    /// Name and unit of each field, in the order in which they are reconstructed.
    #[getter]
    fn fields(&self) -> Vec<(String, String)> {
        let known = &self.shared.model.header.fields;
        let fields = self.shared.fields.iter().filter_map(|at| known.get(*at));
        fields.map(|field| (field.spec.name.clone(), field.spec.unit.clone())).collect()
    }

    #[getter]
    fn observables(&self) -> Vec<(String, String)> {
        let observables = &self.shared.observables;
        observables.names().map(str::to_owned).zip(observables.units().map(str::to_owned)).collect()
    }

    /// Name and unit of each output of a model that was learned from measurements.
    #[getter]
    fn outputs(&self) -> Vec<(String, String)> {
        let unit = |output: &MeasuredOutput| self.shared.model.header.fields[output.field].spec.unit.clone();
        self.shared.outputs.iter().map(|output| (output.name.clone(), unit(output))).collect()
    }

    /// Name and unit of each number of a row.
    #[getter]
    fn columns(&self) -> Vec<(String, String)> {
        self.shared.columns()
    }

    /// Nodes of each field.
    #[getter]
    fn node_count(&self) -> usize {
        self.shared.reconstructor.rows()
    }

    /// Nodes of the whole model.
    #[getter]
    fn model_node_count(&self) -> usize {
        self.shared.model.header.node_count
    }

    #[getter]
    fn node_sets<'py>(&self, py: Python<'py>) -> Vec<(String, Bound<'py, PyArray1<u32>>)> {
        let sets = self.shared.model.header.node_sets.iter();
        sets.map(|set| (set.name.clone(), PyArray1::from_slice(py, &set.nodes))).collect()
    }

    /// Nodes without pressure, shape (3, nodes), mm; `None` where the file has none.
    #[getter]
    fn undeformed_mm<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f32>>>> {
        let axis = |axis| Some(self.shared.model.f32_block(BlockKind::Undeformed(axis))?.to_vec());
        let all: Option<Vec<_>> = (0..3).map(axis).collect();
        all.map(|all| PyArray2::from_vec2(py, &all).map_err(refused)).transpose()
    }

    /// Triangles of the surface, shape (triangles, 3).
    #[getter]
    fn triangles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let surface = self.shared.model.u32_block(BlockKind::Surface).unwrap_or(&[]);
        surface.to_vec().into_pyarray(py).reshape([surface.len() / 3, 3])
    }

    /// All parameters: the small ones as JSON, and where `with_fields` what the fields are sums of.
    fn parameters<'py>(
        &self,
        py: Python<'py>,
        with_fields: bool,
    ) -> PyResult<(String, Vec<FieldRow<'py>>, Vec<ShiftRow<'py>>)> {
        let Loaded { model, reconstructor, observables, nodes, .. } = &*self.shared;
        let small = parameters::small(model, observables)?;
        if !with_fields {
            return Ok((small, Vec::new(), Vec::new()));
        }
        let all = || (0..model.header.node_count as u32).collect();
        let nodes = nodes.clone().unwrap_or_else(all);
        let fields = parameters::fields(py, model, reconstructor, &nodes)?;
        Ok((small, fields, parameters::shifts(py, model, &nodes)))
    }

    /// Writes the rows of states, and their fields into `values`, which has room for all of them or for none.
    fn predict(
        &self,
        py: Python<'_>,
        states: PyReadonlyArray2<'_, f64>,
        with_observables: bool,
        mut rows: PyReadwriteArray2<'_, f64>,
        mut values: PyReadwriteArray1<'_, f32>,
    ) -> PyResult<()> {
        let (states, rows, values) = (states.as_slice()?, rows.as_slice_mut()?, values.as_slice_mut()?);
        py.detach(|| self.shared.predict(states, with_observables, rows, values)).map_err(refused)
    }

    /// The inputs and the row of one state, and its fields into `values`, which has room for them or none. `None` where something that is given
    /// is no plain number or no input, or the pressure is missing: then [`Self::predict`] takes the state, or the caller says what is wrong. In
    /// one call, because each step of the interpreter costs more behind a field that has filled the caches.
    #[allow(clippy::type_complexity)] // state and row
    fn predict_one<'py>(
        &self,
        py: Python<'py>,
        pressure_mpa: Option<Bound<'py, PyAny>>,
        gap_mm: Option<Bound<'py, PyAny>>,
        inputs: &Bound<'py, PyDict>,
        with_observables: bool,
        mut values: PyReadwriteArrayDyn<'py, f32>,
    ) -> PyResult<Option<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>)>> {
        let shared = &self.shared;
        let Some(state) = shared.state_of(pressure_mpa, gap_mm, inputs)? else { return Ok(None) };
        let mut row = vec![f64::NAN; shared.width()];
        let values = values.as_slice_mut()?;
        py.detach(|| shared.predict_part(0, &state, with_observables, &mut row, values)).map_err(refused)?;
        Ok(Some((state.into_pyarray(py), row.into_pyarray(py))))
    }

    /// The model along readings, without a past.
    fn session(&self) -> PyResult<Session> {
        let session = rom::session::Session::new(&self.shared.model, Gaps::Live).map_err(refused)?;
        let evaluation = session.evaluation();
        Ok(Session { shared: self.shared.clone(), state: Mutex::new((session, evaluation)) })
    }

    /// A controller of the quantity `held`, with what a scene's text says of an actuator.
    fn control(&self, held: &str, scene: Option<&str>, actuator: Option<&str>) -> PyResult<Control> {
        Control::new(&self.shared.model, held, scene, actuator)
    }
}

/// A model with its past.
#[pyclass(frozen, module = "softtwin._native")]
pub struct Session {
    shared: Arc<Loaded>,
    state: Mutex<(rom::session::Session, Evaluation)>,
}

impl Session {
    fn advance(&self, t_ns: u64, state: &[f64], row: &mut [f64], values: &mut [f32]) -> Result<(), String> {
        let inputs = self.shared.evaluator.state(state).map_err(|error| format!("state 0: {error}"))?;
        let mut held = self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let (session, evaluation) = &mut *held;
        session.set_parameters(&inputs, evaluation).map_err(|error| error.to_string())?;
        session.step(t_ns, inputs, evaluation).map_err(|error| error.to_string())?;
        self.shared.write(0, evaluation, row, values)
    }
}

#[pymethods]
impl Session {
    /// Takes a reading and writes its row and, unless `values` is empty, its fields. A reading that is refused changes nothing; where the
    /// model has no answer at the state of a reading, the session has reached that state.
    fn step(
        &self,
        py: Python<'_>,
        t_ns: u64,
        state: PyReadonlyArray1<'_, f64>,
        mut row: PyReadwriteArray1<'_, f64>,
        mut values: PyReadwriteArray1<'_, f32>,
    ) -> PyResult<()> {
        let (state, row, values) = (state.as_slice()?, row.as_slice_mut()?, values.as_slice_mut()?);
        py.detach(|| self.advance(t_ns, state, row, values)).map_err(refused)
    }

    /// Forgets the past: the next reading begins at equilibrium, at any time.
    fn restart(&self) {
        self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner).0.restart();
    }
}
