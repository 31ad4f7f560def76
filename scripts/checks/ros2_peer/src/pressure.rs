//! Pressures from hiroz to a twin that has no other readings.

use crate::heard::Heard;
use crate::ros::softtwin_interfaces::WhatIfRequest;
use crate::ros::softtwin_interfaces::srv::WhatIf;
use crate::stage::{Error, PATIENCE, Seen, Stage, ensure};
use crate::states::ns;
use hiroz::msg::ZMessage;
use hiroz::pubsub::ZPub;
use hiroz::{Builder, TypeInfo, WithTypeInfo};
use hiroz_msgs::ros::builtin_interfaces::Time;
use hiroz_msgs::ros::geometry_msgs::WrenchStamped;
use hiroz_msgs::ros::sensor_msgs::FluidPressure;
use hiroz_msgs::ros::std_msgs::Header;
use std::time::{Duration, Instant, SystemTime};

/// Where the gateway takes pressures.
const TOPIC: &str = "/softtwin/fed/pressure_measured";
/// The gap of the scene, mm.
const GAP_MM: f64 = 30.0;
/// A pressure goes to MPa and back.
const ROUNDED_PA: f64 = 1e-6;
/// The same, in the force of this pressure.
const ROUNDED_N: f64 = 1e-9;
/// How long the twin has until a pressure is sent again: what is sent before it listens is lost.
const AGAIN: Duration = Duration::from_millis(500);

/// Publishes pressures.
pub struct Gauge(ZPub<FluidPressure, <FluidPressure as ZMessage>::Serdes>);

impl Gauge {
    /// A publisher, matched by the subscription in the graph.
    pub fn matched(stage: &Stage) -> Result<Self, Error>
    where
        FluidPressure: WithTypeInfo,
    {
        let publisher = stage.node.create_pub::<FluidPressure>(TOPIC).build()?;
        let is_matched = stage.runtime.block_on(publisher.wait_for_subscription(1, PATIENCE));
        ensure(is_matched, || format!("no subscription to {TOPIC}"))?;
        Ok(Self(publisher))
    }

    /// A publisher as if the type were this one.
    pub fn of_type(stage: &Stage, of: TypeInfo) -> Result<Self, Error> {
        Ok(Self(stage.node.create_pub::<FluidPressure>(TOPIC).with_type_info(of).build()?))
    }

    /// Sends a pressure of now.
    pub fn send(&self, pressure_pa: f64) -> Result<(), Error> {
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?;
        let stamp = Time { sec: now.as_secs().try_into()?, nanosec: now.subsec_nanos() };
        let header = Header { stamp, frame_id: "gauge".into() };
        self.0.publish(&FluidPressure { header, fluid_pressure: pressure_pa, variance: 0.0 })
    }

    /// Sends a pressure until the twin has it; its stamp, and how often it was sent.
    fn arrives(&self, pressure_pa: f64, heard: &Heard<FluidPressure>) -> Result<(i64, usize), Error> {
        let end = Instant::now() + PATIENCE;
        for sent in 1.. {
            self.send(pressure_pa)?;
            let again = Instant::now() + AGAIN;
            while Instant::now() < again {
                let is_it =
                    |message: &FluidPressure| (message.fluid_pressure - pressure_pa).abs() < ROUNDED_PA;
                if let Some(message) = heard.take().into_iter().find(is_it) {
                    return Ok((ns(&message.header.stamp), sent));
                }
                std::thread::sleep(Duration::from_millis(1));
            }
            ensure(Instant::now() < end, || format!("{pressure_pa} Pa did not come back as the twin's"))?;
        }
        unreachable!()
    }
}

/// Each pressure comes back as the twin's, and the force beside it is that of the same question.
pub fn the_twin_follows(stage: &Stage) -> Seen {
    let pressures = Heard::<FluidPressure>::on(stage, "/softtwin/fed/pressure")?;
    let wrenches = Heard::<WrenchStamped>::on(stage, "/softtwin/fed/wrench")?;
    let gauge = Gauge::matched(stage)?;
    let what_if = stage.node.create_client::<WhatIf>("/softtwin/fed/what_if").build()?;
    let (mut all_sent, mut forces_n, mut waiting) = (0, Vec::new(), Vec::new());
    for step in 1..=16 {
        let pressure_pa = 5_000.0 * f64::from(step);
        let (stamp, sent) = gauge.arrives(pressure_pa, &pressures)?;
        all_sent += sent;
        let request =
            WhatIfRequest { pressure_mpa: pressure_pa * 1e-6, gap_mm: GAP_MM, ..Default::default() };
        let answer = stage.block_on(what_if.call(&request))?.answer;
        let wrench = crate::stage::until(|| {
            waiting.extend(wrenches.take());
            let found = waiting.iter().find(|wrench: &&WrenchStamped| ns(&wrench.header.stamp) == stamp);
            found.map(|wrench| wrench.wrench.force.y).ok_or_else(|| "no force of the same stamp came".into())
        })?;
        ensure((wrench - answer.contact_force_n).abs() < ROUNDED_N, || {
            format!("{pressure_pa} Pa: the topic says {wrench} N, the service {} N", answer.contact_force_n)
        })?;
        forces_n.push(wrench);
    }
    ensure(forces_n.is_sorted() && forces_n.last() > forces_n.first(), || {
        format!("forces are {forces_n:?} N")
    })?;
    let last = forces_n.last().copied().unwrap_or_default();
    Ok(format!(
        "16 pressures came back ({all_sent} messages), the forces with them are those of what_if, up to {last} N"
    ))
}

/// One pressure comes back.
pub fn one_arrives(stage: &Stage) -> Result<(), Error> {
    let pressures = Heard::<FluidPressure>::on(stage, "/softtwin/fed/pressure")?;
    Gauge::matched(stage)?.arrives(33_000.0, &pressures).map(|_| ())
}
