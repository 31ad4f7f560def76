//! The sensors of an actuator as written in a scene file: where each is, which values it has, how old they may be.

use super::devices::Devices;
use super::mixed::{Input, Mixed, Pace};
use super::modbus::{Polled, RegisterAt};
use super::plugin::PluginSpec;
use super::reading::{InputNames, PRESSURE, Source};
use super::sensor::{Channel, Inbox, Values, problems as value_problems};
use super::serial::{ModbusPath, SerialSpec, check_address};
use super::stream::{Cell, LineSensor, LinesPath, Pick};
use crate::problems::Problems;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The sensors of an actuator by name.
pub type Sensors = BTreeMap<String, SensorSpec>;

/// Pace of the readings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum PaceSpec {
    /// `pace = 200.0`: readings per second.
    RateHz(f64),
    /// `pace = "gauge"`: one for every answer of this sensor.
    Sensor(String),
}

/// A sensor as written in a scene file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum SensorSpec {
    /// A device on Modbus TCP or RTU.
    Modbus(ModbusSensor),
    Lines(LinesSensor),
}

/// A device on Modbus: `tcp` or `serial`, shared with all sensors that name the same one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModbusSensor {
    /// Modbus TCP: `host:port`, usually port 502.
    pub tcp: Option<String>,
    /// Modbus RTU.
    pub serial: Option<SerialSpec>,
    /// Polls a second.
    #[serde(default = "usual_rate")]
    pub rate_hz: f64,
    /// Longest wait for the answers of one poll, ms.
    #[serde(default = "usual_timeout")]
    pub timeout_ms: f64,
    /// Longest pause between attempts to reach a device that does not answer, ms.
    #[serde(default = "usual_backoff")]
    pub backoff_max_ms: f64,
    /// Older values are absent, ms.
    #[serde(default = "usual_age")]
    pub age_limit_ms: f64,
    /// Measured values; each is a register.
    pub values: Values<RegisterAt>,
}

/// Lines of text: from at most one of `serial`, `tcp`, `udp` and `command`; from none: the bridge's standard input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinesSensor {
    /// A serial line.
    pub serial: Option<SerialSpec>,
    /// TCP: `host:port` to connect to.
    pub tcp: Option<String>,
    /// UDP: `address:port` to listen on; a datagram has one line or several.
    pub udp: Option<String>,
    /// A program that prints the lines, with its arguments; it runs in the scene file's folder.
    pub command: Option<Vec<String>>,
    /// A comma between digits separates two numbers, although it may look like a decimal comma.
    #[serde(default)]
    pub comma_separates: bool,
    /// Older values are absent, ms.
    #[serde(default = "usual_age")]
    pub age_limit_ms: f64,
    /// Measured values; each is a cell, from 1, or a JSON key.
    pub values: Values<Cell>,
}

fn usual_rate() -> f64 {
    50.0
}

fn usual_timeout() -> f64 {
    50.0
}

fn usual_backoff() -> f64 {
    5000.0
}

fn usual_age() -> f64 {
    100.0
}

impl SensorSpec {
    /// The sensor in words, for logs.
    pub fn describe(&self) -> String {
        let values = self.values().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
        let from = match self {
            Self::Modbus(spec) => match spec.path() {
                Some(path) => format!("Modbus at {}, {} polls a second", path.place(), spec.rate_hz),
                None => "Modbus".into(),
            },
            Self::Lines(spec) => format!("lines of text from {}", spec.path(Path::new("")).place()),
        };
        format!("{values} from {from}")
    }

    /// Its values by name with their standard deviations.
    pub(crate) fn values(&self) -> Box<dyn Iterator<Item = (&String, Option<f64>)> + '_> {
        match self {
            Self::Modbus(spec) => Box::new(spec.values.iter().map(|(name, value)| (name, value.sigma))),
            Self::Lines(spec) => Box::new(spec.values.iter().map(|(name, value)| (name, value.sigma))),
        }
    }

    fn age_limit_ms(&self) -> f64 {
        match self {
            Self::Modbus(ModbusSensor { age_limit_ms, .. })
            | Self::Lines(LinesSensor { age_limit_ms, .. }) => *age_limit_ms,
        }
    }

    /// Readings a second of a sensor that is asked.
    fn rate_hz(&self) -> Option<f64> {
        match self {
            Self::Modbus(spec) => Some(spec.rate_hz),
            Self::Lines(_) => None,
        }
    }

    fn problems(&self, inputs: &InputNames, problems: &mut Problems) {
        match self {
            Self::Modbus(spec) => {
                ModbusPath::problems(spec.tcp.as_deref(), spec.serial.as_ref(), problems);
                problems.range("timeout_ms", spec.timeout_ms, [0.1, 600_000.0]);
                problems.range("backoff_max_ms", spec.backoff_max_ms, [0.1, 3_600_000.0]);
                let is_serial = spec.serial.is_some();
                let place = |at: &RegisterAt, problems: &mut Problems| at.problems(is_serial, problems);
                value_problems(&spec.values, inputs, problems, place);
            }
            Self::Lines(spec) => {
                spec.problems(problems);
                value_problems(&spec.values, inputs, problems, Cell::problems);
            }
        }
        let age_limit_ms = self.age_limit_ms();
        problems.range("age_limit_ms", age_limit_ms, [1.0, 3_600_000.0]);
        if let Some(rate_hz) = self.rate_hz() {
            problems.rate_hz("rate_hz", rate_hz);
            let period_ms = 1e3 / rate_hz;
            let expected = format!("more than the {period_ms} ms between two answers (rate_hz)");
            // Of a rate that is not a number nothing follows.
            let fits = age_limit_ms > period_ms || period_ms.is_nan();
            problems.expect(fits, "age_limit_ms", &expected, age_limit_ms);
        }
    }

    /// Adds the sensor, whose specification has no problems, to the devices.
    fn open(
        &self,
        name: &str,
        inputs: &InputNames,
        folder: &Path,
        devices: &Devices,
    ) -> Result<Inbox, String> {
        match self {
            Self::Modbus(spec) => {
                let path = spec.path().ok_or("expected exactly one of tcp and serial")?;
                let registers = spec.values.values().map(|value| value.from).collect();
                let ModbusSensor { rate_hz, timeout_ms, backoff_max_ms, .. } = *spec;
                devices.poll_modbus(&path, channels(&spec.values, inputs), name, |feed| {
                    Polled::new(feed, registers, rate_hz, timeout_ms, backoff_max_ms)
                })
            }
            Self::Lines(spec) => {
                let pick = Pick::new(spec.values.iter().map(|(name, value)| (name, &value.from)));
                let comma_separates = spec.comma_separates;
                devices.read_lines(&spec.path(folder), channels(&spec.values, inputs), name, |feed| {
                    LineSensor { feed, pick, comma_separates }
                })
            }
        }
    }
}

impl ModbusSensor {
    fn path(&self) -> Option<ModbusPath> {
        ModbusPath::new(self.tcp.as_deref(), self.serial.as_ref())
    }
}

impl LinesSensor {
    fn path(&self, folder: &Path) -> LinesPath {
        match (&self.serial, &self.tcp, &self.udp, &self.command) {
            (Some(serial), ..) => LinesPath::Serial(serial.clone()),
            (_, Some(address), ..) => LinesPath::Tcp(address.clone()),
            (_, _, Some(address), _) => LinesPath::Udp(address.clone()),
            (_, _, _, Some(command)) => {
                LinesPath::Plugin(PluginSpec { command: command.clone(), folder: folder.into() })
            }
            (None, None, None, None) => LinesPath::Stdin,
        }
    }

    fn problems(&self, problems: &mut Problems) {
        let given = [
            ("serial", self.serial.is_some()),
            ("tcp", self.tcp.is_some()),
            ("udp", self.udp.is_some()),
            ("command", self.command.is_some()),
        ];
        let given: Vec<&str> = given.iter().filter(|(_, given)| *given).map(|(name, _)| *name).collect();
        if given.len() > 1 {
            let found = given.join(", ");
            problems.add(format_args!("expected at most one of serial, tcp, udp and command, found {found}"));
        }
        if let Some(serial) = &self.serial {
            serial.problems(&mut problems.part("serial"));
        }
        for (name, address) in [("tcp", &self.tcp), ("udp", &self.udp)] {
            if let Some(address) = address {
                check_address(address, name, problems);
            }
        }
        let is_nothing =
            self.command.as_ref().is_some_and(|command| command.first().is_none_or(String::is_empty));
        problems.expect(!is_nothing, "command", "a program and its arguments", "nothing");
    }
}

/// The values on their way, in the order of their names; names and units are checked before.
fn channels<P>(values: &Values<P>, inputs: &InputNames) -> Vec<Channel> {
    values.iter().filter_map(|(name, value)| value.channel(name, inputs)).collect()
}

/// Source of these sensors, not started. Commands run in `folder`; device paths are shared through `devices`; each of the
/// `names` is a value of one sensor.
///
/// # Errors
/// All errors, each with its key, the expected and the found value.
pub fn open(
    sensors: &Sensors,
    pace: Option<&PaceSpec>,
    folder: &Path,
    devices: &Devices,
    names: &InputNames,
) -> Result<Box<dyn Source>, Vec<String>> {
    let mut problems = problems(sensors, pace, names);
    let mut inputs = Vec::new();
    if problems.is_empty() {
        for (name, sensor) in sensors {
            let age_limit_ns = (sensor.age_limit_ms() * 1e6) as u64;
            match sensor.open(name, names, folder, devices) {
                Ok(inbox) => inputs.push(Input { name: name.clone(), inbox, age_limit_ns, ahead: None }),
                Err(problem) => problems.push(format!("sensors.{name}: {problem}")),
            }
        }
    }
    let pace = match pace {
        Some(PaceSpec::RateHz(rate_hz)) => Pace::Period((1e9 / rate_hz) as u64),
        Some(PaceSpec::Sensor(name)) => {
            Pace::Sensor(sensors.keys().position(|known| known == name).unwrap_or_default())
        }
        None => Pace::Sensor(0),
    };
    if problems.is_empty() {
        Ok(Box::new(Mixed::new(inputs, pace, names, devices.clone())))
    } else {
        Err(problems)
    }
}

/// All errors in the sensors of an actuator and their pace.
fn problems(sensors: &Sensors, pace: Option<&PaceSpec>, inputs: &InputNames) -> Vec<String> {
    let mut list = Vec::new();
    let mut problems = Problems::new(&mut list, "");
    let names = sensors.keys().cloned().collect::<Vec<_>>().join(", ");
    let expected = format!("a rate in Hz or one of {names}");
    match pace {
        Some(PaceSpec::RateHz(rate_hz)) => {
            problems.rate_hz("pace", *rate_hz);
        }
        Some(PaceSpec::Sensor(name)) => {
            problems.expect(sensors.contains_key(name), "pace", &expected, format_args!("`{name}`"));
        }
        None => problems.expect(sensors.len() == 1, "pace", &expected, "nothing"),
    }
    let mut from: BTreeMap<usize, &str> = BTreeMap::new();
    for (name, sensor) in sensors {
        let mut problems = problems.part(format_args!("sensors.{name}"));
        sensor.problems(inputs, &mut problems);
        for (value, _) in sensor.values() {
            if let Some(other) = inputs.slot(value).and_then(|slot| from.insert(slot, name)) {
                let found = format!("it in `{other}` too");
                problems.expect(false, &format!("values.{value}"), "one sensor for each value", found);
            }
        }
    }
    let is_there = from.contains_key(&PRESSURE) || !inputs.has_no_input();
    problems.expect(is_there, "sensors", "a sensor with pressure_mpa", "none; the twin needs it");
    for name in inputs.iter().filter(|name| inputs.slot(name).is_none_or(|slot| !from.contains_key(&slot))) {
        let expected = format!("a sensor with {name}, which [actuator.inputs] calls measured");
        problems.expect(false, "sensors", &expected, "none");
    }
    list
}
