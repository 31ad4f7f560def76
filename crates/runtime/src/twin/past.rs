//! States that a model carries from reading to reading: inputs behind its memory, its motion.

use rom::evaluation::Evaluation;
use rom::evaluator::RegimeLabel;
use rom::halfwidths::HalfWidths;
use rom::inertia::model_motion::ModelMotion;
use rom::inertia::stepper::ReadingError;
use rom::inputs::Inputs;
use rom::memory::Memory;
use wire::{Outcome, SensorSample};

/// Inputs behind the memory at a reading, and half-widths from its unknown past. Without memory the inputs themselves.
pub(super) fn inputs_behind(
    memory: &mut Option<Memory>,
    sample: &SensorSample,
    inputs: Inputs,
    is_new_source: bool,
) -> (Inputs, HalfWidths) {
    let Some(memory) = memory else { return (inputs, HalfWidths::default()) };
    if is_new_source {
        memory.restart();
    }
    memory.advance(sample.t_sensor_ns, &inputs);
    (memory.effective(&inputs), memory.half_widths())
}

/// Moves a model with inertia to a reading and evaluates it.
///
/// # Errors
/// Outcome of a reading that the motion does not use.
pub(super) fn moved(
    motion: &mut ModelMotion,
    t_sensor_ns: u64,
    inputs: Inputs,
    out: &mut Evaluation,
) -> Result<RegimeLabel, Outcome> {
    let moved = motion.advance(t_sensor_ns, inputs, out).map_err(|error| match error {
        ReadingError::NotLater { .. } => Outcome::DroppedBackInTime,
        ReadingError::NotFinite { .. } => Outcome::DroppedModel,
    })?;
    Ok(RegimeLabel { regime: moved.state.regime, held: false })
}
