//! Regimes with names of the user's own, and what decides between them: what version 6 of the model file adds.

use crate::inputs::InputMap;
use crate::interpolant::Interpolant;
use serde::{Deserialize, Serialize};

/// The named regimes of a model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NamedRegimes {
    /// Their names, in the order of the model's regimes.
    pub names: Vec<String>,
    /// What decides between them; none for a single one.
    pub border: Option<Border>,
}

/// Decides which named regime a state is in: the one with the largest score. The score of a regime interpolates 1 at its own
/// training states and -1 at those of all others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Border {
    /// Inputs of the scores and their ranges over all training states.
    pub inputs: InputMap,
    /// One output for each regime.
    pub scores: Interpolant,
    /// A state whose best two scores are closer than this is near another regime.
    pub doubt: f64,
}
