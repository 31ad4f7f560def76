//! Checks of an actuator: sizes, overlaps, materials.

use super::file::{Actuator, Fixed, ObstacleBody, ObstacleShape, Shape};
use crate::config::{MAX_CAVITIES, MAX_MPA};
use formats::Diagnostic;

/// Smallest wall that can be meshed with elements of useful shape (mm).
const THINNEST_MM: f64 = 0.1;

impl Actuator {
    /// All errors in the values.
    pub(crate) fn diagnostics(&self) -> Vec<Diagnostic> {
        let mut found = Found(Vec::new());
        if self.layout != 1 {
            found.add("layout", "1", self.layout);
        }
        let fits = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if self.name.is_empty() || self.name.len() > 64 || !self.name.chars().all(fits) {
            found.add("name", "1 to 64 letters, digits, - and _", format!("`{}`", self.name));
        }
        self.form(&mut found);
        self.materials(&mut found);
        self.surroundings(&mut found);
        found.0
    }

    /// Checks the boxes, or that there are none and the mesh file has the shape.
    fn form(&self, found: &mut Found) {
        let parts = [
            ("base", self.base.is_some()),
            ("body", self.body.is_some()),
            ("chambers", self.chambers.is_some()),
            ("slots", self.slots.is_some()),
            ("channels", self.channels.is_some()),
        ];
        let given: Vec<&str> = parts.iter().filter(|(_, given)| *given).map(|(name, _)| *name).collect();
        if given.is_empty() {
            if self.support.fixed.is_empty() {
                found.add("support.fixed", "the name of a surface of the mesh file", "nothing");
            }
            return;
        }
        if !parts[..3].iter().all(|(_, given)| *given) {
            let expected = "base, body and chambers (slots and channels may be left out), or none of them and \
                            mesh.file with the shape";
            return found.add("boxes", expected, given.join(", "));
        }
        if Fixed::named(&self.support.fixed).is_none() {
            let names = Fixed::NAMES.map(|(name, _)| name).join(", ");
            found.add("support.fixed", &format!("one of {names}"), format!("`{}`", self.support.fixed));
        }
        let Some(shape) = self.shape() else { return };
        let before = found.0.len();
        shape.sizes(found);
        let opposite = shape.chambers.opposite.as_deref();
        if opposite.is_some_and(|name| !self.pressure_mpa.contains_key(name)) {
            let name = opposite.unwrap_or_default();
            let expected = format!("[pressure_mpa] {name} = 0.0 (MPa), the pressure of that row");
            found.add("chambers.opposite", &expected, "none");
        }
        for (key, value) in [("mesh.seed_mm", self.mesh.seed_mm), ("mesh.size_mm", self.mesh.size_mm)] {
            if !(value.is_finite() && value > 0.0) {
                found.add(key, "a finite number above 0 mm", value);
            }
        }
        if found.0.len() == before {
            shape.along(found);
            shape.upwards(found);
            shape.across(found);
        }
    }

    fn materials(&self, found: &mut Found) {
        if let Err(e) = self.elastomer.check() {
            found.add(format!("elastomer: {}", e.name), e.expected, e.found);
        }
        for (name, material) in &self.materials {
            if let Err(e) = material.check_solid() {
                found.add(format!("materials.{name}: {}", e.name), e.expected, e.found);
            }
        }
        if let Some(Err(e)) = self.sheet.map(|sheet| sheet.check()) {
            found.add(format!("sheet: {}", e.name), e.expected, e.found);
        }
        for (name, film) in &self.films {
            if let Err(e) = film.check() {
                found.add(format!("films.{name}: {}", e.name), e.expected, e.found);
            }
        }
        for (name, pressure) in &self.pressure_mpa {
            if !(0.0..=MAX_MPA).contains(pressure) {
                found.add(format!("pressure_mpa.{name}"), "a pressure of 0 to 10 MPa", pressure);
            }
        }
        if self.pressure_mpa.len() > MAX_CAVITIES {
            let expected = format!("at most {MAX_CAVITIES} cavities in addition to `cavity`");
            found.add("pressure_mpa", &expected, self.pressure_mpa.len());
        }
        if let Err(e) = self.dynamics.check() {
            found.add(format!("dynamics: {}", e.name), e.expected, e.found);
        }
    }

    fn surroundings(&self, found: &mut Found) {
        if self.loads.gravity_mm_s2.iter().any(|g| !g.is_finite()) {
            found.add("loads.gravity_mm_s2", "finite components", format!("{:?}", self.loads.gravity_mm_s2));
        }
        let Some(obstacle) = &self.obstacle else { return };
        for (key, [low, high]) in [("obstacle.x_mm", obstacle.x_mm), ("obstacle.z_mm", obstacle.z_mm)] {
            if !(low.is_finite() && high.is_finite() && low < high) {
                found.add(key, "[lower, upper] in mm, rising", format!("[{low}, {high}]"));
            }
        }
        let ObstacleBody { kind, radius_mm, centre_mm, .. } = obstacle;
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

impl Shape<'_> {
    /// Checks that every size is a finite number above 0.
    fn sizes(&self, found: &mut Found) {
        let (base, body, chambers) = (self.base, self.body, self.chambers);
        for (key, list) in [("lengths_mm", &chambers.lengths_mm), ("tops_mm", &chambers.tops_mm)] {
            if !(list.is_empty() || list.len() == chambers.count) {
                let expected = format!("none, or one for each of the {} chambers", chambers.count);
                found.add(format!("chambers.{key}"), &expected, list.len());
            }
            for value in list.iter().filter(|value| !(value.is_finite() && **value > 0.0)) {
                found.add(format!("chambers.{key}"), "finite numbers above 0 mm", value);
            }
        }
        if let Some(side_mm) = self.slots.map(|slots| slots.side_mm)
            && !(side_mm.is_finite() && side_mm >= 0.0)
        {
            found.add("slots.side_mm", "a finite number, 0 mm or more", side_mm);
        }
        let optional = [
            ("slots.width_mm", self.slots.map(|s| s.width_mm)),
            ("slots.floor_mm", self.slots.map(|s| s.floor_mm)),
            ("channels.width_mm", self.channels.map(|c| c.width_mm)),
            ("channels.top_mm", self.channels.map(|c| c.top_mm)),
        ];
        let optional = optional.into_iter().filter_map(|(key, value)| Some((key, value?)));
        let sizes = [
            ("base.length_mm", base.length_mm),
            ("base.width_mm", base.width_mm),
            ("base.upper_mm", base.upper_mm),
            ("body.length_mm", body.length_mm),
            ("body.width_mm", body.width_mm),
            ("body.top_mm", body.top_mm),
            ("chambers.length_mm", chambers.length_mm),
            ("chambers.pitch_mm", chambers.pitch_mm),
            ("chambers.width_mm", chambers.width_mm),
            ("chambers.top_mm", chambers.top_mm),
        ];
        for (key, value) in sizes.into_iter().chain(optional) {
            if !(value.is_finite() && value > 0.0) {
                found.add(key, "a finite number above 0 mm", value);
            }
        }
        for (key, value) in [
            ("base.lower_mm", base.lower_mm),
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
        let (body, chambers) = (self.body, self.chambers);
        let body_end = body.start_mm + body.length_mm;
        let last = chambers.end_mm();
        found.wall("body: its end within the base (base.length_mm)", body_end, self.base.length_mm, 0.0);
        found.wall(
            "chambers: the first inside the body (body.start_mm)",
            body.start_mm,
            chambers.first_mm,
            THINNEST_MM,
        );
        found.wall("chambers: the last inside the body (body.length_mm)", last, body_end, THINNEST_MM);
        let between = chambers.wall_mm();
        match self.slots {
            Some(slots) => {
                let wall = (between - slots.width_mm) / 2.0;
                found.wall(
                    "slots: a wall left between cavity and slot (slots.width_mm)",
                    0.0,
                    wall,
                    THINNEST_MM,
                );
            }
            None => {
                found.wall(
                    "chambers: a wall between two cavities (chambers.pitch_mm)",
                    0.0,
                    between,
                    THINNEST_MM,
                );
            }
        }
    }

    fn upwards(&self, found: &mut Found) {
        let (floor, top) = (self.cavity_floor_mm(), self.body.top_mm);
        let sheet = self.base.lower_mm;
        found.wall("body.pocket_mm: the pocket ends above the sheet", sheet, floor, THINNEST_MM);
        found.wall("body: stands out of the base (body.top_mm)", self.base_top_mm(), top, THINNEST_MM);
        let [lowest, highest] = self.chambers.tops_range_mm();
        found.wall("chambers: closed above (chambers.top_mm)", highest, top, THINNEST_MM);
        if self.chambers.opposite.is_some() {
            let pocket = self.body.pocket_mm;
            found.wall(
                "body.pocket_mm: the opposite pocket ends below the sheet",
                pocket,
                sheet,
                THINNEST_MM,
            );
        }
        let channel_top = self.channels.map_or(floor, |channels| channels.top_mm);
        if self.channels.is_some() {
            found.wall("channels: have a height (channels.top_mm)", floor, channel_top, THINNEST_MM);
        }
        found.wall("channels: end below the chambers' top", channel_top, lowest, 0.0);
        let Some(slots) = self.slots else { return };
        found.wall(
            "slots: end above the channels (slots.floor_mm)",
            channel_top,
            slots.floor_mm,
            THINNEST_MM,
        );
        found.wall("slots: end above the base (slots.floor_mm)", self.base_top_mm(), slots.floor_mm, 0.0);
        found.wall("slots: have a depth (slots.floor_mm)", slots.floor_mm, top, THINNEST_MM);
    }

    fn across(&self, found: &mut Found) {
        let (body, chambers) = (self.body.width_mm, self.chambers.width_mm);
        found.wall("body: within the base (body.width_mm)", body, self.base.width_mm, 0.0);
        found.wall("chambers: walls at both sides (chambers.width_mm)", chambers, body, 2.0 * THINNEST_MM);
        if let Some(slots) = self.slots.filter(|slots| slots.side_mm > 0.0) {
            let neck = body - 2.0 * slots.side_mm;
            let inner = self.channels.map_or(0.0, |channels| channels.width_mm);
            found.wall("slots.side_mm: walls at both sides of the channel", inner, neck, 2.0 * THINNEST_MM);
        }
        if let Some(channels) = self.channels {
            found.wall(
                "channels: not wider than the chambers (channels.width_mm)",
                channels.width_mm,
                chambers,
                0.0,
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
