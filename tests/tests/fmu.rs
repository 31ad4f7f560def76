//! An FMU of a model with inertia: steps, saved states, refusals. The exported functions are called as an importer calls them.

use fmu as _; // the library with the functions below
use rom::inertia::data::InertiaModel;
use rom::inputs::Inputs;
use rom::model::{BlockKind, Model, Nodes, Selection};
use rom::reconstructor::Reconstructor;
use rom::session::{Gaps, Session};
use std::ffi::{CString, c_char, c_void};
use std::ptr::{null, null_mut};
use tests::{Stage, moving};

const OK: i32 = 0;
const ERROR: i32 = 3;
/// Value references: pressure and gap, and the first output.
const INPUTS: [u32; 2] = [1, 2];

// SAFETY: signatures of FMI 3.0.
unsafe extern "C" {
    fn fmi3InstantiateCoSimulation(
        name: *const c_char,
        token: *const c_char,
        resources: *const c_char,
        visible: bool,
        logging: bool,
        event_mode: bool,
        early_return: bool,
        required: *const u32,
        required_count: usize,
        environment: *mut c_void,
        message: *const c_void,
        intermediate: *const c_void,
    ) -> *mut c_void;
    fn fmi3InstantiateModelExchange(
        name: *const c_char,
        token: *const c_char,
        resources: *const c_char,
        visible: bool,
        logging: bool,
        environment: *mut c_void,
        message: *const c_void,
    ) -> *mut c_void;
    fn fmi3FreeInstance(instance: *mut c_void);
    fn fmi3Reset(instance: *mut c_void) -> i32;
    fn fmi3SetFloat64(
        instance: *mut c_void,
        references: *const u32,
        count: usize,
        values: *const f64,
        values_count: usize,
    ) -> i32;
    fn fmi3GetFloat64(
        instance: *mut c_void,
        references: *const u32,
        count: usize,
        values: *mut f64,
        values_count: usize,
    ) -> i32;
    fn fmi3DoStep(
        instance: *mut c_void,
        current_s: f64,
        step_s: f64,
        no_set_prior: bool,
        event_needed: *mut bool,
        terminate: *mut bool,
        early_return: *mut bool,
        last_s: *mut f64,
    ) -> i32;
    fn fmi3GetFMUState(instance: *mut c_void, state: *mut *mut c_void) -> i32;
    fn fmi3SetFMUState(instance: *mut c_void, state: *mut c_void) -> i32;
    fn fmi3FreeFMUState(instance: *mut c_void, state: *mut *mut c_void) -> i32;
}

/// An instance with one chosen node.
struct Importer {
    instance: *mut c_void,
    /// Value reference of `tip.y`.
    tip_y: u32,
}

impl Importer {
    fn open(stage: &Stage, model_bytes: &[u8]) -> Self {
        let xml = fmu::describe(&Model::from_bytes(model_bytes).unwrap(), &[], "").unwrap();
        // Pressure, gap and the load: a block diagram can connect them all.
        assert_eq!(
            (xml.matches("causality=\"input\"").count(), xml.matches("\"parameter\"").count()),
            (3, 0)
        );
        Self::with_tip(stage, model_bytes, 2)
    }

    fn with_tip(stage: &Stage, model_bytes: &[u8], node: u32) -> Self {
        let nodes = [fmu::ChosenNode { name: "tip".into(), node }];
        let token = fmu::token(model_bytes, &nodes);
        std::fs::create_dir_all(stage.path("resources")).unwrap();
        std::fs::write(stage.path("resources").join(fmu::MODEL_FILE), model_bytes).unwrap();
        std::fs::write(stage.path("resources").join(fmu::NODES_FILE), fmu::nodes_text(&nodes)).unwrap();
        let model = Model::from_bytes(model_bytes).unwrap();
        let xml = fmu::describe(&model, &nodes, &token).unwrap();
        assert!(xml.contains("canGetAndSetFMUState=\"true\"") && !xml.contains("<ModelExchange"), "{xml}");
        let of_tip = xml.split("name=\"tip.y\" valueReference=\"").nth(1).unwrap();
        let tip_y = of_tip.split('"').next().unwrap().parse().unwrap();
        let [name, token, resources] = ["beam", &token, stage.path("resources").to_str().unwrap()]
            .map(|text| CString::new(text).unwrap());
        let (name, token, resources) = (name.as_ptr(), token.as_ptr(), resources.as_ptr());
        // SAFETY: zero-terminated strings; no callbacks.
        let instance = unsafe {
            let exchange =
                fmi3InstantiateModelExchange(name, token, resources, false, false, null_mut(), null());
            assert!(exchange.is_null());
            fmi3InstantiateCoSimulation(
                name,
                token,
                resources,
                false,
                false,
                false,
                false,
                null(),
                0,
                null_mut(),
                null(),
                null(),
            )
        };
        assert!(!instance.is_null());
        Self { instance, tip_y }
    }

    fn set(&self, pressure_mpa: f64) {
        assert_eq!(self.try_to_set(pressure_mpa), OK);
    }

    fn try_to_set(&self, pressure_mpa: f64) -> i32 {
        let values = [pressure_mpa, 20.0];
        // SAFETY: two references and two values.
        unsafe { fmi3SetFloat64(self.instance, INPUTS.as_ptr(), 2, values.as_ptr(), 2) }
    }

    fn step(&self, from_s: f64, step_s: f64) -> i32 {
        let (mut flags, mut last_s) = ([false; 3], f64::NAN);
        let [event, terminate, early] = flags.each_mut().map(std::ptr::from_mut);
        // SAFETY: places for all results.
        unsafe { fmi3DoStep(self.instance, from_s, step_s, true, event, terminate, early, &raw mut last_s) }
    }

    fn tip_y(&self) -> f64 {
        let mut value = f64::NAN;
        // SAFETY: one reference and one place.
        let status = unsafe { fmi3GetFloat64(self.instance, &raw const self.tip_y, 1, &raw mut value, 1) };
        assert_eq!(status, OK);
        value
    }

    /// Tip after each of `steps` of 5 ms of constant inputs from `begin` on.
    fn run(&self, begin: u32, steps: u32) -> Vec<f64> {
        let one = |k: u32| {
            assert_eq!(self.step(0.005 * f64::from(k), 0.005), OK);
            self.tip_y()
        };
        (begin..begin + steps).map(one).collect()
    }
}

impl Drop for Importer {
    fn drop(&mut self) {
        // SAFETY: instantiated once, not used any more.
        unsafe { fmi3FreeInstance(self.instance) };
    }
}

#[test]
fn fmu_with_inertia_swings_as_the_model_and_returns_to_saved_states() {
    let stage = Stage::new("fmustates");
    let importer = Importer::open(&stage, moving::model_bytes());
    let run = || {
        importer.set(0.02);
        let rest = importer.tip_y();
        let still = importer.run(0, 2);
        assert!(still.iter().all(|y| (y - rest).abs() < 1e-3), "{rest} {still:?}");
        importer.set(0.1);
        assert_eq!(importer.tip_y(), still[1], "an input acts with the next step");
        importer.run(2, 60)
    };
    let moves = run();
    // The same motion in Rust: the pressure jumps within a nanosecond and is held.
    let model = Model::from_bytes(moving::model_bytes()).unwrap();
    let (mut motion, tip) = (Session::new(&model, Gaps::Live).unwrap(), 2);
    let reconstructor = Reconstructor::new(&model, &Selection::default()).unwrap();
    let (mut evaluation, mut fields) = (motion.evaluation(), vec![0.0; reconstructor.entries()]);
    let mut at = |t_ns: u64, pressure_mpa: f64| {
        motion.step(t_ns, Inputs::new(pressure_mpa, 20.0), &mut evaluation).unwrap();
        reconstructor.reconstruct_into(&evaluation, &mut fields).unwrap();
        f64::from(fields[reconstructor.rows() + tip])
    };
    at(0, 0.02);
    at(10_000_000, 0.02);
    at(10_000_001, 0.1);
    let expected: Vec<f64> = (3..63).map(|k| at(5_000_000 * k, 0.1)).collect();
    let (low, high) = expected.iter().fold((f64::MAX, f64::MIN), |(l, h), y| (l.min(*y), h.max(*y)));
    for (found, expected) in moves.iter().zip(&expected) {
        assert!((found - expected).abs() < 1e-4 * (high - low), "{moves:?} {expected}");
    }
    assert!(high - low > 1.0, "{expected:?}");
    // A saved state restores inputs, time and motion.
    let mut saved = null_mut();
    // SAFETY: a place for a state; freed once.
    unsafe {
        assert_eq!(fmi3GetFMUState(importer.instance, &raw mut saved), OK);
        let first = importer.run(62, 20);
        importer.set(0.0);
        importer.run(82, 5);
        assert_eq!(fmi3SetFMUState(importer.instance, saved), OK);
        assert_eq!(importer.run(62, 20), first);
        assert_eq!(fmi3FreeFMUState(importer.instance, &raw mut saved), OK);
        assert!(saved.is_null());
        assert_eq!(fmi3SetFMUState(importer.instance, saved), ERROR);
        assert_eq!(fmi3Reset(importer.instance), OK);
    }
    assert_eq!(run(), moves);
    // Backwards, or not a number.
    for (from_s, step_s) in [(0.1, 0.005), (0.4, -0.1), (0.4, f64::NAN)] {
        assert_eq!(importer.step(from_s, step_s), ERROR, "{from_s} {step_s}");
    }
}

#[test]
fn fmu_of_a_learned_model_answers_as_its_session_bit_for_bit() {
    let stage = Stage::new("fmulearned");
    let model = tests::learned_model();
    let importer = Importer::with_tip(&stage, &model.to_bytes().unwrap(), 0);
    importer.set(0.02);
    let mut found = importer.run(0, 10);
    importer.set(0.08);
    found.extend(importer.run(10, 60));
    let mut session = Session::new(&model, Gaps::Live).unwrap();
    let reconstructor = Reconstructor::new(&model, &Selection::default()).unwrap();
    let (mut evaluation, mut fields) = (session.evaluation(), vec![0.0; reconstructor.entries()]);
    let outlet = model.header.inputs[2].value.unwrap();
    let mut at = |k: u32| {
        let pressure_mpa = if k <= 10 { 0.02 } else { 0.08 };
        let inputs = Inputs::new(pressure_mpa, f64::INFINITY).with(2, outlet);
        session.step_held(5_000_000 * u64::from(k), inputs, &mut evaluation).unwrap();
        reconstructor.reconstruct_into(&evaluation, &mut fields).unwrap();
        f64::from(fields[0])
    };
    let expected: Vec<f64> = (1..=70).map(&mut at).collect();
    assert_eq!(found, expected);
    assert!(found[69] != found[12], "{found:?}");
    // Beyond what was learned the value of the session, whose interval contains the truth or is absent; farther out none.
    importer.set(0.15);
    let settled = importer.run(70, 600)[599];
    let inputs = |pressure_mpa: f64| Inputs::new(pressure_mpa, f64::INFINITY).with(2, outlet);
    for k in 71..=670_u64 {
        session.step_held(5_000_000 * k, inputs(0.15), &mut evaluation).unwrap();
    }
    let (value, width) = (evaluation.coefficients[0], evaluation.output_half_widths[0]);
    assert!(evaluation.flags.extrapolated && (settled - value).abs() < 1e-5, "{settled} {value}");
    assert!(width.is_nan() || (value - 200.0 * (0.15 - outlet)).abs() < width, "{value} {width}");
    importer.set(1.0);
    importer.step(3.35, 0.005);
    let mut far = f64::NAN;
    // SAFETY: one reference and a place for one value.
    let status = unsafe { fmi3GetFloat64(importer.instance, &raw const importer.tip_y, 1, &raw mut far, 1) };
    assert!(status != OK || far.is_nan(), "{far}");
}

#[test]
fn long_steps_of_an_fmu_swing_on() {
    let mut model = Model::from_bytes(moving::model_bytes()).unwrap();
    let mut inertia: InertiaModel = model.record(BlockKind::Inertia).unwrap().unwrap();
    inertia.damping_s = 1e-4; // it swings for many seconds
    model.set_record(BlockKind::Inertia, &inertia).unwrap();
    let stage = Stage::new("fmulong");
    let importer = Importer::open(&stage, &model.to_bytes().unwrap());
    let after = |steps: u32| {
        // SAFETY: instantiated, not freed.
        assert_eq!(unsafe { fmi3Reset(importer.instance) }, OK);
        importer.set(0.0);
        importer.run(0, 1);
        importer.set(0.02);
        let step_s = 2.0 / f64::from(steps);
        (0..steps).for_each(|k| assert_eq!(importer.step(0.005 + step_s * f64::from(k), step_s), OK));
        importer.tip_y()
    };
    // SAFETY: instantiated, not freed.
    assert_eq!(unsafe { fmi3Reset(importer.instance) }, OK);
    importer.set(0.02);
    let rest = importer.tip_y();
    let (once, often) = (after(1), after(400));
    assert!((once - often).abs() < 0.01 * (once - rest).abs(), "{once} {often} {rest}");
}

#[test]
fn steps_of_an_fmu_are_those_of_the_session_over_random_readings() {
    let model = Model::from_bytes(&moving::relaxing_bytes()).unwrap();
    let stage = Stage::new("fmurandom");
    let importer = Importer::open(&stage, &moving::relaxing_bytes());
    let mut session = Session::new(&model, Gaps::Recorded).unwrap();
    // What the FMU sums: a kernel adds the modes of other nodes and fields in another order.
    let names = model.header.fields.iter().map(|field| field.spec.name.clone());
    let fields = Some(names.filter(|name| name != "von_mises").collect());
    let reconstructor =
        Reconstructor::new(&model, &Selection { fields, nodes: Nodes::List(vec![2]) }).unwrap();
    let (mut evaluation, mut fields) = (session.evaluation(), vec![0.0; reconstructor.entries()]);
    let (mut last_s, mut begin_s, mut inputs) = (0.0, None, Inputs::new(0.0, 20.0));
    let (mut answered, mut refused) = (0, 0);
    for reading in moving::readings(4) {
        if reading.restarts {
            // SAFETY: instantiated, not freed.
            assert_eq!(unsafe { fmi3Reset(importer.instance) }, OK);
            session.restart();
            begin_s = None;
            (inputs, last_s) = (Inputs::new(0.0, 20.0), 1e-9 * reading.t_ns as f64 - 1e-3);
            importer.set(0.0);
        }
        if reading.pressure_mpa.is_nan() {
            assert_eq!(importer.try_to_set(reading.pressure_mpa), ERROR);
        } else {
            importer.set(reading.pressure_mpa);
            inputs = Inputs::new(reading.pressure_mpa, 20.0);
        }
        let step_s = 1e-9 * reading.t_ns as f64 - last_s;
        if step_s <= 0.0 {
            assert_eq!(importer.step(last_s, step_s - 1e-9), ERROR, "{reading:?}");
            refused += 1;
            continue;
        }
        let end_s = last_s + step_s;
        let end_ns = ((end_s - begin_s.unwrap_or(last_s)) * 1e9).round() as u64;
        let stepped = session.step_held(end_ns, inputs, &mut evaluation);
        assert_eq!(importer.step(last_s, step_s), if stepped.is_ok() { OK } else { ERROR }, "{reading:?}");
        if stepped.is_err() {
            refused += 1;
            continue;
        }
        begin_s = begin_s.or(Some(last_s));
        last_s = end_s;
        if reconstructor.reconstruct_into(&evaluation, &mut fields).is_ok() {
            assert_eq!(importer.tip_y(), f64::from(fields[1]), "{reading:?}");
            answered += 1;
        }
    }
    assert!(answered > 300 && refused > 10, "{answered} {refused}");
}
