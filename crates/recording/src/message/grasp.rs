//! Grasps.

use serde::Serialize;
use wire::Grasp;
use wire::layout::{flags, grasp_status, unpack_name};

use super::{Recorded, number, schema};

/// A grasp as JSON. Fields as in [`Grasp`].
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs)] // the wire's payload says what each is
pub struct GraspMessage {
    pub seq: u64,
    pub t_sensor_ns: u64,
    pub t_publish_ns: u64,
    pub verdict: &'static str,
    #[serde(serialize_with = "number::serialize")]
    pub mass_kg: f64,
    #[serde(serialize_with = "number::serialize")]
    pub friction: f64,
    #[serde(serialize_with = "number::serialize")]
    pub safety: f64,
    #[serde(serialize_with = "number::serialize")]
    pub needed_force_n: f64,
    #[serde(serialize_with = "number::serialize")]
    pub least_force_n: f64,
    #[serde(serialize_with = "number::serialize")]
    pub margin: f64,
    #[serde(serialize_with = "number::serialize")]
    pub needed_friction: f64,
    #[serde(serialize_with = "number::serialize")]
    pub stop_pressure_mpa: f64,
    #[serde(serialize_with = "number::serialize")]
    pub stop_pressure_bar_mpa: f64,
    #[serde(serialize_with = "number::serialize")]
    pub force_halfwidth_n: f64,
    pub forces_n: Vec<f64>,
    pub pressures_mpa: Vec<f64>,
    pub flags: Vec<&'static str>,
    pub scene: String,
    pub boot_id: String,
}

impl From<&Grasp> for GraspMessage {
    fn from(grasp: &Grasp) -> Self {
        Self {
            seq: grasp.seq,
            t_sensor_ns: grasp.t_sensor_ns,
            t_publish_ns: grasp.t_publish_ns,
            verdict: grasp_status::as_str(grasp.verdict),
            mass_kg: grasp.mass_kg,
            friction: grasp.friction,
            safety: grasp.safety,
            needed_force_n: grasp.needed_force_n,
            least_force_n: grasp.least_force_n,
            margin: grasp.margin,
            needed_friction: grasp.needed_friction,
            stop_pressure_mpa: grasp.stop_pressure_mpa,
            stop_pressure_bar_mpa: grasp.stop_pressure_bar_mpa,
            force_halfwidth_n: grasp.force_halfwidth_n,
            forces_n: grasp.fingers().map(|(force, _)| force).collect(),
            pressures_mpa: grasp.fingers().map(|(_, pressure)| pressure).collect(),
            flags: flags::names(grasp.flags).collect(),
            scene: unpack_name(&grasp.scene),
            boot_id: format!("{:016x}", grasp.boot_id),
        }
    }
}

impl Recorded for GraspMessage {
    const SCHEMA_NAME: &'static str = "softtwin.Grasp";

    fn schema_json() -> String {
        schema::object(
            Self::SCHEMA_NAME,
            &[
                ("seq", "integer", "counts up by one per grasp within a run of the twin"),
                (
                    "t_sensor_ns",
                    "integer",
                    "when the oldest reading behind it was taken, ns of the monotonic clock",
                ),
                ("t_publish_ns", "integer", "when it was sent, ns of the monotonic clock"),
                ("verdict", "string", "unknown, not held, held within the error bar, or held"),
                ("mass_kg", "number", "mass of the object, kg"),
                ("friction", "number", "friction coefficient between finger and object"),
                ("safety", "number", "safety factor on the weight"),
                ("needed_force_n", "number", "force that each finger must bring, N"),
                ("least_force_n", "number", "smallest force of a finger, N"),
                ("margin", "number", "least force over needed force, less 1"),
                ("needed_friction", "number", "friction coefficient from which these forces hold the object"),
                ("stop_pressure_mpa", "number", "pressure at which the object is first held, MPa; NaN: none"),
                ("stop_pressure_bar_mpa", "number", "half width of its error bar, MPa"),
                ("force_halfwidth_n", "number", "half width of the forces' error bar, N"),
                ("forces_n", "number[]", "force of each finger, N"),
                ("pressures_mpa", "number[]", "pressure of each finger, MPa"),
                ("flags", "string[]", "set flags of all fingers by name"),
                ("scene", "string", "name of the scene"),
                ("boot_id", "string", "the run of the twin, hexadecimal"),
            ],
        )
    }
}
