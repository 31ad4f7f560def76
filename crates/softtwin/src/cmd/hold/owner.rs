//! The right to drive the valve, with the numbers of what is sent.

use wire::layout::pack_name;
use wire::{Bus, Setpoint, SetpointWriter, Topic, boot_id, now_ns};

pub(super) struct Owner {
    writer: SetpointWriter,
    pub(super) boot_id: u64,
    pub(super) seq: u64,
    valid_for_ns: u64,
    name: [u8; 32],
}

impl Owner {
    pub(super) fn new(bus: &Bus, topic: &Topic, name: &str, valid_ms: f64) -> anyhow::Result<Self> {
        let writer = SetpointWriter::create_named(bus, topic, name)?;
        let valid_for_ns = (valid_ms * 1e6) as u64;
        Ok(Self { writer, boot_id: boot_id(), seq: 0, valid_for_ns, name: pack_name(name) })
    }

    /// Sends a pressure; NaN lets go of the valve.
    pub(super) fn send(&mut self, pressure_mpa: f64, t_sensor_ns: u64) -> anyhow::Result<()> {
        self.seq += 1;
        let Self { boot_id, seq, valid_for_ns, name: owner, .. } = *self;
        let t_publish_ns = now_ns();
        let setpoint =
            Setpoint { boot_id, seq, t_sensor_ns, t_publish_ns, valid_for_ns, pressure_mpa, owner };
        Ok(self.writer.publish(setpoint)?)
    }
}
