//! A model with its past: everyone who follows readings steps a [`Session`].
//!
//! A reading passes through the memory of the inputs, then the branch of a model over volumes, then the motion of the body, and is
//! evaluated there. A session refuses a reading before anything moves, so that the next one finds it as it was.

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

/// What the inputs did between two readings that are far apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gaps {
    /// Readings arrive while they are taken, and nobody knows what happened in a gap: the last inputs are held, half-widths grow by
    /// what the memory cannot know, and after a long gap a motion restarts at rest.
    Live,
    /// All readings are instants of one recording or simulation that begins at rest: inputs are straight lines between any two of them.
    Recorded,
}

/// Static model, model with memory of its inputs, with inertia, or with both; a model over volumes also follows a pressure
/// ([`crate::branch`]). A clone is the state at an instant.
#[derive(Clone, Debug)]
pub struct Session {
    evaluator: Evaluator,
    memory: Option<Memory>,
    follower: Option<Follower>,
    motion: Option<Box<ModelMotion>>,
    /// Time of the last reading, ns.
    last_ns: Option<u64>,
}

/// What a step came to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepOutcome {
    /// Largest distance of the inertial load from its training range since the last reading, as a fraction of it.
    pub load_distance: f64,
    /// Memory or motion began at equilibrium with this reading.
    pub at_rest: bool,
    /// The inputs were held over a gap in the readings.
    pub held: bool,
}

impl Session {
    /// A model without a past.
    ///
    /// # Errors
    /// Memory or inertia that do not fit the model.
    pub fn new(model: &Model, gaps: Gaps) -> Result<Self, ModelFileError> {
        let mut session = Self {
            evaluator: Evaluator::new(&model.header)?,
            memory: Memory::of(model)?,
            follower: Follower::of(model)?,
            motion: ModelMotion::new(model)?.map(Box::new),
            last_ns: None,
        };
        if gaps == Gaps::Recorded {
            session.memory.iter_mut().for_each(Memory::hold_never);
            session.follower.iter_mut().for_each(Follower::hold_never);
            session.motion.iter_mut().for_each(|motion| motion.as_recording());
        }
        Ok(session)
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

    /// Forgets: the next reading begins at equilibrium, at any time.
    pub fn restart(&mut self) {
        self.memory.iter_mut().for_each(Memory::restart);
        self.follower.iter_mut().for_each(Follower::restart);
        self.motion.iter_mut().for_each(|motion| motion.reset());
        self.last_ns = None;
    }

    /// Moves to a reading and evaluates: the inputs of the evaluation are those behind the memory, with the inertial load. A static model
    /// follows at once, whatever the time. A model over volumes takes the volume of a reading, or follows its pressure. Allocates nothing.
    ///
    /// # Errors
    /// [`ReadingError`]; session and evaluation have not changed.
    pub fn step(
        &mut self,
        t_ns: u64,
        inputs: Inputs,
        out: &mut Evaluation,
    ) -> Result<StepOutcome, ReadingError> {
        self.check(t_ns, &inputs)?;
        let mut outcome = StepOutcome::default();
        let (mut behind, mut of_past) = (inputs, None);
        if let Some(memory) = &mut self.memory {
            match memory.advance(t_ns, &inputs) {
                Advance::Started => outcome.at_rest = true,
                Advance::Gap => outcome.held = true,
                // The last two were refused above.
                Advance::Advanced | Advance::Late | Advance::NotFinite => {}
            }
            (behind, of_past) = (memory.effective(&inputs), Some(memory.half_widths()));
        }
        let follower = self.follower.as_mut().filter(|follower| follower.is_for(&inputs));
        let followed = follower.map(|follower| follower.advance(t_ns, &mut behind));
        match &mut self.motion {
            Some(motion) => {
                let moved = motion.advance(t_ns, behind, out)?;
                outcome.load_distance = moved.load_distance;
                outcome.at_rest |= moved.at_rest;
                outcome.held |= moved.held;
            }
            None => self.evaluator.evaluate(behind, out),
        }
        self.last_ns = Some(t_ns);
        followed.iter().for_each(|followed| followed.describe(out));
        if let Some(of_past) = of_past {
            out.halfwidths = out.halfwidths.with(&of_past);
        }
        Ok(outcome)
    }

    /// As [`Self::step`] for inputs that jumped right after the last reading and are held until `t_ns`, as a simulation gives them.
    /// Before the first reading the model is at rest under them at time 0.
    ///
    /// # Errors
    /// [`ReadingError`]; session and evaluation have not changed.
    pub fn step_held(
        &mut self,
        t_ns: u64,
        inputs: Inputs,
        out: &mut Evaluation,
    ) -> Result<StepOutcome, ReadingError> {
        self.check(t_ns, &inputs)?;
        let jump_ns = self.last_ns.map_or(0, |last_ns| last_ns + 1);
        if jump_ns == t_ns {
            return self.step(t_ns, inputs, out);
        }
        let jumped = self.step(jump_ns, inputs, out)?;
        let held = self.step(t_ns, inputs, out)?;
        Ok(StepOutcome {
            load_distance: jumped.load_distance.max(held.load_distance),
            at_rest: jumped.at_rest || held.at_rest,
            held: held.held,
        })
    }

    /// Refuses what a step cannot take, before anything moves.
    fn check(&self, t_ns: u64, inputs: &Inputs) -> Result<(), ReadingError> {
        let follows = self.follower.as_ref().is_some_and(|follower| follower.is_for(inputs));
        let last_ns = self.last_ns.filter(|last_ns| t_ns <= *last_ns && (follows || self.has_memory()));
        if let Some(last_ns) = last_ns {
            return Err(ReadingError::NotLater { found_ns: t_ns, last_ns });
        }
        let is_remembered = self.memory.as_ref().is_none_or(|memory| memory.takes(inputs));
        if !is_remembered || follows && !inputs.pressure_mpa().is_finite() {
            return Err(ReadingError::NotFinite { found_ns: t_ns });
        }
        self.motion.as_ref().map_or(Ok(()), |motion| motion.check(t_ns, inputs))
    }
}
