//! Regimes that lists of cases are for.

use fem::cases::Case;
use formats::database::ObstacleKind;
use rom::snapshots::RegimeKind;

/// Regimes a list can be for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Regime {
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

impl Regime {
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
        let rounded = |value: f64, per_unit: f64| (value * per_unit).round() / per_unit;
        Case {
            name,
            regime: self.name().into(),
            split: split.into(),
            pressure_mpa: rounded(pressure_mpa, 1e9),
            volume_mm3: None,
            gap_mm: gap_mm.map(|gap| rounded(gap, 1e6)),
            settings: Vec::new(),
        }
    }
}
