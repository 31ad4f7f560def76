//! Configuration in two steps: typed by serde (unknown keys are refused), then checked as a whole. All problems are
//! reported together, each with its key, expected and found.

mod error;
mod estimate;
mod grasp;
mod input;
mod paths;
mod scene;
mod settings;

pub use control::held::MarkerSpec;
pub use error::{ConfigError, collect, read};
pub use estimate::{BIASES, CameraSpec, EstimateSpec, ObservedSpec, ObservedSpecs, SigmaSpec, UnknownSpec};
pub(crate) use estimate::{FORCE_BIAS, PRESSURE_BIAS, Sigmas};
pub use grasp::{BlockSpec, GraspSpec, PlaceSpec};
pub use input::{InputFrom, InputSpecs, Measured, WithinSpec};
pub use scene::{ActuatorSpec, FixedNodes, Gap, NodesSpec, OutputSpec, Queries, Scene, StateSpec};
pub(crate) use settings::ms_to_ns;
pub use settings::{Limits, OnMissingRights, OutsideDomain, Realtime, Settings};
