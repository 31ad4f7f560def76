//! A model along readings in this process: its memory and its inertia, without a daemon.

use crate::ffi::{argument, call, put, take, write_handle};
use crate::model::{softtwin_model, softtwin_prediction};
use crate::status::softtwin_status;
use rom::evaluation::Evaluation;
use rom::session::{Gaps, Session};
use rom::snapshots::RegimeKind;

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
        let of = unsafe { model.as_ref() }.ok_or_else(|| argument("the model is null"))?;
        let session = Session::new(of.model(), Gaps::Live).map_err(|error| argument(&error.to_string()))?;
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
        let model = unsafe { motion.model.as_ref() }.ok_or_else(|| argument("the model is null"))?;
        if inputs.is_null() || out.is_null() {
            return Err(argument("the inputs or the place for the prediction is null"));
        }
        // SAFETY: one number per input by the caller's promise.
        let inputs = model.state(0, unsafe { std::slice::from_raw_parts(inputs, model.width()) })?;
        let refused = |error: &dyn std::fmt::Display| argument(&error.to_string());
        let set = motion.session.set_parameters(&inputs, &mut motion.evaluation);
        set.map_err(|error| refused(&error))?;
        // Only a model that lacks a regime can have no fields after its step.
        let evaluator = motion.session.evaluator();
        let is_whole = [RegimeKind::Free, RegimeKind::Contact].iter().all(|kind| evaluator.has_regime(*kind));
        let before = (!is_whole && evaluator.onset().is_some()).then(|| motion.session.clone());
        let stepped = motion.session.step(t_ns, inputs, &mut motion.evaluation);
        stepped.map_err(|error| refused(&error))?;
        // SAFETY: by the caller's promise.
        let peaks = unsafe { model.fields(&"the state", &motion.evaluation, values) };
        let peaks = peaks.inspect_err(|_| before.into_iter().for_each(|before| motion.session = before))?;
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
