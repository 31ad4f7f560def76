//! The object between the fingers of a scene, and the places of actuators and blocks.

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
    pub(super) fn problems(&self, scene: &str, actuators: &[&str], problems: &mut Vec<String>) {
        for (key, value) in [("mass_g", self.mass_g), ("friction", self.friction), ("safety", self.safety)] {
            if !(value.is_finite() && value > 0.0) {
                problems.push(format!("grasp.{key}: expected a finite number above 0, found {value}"));
            }
        }
        if let Err(error) = wire::Topic::grasp(scene) {
            problems.push(format!("name: it names the grasp's topic: {error}"));
        }
        for name in &self.fingers {
            if !actuators.contains(&name.as_str()) {
                problems.push(format!("grasp.fingers: no actuator is called `{name}`"));
            }
        }
        let known = self.fingers.iter().filter(|name| actuators.contains(&name.as_str())).count();
        let count = if self.fingers.is_empty() { actuators.len() } else { known };
        if !(2..=FINGERS_MAX).contains(&count) {
            problems.push(format!("grasp.fingers: expected 2 to {FINGERS_MAX} fingers, found {count}"));
        }
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

    pub(super) fn problems(&self, place: &str, problems: &mut Vec<String>) {
        if self.offset_mm.iter().any(|value| !value.is_finite()) {
            problems.push(format!(
                "{place}.place.offset_mm: expected three finite numbers, found {:?}",
                self.offset_mm
            ));
        }
    }
}

pub(super) fn plate_problems(plate: &Footprint, place: &str, problems: &mut Vec<String>) {
    for (key, [low, high]) in [("x_mm", plate.x_mm), ("z_mm", plate.z_mm)] {
        if !(low < high && (high - low).is_finite()) {
            problems
                .push(format!("{place}.plate.{key}: expected [least, largest] in mm, found {low} .. {high}"));
        }
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
    pub(super) fn problems(&self, place: &str, problems: &mut Vec<String>) {
        if !self.min_mm.iter().zip(&self.max_mm).all(|(min, max)| min < max && (max - min).is_finite()) {
            problems.push(format!(
                "{place}: expected min_mm < max_mm, found {:?} .. {:?}",
                self.min_mm, self.max_mm
            ));
        }
    }
}

#[cfg(test)]
#[path = "../../tests/unit/config_grasp.rs"]
mod tests;
