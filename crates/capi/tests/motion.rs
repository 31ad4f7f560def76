//! A model with inertia through the C interface: bit-identical to its motion in Rust, and refusals.

use capi::{
    softtwin_model, softtwin_model_close, softtwin_model_open, softtwin_motion, softtwin_motion_close,
    softtwin_motion_open, softtwin_motion_reset, softtwin_motion_step, softtwin_prediction, softtwin_status,
};
use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::reconstructor::Reconstructor;
use rom::session::{Gaps, Session};
use std::ffi::CString;
use std::mem::MaybeUninit;
use std::ptr::null_mut;
use tests::{Stage, moving};

struct Opened {
    model: *mut softtwin_model,
    motion: *mut softtwin_motion,
    values: Vec<f32>,
}

impl Opened {
    fn step(&mut self, t_ns: u64, pressure_mpa: f64) -> softtwin_status {
        self.step_under(t_ns, [pressure_mpa, 20.0, f64::NAN])
    }

    fn step_under(&mut self, t_ns: u64, inputs: [f64; 3]) -> softtwin_status {
        let mut out = MaybeUninit::<softtwin_prediction>::uninit();
        // SAFETY: the motion is open, the arrays have the sizes of the model.
        unsafe {
            softtwin_motion_step(
                self.motion,
                t_ns,
                inputs.as_ptr(),
                out.as_mut_ptr(),
                self.values.as_mut_ptr(),
            )
        }
    }
}

impl Drop for Opened {
    fn drop(&mut self) {
        // SAFETY: both are open and not used any more.
        unsafe {
            softtwin_motion_close(self.motion);
            softtwin_model_close(self.model);
        }
    }
}

#[test]
fn motion_in_c_is_that_of_the_session_over_random_readings() {
    let stage = Stage::with_model("capimotion", &moving::relaxing_bytes());
    let path = CString::new(stage.path("beam.twin").to_str().unwrap()).unwrap();
    let model = Model::from_bytes(&moving::relaxing_bytes()).unwrap();
    let reconstructor = Reconstructor::new(&model, &Selection::default()).unwrap();
    let mut expected = vec![0.0; reconstructor.entries()];
    let mut opened = Opened { model: null_mut(), motion: null_mut(), values: expected.clone() };
    // SAFETY: places for two pointers.
    unsafe {
        assert_eq!(softtwin_model_open(path.as_ptr(), &raw mut opened.model), softtwin_status::SOFTTWIN_OK);
        let status = softtwin_motion_open(opened.model, &raw mut opened.motion);
        assert_eq!(status, softtwin_status::SOFTTWIN_OK);
    }
    let mut session = Session::new(&model, Gaps::Live).unwrap();
    let mut evaluation = session.evaluation();
    let (mut answered, mut refused) = (0, 0);
    for reading in [1, 2, 3].into_iter().flat_map(moving::readings) {
        if reading.restarts || reading.t_ns < 20_000_000 {
            session.restart();
            // SAFETY: the motion is open.
            unsafe { softtwin_motion_reset(opened.motion) };
        }
        let stepped = session.step(reading.t_ns, Inputs::new(reading.pressure_mpa, 20.0), &mut evaluation);
        let has_fields =
            stepped.is_ok() && reconstructor.reconstruct_into(&evaluation, &mut expected).is_ok();
        let status = match (stepped.is_ok(), has_fields) {
            (true, true) => softtwin_status::SOFTTWIN_OK,
            (true, false) => softtwin_status::SOFTTWIN_REFUSED,
            (false, _) => softtwin_status::SOFTTWIN_ARGUMENT,
        };
        assert_eq!(opened.step(reading.t_ns, reading.pressure_mpa), status, "{reading:?}");
        assert!(!has_fields || opened.values == expected, "{reading:?}");
        (answered, refused) = (answered + u32::from(has_fields), refused + u32::from(stepped.is_err()));
    }
    assert!(answered > 900 && refused > 50, "{answered} {refused}");
}

#[test]
fn learned_model_in_c_has_an_interval_beyond_what_was_learned_or_none_and_no_answer_far_out() {
    let model = tests::learned_model();
    let stage = Stage::with_model("capilearned", &model.to_bytes().unwrap());
    let path = CString::new(stage.path("beam.twin").to_str().unwrap()).unwrap();
    let entries = Reconstructor::new(&model, &Selection::default()).unwrap().entries();
    let mut opened = Opened { model: null_mut(), motion: null_mut(), values: vec![0.0; entries] };
    // SAFETY: places for two pointers.
    unsafe {
        assert_eq!(softtwin_model_open(path.as_ptr(), &raw mut opened.model), softtwin_status::SOFTTWIN_OK);
        let status = softtwin_motion_open(opened.model, &raw mut opened.motion);
        assert_eq!(status, softtwin_status::SOFTTWIN_OK);
    }
    let mut session = Session::new(&model, Gaps::Live).unwrap();
    let mut evaluation = session.evaluation();
    let outlet = model.header.inputs[2].value.unwrap();
    for k in 0..300 {
        let (t_ns, pressure_mpa) = (20_000_000 * k, if k < 10 { 0.05 } else { 0.15 });
        session
            .step(t_ns, Inputs::new(pressure_mpa, f64::INFINITY).with(2, outlet), &mut evaluation)
            .unwrap();
        let status = opened.step_under(t_ns, [pressure_mpa, f64::NAN, outlet]);
        assert_eq!(status, softtwin_status::SOFTTWIN_OK, "{k}");
        assert!(
            opened.values.iter().any(|v| (f64::from(*v) - evaluation.coefficients[0]).abs() < 1e-4),
            "{k}"
        );
    }
    let (value, width) = (evaluation.coefficients[0], evaluation.output_half_widths[0]);
    assert!(evaluation.flags.extrapolated);
    assert!(width.is_nan() || (value - 200.0 * (0.15 - outlet)).abs() < width, "{value} {width}");
    let far = opened.step_under(6_000_000_000, [1.0, f64::NAN, outlet]);
    assert_eq!(far, softtwin_status::SOFTTWIN_REFUSED);
}
