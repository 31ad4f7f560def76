//! A peer with other type hashes: it receives nothing and is named in the gateway's log; other peers continue.

use crate::heard::Heard;
use crate::pressure::{Gauge, one_arrives};
use crate::services;
use crate::stage::{Error, Seen, Stage, ensure, until};
use hiroz::{Builder, MessageTypeInfo, ServiceTypeInfo, TypeHash, TypeInfo};
use hiroz_msgs::ros::geometry_msgs::WrenchStamped;
use hiroz_msgs::ros::sensor_msgs::FluidPressure;
use hiroz_msgs::ros::std_srvs::TriggerRequest;
use hiroz_msgs::ros::std_srvs::srv::Trigger;
use std::time::Duration;

/// Longest wait for an answer that does not come.
const SILENCE: Duration = Duration::from_secs(2);
/// Messages of the right type meanwhile.
const MEANWHILE: usize = 100;

/// The type, of another definition.
fn other(of: TypeInfo) -> TypeInfo {
    TypeInfo::new(&of.name, TypeHash::new(1, [0xab; 32]))
}

/// Pressures and a request of another hash are named with the hash that is expected.
pub fn is_named(stage: &Stage) -> Seen {
    let gauge = Gauge::of_type(stage, other(FluidPressure::type_info()))?;
    let expected = format!("expected type hash {}", FluidPressure::type_hash());
    let pressure = until(|| {
        gauge.send(20_000.0)?;
        said(stage, "a message from ROS is no reading", &expected)
    })?;
    let builder = stage.node.create_client::<Trigger>("/softtwin/finger/describe");
    let client = builder.with_type_info(other(Trigger::service_type_info())).build()?;
    let answer = stage.runtime.block_on(client.call_with_timeout(&TriggerRequest::default(), SILENCE));
    ensure(answer.is_err(), || "a request of another hash is answered".into())?;
    let expected = format!("expected type hash {}", Trigger::service_type_info().hash);
    let request = until(|| said(stage, "a request from ROS is refused", &expected))?;
    Ok(format!("\n          {pressure}\n          {request}"))
}

/// The line of the gateway's log.
fn said(stage: &Stage, what: &str, expected: &str) -> Result<String, Error> {
    let log = stage.text("gateway.log")?;
    let line = log.lines().find(|line| line.contains(what) && line.contains(expected));
    line.map(str::to_owned)
        .ok_or_else(|| format!("the log has no line with `{what}` and `{expected}`:\n{log}").into())
}

/// A subscription of another hash hears nothing while others hear; pressures and services of the right hash continue.
pub fn breaks_nothing(stage: &Stage) -> Seen {
    let none =
        Heard::<WrenchStamped>::of_type(stage, "/softtwin/finger/wrench", other(WrenchStamped::type_info()))?;
    let right = Heard::<WrenchStamped>::on(stage, "/softtwin/finger/wrench")?;
    right.wait(MEANWHILE)?;
    ensure(none.count() == 0, || format!("{} messages of another type came", none.count()))?;
    one_arrives(stage)?;
    services::describe(stage)?;
    Ok(format!("0 messages of the other type while {MEANWHILE} came; a pressure and a request go on"))
}
