//! Inputs of a model over time: behind its memory, if it has one.

use rom::inputs::Inputs;
use rom::memory::Memory;
use rom::model::{Model, ModelFileError};

/// Effect of an unknown past, as a fraction of an input's range, below which it is not followed further.
const FADED: f64 = 1e-4;

/// Memory of a model along a series of readings.
pub struct Past {
    memory: Option<Memory>,
    begin_s: Option<f64>,
}

/// Inputs of the static map at a reading.
pub struct Effective {
    /// Inputs.
    pub inputs: Inputs,
    /// Inputs after the smallest and the largest past; `None` once the past has faded.
    pub enclosing: Option<[Inputs; 2]>,
}

impl Past {
    /// Memory of a model without a past.
    pub fn of(model: &Model) -> Result<Self, ModelFileError> {
        Ok(Self { memory: Memory::of(model)?, begin_s: None })
    }

    /// Advances to a reading. One that is not after the last leaves the memory unchanged.
    pub fn at(&mut self, t_s: f64, inputs: &Inputs) -> Effective {
        let begin_s = *self.begin_s.get_or_insert(t_s);
        let Some(memory) = &mut self.memory else { return Effective { inputs: *inputs, enclosing: None } };
        let t_ns = (1e9 * (t_s - begin_s)).round();
        if t_ns >= 0.0 {
            memory.advance(t_ns as u64, inputs);
        }
        let spread = memory.spread();
        let is_open =
            memory.spec().inputs.iter().any(|of| spread[of.input] > FADED * (of.range[1] - of.range[0]));
        let inputs_behind = memory.effective(inputs);
        Effective { inputs: inputs_behind, enclosing: is_open.then(|| memory.enclosing(inputs)) }
    }
}
