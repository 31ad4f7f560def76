//! States as messages, bit-identical to the output of `softtwin echo` for the same twin.

use crate::heard::Heard;
use crate::stage::{Error, Seen, Stage, ensure, read, until};
use hiroz_msgs::ros::builtin_interfaces::Time;
use hiroz_msgs::ros::diagnostic_msgs::DiagnosticArray;
use hiroz_msgs::ros::geometry_msgs::WrenchStamped;
use hiroz_msgs::ros::sensor_msgs::FluidPressure;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::{Duration, SystemTime};

/// States to compare: more than the trace that is replayed has.
const STATES: usize = 900;
const PA_PER_MPA: f64 = 1e6;

/// A stamp as a number that orders and compares, ns.
pub fn ns(stamp: &Time) -> i64 {
    i64::from(stamp.sec) * 1_000_000_000 + i64::from(stamp.nanosec)
}

/// A stamp of the last minute.
pub fn is_now(stamp: &Time) -> bool {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    now.saturating_sub(Duration::from_nanos(ns(stamp).unsigned_abs())) < Duration::from_secs(60)
}

/// Forces and pressures of the same stamps are those of a state; pressures are those of the trace.
pub fn wrench_and_pressure(stage: &Stage) -> Seen {
    let wrenches = Heard::<WrenchStamped>::on(stage, "/softtwin/finger/wrench")?;
    let pressures = Heard::<FluidPressure>::on(stage, "/softtwin/finger/pressure")?;
    wrenches.wait(STATES)?;
    pressures.wait(STATES)?;
    let trace = trace()?;
    let mut by_stamp = BTreeMap::new();
    for message in pressures.take() {
        let pressure_pa = message.fluid_pressure;
        ensure(message.header.frame_id == "finger" && message.variance == 0.0, || {
            format!("found {message:?}")
        })?;
        ensure(trace.contains(&pressure_pa.to_bits()), || format!("{pressure_pa} Pa is not in the trace"))?;
        by_stamp.insert(ns(&message.header.stamp), pressure_pa);
    }
    let (mut pairs, mut largest_n) = (Vec::new(), 0.0_f64);
    for message in wrenches.take() {
        let (force, torque) = (&message.wrench.force, &message.wrench.torque);
        let others = [force.x, force.z, torque.x, torque.y, torque.z];
        let is_plain = message.header.frame_id == "finger_contact" && others == [0.0; 5];
        ensure(is_plain && is_now(&message.header.stamp), || format!("found {message:?}"))?;
        largest_n = largest_n.max(force.y);
        pairs.extend(
            by_stamp.get(&ns(&message.header.stamp)).map(|pressure| (force.y.to_bits(), pressure.to_bits())),
        );
    }
    let common = pairs.len();
    ensure(common * 2 >= STATES, || format!("only {common} stamps are common to both topics"))?;
    ensure(largest_n > 0.0, || "no force above 0 came".into())?;
    until(|| {
        let states: BTreeSet<_> = stage.samples("states.jsonl")?.iter().filter_map(pair).collect();
        let unknown = pairs.iter().filter(|pair| !states.contains(pair)).count();
        ensure(unknown == 0, || format!("{unknown} of {common} are no force and pressure of a state"))
    })?;
    Ok(format!("{common} forces (up to {largest_n} N) and pressures are bit-identical to the states'"))
}

/// Force in N and pressure in Pa of a state.
fn pair(state: &Value) -> Option<(u64, u64)> {
    let pressure_pa = state["pressure_mpa"].as_f64()? * PA_PER_MPA;
    Some((state["contact_force_n"].as_f64()?.to_bits(), pressure_pa.to_bits()))
}

/// The pressures that the bridge replays, Pa.
fn trace() -> Result<BTreeSet<u64>, Error> {
    let text = read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../config/traces/gap40.csv"))?;
    let rows = text.lines().filter_map(|line| line.split(',').nth(1)?.parse::<f64>().ok());
    Ok(rows.map(|pressure_mpa| (pressure_mpa * PA_PER_MPA).to_bits()).collect())
}

/// The twin's health as one status.
pub fn diagnostics(stage: &Stage) -> Seen {
    let heard = Heard::<DiagnosticArray>::on(stage, "/softtwin/finger/diagnostics")?;
    let (message, status) = until(|| {
        let message = heard.take().pop().ok_or("no message came")?;
        let [status] = &message.status[..] else {
            return Err(format!("expected one status, found {message:?}").into());
        };
        // Stale is what a twin says truly when the machine gives it no time.
        ensure(status.level <= 1, || format!("expected level 0 or 1 of a living twin, found {status:?}"))?;
        Ok((message.clone(), status.clone()))
    })?;
    ensure(is_now(&message.header.stamp), || format!("found {:?}", message.header))?;
    ensure(status.name == "softtwin: finger" && status.hardware_id == "finger", || {
        format!("found {status:?}")
    })?;
    let values: BTreeMap<_, _> =
        status.values.iter().map(|pair| (pair.key.as_str(), pair.value.as_str())).collect();
    let rate_hz: f64 = values.get("rate_hz").ok_or_else(|| format!("no rate_hz in {values:?}"))?.parse()?;
    ensure(rate_hz > 0.0, || format!("expected more than 0 Hz, found {rate_hz}"))?;
    Ok(format!("level {}, `{}`, {values:?}", status.level, status.message))
}
