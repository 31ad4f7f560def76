//! One received sample of any kind.

use super::text;
use recording::message::{CommandMessage, GraspMessage, HealthMessage, SensorMessage, StateMessage};
use serde_json::{Value, json};
use wire::layout::{field_id, flags, regime, unpack_name};
use wire::{Command, FieldSample, Grasp, Health, SensorSample, State};

/// A sample of any kind of topic.
#[derive(Debug)]
pub enum Sample {
    /// A reading.
    Sensor(SensorSample),
    /// A state.
    State(Box<State>),
    /// Health.
    Health(Health),
    /// A field, still in shared memory.
    Field(FieldSample),
    /// A grasp.
    Grasp(Grasp),
    /// A pressure command.
    Command(Command),
}

impl Sample {
    /// Run of the sender and number within the run.
    pub fn boot_and_seq(&self) -> (u64, u64) {
        match self {
            Self::Sensor(sample) => (sample.boot_id, sample.seq),
            Self::State(sample) => (sample.boot_id, sample.seq),
            Self::Health(sample) => (sample.boot_id, sample.seq),
            Self::Field(sample) => (sample.header().boot_id, sample.header().seq),
            Self::Grasp(sample) => (sample.boot_id, sample.seq),
            Self::Command(sample) => (sample.boot_id, sample.seq),
        }
    }

    /// When the reading behind it was taken; none for health, and for a state that stands in for a missing reading.
    pub fn t_sensor_ns(&self) -> Option<u64> {
        let old = flags::STALE | flags::HELD | flags::NO_DATA;
        match self {
            Self::Sensor(sample) => Some(sample.t_sensor_ns),
            Self::State(sample) => (sample.flags & old == 0).then_some(sample.t_sensor_ns),
            Self::Health(_) => None,
            Self::Field(sample) => Some(sample.header().t_sensor_ns),
            Self::Grasp(sample) => (sample.flags & old == 0).then_some(sample.t_sensor_ns),
            Self::Command(sample) => (sample.t_sensor_ns != 0).then_some(sample.t_sensor_ns),
        }
    }

    /// One line for people: a summary, never all values of a field.
    pub fn line(&self) -> String {
        match self {
            Self::Sensor(sample) => text::sensor(sample),
            Self::State(sample) => text::state(sample),
            Self::Health(sample) => text::health(sample),
            Self::Field(sample) => text::field(sample),
            Self::Grasp(sample) => text::grasp(sample),
            Self::Command(sample) => text::command(sample),
        }
    }

    /// The sample as JSON; a field as header and range of each of its fields.
    pub fn json(&self) -> anyhow::Result<Value> {
        Ok(match self {
            Self::Sensor(sample) => serde_json::to_value(SensorMessage::from(sample))?,
            Self::State(sample) => serde_json::to_value(StateMessage::from(&**sample))?,
            Self::Health(sample) => serde_json::to_value(HealthMessage::from(sample))?,
            Self::Field(sample) => field_json(sample),
            Self::Grasp(sample) => serde_json::to_value(GraspMessage::from(sample))?,
            Self::Command(sample) => serde_json::to_value(CommandMessage::from(sample))?,
        })
    }
}

fn field_json(sample: &FieldSample) -> Value {
    let header = sample.header();
    let fields: serde_json::Map<String, Value> = header
        .fields()
        .filter_map(|id| {
            let (min, max) = range(sample.field(id)?);
            Some((field_id::as_str(id).to_owned(), json!({ "min": min, "max": max })))
        })
        .collect();
    json!({
        "seq": header.seq,
        "sensor_seq": header.sensor_seq,
        "t_sensor_ns": header.t_sensor_ns,
        "t_publish_ns": header.t_publish_ns,
        "pressure_mpa": header.pressure_mpa,
        "gap_mm": header.gap_mm,
        "contact_force_n": header.contact_force_n,
        "max_von_mises_mpa": header.max_von_mises_mpa,
        "max_von_mises_node": header.max_von_mises_node,
        "regime": regime::as_str(header.regime),
        "flags": flags::names(header.flags).collect::<Vec<_>>(),
        "node_set": unpack_name(&header.node_set),
        "nodes": header.node_count,
        "entries": header.entries(),
        "fields": fields,
    })
}

/// Smallest and largest value, NaN left out.
pub fn range(values: &[f32]) -> (f32, f32) {
    values
        .iter()
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(min, max), value| (min.min(*value), max.max(*value)))
}

/// Finds lost samples by jumps of the sequence number; a new run of the sender begins anew.
#[derive(Debug, Default)]
pub struct SeqTracker {
    last: Option<(u64, u64)>,
    /// Samples that never came.
    pub lost: u64,
}

impl SeqTracker {
    /// Notes a sample.
    pub fn see(&mut self, (boot, seq): (u64, u64)) {
        if let Some((last_boot, last_seq)) = self.last
            && last_boot == boot
        {
            self.lost += seq.saturating_sub(last_seq + 1);
        }
        self.last = Some((boot, seq));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jumps_are_lost_samples_and_restarts_are_not() {
        let mut tracker = SeqTracker::default();
        for seen in [(1, 5), (1, 6), (1, 9), (2, 1), (2, 2), (2, 4)] {
            tracker.see(seen);
        }
        assert_eq!(tracker.lost, 3);
    }

    #[test]
    fn the_range_leaves_nan_out() {
        assert_eq!(range(&[2.0, f32::NAN, -1.0]), (-1.0, 2.0));
    }
}
