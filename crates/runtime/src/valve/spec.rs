//! `[actuator.valve]` and `[actuator.valves.CAVITY]` of a scene: the device behind a setpoint, its limits, and what closes it.

use crate::source::{FilterSpec, ModbusPath, Quantity, RegisterAt, SerialSpec, ValueSpec};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A pressure source that the bridge drives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValveSpec {
    /// Written whenever nothing else is allowed, MPa.
    #[serde(default)]
    pub safe_mpa: f64,
    /// Lowest and highest value that is ever written, MPa.
    pub range_mpa: [f64; 2],
    /// Greatest change of the written value, MPa/s. The way to the safe value has no such limit.
    #[serde(default = "no_limit")]
    pub rate_mpa_per_s: f64,
    /// Least writes per second; each renews the device's time-out, also while the value stays. Setpoints are written when they come, at most
    /// twice as often.
    #[serde(default = "usual_rate")]
    pub write_hz: f64,
    /// Upper limit of a setpoint's validity, ms.
    #[serde(default = "usual_validity")]
    pub valid_max_ms: f64,
    /// The reading behind the twin's state may be so old, ms.
    #[serde(default = "usual_age")]
    pub state_max_age_ms: f64,
    /// Closes outside the sampled states.
    #[serde(default = "yes")]
    pub stop_outside_domain: bool,
    /// Closes when the measured or the predicted force is beyond it, N.
    #[serde(default = "no_limit")]
    pub force_max_n: f64,
    /// Closes when the state has no measured force.
    #[serde(default)]
    pub needs_force: bool,
    /// Closes when the measured force, a marker or an observable contradicts the predicted one, or the estimate has an alarm.
    #[serde(default)]
    pub stop_on_mismatch: bool,
    /// A Modbus device.
    pub modbus: Option<ModbusValve>,
    /// A device that takes lines of text.
    pub lines: Option<LinesValve>,
    /// A digital-to-analogue converter of Linux IIO.
    pub iio: Option<IioValve>,
}

/// A holding register.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModbusValve {
    /// Modbus TCP: `host:port`.
    pub tcp: Option<String>,
    /// Modbus RTU.
    pub serial: Option<SerialSpec>,
    /// Holding register of the value; value = raw x scale + offset, in `unit`. Without points, filter and sigma.
    pub value: ValueSpec<RegisterAt>,
    /// The device's own time-out: what is written there once a connection, raw.
    pub watchdog: Option<WatchdogSpec>,
    /// Longest wait for the answer to one write, ms.
    #[serde(default = "usual_timeout")]
    pub timeout_ms: f64,
}

/// The register that sets after which silence the device closes by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WatchdogSpec {
    /// Address of the holding register, in the unit of the value.
    pub register: u16,
    /// Value to be written, in the device's unit (usually ms).
    pub raw: u16,
}

/// Lines of text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinesValve {
    /// TCP: `host:port`.
    pub tcp: Option<String>,
    /// A serial line.
    pub serial: Option<SerialSpec>,
    /// The line with its ending; `{value}` is the pressure.
    pub format: String,
    /// Digits after the point.
    #[serde(default = "three")]
    pub decimals: usize,
    /// Unit of the value: Pa, kPa, MPa, mbar, bar or psi; default MPa.
    pub unit: Option<String>,
    /// The line that confirms begins with this; without it every write counts as confirmed that the system takes.
    pub reply: Option<String>,
    /// Longest wait for one line, ms.
    #[serde(default = "usual_timeout")]
    pub timeout_ms: f64,
}

/// `out_voltage<channel>_raw` of a device.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IioValve {
    /// Folder of the devices.
    #[serde(default = "iio_root")]
    pub root: PathBuf,
    /// The device's folder, such as `iio:device0`.
    pub device: String,
    /// Number of the output.
    #[serde(default)]
    pub channel: u32,
    /// MPa for one step of the converter.
    pub scale: f64,
    /// MPa at 0.
    #[serde(default)]
    pub offset: f64,
    /// Highest number that the converter takes.
    pub raw_max: u32,
}

fn no_limit() -> f64 {
    f64::INFINITY
}
fn usual_rate() -> f64 {
    200.0
}
fn usual_validity() -> f64 {
    500.0
}
fn usual_age() -> f64 {
    50.0
}
fn usual_timeout() -> f64 {
    30.0
}
fn yes() -> bool {
    true
}
fn three() -> usize {
    3
}
fn iio_root() -> PathBuf {
    "/sys/bus/iio/devices".into()
}

impl ValveSpec {
    /// Key of the valve of a cavity in its actuator's part of the scene; `None`: that of `pressure_mpa`.
    pub fn key(cavity: Option<&str>) -> String {
        cavity.map_or("valve".to_owned(), |cavity| format!("valves.{cavity}"))
    }

    /// All errors in it; `key` is its place in the file.
    pub fn problems(&self, key: &str, problems: &mut Vec<String>) {
        let [low, high] = self.range_mpa;
        if !(low.is_finite() && high.is_finite() && low < high) {
            problems
                .push(format!("{key}.range_mpa: expected lowest < highest in MPa, found {low} .. {high}"));
        }
        if !(low..=high).contains(&self.safe_mpa) {
            problems.push(format!("{key}.safe_mpa: expected a value of range_mpa, found {}", self.safe_mpa));
        }
        for (name, value, min, max) in [
            ("write_hz", self.write_hz, 1.0, 2000.0),
            ("valid_max_ms", self.valid_max_ms, 1.0, 60_000.0),
            ("state_max_age_ms", self.state_max_age_ms, 1.0, 60_000.0),
        ] {
            in_range(&format!("{key}.{name}"), value, min, max, problems);
        }
        for (name, value) in [("rate_mpa_per_s", self.rate_mpa_per_s), ("force_max_n", self.force_max_n)] {
            if value.is_nan() || value <= 0.0 {
                problems.push(format!("{key}.{name}: expected more than 0, found {value}"));
            }
        }
        let devices = [self.modbus.is_some(), self.lines.is_some(), self.iio.is_some()];
        if devices.iter().filter(|is_there| **is_there).count() != 1 {
            problems.push(format!("{key}: expected exactly one of modbus, lines and iio"));
        }
        if let Some(modbus) = &self.modbus {
            modbus.problems(&format!("{key}.modbus"), self.range_mpa, problems);
        }
        if let Some(lines) = &self.lines {
            lines.problems(&format!("{key}.lines"), problems);
        }
        if let Some(iio) = &self.iio {
            iio.problems(&format!("{key}.iio"), self.range_mpa, problems);
        }
    }

    /// Whether the bridge sets the device's own time-out, which closes the valve while the bridge is stopped.
    pub fn has_watchdog(&self) -> bool {
        self.modbus.as_ref().is_some_and(|modbus| modbus.watchdog.is_some())
    }

    /// The device in words, for logs.
    pub fn describe(&self) -> String {
        let at = |tcp: &Option<String>, serial: &Option<SerialSpec>| {
            let port = serial.as_ref().map(|serial| serial.port.display().to_string());
            tcp.clone().or(port).unwrap_or_default()
        };
        match (&self.modbus, &self.lines, &self.iio) {
            (Some(modbus), _, _) => format!("Modbus at {}", at(&modbus.tcp, &modbus.serial)),
            (_, Some(lines), _) => format!("lines of text to {}", at(&lines.tcp, &lines.serial)),
            (_, _, Some(iio)) => format!("{}", iio.path().display()),
            (None, None, None) => "nothing".into(),
        }
    }
}

fn in_range(key: &str, value: f64, min: f64, max: f64, problems: &mut Vec<String>) {
    if !(min..=max).contains(&value) {
        problems.push(format!("{key}: expected {min} to {max}, found {value}"));
    }
}

impl ModbusValve {
    fn problems(&self, key: &str, range_mpa: [f64; 2], problems: &mut Vec<String>) {
        ModbusPath::problems(self.tcp.as_deref(), self.serial.as_ref(), key, problems);
        in_range(&format!("{key}.timeout_ms"), self.timeout_ms, 0.1, 60_000.0, problems);
        let before = problems.len();
        self.value.from.problems(self.serial.is_some(), &format!("{key}.value.from"), problems);
        self.value.problems(&format!("{key}.value"), problems);
        Quantity::Pressure.check_unit(&format!("{key}.value.unit"), self.value.unit.as_deref(), problems);
        let ValueSpec { points, filter, sigma, .. } = &self.value;
        if !points.is_empty() || *filter != FilterSpec::Off || sigma.is_some() {
            problems.push(format!(
                "{key}.value: expected scale, offset and unit only, found points, filter or sigma"
            ));
        }
        if problems.len() == before {
            for end in range_mpa.into_iter().filter(|end| self.registers(*end).is_none()) {
                problems.push(format!(
                    "{key}.value: {end} MPa of range_mpa does not fit into a register of this encoding, scale and offset"
                ));
            }
        }
    }
}

impl ModbusValve {
    /// The registers of a pressure; `None` if it does not fit.
    pub fn registers(&self, pressure_mpa: f64) -> Option<Vec<u16>> {
        let ValueSpec { from, scale, offset, unit, .. } = &self.value;
        let factor = Quantity::Pressure.factor(unit.as_deref())?;
        from.encode((pressure_mpa / factor - offset) / scale)
    }
}

impl LinesValve {
    fn problems(&self, key: &str, problems: &mut Vec<String>) {
        ModbusPath::problems(self.tcp.as_deref(), self.serial.as_ref(), key, problems);
        in_range(&format!("{key}.timeout_ms"), self.timeout_ms, 0.1, 60_000.0, problems);
        if !(self.format.contains("{value}") && self.format.ends_with(['\n', '\r'])) {
            problems.push(format!(
                "{key}.format: expected a line with {{value}} and its ending, such as \"SP {{value}}\\r\\n\", found {:?}",
                self.format
            ));
        }
        if self.decimals > 9 {
            problems.push(format!("{key}.decimals: expected 0 to 9, found {}", self.decimals));
        }
        Quantity::Pressure.check_unit(&format!("{key}.unit"), self.unit.as_deref(), problems);
    }

    /// The line for a pressure in MPa.
    pub fn line(&self, pressure_mpa: f64) -> String {
        let factor = Quantity::Pressure.factor(self.unit.as_deref()).unwrap_or(f64::NAN);
        self.format.replace("{value}", &format!("{:.*}", self.decimals, pressure_mpa / factor))
    }
}

impl IioValve {
    fn problems(&self, key: &str, range_mpa: [f64; 2], problems: &mut Vec<String>) {
        if self.device.is_empty() || self.device.contains('/') {
            problems
                .push(format!("{key}.device: expected a name such as iio:device0, found `{}`", self.device));
        }
        if !(self.scale.is_finite() && self.scale != 0.0 && self.offset.is_finite()) {
            problems.push(format!(
                "{key}.scale, {key}.offset: expected finite numbers, a scale other than 0, found {} and {}",
                self.scale, self.offset
            ));
            return;
        }
        for end in range_mpa.into_iter().filter(|end| self.raw(*end).is_none()) {
            problems.push(format!(
                "{key}: {end} MPa of range_mpa is {} steps; the converter takes 0 to {}",
                ((end - self.offset) / self.scale).round(),
                self.raw_max
            ));
        }
    }

    /// Converter value for a pressure in MPa; `None` if it cannot be represented.
    pub fn raw(&self, pressure_mpa: f64) -> Option<u32> {
        let raw = ((pressure_mpa - self.offset) / self.scale).round();
        (0.0..=f64::from(self.raw_max)).contains(&raw).then_some(raw as u32)
    }

    /// The file that takes the number.
    pub fn path(&self) -> PathBuf {
        self.root.join(&self.device).join(format!("out_voltage{}_raw", self.channel))
    }
}
