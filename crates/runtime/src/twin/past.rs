//! States that a model carries from reading to reading: inputs behind its memory, its motion.

use rom::branch::{Followed, Follower};
use rom::evaluation::Evaluation;
use rom::evaluator::RegimeLabel;
use rom::halfwidths::HalfWidths;
use rom::inertia::model_motion::ModelMotion;
use rom::inertia::stepper::ReadingError;
use rom::inputs::{Inputs, MAX_INPUTS};
use rom::memory::{Advance, Memory};
use wire::{Outcome, SensorSample};

/// Inputs of the static map at a reading.
#[derive(Debug, Clone, Copy)]
pub(super) struct Behind {
    /// The model's inputs: those of the reading, behind the memory if the model has one.
    pub inputs: Inputs,
    /// Largest errors of each by unknown pasts.
    pub spread: [[f64; 2]; MAX_INPUTS],
    /// Half-widths from it.
    pub half_widths: HalfWidths,
    /// The past became unknown with this reading.
    pub is_new_past: bool,
    /// Branch that a pressure without volume is on.
    pub followed: Option<Followed>,
}

/// States that inputs carry from reading to reading.
#[derive(Debug)]
pub(super) struct Past {
    /// Memory of the inputs; `None` for a static model.
    pub memory: Option<Memory>,
    /// Volume of a pressure, for a model over volumes.
    pub follower: Option<Follower>,
}

impl Past {
    /// Inputs behind the memory at a reading, with the volume on the present branch. Without memory the inputs themselves.
    pub fn behind(&mut self, sample: &SensorSample, inputs: Inputs, is_new_source: bool) -> Behind {
        let mut behind = behind_memory(&mut self.memory, sample, inputs, is_new_source);
        if let Some(follower) = &mut self.follower {
            if is_new_source {
                follower.restart();
            }
            behind.followed = Some(follower.advance(sample.t_sensor_ns, &mut behind.inputs));
        }
        behind
    }
}

fn behind_memory(
    memory: &mut Option<Memory>,
    sample: &SensorSample,
    inputs: Inputs,
    is_new_source: bool,
) -> Behind {
    let Some(memory) = memory else {
        let half_widths = HalfWidths::default();
        return Behind {
            inputs,
            spread: [[0.0; 2]; MAX_INPUTS],
            half_widths,
            is_new_past: false,
            followed: None,
        };
    };
    if is_new_source {
        memory.restart();
    }
    let outcome = memory.advance(sample.t_sensor_ns, &inputs);
    Behind {
        inputs: memory.effective(&inputs),
        spread: memory.spreads(),
        half_widths: memory.half_widths(),
        is_new_past: matches!(outcome, Advance::Started | Advance::Gap),
        followed: None,
    }
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
