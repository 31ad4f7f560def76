//! A model along readings: its inputs behind the memory, its motion, its evaluation there.

use crate::branch::Follower;
use crate::evaluation::Evaluation;
use crate::evaluator::Evaluator;
use crate::inertia::model_motion::ModelMotion;
use crate::inertia::stepper::ReadingError;
use crate::inputs::Inputs;
use crate::memory::{Advance, Memory};
use crate::model::{Model, ModelError, ModelFileError};

/// Effect of an unknown past, as a fraction of an input's range, below which it has faded.
const FADED: f64 = 1e-4;

/// Static model, model with memory of its inputs, with inertia, or with both; a model over volumes also follows a pressure
/// ([`crate::branch`]). A clone is the state at an instant.
#[derive(Clone, Debug)]
pub struct Moving {
    evaluator: Evaluator,
    memory: Option<Memory>,
    follower: Option<Follower>,
    motion: Option<Box<ModelMotion>>,
}

/// Outcome of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stepped {
    /// Largest distance of the inertial load from its training range since the last reading, as a fraction of it.
    pub load_distance: f64,
    /// Memory or motion began at equilibrium with this reading.
    pub at_rest: bool,
    /// The inputs were held over a gap in the readings.
    pub held: bool,
}

impl Moving {
    /// A model without a past.
    ///
    /// # Errors
    /// Memory or inertia that do not fit the model.
    pub fn new(model: &Model) -> Result<Self, ModelFileError> {
        Ok(Self {
            evaluator: Evaluator::new(&model.header)?,
            memory: Memory::of(model)?,
            follower: Follower::of(model)?,
            motion: ModelMotion::new(model)?.map(Box::new),
        })
    }

    /// Treats all readings as instants of one recording: inputs are straight lines between any two of them.
    #[must_use]
    pub fn as_recording(mut self) -> Self {
        self.motion = self.motion.map(|motion| Box::new(motion.as_recording()));
        if let Some(memory) = &mut self.memory {
            memory.hold_never();
        }
        self.follower.iter_mut().for_each(Follower::hold_never);
        self
    }

    /// True for a model whose answers depend on the past.
    pub fn has_memory(&self) -> bool {
        self.memory.is_some() || self.motion.is_some()
    }

    /// True for a model with inertia.
    pub fn has_inertia(&self) -> bool {
        self.motion.is_some()
    }

    /// Its static evaluator.
    pub fn evaluator(&self) -> &Evaluator {
        &self.evaluator
    }

    /// Sets the parameters of a model, which it takes where a reading does not.
    ///
    /// # Errors
    /// As [`Evaluator::set_parameters`].
    pub fn set_parameters(&mut self, inputs: &Inputs, scratch: &mut Evaluation) -> Result<(), ModelError> {
        self.evaluator.set_parameters(inputs, scratch)
    }

    /// Inputs behind the memory at the last reading after the smallest and the largest past, which enclose those after any past; `None`
    /// without memory or once the past has faded.
    pub fn enclosing(&self, inputs: &Inputs) -> Option<[Inputs; 2]> {
        let memory = self.memory.as_ref()?;
        let spread = memory.spread();
        let is_open =
            memory.spec().inputs.iter().any(|of| spread[of.input] > FADED * (of.range[1] - of.range[0]));
        is_open.then(|| memory.enclosing(inputs))
    }

    /// Evaluation with capacity for any state.
    pub fn evaluation(&self) -> Evaluation {
        self.motion.as_ref().map_or_else(|| self.evaluator.evaluation(), |motion| motion.evaluation())
    }

    /// Forgets: the next reading begins at equilibrium.
    pub fn reset(&mut self) {
        self.memory.iter_mut().for_each(Memory::restart);
        self.follower.iter_mut().for_each(Follower::restart);
        self.motion.iter_mut().for_each(|motion| motion.reset());
    }

    /// Moves to a reading and evaluates: the inputs of the evaluation are those behind the memory, with the inertial load. A static model
    /// follows at once. A model over volumes takes the volume of a reading, or follows its pressure. Allocates nothing.
    ///
    /// # Errors
    /// [`ReadingError`]; nothing changed.
    pub fn step(&mut self, t_ns: u64, inputs: Inputs, out: &mut Evaluation) -> Result<Stepped, ReadingError> {
        let mut stepped = Stepped::default();
        let mut follower = self.follower.as_mut().filter(|follower| follower.is_for(&inputs));
        if follower.is_some() && !inputs.pressure_mpa().is_finite() {
            return Err(ReadingError::NotFinite { found_ns: t_ns });
        }
        let (mut behind, mut of_past) = (inputs, None);
        if let Some(memory) = &mut self.memory {
            match memory.advance(t_ns, &inputs) {
                Advance::Late => {
                    let last_ns = memory.last_ns().unwrap_or_default();
                    return Err(ReadingError::NotLater { found_ns: t_ns, last_ns });
                }
                Advance::NotFinite => return Err(ReadingError::NotFinite { found_ns: t_ns }),
                Advance::Started => stepped.at_rest = true,
                Advance::Gap => stepped.held = true,
                Advance::Advanced => {}
            }
            (behind, of_past) = (memory.effective(&inputs), Some(memory.half_widths()));
        }
        let followed = follower.as_mut().map(|follower| follower.advance(t_ns, &mut behind));
        match &mut self.motion {
            Some(motion) => {
                let moved = motion.advance(t_ns, behind, out)?;
                stepped.load_distance = moved.load_distance;
                stepped.at_rest |= moved.at_rest;
                stepped.held |= moved.held;
            }
            None => self.evaluator.evaluate(behind, out),
        }
        followed.iter().for_each(|followed| followed.describe(out));
        if let Some(of_past) = of_past {
            out.halfwidths = out.halfwidths.with(&of_past);
        }
        Ok(stepped)
    }
}
