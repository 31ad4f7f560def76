//! `softtwin setpoint ACTUATOR VALUE...`: a new target for the controller that `softtwin hold` runs.

use super::Args;
use crate::failure::usage;
use crate::output;
use std::time::{Duration, Instant};
use wire::layout::{TARGET_VALUES_MAX, pack_name, target_kind};
use wire::{Bus, SetpointReader, Target, TargetWriter, Topic, WakeSet, Wakeable, WireError, boot_id, now_ns};

/// Name of the owner.
const OWNER: &str = "softtwin-target";
/// Longest wait for the controller.
const PATIENCE: Duration = Duration::from_secs(2);

impl Args {
    /// Sends the target to the controller that listens.
    pub(super) fn retarget(&self, bus: &Bus) -> anyhow::Result<()> {
        let count = self.values.len();
        let target_kind = match (count, self.rate, self.interval_s) {
            (1, None, None) => target_kind::STEP,
            (1, Some(_), None) => target_kind::RAMP,
            (2..=TARGET_VALUES_MAX, None, Some(_)) => target_kind::SERIES,
            _ => {
                return Err(usage(format!(
                    "expected one value, or 2 to {TARGET_VALUES_MAX} values with --interval-s, found {count}"
                )));
            }
        };
        let topic = Topic::target(&self.actuator)?;
        let setpoints = match SetpointReader::open(bus, &Topic::setpoint(&self.actuator)?) {
            Err(WireError::NoSuchTopic { .. }) => anyhow::bail!("{}", self.no_controller()),
            opened => opened?,
        };
        let mut writer = TargetWriter::create_named(bus, &topic, OWNER)?;
        let mut target = Target {
            boot_id: boot_id(),
            seq: 1,
            t_publish_ns: now_ns(),
            target_kind,
            value_count: count as u32,
            rate_per_s: self.rate.unwrap_or(f64::NAN),
            interval_s: self.interval_s.unwrap_or(f64::NAN),
            owner: pack_name(OWNER),
            ..Target::default()
        };
        for (to, from) in target.values.iter_mut().zip(&self.values) {
            *to = *from;
        }
        writer.publish(target)?;
        // The controller takes the newest target before each setpoint: of two that were sent later, the second has seen it.
        let (mut wake, begin, mut later) = (WakeSet::new([&setpoints as &dyn Wakeable]), Instant::now(), 0);
        while begin.elapsed() < PATIENCE {
            while let Some(setpoint) = setpoints.next()? {
                later += u32::from(setpoint.t_publish_ns > target.t_publish_ns);
            }
            if later >= 2 {
                output!("{topic}: sent")?;
                return Ok(());
            }
            wake.wait(PATIENCE.saturating_sub(begin.elapsed()))?;
        }
        anyhow::bail!("{}", self.no_controller())
    }

    fn no_controller(&self) -> String {
        format!(
            "no controller holds `{0}`: start `softtwin hold` with a scene that has the actuator `{0}`",
            self.actuator
        )
    }
}
