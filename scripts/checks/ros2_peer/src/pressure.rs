//! Pressures from hiroz to a twin that has no other readings.

use crate::heard::Heard;
use crate::ros::softtwin_interfaces::WhatIfRequest;
use crate::ros::softtwin_interfaces::srv::WhatIf;
use crate::stage::{Error, PATIENCE, Seen, Stage, ensure};
use crate::states::ns;
use hiroz::msg::ZMessage;
use hiroz::pubsub::ZPub;
use hiroz::{Builder, TypeInfo};
use hiroz_msgs::ros::builtin_interfaces::Time;
use hiroz_msgs::ros::geometry_msgs::WrenchStamped;
use hiroz_msgs::ros::sensor_msgs::FluidPressure;
use hiroz_msgs::ros::std_msgs::Header;
use std::collections::BTreeMap;
use std::time::{Duration, Instant, SystemTime};

/// Where the gateway takes pressures.
const TOPIC: &str = "/softtwin/fed/pressure_measured";
/// The gap of the scene, mm.
const GAP_MM: f64 = 30.0;
/// A pressure goes to MPa and back.
const ROUNDED_PA: f64 = 1e-6;
/// The same, in the force of this pressure.
const ROUNDED_N: f64 = 1e-9;
/// Pressures that are sent, up to most of the model's range.
const STEPS: u8 = 16;
/// How long the twin has until a pressure is sent again: what is sent before it listens is lost.
const AGAIN: Duration = Duration::from_millis(500);

/// Publishes pressures.
pub struct Gauge(ZPub<FluidPressure, <FluidPressure as ZMessage>::Serdes>);

impl Gauge {
    /// A publisher, matched by the subscription in the graph.
    pub fn matched(stage: &Stage) -> Result<Self, Error> {
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

    /// Sends a pressure until the twin has it; how often, and the force with the same stamp, N.
    fn arrives(&self, pressure_pa: f64, heard: &mut Heards) -> Result<(usize, f64), Error> {
        let end = Instant::now() + PATIENCE;
        for sent in 1.. {
            self.send(pressure_pa)?;
            let again = Instant::now() + AGAIN;
            while Instant::now() < again {
                if let Some(force_n) = heard.force_at(pressure_pa) {
                    return Ok((sent, force_n));
                }
                std::thread::sleep(Duration::from_millis(1));
            }
            ensure(Instant::now() < end, || {
                format!("{pressure_pa} Pa did not come back as the twin's with a force")
            })?;
        }
        unreachable!()
    }
}

/// Pressures and forces of the twin that the gauge feeds.
struct Heards {
    pressures: Heard<FluidPressure>,
    wrenches: Heard<WrenchStamped>,
    pa_by_stamp: BTreeMap<i64, f64>,
    n_by_stamp: BTreeMap<i64, f64>,
}

impl Heards {
    fn on(stage: &Stage) -> Result<Self, Error> {
        Ok(Self {
            pressures: Heard::on(stage, "/softtwin/fed/pressure")?,
            wrenches: Heard::on(stage, "/softtwin/fed/wrench")?,
            pa_by_stamp: BTreeMap::new(),
            n_by_stamp: BTreeMap::new(),
        })
    }

    /// The force whose stamp is that of this pressure.
    fn force_at(&mut self, pressure_pa: f64) -> Option<f64> {
        let pressures = self.pressures.take().into_iter();
        self.pa_by_stamp.extend(pressures.map(|message| (ns(&message.header.stamp), message.fluid_pressure)));
        let wrenches = self.wrenches.take().into_iter();
        self.n_by_stamp.extend(wrenches.map(|message| (ns(&message.header.stamp), message.wrench.force.y)));
        let of_it =
            self.pa_by_stamp.iter().filter(|(_, found_pa)| (*found_pa - pressure_pa).abs() < ROUNDED_PA);
        of_it.filter_map(|(stamp, _)| self.n_by_stamp.get(stamp)).next_back().copied()
    }
}

/// Each pressure comes back as the twin's, and the force beside it is that of the same question.
pub fn the_twin_follows(stage: &Stage) -> Seen {
    let mut heard = Heards::on(stage)?;
    let gauge = Gauge::matched(stage)?;
    let what_if = stage.node.create_client::<WhatIf>("/softtwin/fed/what_if").build()?;
    let (mut all_sent, mut forces_n) = (0, Vec::new());
    for step in 1..=STEPS {
        let pressure_pa = 5_000.0 * f64::from(step);
        let (sent, force_n) = gauge.arrives(pressure_pa, &mut heard)?;
        let asked = WhatIfRequest { pressure_mpa: pressure_pa * 1e-6, gap_mm: GAP_MM, ..Default::default() };
        let answered_n = stage.call(&what_if, &asked)?.answer.contact_force_n;
        ensure((force_n - answered_n).abs() < ROUNDED_N, || {
            format!("{pressure_pa} Pa: the topic says {force_n} N, the service {answered_n} N")
        })?;
        all_sent += sent;
        forces_n.push(force_n);
    }
    ensure(forces_n.is_sorted() && forces_n.last() > forces_n.first(), || {
        format!("forces are {forces_n:?} N")
    })?;
    let last = forces_n.last().copied().unwrap_or_default();
    Ok(format!(
        "{STEPS} pressures came back ({all_sent} sent), their forces are those of what_if, up to {last} N"
    ))
}

/// One pressure comes back.
pub fn one_arrives(stage: &Stage) -> Result<(), Error> {
    Gauge::matched(stage)?.arrives(33_000.0, &mut Heards::on(stage)?).map(|_| ())
}
