//! Blocks of a model's memory and their constants.

use super::creep::{Creep, MAX_CREEPS};
use super::line::Line;
use super::orifice::Orifice;
use super::play::{MAX_PLAYS, Play};
use crate::inputs::MAX_INPUTS;
use crate::model::{BlockKind, Model, ModelFileError};
use serde::{Deserialize, Serialize};

/// Blocks of a model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MemorySpec {
    /// Inputs with memory; the others act at once.
    pub inputs: Vec<InputMemory>,
    /// Longest time between two readings that is bridged by a straight line, s. Over a longer one the last input is held, and the input
    /// counts as unknown.
    pub max_gap_s: f64,
}

/// Blocks of one input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputMemory {
    /// Position in the model's inputs.
    pub input: usize,
    /// Smallest and largest value that an unknown past may have had.
    pub range: [f64; 2],
    /// Line.
    pub line: Option<Line>,
    /// Line with an orifice in place of `line`; the input is a gauge pressure, MPa.
    pub orifice: Option<Orifice>,
    /// Play operators.
    pub play: Vec<Play>,
    /// Creep.
    pub creep: Vec<Creep>,
    /// Largest slopes of the answers, by which an unknown past widens the half-widths.
    pub slopes: Slopes,
}

/// Largest change of a model's answers per unit of an input; 0 where there is none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Slopes {
    /// Largest slope of the displacement of any node, mm per unit.
    pub displacement_mm: f64,
    /// Slope of the stress, MPa per unit.
    pub stress_mpa: f64,
    /// Slope of the contact force, N per unit.
    pub force_n: f64,
}

impl InputMemory {
    /// True if the pressure of the cavity lags behind the input.
    pub(super) fn has_lag(&self) -> bool {
        self.line.is_some() || self.orifice.is_some()
    }

    /// True if the past of the creep is another one than that of line and play.
    pub fn has_two_pasts(&self) -> bool {
        !self.creep.is_empty() && (self.has_lag() || !self.play.is_empty())
    }

    fn check(&self, inputs: usize) -> Result<(), String> {
        let positive = |value: f64| value > 0.0 && value.is_finite();
        let require = |sound: bool, what: &str| if sound { Ok(()) } else { Err(what.to_owned()) };
        require(self.input < inputs, "memory of a missing input")?;
        require(
            self.range.iter().all(|v| v.is_finite()) && self.range[0] <= self.range[1],
            "the range of an input's past is empty",
        )?;
        let line = self.line.is_none_or(|line| positive(line.fill_s) && positive(line.empty_s));
        require(line, "a line's time constant is not above 0 s")?;
        let orifice =
            self.orifice.is_none_or(|o| positive(o.time_s) && (0.0..1.0).contains(&o.critical_ratio));
        require(orifice, "an orifice's time is not above 0 s or its critical ratio not within 0 and 1")?;
        require(self.line.is_none() || self.orifice.is_none(), "a line and an orifice of one input")?;
        require(self.play.len() <= MAX_PLAYS, "more than six play operators")?;
        require(self.play.iter().all(|p| positive(p.threshold)), "a threshold of play is not above 0")?;
        require(self.creep.len() <= MAX_CREEPS, "more than four creep terms")?;
        require(self.creep.iter().all(|c| positive(c.time_s)), "a creep time is not above 0 s")?;
        let Slopes { displacement_mm, stress_mpa, force_n } = self.slopes;
        let slopes = [displacement_mm, stress_mpa, force_n];
        require(slopes.iter().all(|s| *s >= 0.0 && s.is_finite()), "a slope of memory is not valid")?;
        let plays = self.play.iter().map(|play| play.weight);
        require(are_shares(plays), "weights of play are not within 0 and 1")?;
        require(are_shares(self.creep.iter().map(|c| c.weight)), "weights of creep are not within 0 and 1")
    }
}

/// True if the weights are not negative and leave the rest of 1 to the input.
fn are_shares(mut weights: impl Iterator<Item = f64>) -> bool {
    weights.try_fold(0.0, |sum, w| (w >= 0.0).then_some(sum + w)).is_some_and(|sum| sum <= 1.0)
}

impl MemorySpec {
    /// Memory of a model; `None` for a static model.
    ///
    /// # Errors
    /// [`ModelFileError::Header`] for blocks that are not valid.
    pub fn of(model: &Model) -> Result<Option<Self>, ModelFileError> {
        let found: Option<Self> = model.record(BlockKind::Memory)?;
        if let Some(spec) = &found {
            let refused = |reason| ModelFileError::Header(format!("memory: {reason}"));
            spec.check(model.header.inputs.len()).map_err(refused)?;
        }
        Ok(found)
    }

    /// Checks the blocks for a model with this number of inputs.
    ///
    /// # Errors
    /// A sentence on the first block that is not valid.
    pub fn check(&self, inputs: usize) -> Result<(), String> {
        if self.inputs.is_empty() || self.inputs.windows(2).any(|pair| pair[0].input >= pair[1].input) {
            return Err("inputs with memory are missing or out of order".into());
        }
        if !(self.max_gap_s > 0.0 && self.max_gap_s.is_finite()) {
            return Err("the longest gap is not above 0 s".into());
        }
        self.inputs.iter().try_for_each(|input| input.check(inputs.min(MAX_INPUTS)))
    }
}
