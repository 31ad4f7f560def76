//! Another model, or another scene, between two readings. Topics, sequence numbers and counters continue; readers see a new
//! model hash and nothing else.

use super::parts::Parts;
use crate::estimation::Estimator;
use crate::load::LoadedActuator;
use crate::publish::shape;
use rom::reconstructor::Reconstructor;

/// Why a running twin cannot continue with what was loaded. It continues with what it has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SwapError {
    /// Other actuators, or sensors, than before.
    #[error("the scene has the actuators {new}, this twin runs {running}; restart the twin for that")]
    Actuators { running: String, new: String },
    /// Other field topics than before, or other sizes of their samples.
    #[error(
        "`{actuator}`: the new scene or model has the outputs {new}, this twin runs {running}; readers hold memory of \
         that size: restart the twin"
    )]
    Outputs {
        actuator: String,
        /// What runs, as `topic (values)`.
        running: String,
        new: String,
    },
}

/// Parts that a swap removed from the loop. Dropping them frees tens of megabytes, which takes too long between two readings.
#[derive(Debug, Default)]
pub struct Retired {
    /// Sessions and predictions of markers.
    pub(super) parts: Vec<Parts>,
    /// Reconstructors, with their bases.
    pub(super) reconstructors: Vec<Reconstructor>,
    pub(super) estimators: Vec<Estimator>,
}

/// Properties that readers of a running actuator depend on.
pub(super) struct RunningActuator<'a> {
    pub(super) name: &'a str,
    /// The actuator whose sensor it reads.
    pub(super) sensor: &'a str,
    /// Topic and size of each output.
    pub(super) outputs: Vec<String>,
    /// Whether it has an estimate topic.
    pub(super) estimates: bool,
}

/// Checks that a running twin can continue with what was loaded: the same actuators and topics, samples of the same size.
///
/// # Errors
/// [`SwapError`] with both.
pub(super) fn check(running: &[RunningActuator<'_>], new: &[LoadedActuator]) -> Result<(), SwapError> {
    let names = list(running.iter().map(|actuator| (actuator.name, actuator.sensor)));
    let new_names = list(new.iter().map(|loaded| (loaded.spec.name.as_str(), loaded.spec.sensor())));
    if names != new_names {
        return Err(SwapError::Actuators { running: names, new: new_names });
    }
    for (actuator, loaded) in running.iter().zip(new) {
        let estimate = |wanted: bool| wanted.then(|| String::from("estimate"));
        let running: Vec<String> =
            actuator.outputs.iter().cloned().chain(estimate(actuator.estimates)).collect();
        let wanted = loaded.outputs.iter();
        let new = wanted.map(|output| shape(output.spec.topic_name(), output.reconstructor.entries()));
        let new: Vec<String> = new.chain(estimate(loaded.estimator.is_some())).collect();
        if running != new {
            let (running, new) = (running.join(", "), new.join(", "));
            return Err(SwapError::Outputs { actuator: loaded.spec.name.clone(), running, new });
        }
    }
    Ok(())
}

/// Actuators, with the sensor of those that read another's.
fn list<'a>(names: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let text = |(name, sensor)| {
        if name == sensor { String::from(name) } else { format!("{name} (sensor {sensor})") }
    };
    names.map(text).collect::<Vec<String>>().join(", ")
}
