//! Readings from a node of ROS 2: `sensor_msgs/FluidPressure`.

use super::attachment::{self, plain};
use super::cdr::fluid_pressure;
use super::config::Ros2;
use super::message::PA_PER_MPA;
use super::names::{Entity, Names, token};
use super::types::PRESSURE;
use crate::link::Link;
use wire::{SensorSample, Topic};
use zenoh::liveliness::LivelinessToken;
use zenoh::sample::Sample;

/// First entity number of subscriptions, above those of publishers.
const FIRST: usize = 10_000;

/// Pressures from ROS for one actuator: `softtwin/<actuator>/pressure_measured`.
pub struct Inlet {
    /// The key to subscribe to, with any hash: a wrong one is reported.
    pub key: String,
    _token: LivelinessToken,
}

impl Inlet {
    /// Announces the subscription.
    ///
    /// # Errors
    /// When the session is closed.
    pub fn declare(link: &Link, ros: &Ros2, number: usize, topic: &Topic) -> anyhow::Result<Self> {
        let names = Names::new(ros, link);
        let name = format!("softtwin/{}/pressure_measured", plain(topic.actuator()));
        let endpoint = names.endpoint(FIRST + number, Entity::Subscription, &name, PRESSURE);
        Ok(Self { key: names.key(&name, PRESSURE, "*"), _token: token(link, endpoint)? })
    }
}

/// The reading in a `FluidPressure`, with number and run of the sender.
///
/// # Errors
/// A message of another type or without its attachment.
pub fn reading(sample: &Sample) -> Result<SensorSample, String> {
    let key = sample.key_expr().as_str();
    PRESSURE.check_hash(key)?;
    let expected =
        || format!("{key}: expected a sensor_msgs/FluidPressure in little-endian CDR with its attachment");
    let (t_sensor_ns, pressure_pa) = fluid_pressure(&sample.payload().to_bytes()).ok_or_else(expected)?;
    let bytes = sample.attachment().ok_or_else(expected)?.to_bytes();
    let (number, gid) = attachment::parse(&bytes).ok_or_else(expected)?;
    let boot_id = gid.first_chunk().map_or(0, |half| u64::from_le_bytes(*half)).max(1);
    let pressure_mpa = pressure_pa / PA_PER_MPA;
    Ok(SensorSample { boot_id, seq: number as u64, t_sensor_ns, pressure_mpa, ..SensorSample::default() })
}
