//! The words of the case tables: regimes, splits and the obstacle that goes with a regime.

use rom::snapshots::{Footprint, RegimeKind, Split};
use serde::{Deserialize, Serialize};

/// What the actuator can touch. It decides about gravity as well, so one model holds the cases of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObstacleKind {
    /// A plate below the actuator: regimes `free` and `contact`.
    #[default]
    Plate,
    /// The block that a finger grips: regime `gripper`.
    Block,
}

impl ObstacleKind {
    /// All kinds.
    pub const ALL: [Self; 2] = [Self::Plate, Self::Block];

    /// Name on the command line: that of its scene.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plate => "plate",
            Self::Block => "gripper",
        }
    }

    /// Where the obstacle is, unless a database says otherwise.
    pub(super) const fn footprint(self) -> Footprint {
        match self {
            Self::Plate => Footprint::PLATE,
            Self::Block => Footprint::BLOCK,
        }
    }
}

/// Regimes as tables name them, with their meaning.
pub const REGIMES: [(&str, (ObstacleKind, RegimeKind)); 3] = [
    ("free", (ObstacleKind::Plate, RegimeKind::Free)),
    ("contact", (ObstacleKind::Plate, RegimeKind::Contact)),
    ("gripper", (ObstacleKind::Block, RegimeKind::Contact)),
];

/// Words for a regime in a table, as a message names them.
pub const ANY_REGIME: &str = "free, contact or gripper; a structure with several shapes (buckled, snapped) needs one database and \
                              one model per shape";

/// Splits as tables name them, the most urgent first.
pub const SPLITS: [(&str, Split); 3] =
    [("train", Split::Train), ("test", Split::Test), ("check", Split::Check)];

/// The name of a split.
pub(super) fn split_name(split: Split) -> &'static str {
    SPLITS.iter().find(|(_, value)| *value == split).map_or("", |(name, _)| name)
}
