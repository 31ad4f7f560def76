//! What lists of cases are for: their regimes, and the parameters of the actuator that vary in them.

use super::PlanError;
use crate::actuator::{Setting, moved_nodes};
use crate::cases::{Case, rounded};
use crate::family::{Family, VariantError};
use formats::database::ObstacleKind;
use rom::snapshots::RegimeKind;
use std::str::FromStr;

/// Regimes a list can be for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ListRegime {
    /// Pressure alone.
    Free,
    /// Pressure and gap, over a plate.
    Contact,
    /// Pressure and gap, before a block.
    Gripper,
    /// Pressure and gap over a plate; every fourth state free.
    Both,
}

/// One of this many states of both regimes is free: the free model has one input less.
const FREE_EVERY: usize = 4;

impl ListRegime {
    /// Its name in lists and databases.
    pub fn name(self) -> &'static str {
        match self {
            Self::Free => "free",
            Self::Contact | Self::Both => "contact",
            Self::Gripper => "gripper",
        }
    }

    /// The regime of a list's state: the list's own, or for both one of the two.
    pub fn of(self, index: usize) -> Self {
        match self {
            Self::Both if index.is_multiple_of(FREE_EVERY) => Self::Free,
            Self::Both => Self::Contact,
            other => other,
        }
    }

    /// Obstacle and regime of its model.
    pub fn kinds(self) -> (ObstacleKind, RegimeKind) {
        match self {
            Self::Free => (ObstacleKind::Plate, RegimeKind::Free),
            Self::Contact | Self::Both => (ObstacleKind::Plate, RegimeKind::Contact),
            Self::Gripper => (ObstacleKind::Block, RegimeKind::Contact),
        }
    }

    /// A case at a point (MPa, mm), rounded to 1e-9 MPa and 1e-6 mm for shorter lists.
    pub fn case(self, name: String, split: &str, (pressure_mpa, gap_mm): (f64, Option<f64>)) -> Case {
        Case {
            regime: self.name().into(),
            split: split.into(),
            ..Case::new(name, rounded(pressure_mpa, 1e9), gap_mm.map(|gap| rounded(gap, 1e6)))
        }
    }
}

/// More parameters make more corners of their ranges than can be checked, and more inputs than a model has.
const MOST: usize = 8;

/// A quantity of `actuator.toml` that varies.
#[derive(Clone, Debug)]
pub struct Parameter {
    /// Dotted key.
    pub name: String,
    /// Lower and upper value.
    pub range: [f64; 2],
}

impl FromStr for Parameter {
    type Err = String;

    /// `NAME=LOW:HIGH`.
    fn from_str(text: &str) -> Result<Self, String> {
        let expected = "expected NAME=LOW:HIGH with LOW < HIGH, such as elastomer.law.mu_mpa=0.6:1.0";
        let (name, range) = text.split_once('=').ok_or(expected)?;
        let (low, high) = range.split_once(':').ok_or(expected)?;
        match (low.trim().parse::<f64>(), high.trim().parse::<f64>()) {
            (Ok(low), Ok(high)) if low < high && low.is_finite() && high.is_finite() => {
                Ok(Self { name: name.trim().into(), range: [low, high] })
            }
            _ => Err(expected.into()),
        }
    }
}

/// Checks every corner of the ranges on the actuator's mesh: where no corner collides, nothing between them does, because
/// planes move linearly with each parameter.
///
/// # Errors
/// Too many parameters; a corner that the actuator or its mesh cannot have.
pub fn check_corners(family: &Family, parameters: &[Parameter]) -> Result<(), PlanError> {
    if parameters.len() > MOST {
        let found = parameters.len();
        return Err(PlanError::Refused(format!("--parameter: expected at most {MOST}, found {found}")));
    }
    let refused = |error: VariantError| PlanError::Refused(error.to_string());
    for corner in 0..1_usize << parameters.len() {
        let value = |(k, p): (usize, &Parameter)| (p.name.clone(), p.range[(corner >> k) & 1]);
        let settings: Vec<Setting> = parameters.iter().enumerate().map(value).collect();
        let changed = family.variant(&settings).and_then(|variant| family.actuator_of(&variant));
        let changed = changed.map_err(refused)?;
        moved_nodes(family.problem.mesh(), &family.actuator, &changed)
            .map_err(|wrong| refused(VariantError::Values(wrong)))?;
    }
    Ok(())
}
