//! Another model, or another scene, between two readings. Topics, sequence numbers and counters go on; readers notice a new
//! model hash and nothing else.

use super::Twin;
use super::actuator::ActuatorTwin;
use super::load::Loaded;
use rom::predict::Predictor;

/// Why a running twin cannot go on with what was loaded. It goes on with what it has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SwapError {
    /// Other actuators, or sensors, than before.
    #[error("the scene has the actuators {new}, this twin runs {running}; start the twin anew for that")]
    Actuators {
        /// Running.
        running: String,
        /// In the new scene.
        new: String,
    },
    /// Other field topics than before, or other sizes of their samples.
    #[error(
        "`{actuator}`: the new scene or model has the outputs {new}, this twin runs {running}; readers hold memory of \
         that size: start the twin anew"
    )]
    Outputs {
        /// The actuator.
        actuator: String,
        /// Running, as `topic (values)`.
        running: String,
        /// Wanted.
        new: String,
    },
}

/// What a swap took out of the loop. Dropping it frees tens of megabytes: not a thing to do between two readings.
#[derive(Debug, Default)]
pub struct Retired(#[expect(dead_code, reason = "held to be dropped by its owner")] Vec<Predictor>);

impl Twin {
    /// Continues with other models for the same actuators and topics. All or nothing.
    ///
    /// Cost: a few pointers an actuator; nothing is loaded, nothing freed.
    ///
    /// # Errors
    /// [`SwapError`]; the twin is as before.
    pub fn swap(&mut self, loaded: Vec<Loaded>) -> Result<Retired, SwapError> {
        let running = list(self.actuators.iter().map(ActuatorTwin::names));
        let new = list(loaded.iter().map(|loaded| (loaded.spec.name.as_str(), loaded.spec.sensor())));
        if running != new {
            return Err(SwapError::Actuators { running, new });
        }
        for (actuator, loaded) in self.actuators.iter().zip(&loaded) {
            let (running, new) = (actuator.shapes(), shapes(loaded));
            if running != new {
                let actuator = loaded.spec.name.clone();
                return Err(SwapError::Outputs {
                    actuator,
                    running: running.join(", "),
                    new: new.join(", "),
                });
            }
        }
        let mut retired = Vec::new();
        for (actuator, loaded) in self.actuators.iter_mut().zip(loaded) {
            actuator.swap(loaded, &mut retired);
        }
        Ok(Retired(retired))
    }
}

/// Actuators, with the sensor of those that read another's.
fn list<'a>(names: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let text = |(name, sensor)| {
        if name == sensor { String::from(name) } else { format!("{name} (sensor {sensor})") }
    };
    names.map(text).collect::<Vec<String>>().join(", ")
}

/// Topics with the values of a sample, as the model would have them.
fn shapes(loaded: &Loaded) -> Vec<String> {
    let shape = |set: Option<&str>, entries: usize| format!("{} ({entries})", set.unwrap_or("all"));
    loaded.outputs.iter().map(|output| shape(output.spec.topic_name(), output.predictor.entries())).collect()
}
