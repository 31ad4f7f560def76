//! A model with its past: everyone who follows readings steps a [`Session`].
//!
//! A reading passes through the memory of the inputs, then the branch of a model over volumes, then the motion of the body, and is
//! evaluated there. A session refuses a reading before anything moves, so that the next one finds it as it was.

use crate::branch::{BranchState, Follower};
use crate::evaluation::Evaluation;
use crate::evaluator::{Evaluator, Query};
use crate::halfwidths::HalfWidths;
use crate::inertia::model_motion::ModelMotion;
use crate::inertia::stepper::ReadingError;
use crate::inputs::{Inputs, MAX_INPUTS};
use crate::learned::{LearnedState, OffsetFilter};
use crate::memory::{Advance, Memory};
use crate::model::{Model, ModelError, ModelFileError};

/// What the inputs did between two readings that are far apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gaps {
    /// Readings arrive while they are taken, and nobody knows what happened in a gap: the last inputs are held, half-widths grow by
    /// what the memory cannot know, and after a long gap a motion restarts at rest.
    Live,
    /// All readings are instants of one recording or simulation that begins at rest: inputs are straight lines between any two of them.
    Recorded,
}

/// A model together with what it remembers of earlier readings: filtered inputs, a motion, a learned state, and of a model over volumes
/// the branch that it is on ([`crate::branch`]); each only if the model has it. A clone is a saved state.
#[derive(Clone, Debug)]
pub struct Session {
    evaluator: Evaluator,
    memory: Option<Memory>,
    learned: Option<LearnedPast>,
    /// Offsets of a learned model's outputs that follow their measured values.
    following: Option<OffsetFilter>,
    follower: Option<Follower>,
    motion: Option<Box<ModelMotion>>,
    /// Time of the last reading, ns.
    last_ns: Option<u64>,
}

/// The past of a model learned from measurements.
#[derive(Clone, Debug)]
struct LearnedPast {
    state: Box<LearnedState>,
    /// The longest gap between two readings over which the inputs are straight lines, s; longer ones hold the last inputs.
    max_gap_s: f64,
}

/// A reading that a session has taken.
#[derive(Clone, Copy, Debug)]
pub struct FilteredInputs {
    /// What the static model sees: the inputs after the memory and, for a model over volume, with the volume on the present branch.
    pub inputs: Inputs,
    /// Largest errors of each input by what the memory does not know of the past.
    pub spread: [[f64; 2]; MAX_INPUTS],
    t_ns: u64,
    /// Half-widths that come from the spread; `None` without memory.
    halfwidths: Option<HalfWidths>,
    followed: Option<BranchState>,
    at_rest: bool,
    held: bool,
}

impl FilteredInputs {
    /// The memory knows nothing from before this reading, or not what happened since the one before.
    pub fn has_new_past(&self) -> bool {
        self.at_rest || self.held
    }

    /// The reading before is so long ago that the memory does not know what the inputs did since.
    pub fn is_after_gap(&self) -> bool {
        self.held
    }

    /// Notes what a reading that was taken did to the memory.
    fn note(&mut self, advance: Advance) {
        match advance {
            Advance::Started => self.at_rest = true,
            Advance::Gap => self.held = true,
            // The last two were refused before.
            Advance::Advanced | Advance::Late | Advance::NotFinite => {}
        }
    }

    /// Adds the branch and what the memory does not know to an evaluation at these inputs.
    pub fn apply_to(&self, out: &mut Evaluation) {
        self.followed.iter().for_each(|followed| followed.apply_to(out));
        if let Some(halfwidths) = &self.halfwidths {
            out.halfwidths = out.halfwidths.with(halfwidths);
        }
    }
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
        let mut follower = Follower::of(model)?;
        if gaps == Gaps::Recorded {
            follower.iter_mut().for_each(Follower::hold_never);
        }
        Ok(Self { follower, ..Self::with_volumes(model, gaps)? })
    }

    /// As [`Self::new`] for readings that contain the volume wherever the model takes one: the field of pressures need not be loaded.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_volumes(model: &Model, gaps: Gaps) -> Result<Self, ModelFileError> {
        let learned = model.header.learned.as_ref();
        let max_gap_s = |longest_s: f64| if gaps == Gaps::Recorded { f64::INFINITY } else { longest_s };
        let mut session = Self {
            evaluator: Evaluator::new(&model.header)?,
            learned: learned.map(|map| LearnedPast {
                state: Box::new(map.initial_state()),
                max_gap_s: max_gap_s(map.max_gap_s),
            }),
            following: None,
            memory: Memory::of(model)?,
            follower: None,
            motion: ModelMotion::new(model)?.map(Box::new),
            last_ns: None,
        };
        if gaps == Gaps::Recorded {
            session.memory.iter_mut().for_each(Memory::hold_never);
            session.motion.iter_mut().for_each(|motion| motion.as_recording());
        }
        Ok(session)
    }

    /// True for a model whose answers depend on the past.
    pub fn has_memory(&self) -> bool {
        let learned = self.evaluator.learned();
        self.memory.is_some() || self.motion.is_some() || learned.is_some_and(|map| map.has_memory())
    }

    /// True for a model with memory of its inputs.
    pub fn filters_inputs(&self) -> bool {
        self.memory.is_some()
    }

    /// True for a model with inertia.
    pub fn has_inertia(&self) -> bool {
        self.motion.is_some()
    }

    /// True for a model over volumes that follows a pressure.
    pub fn follows_pressure(&self) -> bool {
        self.follower.is_some()
    }

    /// From now on the outputs of a learned model have offsets that follow measured values ([`Self::follow`]). False for another model.
    pub fn start_following(&mut self) -> bool {
        self.following = self.evaluator.learned().map(|map| OffsetFilter::new(map));
        self.following.is_some()
    }

    /// Measured minus freely predicted value of an output, which [`Self::follow`] takes: `answered` is the session's answer at that time,
    /// after which it has followed nothing. NaN if one of them is not there.
    pub fn free_error(&self, output: usize, measured: f64, answered: &Evaluation) -> f64 {
        let answer = answered.coefficients.get(output).copied().unwrap_or(f64::NAN);
        measured - (answer - self.offset(output))
    }

    /// Takes measured minus freely predicted values ([`Self::free_error`]) of a time, ns, by output; NaN where nothing was measured. They
    /// count from the next answer on. Allocates nothing.
    pub fn follow(&mut self, t_ns: u64, errors: &[f64]) {
        self.following.iter_mut().for_each(|following| following.take(t_ns, errors));
    }

    /// True if answers have offsets that follow measured values.
    pub fn has_followed(&self) -> bool {
        self.following.as_ref().is_some_and(OffsetFilter::has_begun)
    }

    /// Part of an output's value that follows measured values; 0 where none are followed.
    pub fn offset(&self, output: usize) -> f64 {
        self.following.as_ref().map_or(0.0, |following| following.offset(output))
    }

    /// As [`Evaluator::restrict`].
    pub fn restrict(&mut self, fields: &[usize]) {
        self.evaluator.restrict(fields);
    }

    /// Its static evaluator alone.
    pub fn into_evaluator(self) -> Evaluator {
        self.evaluator
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

    /// Evaluation with capacity for any state.
    pub fn evaluation(&self) -> Evaluation {
        self.motion.as_ref().map_or_else(|| self.evaluator.evaluation(), |motion| motion.evaluation())
    }

    /// Forgets: the next reading begins at equilibrium, at any time.
    pub fn restart(&mut self) {
        self.memory.iter_mut().for_each(Memory::restart);
        self.learned.iter_mut().for_each(|past| past.state.restart());
        self.following.iter_mut().for_each(OffsetFilter::restart);
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
        let filtered = self.take(t_ns, inputs)?;
        let outcome = self.answer(&filtered, out)?;
        self.complete(out);
        Ok(outcome)
    }

    /// First half of [`Self::step`]: the reading passes through the memory and the branch. Readings that arrive faster than they are
    /// answered are all taken, so that the memory sees each of them, and only the newest are answered.
    ///
    /// # Errors
    /// [`ReadingError`]; the session has not changed.
    pub fn take(&mut self, t_ns: u64, inputs: Inputs) -> Result<FilteredInputs, ReadingError> {
        self.check(t_ns, &inputs)?;
        let mut filtered = FilteredInputs {
            inputs,
            spread: [[0.0; 2]; MAX_INPUTS],
            t_ns,
            halfwidths: None,
            followed: None,
            at_rest: false,
            held: false,
        };
        if let Some(memory) = &mut self.memory {
            filtered.note(memory.advance(t_ns, &inputs));
            filtered.inputs = memory.effective(&inputs);
            (filtered.spread, filtered.halfwidths) = (memory.spreads(), Some(memory.half_widths()));
        }
        if let Some((past, map)) = self.learned.as_mut().zip(self.evaluator.learned()) {
            let inputs = self.evaluator.with_defaults(inputs);
            if map.has_memory() {
                filtered.note(past.state.advance(map, t_ns, &inputs, past.max_gap_s));
            } else {
                past.state.settle(map, &inputs);
            }
        }
        let follower = self.follower.as_mut().filter(|follower| follower.is_for(&inputs));
        filtered.followed = follower.map(|follower| follower.advance(t_ns, &mut filtered.inputs));
        self.last_ns = Some(t_ns);
        Ok(filtered)
    }

    /// True if an answer is that of the newest reading that was taken, whichever is asked for: the state of a learned model is not kept
    /// with each reading. Who wants an answer to every reading asks before the next is taken.
    pub fn answers_only_the_newest(&self) -> bool {
        self.learned.is_some()
    }

    /// Second half of [`Self::step`]: the body moves to a reading that was taken and is evaluated there. The coefficients of a model without
    /// inertia come with [`Self::complete`]: a state without fields does not need them.
    ///
    /// # Errors
    /// [`ReadingError`] for a reading that is not later than the last one answered; session and evaluation have not changed.
    pub fn answer(
        &mut self,
        filtered: &FilteredInputs,
        out: &mut Evaluation,
    ) -> Result<StepOutcome, ReadingError> {
        let mut outcome = StepOutcome { load_distance: 0.0, at_rest: filtered.at_rest, held: filtered.held };
        match (&mut self.motion, &mut self.learned) {
            (_, Some(past)) => {
                let following = self.following.as_ref().map(|following| (following, filtered.t_ns));
                self.evaluator.answer_after(filtered.inputs, &mut past.state, following, out);
            }
            (Some(motion), _) => {
                let moved = motion.advance(filtered.t_ns, filtered.inputs, out)?;
                outcome.load_distance = moved.load_distance;
                outcome.at_rest |= moved.at_rest;
                outcome.held |= moved.held;
            }
            (None, None) => self.evaluator.answer(filtered.inputs, Query::STATE, out),
        }
        filtered.apply_to(out);
        Ok(outcome)
    }

    /// Adds the coefficients to an evaluation of [`Self::answer`].
    pub fn complete(&self, out: &mut Evaluation) {
        self.evaluator.complete(out);
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
        let is_remembered = self.memory.as_ref().is_none_or(|memory| memory.takes(inputs))
            && self
                .evaluator
                .learned()
                .is_none_or(|map| !map.has_memory() || map.takes(&self.evaluator.with_defaults(*inputs)));
        if !is_remembered || follows && !inputs.pressure_mpa().is_finite() {
            return Err(ReadingError::NotFinite { found_ns: t_ns });
        }
        self.motion.as_ref().map_or(Ok(()), |motion| motion.check(t_ns, inputs))
    }
}
