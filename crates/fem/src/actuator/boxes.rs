//! Boxes of an actuator from `actuator.toml`: solid parts, cut-outs, walls.

use super::file::Shape;

/// Lower and upper bound along x, y and z (mm).
pub(crate) type Bounds = [[f64; 2]; 3];

/// An actuator's boxes, in the frame of the mesh.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Boxes {
    /// Named parts: base below the sheet, base above it, and bodies, which overlap the base in their pockets.
    pub(crate) solids: Vec<(&'static str, Bounds)>,
    /// The row above the base, and the opposite one.
    pub(crate) rows: Vec<Row>,
}

/// Cut-outs of a row.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Row {
    /// Cavities of the chambers, from the first on.
    pub(crate) chambers: Vec<Bounds>,
    /// Tunnels between neighbouring chambers.
    pub(crate) channels: Vec<Bounds>,
    /// Slots between neighbouring chambers by their number: a cut from the top and, for a bellows, one from each side.
    pub(crate) slots: Vec<(usize, Bounds)>,
}

impl Row {
    /// All cut-outs.
    pub(crate) fn cuts(&self) -> impl Iterator<Item = &Bounds> {
        self.chambers.iter().chain(&self.channels).chain(self.slots.iter().map(|(_, slot)| slot))
    }

    fn of(a: &Shape<'_>) -> Self {
        let (chambers, floor) = (a.chambers, a.cavity_floor_mm());
        let mut row = Self::default();
        for i in 0..chambers.count {
            let along = chambers.along_mm(i);
            row.chambers.push([along, [floor, chambers.cavity_top_mm(i)], a.band(chambers.width_mm)]);
            if i + 1 == chambers.count {
                break;
            }
            let between = [along[1], chambers.along_mm(i + 1)[0]];
            if let Some(channels) = a.channels {
                row.channels.push([between, [floor, channels.top_mm], a.band(channels.width_mm)]);
            }
            if let Some(slots) = a.slots {
                let centre = 0.5 * (between[0] + between[1]);
                let along = [centre - 0.5 * slots.width_mm, centre + 0.5 * slots.width_mm];
                let [near, far] = a.band(a.body.width_mm);
                row.slots.push((i, [along, [slots.floor_mm, a.body.top_mm], [near, far]]));
                let beside = [a.base_top_mm(), slots.floor_mm];
                if slots.side_mm > 0.0 && beside[0] < beside[1] {
                    row.slots.push((i, [along, beside, [near, near + slots.side_mm]]));
                    row.slots.push((i, [along, beside, [far - slots.side_mm, far]]));
                }
            }
        }
        row
    }

    fn moved(&self, y: &impl Fn([f64; 2]) -> [f64; 2]) -> Self {
        let moved = |[along, height, across]: &Bounds| [*along, y(*height), *across];
        Self {
            chambers: self.chambers.iter().map(moved).collect(),
            channels: self.channels.iter().map(moved).collect(),
            slots: self.slots.iter().map(|(i, slot)| (*i, moved(slot))).collect(),
        }
    }
}

impl Shape<'_> {
    fn band(&self, width: f64) -> [f64; 2] {
        let middle = 0.5 * self.base.width_mm;
        [middle - 0.5 * width, middle + 0.5 * width]
    }
}

impl Boxes {
    /// The boxes of a checked actuator.
    pub(crate) fn of(a: &Shape<'_>) -> Self {
        let (up, height) = (a.base_mm(), a.base_top_mm());
        let lifted = |[low, high]: [f64; 2]| [low + up, high + up];
        let mirrored = |[low, high]: [f64; 2]| [up + height - high, up + height - low];
        let layer = |y: [f64; 2]| [[0.0, a.base.length_mm], lifted(y), [0.0, a.base.width_mm]];
        let along = [a.body.start_mm, a.body.start_mm + a.body.length_mm];
        let body = [a.cavity_floor_mm(), a.body.top_mm];
        let across = a.band(a.body.width_mm);
        let row = Row::of(a);
        let mut solids = vec![
            ("lower", layer([0.0, a.base.lower_mm])),
            ("upper", layer([a.base.lower_mm, height])),
            ("body", [along, lifted(body), across]),
        ];
        let mut rows = vec![row.moved(&lifted)];
        if a.chambers.opposite.is_some() {
            solids.push(("opposite", [along, mirrored(body), across]));
            rows.push(row.moved(&mirrored));
        }
        Self { solids, rows }
    }

    /// True if a point that lies on no face is in the elastomer.
    pub(crate) fn solid_at(&self, p: [f64; 3]) -> bool {
        let mut cuts = self.rows.iter().flat_map(Row::cuts);
        self.solids.iter().any(|(_, b)| inside(b, p, 0.0)) && !cuts.any(|b| inside(b, p, 0.0))
    }

    /// Part of a point in the elastomer: `lower` and `upper` base, `body`, or the `opposite` one.
    pub(crate) fn part(&self, p: [f64; 3]) -> &'static str {
        self.solids.iter().find(|(_, b)| inside(b, p, 0.0)).map_or("body", |(name, _)| name)
    }

    /// Row in whose cavity, or on whose wall, a point lies.
    pub(crate) fn cavity_at(&self, p: [f64; 3], tolerance_mm: f64) -> Option<usize> {
        let encloses =
            |row: &Row| row.chambers.iter().chain(&row.channels).any(|b| inside(b, p, tolerance_mm));
        self.rows.iter().position(encloses)
    }

    /// Number and side, `lower` or `upper`, of the slot on whose wall across x a point lies; those of the opposite row follow.
    pub(crate) fn slot_at(&self, p: [f64; 3], tolerance_mm: f64) -> Option<(usize, &'static str)> {
        let before = |row: usize| row * self.rows[0].chambers.len().saturating_sub(1);
        let all = self.rows.iter().enumerate();
        let all = all.flat_map(|(row, cuts)| cuts.slots.iter().map(move |(i, b)| (before(row) + i, b)));
        let side = |b: &Bounds| {
            let on = |x: f64| (p[0] - x).abs() < tolerance_mm && inside(b, p, tolerance_mm);
            if on(b[0][0]) { Some("lower") } else { on(b[0][1]).then_some("upper") }
        };
        all.filter_map(|(number, b)| Some((number, side(b)?))).next()
    }

    /// Coordinates of all faces along one axis, rising.
    pub(crate) fn planes(&self, axis: usize) -> Vec<f64> {
        let solids = self.solids.iter().map(|(_, b)| b);
        let all = solids.chain(self.rows.iter().flat_map(Row::cuts));
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
