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
}

impl Regime {
    /// Its name in lists and databases.
    pub fn name(self) -> &'static str {
        match self {
            Self::Free => "free",
            Self::Contact => "contact",
            Self::Gripper => "gripper",
        }
    }

    /// Obstacle and regime of its model.
    pub fn kinds(self) -> (ObstacleKind, RegimeKind) {
        match self {
            Self::Free => (ObstacleKind::Plate, RegimeKind::Free),
            Self::Contact => (ObstacleKind::Plate, RegimeKind::Contact),
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
            gap_mm: gap_mm.map(|gap| rounded(gap, 1e6)),
        }
    }
}
