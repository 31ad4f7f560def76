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
        let inputs = [pressure_mpa, 20.0, f64::NAN];
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
fn motion_in_c_is_that_of_the_model_and_refused_steps_change_nothing() {
    let stage = Stage::with_model("capimotion", moving::model_bytes());
    let path = CString::new(stage.path("beam.twin").to_str().unwrap()).unwrap();
    let model = Model::from_bytes(moving::model_bytes()).unwrap();
    let reconstructor = Reconstructor::new(&model, &Selection::default()).unwrap();
    let mut expected = vec![0.0; reconstructor.entries()];
    let mut opened = Opened { model: null_mut(), motion: null_mut(), values: expected.clone() };
    // SAFETY: places for two pointers.
    unsafe {
        assert_eq!(softtwin_model_open(path.as_ptr(), &raw mut opened.model), softtwin_status::SOFTTWIN_OK);
        let status = softtwin_motion_open(opened.model, &raw mut opened.motion);
        assert_eq!(status, softtwin_status::SOFTTWIN_OK);
    }
    let mut moving = Session::new(&model, Gaps::Live).unwrap();
    let mut evaluation = moving.evaluation();
    let mut lowest = [f32::INFINITY; 2];
    for lowest in &mut lowest {
        for k in 0..60_u64 {
            let pressure_mpa = if k < 3 { 0.02 } else { 0.12 };
            let inputs = Inputs::new(pressure_mpa, 20.0);
            moving.step(5_000_000 * k, inputs, &mut evaluation).unwrap();
            reconstructor.reconstruct_into(&evaluation, &mut expected).unwrap();
            assert_eq!(opened.step(5_000_000 * k, pressure_mpa), softtwin_status::SOFTTWIN_OK);
            assert_eq!(opened.values, expected, "step {k}");
            *lowest = opened.values.iter().copied().fold(*lowest, f32::min);
            for (t_ns, pressure_mpa) in [(5_000_000 * k, 0.2), (u64::MAX, f64::NAN)] {
                assert_eq!(opened.step(t_ns, pressure_mpa), softtwin_status::SOFTTWIN_ARGUMENT);
            }
        }
        moving.restart();
        // SAFETY: the motion is open.
        unsafe { softtwin_motion_reset(opened.motion) };
    }
    assert_eq!(lowest[0].to_bits(), lowest[1].to_bits());
}
