//! A single Modbus device as the source of an actuator: gauge, gap sensor and load cell polled together.

use super::calibration::Channel;
use super::devices::Devices;
use super::filter::{Filter, FilterSpec};
use super::mixed::Mixed;
use super::modbus::{ModbusPath, Polled};
use super::register::{Quantity, RegisterSpec};
use super::serial::SerialSpec;
use crate::source::reading::Source;
use crate::source::value::{FORCE, GAP, PRESSURE};
use serde::{Deserialize, Serialize};

/// A Modbus sensor as written in a scene file: `tcp` or `serial`, and where each quantity stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModbusSpec {
    /// Modbus TCP: `host:port`, usually port 502.
    #[serde(default)]
    pub tcp: Option<String>,
    /// Modbus RTU.
    #[serde(default)]
    pub serial: Option<SerialSpec>,
    /// Polls a second.
    #[serde(default = "usual_rate")]
    pub poll_hz: f64,
    /// Longest wait for the answers of one poll, ms.
    #[serde(default = "usual_timeout")]
    pub timeout_ms: f64,
    /// Longest pause between attempts to reconnect, ms.
    #[serde(default = "usual_backoff")]
    pub backoff_max_ms: f64,
    /// Smoothing of the pressure.
    #[serde(default)]
    pub filter: FilterSpec,
    /// The gauge.
    pub pressure: RegisterSpec,
    /// The gap sensor, if there is one.
    #[serde(default)]
    pub gap: Option<RegisterSpec>,
    /// The load cell, if there is one.
    #[serde(default)]
    pub force: Option<RegisterSpec>,
}

fn usual_rate() -> f64 {
    50.0
}

fn usual_timeout() -> f64 {
    200.0
}

fn usual_backoff() -> f64 {
    5000.0
}

impl ModbusSpec {
    /// Everything that is wrong with it.
    pub fn problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        ModbusPath::problems(self.tcp.as_deref(), self.serial.as_ref(), "source", &mut problems);
        for (key, value, min, max) in [
            ("poll_hz", self.poll_hz, 1e-3, 20_000.0),
            ("timeout_ms", self.timeout_ms, 0.1, 600_000.0),
            ("backoff_max_ms", self.backoff_max_ms, 0.1, 3_600_000.0),
        ] {
            if !(min..=max).contains(&value) {
                problems.push(format!("source.{key}: expected {min} to {max}, found {value}"));
            }
        }
        self.filter.problems("source.filter", &mut problems);
        self.pressure.problems("source.pressure", Quantity::Pressure, &mut problems);
        if let Some(gap) = &self.gap {
            gap.problems("source.gap", Quantity::Gap, &mut problems);
        }
        if let Some(force) = &self.force {
            force.problems("source.force", Quantity::Force, &mut problems);
        }
        problems
    }

    /// A source that is not started.
    ///
    /// # Errors
    /// [`Self::problems`].
    pub(crate) fn open(&self, devices: &Devices) -> Result<Box<dyn Source>, Vec<String>> {
        let problems = self.problems();
        let path = ModbusPath::new(self.tcp.as_deref(), self.serial.as_ref());
        let Some(path) = path.filter(|_| problems.is_empty()) else { return Err(problems) };
        let given = [
            (PRESSURE, Quantity::Pressure, Some(&self.pressure)),
            (GAP, Quantity::Gap, self.gap.as_ref()),
            (FORCE, Quantity::Force, self.force.as_ref()),
        ];
        let (mut channels, mut registers) = (Vec::new(), Vec::new());
        for (slot, quantity, spec) in given {
            let Some(spec) = spec else { continue };
            let factor = quantity.factor(spec.unit.as_deref()).unwrap_or(f64::NAN);
            let mut channel = Channel::plain(slot, factor);
            (channel.calibration.scale, channel.calibration.offset) = (spec.scale, spec.offset);
            if slot == PRESSURE {
                channel.filter = Filter::new(self.filter);
            }
            channels.push(channel);
            registers.push(spec.at());
        }
        let Self { poll_hz, timeout_ms, backoff_max_ms, .. } = *self;
        let inbox = devices.poll_modbus(&path, channels, "", |feed| {
            Polled::new(feed, registers, poll_hz, timeout_ms, backoff_max_ms)
        });
        let inbox = inbox.map_err(|problem| vec![format!("source: {problem}")])?;
        Ok(Mixed::single(inbox, devices))
    }
}
