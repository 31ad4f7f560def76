//! Boxes of an actuator from `actuator.toml`: solid parts, cut-outs, walls.

use super::file::{Channels, Shape, Slots};

/// Lower and upper bound along x, y and z (mm).
pub(crate) type Bounds = [[f64; 2]; 3];

/// An actuator's boxes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Boxes {
    /// Base below the sheet, base above it, and body, which overlaps the base in the pocket.
    pub(crate) solids: [Bounds; 3],
    /// Cavities of the chambers, from the held end on.
    pub(crate) chambers: Vec<Bounds>,
    /// Tunnels between neighbouring chambers.
    pub(crate) channels: Vec<Bounds>,
    /// Slots between neighbouring chambers.
    pub(crate) slots: Vec<Bounds>,
}

impl Boxes {
    /// The boxes of a checked actuator.
    pub(crate) fn of(a: &Shape<'_>) -> Self {
        let middle = 0.5 * a.base.width_mm;
        let across = |width: f64| [middle - 0.5 * width, middle + 0.5 * width];
        let floor = a.cavity_floor_mm();
        let start = |i: usize| a.chambers.first_mm + i as f64 * a.chambers.pitch_mm;
        let chamber = |i: usize| -> Bounds {
            let along = [start(i), start(i) + a.chambers.length_mm];
            [along, [floor, a.chambers.top_mm], across(a.chambers.width_mm)]
        };
        let between = |i: usize| [start(i) + a.chambers.length_mm, start(i + 1)];
        let slot = |(slots, i): (&Slots, usize)| -> Bounds {
            let centre = 0.5 * (between(i)[0] + between(i)[1]);
            let along = [centre - 0.5 * slots.width_mm, centre + 0.5 * slots.width_mm];
            [along, [slots.floor_mm, a.body.top_mm], across(a.body.width_mm)]
        };
        let gaps = 0..a.chambers.count - 1;
        let channel = |(channels, i): (&Channels, usize)| -> Bounds {
            [between(i), [floor, channels.top_mm], across(channels.width_mm)]
        };
        let layer = |low: f64, high: f64| [[0.0, a.base.length_mm], [low, high], [0.0, a.base.width_mm]];
        let along = [a.body.start_mm, a.body.start_mm + a.body.length_mm];
        Self {
            solids: [
                layer(0.0, a.base.lower_mm),
                layer(a.base.lower_mm, a.base_top_mm()),
                [along, [floor, a.body.top_mm], across(a.body.width_mm)],
            ],
            chambers: (0..a.chambers.count).map(chamber).collect(),
            channels: a
                .channels
                .iter()
                .flat_map(|c| gaps.clone().map(move |i| (*c, i)))
                .map(channel)
                .collect(),
            slots: a.slots.iter().flat_map(|s| gaps.clone().map(move |i| (*s, i))).map(slot).collect(),
        }
    }

    /// True if a point that lies on no face is in the elastomer.
    pub(crate) fn solid_at(&self, p: [f64; 3]) -> bool {
        let cut = self.chambers.iter().chain(&self.channels).chain(&self.slots);
        self.solids.iter().any(|b| inside(b, p, 0.0)) && !cut.into_iter().any(|b| inside(b, p, 0.0))
    }

    /// Part of a point in the elastomer: `lower` and `upper` base, or `body`.
    pub(crate) fn part(&self, p: [f64; 3]) -> &'static str {
        let parts = ["lower", "upper", "body"];
        let found = self.solids.iter().position(|b| inside(b, p, 0.0));
        found.map_or("body", |at| parts[at])
    }

    /// True if a point lies in or on the cavity.
    pub(crate) fn in_cavity(&self, p: [f64; 3], tolerance_mm: f64) -> bool {
        self.chambers.iter().chain(&self.channels).any(|b| inside(b, p, tolerance_mm))
    }

    /// Coordinates of all faces along one axis, rising.
    pub(crate) fn planes(&self, axis: usize) -> Vec<f64> {
        let all = self.solids.iter().chain(&self.chambers).chain(&self.channels).chain(&self.slots);
        let mut planes: Vec<f64> = all.flat_map(|b| b[axis]).collect();
        planes.sort_by(f64::total_cmp);
        // Sums of decimal lengths differ in their last digits.
        planes.dedup_by(|b, a| *b - *a < 1.0e-9);
        planes
    }
}

fn inside(bounds: &Bounds, p: [f64; 3], tolerance_mm: f64) -> bool {
    bounds.iter().zip(p).all(|([low, high], v)| v >= low - tolerance_mm && v <= high + tolerance_mm)
}
