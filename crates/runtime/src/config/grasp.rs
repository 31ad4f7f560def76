//! The object between the fingers of a scene, and the places of actuators and blocks.

use crate::problems::Problems;
use rom::snapshots::Footprint;
use serde::{Deserialize, Serialize};
use wire::layout::FINGERS_MAX;

/// The object that the scene's actuators hold by friction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GraspSpec {
    /// Mass of the object, g.
    pub mass_g: f64,
    /// Friction coefficient between finger and object.
    pub friction: f64,
    /// Safety factor on the weight.
    #[serde(default = "one")]
    pub safety: f64,
    /// The fingers, by name; empty: all actuators of the scene.
    #[serde(default)]
    pub fingers: Vec<String>,
}

fn one() -> f64 {
    1.0
}

impl GraspSpec {
    pub(super) fn problems(&self, scene: &str, actuators: &[&str], problems: &mut Problems) {
        if let Err(error) = wire::Topic::grasp(scene) {
            problems.part("name").add(format_args!("it names the grasp's topic: {error}"));
        }
        let mut problems = problems.part("grasp");
        for (key, value) in [("mass_g", self.mass_g), ("friction", self.friction), ("safety", self.safety)] {
            problems.above_0(key, value);
        }
        let (known, unknown): (Vec<_>, Vec<_>) =
            self.fingers.iter().partition(|name| actuators.contains(&name.as_str()));
        for name in unknown {
            problems.part("fingers").add(format_args!("no actuator is called `{name}`"));
        }
        let count = if self.fingers.is_empty() { actuators.len() } else { known.len() };
        let expected = format!("2 to {FINGERS_MAX} fingers");
        problems.expect((2..=FINGERS_MAX).contains(&count), "fingers", &expected, count);
    }
}

/// Where an actuator stands: its own frame (x along it, y up, z across) is mirrored, then moved.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlaceSpec {
    /// Mirrored up and down: y becomes -y.
    pub mirrored: bool,
    /// Then moved by this, mm.
    pub offset_mm: [f64; 3],
}

impl PlaceSpec {
    /// A point of the actuator's frame in the scene's frame, mm.
    pub fn apply(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [dx, dy, dz] = self.offset_mm;
        [x + dx, if self.mirrored { dy - y } else { dy + y }, z + dz]
    }

    pub(super) fn problems(&self, problems: &mut Problems) {
        let (fits, found) = (self.offset_mm.iter().all(|mm| mm.is_finite()), format!("{:?}", self.offset_mm));
        problems.expect(fits, "place.offset_mm", "three finite numbers", found);
    }
}

pub(super) fn plate_problems(plate: &Footprint, problems: &mut Problems) {
    for (key, [low, high]) in [("x_mm", plate.x_mm), ("z_mm", plate.z_mm)] {
        let fits = low < high && (high - low).is_finite();
        let found = format!("{low} .. {high}");
        problems.part("plate").expect(fits, key, "[least, largest] in mm", found);
    }
}

/// A rigid block of the scene, for pictures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlockSpec {
    /// Lower corner in the scene's frame, mm.
    pub min_mm: [f64; 3],
    /// Upper corner, mm.
    pub max_mm: [f64; 3],
}

impl BlockSpec {
    pub(super) fn problems(&self, key: &str, problems: &mut Problems) {
        let mut pairs = self.min_mm.iter().zip(&self.max_mm);
        let fits = pairs.all(|(min, max)| min < max && (max - min).is_finite());
        let found = format!("{:?} .. {:?}", self.min_mm, self.max_mm);
        problems.expect(fits, key, "min_mm < max_mm", found);
    }
}

#[cfg(test)]
#[path = "../../tests/unit/config_grasp.rs"]
mod tests;
