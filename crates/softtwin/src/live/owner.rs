//! The right to drive a valve, with the numbers of what is sent.

use std::time::Duration;
use wire::layout::pack_name;
use wire::{Bus, Setpoint, SetpointWriter, Topic, boot_id, now_ns};

/// Owner of a valve while it exists.
pub struct Owner {
    writer: SetpointWriter,
    /// The run of this program.
    pub boot_id: u64,
    /// Number of the last setpoint.
    pub seq: u64,
    /// When the last setpoint was sent.
    pub sent_ns: u64,
    valid_for_ns: u64,
    name: [u8; 32],
}

impl Owner {
    /// Setpoints count for `valid` from their sending on; an override with 0 until it is released.
    pub fn new(bus: &Bus, topic: &Topic, name: &str, valid: Duration) -> anyhow::Result<Self> {
        let writer = SetpointWriter::create_named(bus, topic, name)?;
        let (valid_for_ns, name) = (valid.as_nanos() as u64, pack_name(name));
        Ok(Self { writer, boot_id: boot_id(), seq: 0, sent_ns: 0, valid_for_ns, name })
    }

    /// Sends a pressure; NaN lets go of the valve.
    pub fn send(&mut self, pressure_mpa: f64, t_sensor_ns: u64) -> anyhow::Result<()> {
        (self.seq, self.sent_ns) = (self.seq + 1, now_ns());
        let Self { boot_id, seq, sent_ns: t_publish_ns, valid_for_ns, name: owner, .. } = *self;
        let setpoint =
            Setpoint { boot_id, seq, t_sensor_ns, t_publish_ns, valid_for_ns, pressure_mpa, owner };
        Ok(self.writer.publish(setpoint)?)
    }
}
