//! Inputs behind the memory of a model; readings that its motion refuses.

use rom::halfwidths::HalfWidths;
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

/// Outcome of a reading that the motion did not use.
pub(super) fn refused(error: ReadingError) -> Outcome {
    match error {
        ReadingError::NotLater { .. } => Outcome::DroppedBackInTime,
        ReadingError::NotFinite { .. } => Outcome::DroppedModel,
    }
}
