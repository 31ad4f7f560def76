//! Checks of an actuator: sizes, overlaps, materials.

use super::file::{Actuator, ObstacleBody, ObstacleShape};
use formats::Diagnostic;

/// Smallest wall that can be meshed with elements of useful shape (mm).
const THINNEST_MM: f64 = 0.1;

/// All errors in the values.
pub(crate) fn diagnostics(actuator: &Actuator) -> Vec<Diagnostic> {
    actuator.diagnostics()
}

impl Actuator {
    fn diagnostics(&self) -> Vec<Diagnostic> {
        let mut found = Found(Vec::new());
        if self.layout != 1 {
            found.add("layout", "1", self.layout);
        }
        let fits = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if self.name.is_empty() || self.name.len() > 64 || !self.name.chars().all(fits) {
            found.add("name", "1 to 64 letters, digits, - and _", format!("`{}`", self.name));
        }
        self.sizes(&mut found);
        if found.0.is_empty() {
            self.along(&mut found);
            self.upwards(&mut found);
            self.across(&mut found);
        }
        self.materials(&mut found);
        self.surroundings(&mut found);
        found.0
    }

    /// Checks that every size is a finite number above 0.
    fn sizes(&self, found: &mut Found) {
        let (base, body, chambers) = (&self.base, &self.body, &self.chambers);
        for (key, value) in [
            ("base.length_mm", base.length_mm),
            ("base.width_mm", base.width_mm),
            ("base.lower_mm", base.lower_mm),
            ("base.upper_mm", base.upper_mm),
            ("body.length_mm", body.length_mm),
            ("body.width_mm", body.width_mm),
            ("body.top_mm", body.top_mm),
            ("chambers.length_mm", chambers.length_mm),
            ("chambers.pitch_mm", chambers.pitch_mm),
            ("chambers.width_mm", chambers.width_mm),
            ("chambers.top_mm", chambers.top_mm),
            ("slots.width_mm", self.slots.width_mm),
            ("slots.floor_mm", self.slots.floor_mm),
            ("channels.width_mm", self.channels.width_mm),
            ("channels.top_mm", self.channels.top_mm),
            ("mesh.seed_mm", self.mesh.seed_mm),
            ("mesh.size_mm", self.mesh.size_mm),
        ] {
            if !(value.is_finite() && value > 0.0) {
                found.add(key, "a finite number above 0 mm (the part would vanish)", value);
            }
        }
        for (key, value) in [
            ("body.start_mm", body.start_mm),
            ("body.pocket_mm", body.pocket_mm),
            ("chambers.first_mm", chambers.first_mm),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                found.add(key, "a finite number, 0 mm or more", value);
            }
        }
        if !(1..=1000).contains(&chambers.count) {
            found.add("chambers.count", "1 to 1000", chambers.count);
        }
    }

    fn along(&self, found: &mut Found) {
        let (body, chambers) = (&self.body, &self.chambers);
        let body_end = body.start_mm + body.length_mm;
        let last = chambers.first_mm + (chambers.count - 1) as f64 * chambers.pitch_mm + chambers.length_mm;
        found.wall("body: its end within the base (base.length_mm)", body_end, self.base.length_mm, 0.0);
        found.wall(
            "chambers: the first inside the body (body.start_mm)",
            body.start_mm,
            chambers.first_mm,
            THINNEST_MM,
        );
        found.wall("chambers: the last inside the body (body.length_mm)", last, body_end, THINNEST_MM);
        let wall = (chambers.pitch_mm - chambers.length_mm - self.slots.width_mm) / 2.0;
        found.wall("slots: a wall left between cavity and slot (slots.width_mm)", 0.0, wall, THINNEST_MM);
    }

    fn upwards(&self, found: &mut Found) {
        let (floor, top) = (self.cavity_floor_mm(), self.body.top_mm);
        let sheet = self.base.lower_mm;
        found.wall("body.pocket_mm: the pocket ends above the sheet", sheet, floor, THINNEST_MM);
        found.wall("body: stands out of the base (body.top_mm)", self.base_top_mm(), top, THINNEST_MM);
        found.wall("chambers: closed above (chambers.top_mm)", self.chambers.top_mm, top, THINNEST_MM);
        found.wall("channels: have a height (channels.top_mm)", floor, self.channels.top_mm, THINNEST_MM);
        found.wall("channels: end below the chambers' top", self.channels.top_mm, self.chambers.top_mm, 0.0);
        found.wall(
            "slots: end above the channels (slots.floor_mm)",
            self.channels.top_mm,
            self.slots.floor_mm,
            THINNEST_MM,
        );
        found.wall(
            "slots: end above the base (slots.floor_mm)",
            self.base_top_mm(),
            self.slots.floor_mm,
            0.0,
        );
        found.wall("slots: have a depth (slots.floor_mm)", self.slots.floor_mm, top, THINNEST_MM);
    }

    fn across(&self, found: &mut Found) {
        let (body, chambers) = (self.body.width_mm, self.chambers.width_mm);
        found.wall("body: within the base (body.width_mm)", body, self.base.width_mm, 0.0);
        found.wall("chambers: walls at both sides (chambers.width_mm)", chambers, body, 2.0 * THINNEST_MM);
        found.wall(
            "channels: not wider than the chambers (channels.width_mm)",
            self.channels.width_mm,
            chambers,
            0.0,
        );
    }

    fn materials(&self, found: &mut Found) {
        if let Err(e) = self.elastomer.check() {
            found.add(format!("elastomer: {}", e.name), e.expected, e.found);
        }
        if let Err(e) = self.sheet.check() {
            found.add(format!("sheet: {}", e.name), e.expected, e.found);
        }
        if let Err(e) = self.dynamics.check() {
            found.add(format!("dynamics: {}", e.name), e.expected, e.found);
        }
    }

    fn surroundings(&self, found: &mut Found) {
        if self.loads.gravity_mm_s2.iter().any(|g| !g.is_finite()) {
            found.add("loads.gravity_mm_s2", "finite components", format!("{:?}", self.loads.gravity_mm_s2));
        }
        for (key, [low, high]) in
            [("obstacle.x_mm", self.obstacle.x_mm), ("obstacle.z_mm", self.obstacle.z_mm)]
        {
            if !(low.is_finite() && high.is_finite() && low < high) {
                found.add(key, "[lower, upper] in mm, rising", format!("[{low}, {high}]"));
            }
        }
        let ObstacleBody { kind, radius_mm, centre_mm, .. } = &self.obstacle;
        let is_round = matches!(kind, ObstacleShape::Sphere | ObstacleShape::Cylinder);
        if is_round && !radius_mm.is_some_and(|radius| radius.is_finite() && radius > 0.0) {
            found.add("obstacle.radius_mm", "a finite number above 0 mm", format!("{radius_mm:?}"));
        }
        if is_round && !centre_mm.is_some_and(|centre| centre.iter().all(|c| c.is_finite())) {
            found.add("obstacle.centre_mm", "[x, z] of the highest point in mm", format!("{centre_mm:?}"));
        }
        if !is_round && (radius_mm.is_some() || centre_mm.is_some()) {
            found.add(
                "obstacle",
                "radius_mm and centre_mm of a sphere or cylinder only",
                format!("{kind:?}"),
            );
        }
    }
}

struct Found(Vec<Diagnostic>);

impl Found {
    fn add(&mut self, place: impl ToString, expected: &str, found: impl ToString) {
        self.0.push(Diagnostic::new(place.to_string(), expected, found.to_string()));
    }

    /// Checks that `high` is at least `least` above `low`; otherwise the parts overlap.
    fn wall(&mut self, place: &str, low: f64, high: f64, least: f64) {
        let wall = high - low;
        // Sums of decimal lengths carry rounding errors far below any tolerance of manufacture.
        if wall < least - 1e-9 {
            self.add(
                place,
                &format!("at least {least} mm between {low} and {high} mm"),
                format!("{wall} mm"),
            );
        }
    }
}
