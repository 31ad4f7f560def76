//! A model in this process: its answers without a daemon, bit-identical to `softtwin predict`, and its answers along readings.

use crate::ffi::{Failure, argument, call, name, put, shared, softtwin_status, take, text, write_handle};
use rom::evaluation::Evaluation;
use rom::evaluator::Evaluator;
use rom::inputs::{GAP, Inputs, MAX_INPUTS, PRESSURE};
use rom::model::{Model, Nodes, Selection};
use rom::observable::{MAX_OBSERVABLES, Observables};
use rom::reconstructor::{Peak, Peaks, Reconstructor};
use rom::session::{Gaps, Session};
use std::borrow::Cow;
use std::ffi::{CStr, CString, c_char};
use std::mem::MaybeUninit;
use std::path::Path;
use std::sync::Arc;

#[repr(C)]
pub struct softtwin_model_input {
    name: *const c_char,
    unit: *const c_char,
    min: f64,
    max: f64,
    value: f64,
}

#[repr(C)]
pub struct softtwin_model_field {
    name: *const c_char,
    unit: *const c_char,
}

#[repr(C)]
pub struct softtwin_model_node_set {
    name: *const c_char,
    nodes: *const u32,
    count: usize,
}

#[repr(C)]
pub struct softtwin_model_info {
    actuator: *const c_char,
    inputs: *const softtwin_model_input,
    input_count: usize,
    fields: *const softtwin_model_field,
    field_count: usize,
    node_count: usize,
    model_node_count: usize,
    node_sets: *const softtwin_model_node_set,
    node_set_count: usize,
    undeformed_mm: [*const f32; 3],
    triangles: *const u32,
    triangle_count: usize,
    observables: *const softtwin_model_field,
    observable_count: usize,
}

#[repr(C)]
#[derive(Clone, Copy, Default)]
pub struct softtwin_prediction {
    contact_force_n: f64,
    force_gradient: [f64; MAX_INPUTS],
    onset_pressure_mpa: f64,
    force_halfwidth_n: f64,
    displacement_halfwidth_mm: f64,
    von_mises_halfwidth_mpa: f64,
    coverage: f64,
    domain_distance: f64,
    max_displacement_mm: f64,
    max_von_mises_mpa: f64,
    max_displacement_node: u32,
    max_von_mises_node: u32,
    regime: u32,
    domain_status: u32,
    force_clamped: u32,
    reserved: u32,
    observables: [f64; MAX_OBSERVABLES],
    observable_halfwidths: [f64; MAX_OBSERVABLES],
    observable_offsets: [f64; MAX_OBSERVABLES],
}

/// The Python client's structure has the same size.
const _: () = assert!(size_of::<softtwin_prediction>() == 352);

/// The strings and tables that [`softtwin_model_info`] points into.
struct ModelStrings {
    actuator: CString,
    inputs: Vec<softtwin_model_input>,
    fields: Vec<softtwin_model_field>,
    observables: Vec<softtwin_model_field>,
    node_sets: Vec<softtwin_model_node_set>,
    /// Owns the names and units of the tables above.
    _strings: Vec<CString>,
}

pub struct softtwin_model {
    model: Arc<Model>,
    evaluator: Evaluator,
    reconstructor: Reconstructor,
    observables: Observables,
    description: ModelStrings,
}

impl ModelStrings {
    fn new(model: &Model, fields: &[usize], observables: &Observables) -> Self {
        let mut strings = Vec::new();
        let header = &model.header;
        let needs = header.needs();
        // A `CString` does not move its bytes when it is moved, so the pointers stay valid.
        let mut keep = |text: &str| {
            let text = CString::new(text.replace('\0', " ")).unwrap_or_default();
            strings.push(text);
            strings.last().map_or(std::ptr::null(), |text| text.as_ptr())
        };
        Self {
            inputs: (header.inputs.iter().enumerate())
                .map(|(index, input)| softtwin_model_input {
                    name: keep(&input.key()),
                    unit: keep(&input.unit),
                    min: input.range[0],
                    max: input.range[1],
                    value: match index {
                        PRESSURE if !needs.pressure => 0.0,
                        GAP if !needs.gap => f64::INFINITY,
                        _ => input.value.unwrap_or(f64::NAN),
                    },
                })
                .collect(),
            fields: (fields.iter().filter_map(|at| header.fields.get(*at)))
                .map(|field| softtwin_model_field {
                    name: keep(&field.spec.name),
                    unit: keep(&field.spec.unit),
                })
                .collect(),
            observables: (observables.names().zip(observables.units()))
                .map(|(name, unit)| softtwin_model_field { name: keep(name), unit: keep(unit) })
                .collect(),
            node_sets: (header.node_sets.iter())
                .map(|set| softtwin_model_node_set {
                    name: keep(&set.name),
                    nodes: set.nodes.as_ptr(),
                    count: set.nodes.len(),
                })
                .collect(),
            actuator: CString::new(header.actuator.replace('\0', " ")).unwrap_or_default(),
            _strings: strings,
        }
    }
}

impl softtwin_model {
    fn new(model: Arc<Model>, selection: &Selection) -> Result<Self, Failure> {
        let refused = |error: rom::model::ModelError| argument(&error.to_string());
        let fields = model.header.resolve_fields(selection.fields.as_deref()).map_err(refused)?;
        let observables = Observables::of(&model).map_err(|error| argument(&error.to_string()))?;
        Ok(Self {
            evaluator: Evaluator::new(&model.header).map_err(refused)?,
            reconstructor: Reconstructor::new(&model, selection).map_err(refused)?,
            description: ModelStrings::new(&model, &fields, &observables),
            observables,
            model,
        })
    }

    pub(crate) fn model(&self) -> &Model {
        &self.model
    }

    /// Number of inputs of a state.
    pub(crate) fn width(&self) -> usize {
        self.evaluator.inputs().len()
    }

    /// Fields of a state into `values`, unless that is null, and their largest values.
    ///
    /// # Safety
    /// `values` is null or has room for fields x nodes; they may never have been written.
    pub(crate) unsafe fn fields(
        &self,
        state: &dyn std::fmt::Display,
        evaluation: &Evaluation,
        values: *mut f32,
    ) -> Result<Peaks, Failure> {
        let refuse = |why: String| {
            let text = format!("{state} belongs to regime {}: {why}", evaluation.regime.name());
            Failure::Own(softtwin_status::SOFTTWIN_REFUSED, text)
        };
        if let Some(why) = self.evaluator.refusal(evaluation) {
            return Err(refuse(why));
        }
        if values.is_null() {
            return Ok(Peaks::default());
        }
        let entries = self.reconstructor.entries();
        // SAFETY: not null, and room for that many by the caller's promise.
        let room = unsafe { std::slice::from_raw_parts_mut(values.cast::<MaybeUninit<f32>>(), entries) };
        self.reconstructor.reconstruct_uninit(evaluation, room).map_err(|error| refuse(error.to_string()))
    }

    pub(crate) fn prediction(&self, evaluation: &Evaluation, peaks: &Peaks) -> softtwin_prediction {
        prediction(evaluation, peaks, &self.observables)
    }

    /// The state at `values`, one for each input; NaN is the model's value of a parameter.
    pub(crate) fn state(&self, number: usize, values: &[f64]) -> Result<Inputs, Failure> {
        self.evaluator.state(values).map_err(|error| argument(&format!("state {number}: {error}")))
    }
}

fn prediction(evaluation: &Evaluation, peaks: &Peaks, observables: &Observables) -> softtwin_prediction {
    let peak =
        |found: Option<Peak>| found.map_or((f64::NAN, u32::MAX), |peak| (peak.value.into(), peak.node));
    let observed = |at| observables.value(at, evaluation);
    let mut out = softtwin_prediction {
        observables: std::array::from_fn(|at| observed(at).value),
        observable_halfwidths: std::array::from_fn(|at| observed(at).halfwidth),
        observable_offsets: std::array::from_fn(|at| observed(at).offset),
        force_gradient: evaluation.force_gradient,
        coverage: evaluation.halfwidths.coverage,
        force_clamped: evaluation.flags.force_clamped.into(),
        ..softtwin_prediction::default()
    };
    rom::numbers!(out, evaluation);
    (out.max_displacement_mm, out.max_displacement_node) = peak(peaks.displacement_mm);
    (out.max_von_mises_mpa, out.max_von_mises_node) = peak(peaks.stress_mpa);
    out
}

/// # Safety
/// `path` is zero-terminated, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_model_open(
    path: *const c_char,
    out: *mut *mut softtwin_model,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let path = unsafe { name(path) }?;
        let (model, _) = Model::read(Path::new(path)).map_err(|e| argument(&format!("{path}: {e}")))?;
        // SAFETY: by the caller's promise.
        unsafe { write_handle(out, softtwin_model::new(Arc::new(model), &Selection::default())?) }
    })
}

/// # Safety
/// `model` is live, strings are null or zero-terminated, `nodes` is null or points to `node_count` numbers, `out` points to
/// memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_model_select(
    model: *const softtwin_model,
    fields: *const c_char,
    node_set: *const c_char,
    nodes: *const u32,
    node_count: usize,
    out: *mut *mut softtwin_model,
) -> softtwin_status {
    call(|| {
        // SAFETY: null or live by the caller's promise.
        let model = unsafe { shared(model, "the model") }?;
        // SAFETY: by the caller's promise.
        let (fields, set) = unsafe { (text(fields)?, text(node_set)?) };
        let nodes = match set {
            Some(set) => Nodes::Set(set.to_owned()),
            None if nodes.is_null() => Nodes::All,
            // SAFETY: not null, and `node_count` numbers by the caller's promise.
            None => Nodes::List(unsafe { std::slice::from_raw_parts(nodes, node_count) }.to_vec()),
        };
        let fields = fields.map(|list| list.split(',').map(|name| name.trim().to_owned()).collect());
        let selected = softtwin_model::new(model.model.clone(), &Selection { fields, nodes })?;
        // SAFETY: by the caller's promise.
        unsafe { write_handle(out, selected) }
    })
}

/// # Safety
/// `model` is live, `out` points to memory for the structure.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_model_describe(
    model: *const softtwin_model,
    out: *mut softtwin_model_info,
) -> softtwin_status {
    call(|| {
        // SAFETY: null or live by the caller's promise.
        let model = unsafe { shared(model, "the model") }?;
        if out.is_null() {
            return Err(argument("the place for the result is null"));
        }
        let (strings, data) = (&model.description, &model.model);
        let undeformed_mm =
            data.undeformed_mm().map_or([std::ptr::null(); 3], |axes| axes.map(<[f32]>::as_ptr));
        let surface = data.facets().as_flattened();
        let info = softtwin_model_info {
            actuator: CStr::as_ptr(&strings.actuator),
            inputs: strings.inputs.as_ptr(),
            input_count: strings.inputs.len(),
            fields: strings.fields.as_ptr(),
            field_count: strings.fields.len(),
            node_count: model.reconstructor.rows(),
            model_node_count: data.header.node_count,
            node_sets: strings.node_sets.as_ptr(),
            node_set_count: strings.node_sets.len(),
            undeformed_mm,
            triangles: surface.as_ptr(),
            triangle_count: surface.len() / 3,
            observables: strings.observables.as_ptr(),
            observable_count: strings.observables.len(),
        };
        // SAFETY: not null, and writable by the caller's promise.
        unsafe { out.write(info) };
        Ok(())
    })
}

/// # Safety
/// `model` is live; `inputs`, `predictions` and `values` point to arrays of these sizes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_model_predict(
    model: *const softtwin_model,
    inputs: *const f64,
    states: usize,
    predictions: *mut softtwin_prediction,
    values: *mut f32,
) -> softtwin_status {
    call(|| {
        // SAFETY: null or live by the caller's promise.
        let model = unsafe { shared(model, "the model") }?;
        if states > 0 && (inputs.is_null() || predictions.is_null()) {
            return Err(argument("the inputs or the place for the predictions is null"));
        }
        let (width, entries) = (model.evaluator.inputs().len(), model.reconstructor.entries());
        let mut evaluation = model.evaluator.evaluation();
        let mut evaluator = Cow::Borrowed(&model.evaluator);
        for at in 0..states {
            // SAFETY: `states` x `width` numbers by the caller's promise.
            let given = unsafe { std::slice::from_raw_parts(inputs.add(at * width), width) };
            let state = model.state(at, given)?;
            if !evaluator.has_default_parameters(&state) {
                let refused = |error| argument(&format!("state {at}: {error}"));
                evaluator.to_mut().set_parameters(&state, &mut evaluation).map_err(refused)?;
            }
            evaluator.evaluate(state, &mut evaluation);
            // SAFETY: room for `states` x `entries` values by the caller's promise.
            let peaks = unsafe {
                let place = if values.is_null() { values } else { values.add(at * entries) };
                model.fields(&format_args!("state {at}"), &evaluation, place)?
            };
            let predicted = model.prediction(&evaluation, &peaks);
            // SAFETY: room for `states` predictions by the caller's promise.
            unsafe { put(predictions.add(at), predicted) }?;
        }
        Ok(())
    })
}

/// # Safety
/// `model` is null or came from `softtwin_model_open` or `softtwin_model_select` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_model_close(model: *mut softtwin_model) {
    // SAFETY: by the caller's promise.
    unsafe { take(model) }
}

/// A model along readings in this process: its memory and its inertia, without a daemon.
pub struct softtwin_motion {
    model: *const softtwin_model,
    session: Session,
    evaluation: Evaluation,
}

/// # Safety
/// `model` is live until the motion is closed, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_motion_open(
    model: *const softtwin_model,
    out: *mut *mut softtwin_motion,
) -> softtwin_status {
    call(|| {
        // SAFETY: null or live by the caller's promise.
        let owner = unsafe { shared(model, "the model") }?;
        let session =
            Session::new(owner.model(), Gaps::Live).map_err(|error| argument(&error.to_string()))?;
        let evaluation = session.evaluation();
        // SAFETY: by the caller's promise.
        unsafe { write_handle(out, softtwin_motion { model, session, evaluation }) }
    })
}

/// # Safety
/// `motion` and its model are live, used by one thread; `inputs`, `out` and `values` point to arrays of these sizes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_motion_step(
    motion: *mut softtwin_motion,
    t_ns: u64,
    inputs: *const f64,
    out: *mut softtwin_prediction,
    values: *mut f32,
) -> softtwin_status {
    call(|| {
        // SAFETY: null or live by the caller's promise, and so is its model.
        let motion = unsafe { motion.as_mut() }.ok_or_else(|| argument("the motion is null"))?;
        // SAFETY: the model is live by the caller's promise.
        let model = unsafe { shared(motion.model, "the model") }?;
        if inputs.is_null() || out.is_null() {
            return Err(argument("the inputs or the place for the prediction is null"));
        }
        // SAFETY: one number per input by the caller's promise.
        let inputs = model.state(0, unsafe { std::slice::from_raw_parts(inputs, model.width()) })?;
        let refused = |error: &dyn std::fmt::Display| argument(&error.to_string());
        let set = motion.session.set_parameters(&inputs, &mut motion.evaluation);
        set.map_err(|error| refused(&error))?;
        let stepped = motion.session.step(t_ns, inputs, &mut motion.evaluation);
        stepped.map_err(|error| refused(&error))?;
        // SAFETY: by the caller's promise.
        let peaks = unsafe { model.fields(&"the state", &motion.evaluation, values) }?;
        // SAFETY: by the caller's promise.
        unsafe { put(out, model.prediction(&motion.evaluation, &peaks)) }
    })
}

/// # Safety
/// `motion` is null or live.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_motion_reset(motion: *mut softtwin_motion) {
    // SAFETY: by the caller's promise.
    if let Some(motion) = unsafe { motion.as_mut() } {
        motion.session.restart();
    }
}

/// # Safety
/// `motion` is null or came from `softtwin_motion_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_motion_close(motion: *mut softtwin_motion) {
    // SAFETY: by the caller's promise.
    unsafe { take(motion) }
}
