//! `[actuator.valve]` and `[actuator.valves.CAVITY]` of a scene: the device behind a setpoint, its limits, and what closes it.

use crate::problems::Problems;
use crate::source::{FilterSpec, ModbusPath, RegisterAt, SensorQuantity, SerialSpec, ValueSpec};
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
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WatchdogSpec {
    /// Address of the holding register, in the unit of the value.
    pub register: u16,
    /// Value to be written.
    pub raw: u16,
    /// Milliseconds of one step of `raw`.
    #[serde(default = "one")]
    pub scale_ms: f64,
}

impl WatchdogSpec {
    fn ms(&self) -> f64 {
        f64::from(self.raw) * self.scale_ms
    }
}

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
fn one() -> f64 {
    1.0
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

/// Periods without a write from which on the device counts as silent, and the least of them in its own time-out.
const SILENT_PERIODS: f64 = 4.0;
const WATCHDOG_PERIODS: f64 = 3.0;

impl ValveSpec {
    /// Key of the valve of a cavity in its actuator's part of the scene; `None`: that of `pressure_mpa`.
    pub fn key(cavity: Option<&str>) -> String {
        cavity.map_or("valve".to_owned(), |cavity| format!("valves.{cavity}"))
    }

    /// All errors in it.
    pub fn problems(&self, problems: &mut Problems) {
        let [low, high] = self.range_mpa;
        let fits = low.is_finite() && high.is_finite() && low < high;
        problems.expect(fits, "range_mpa", "lowest < highest in MPa", format_args!("{low} .. {high}"));
        let fits = (low..=high).contains(&self.safe_mpa);
        problems.expect(fits, "safe_mpa", "a value of range_mpa", self.safe_mpa);
        problems.range("write_hz", self.write_hz, [1.0, 2000.0]);
        problems.range("valid_max_ms", self.valid_max_ms, [1.0, 60_000.0]);
        problems.range("state_max_age_ms", self.state_max_age_ms, [1.0, 60_000.0]);
        problems.expect(self.rate_mpa_per_s > 0.0, "rate_mpa_per_s", "more than 0", self.rate_mpa_per_s);
        problems.expect(self.force_max_n > 0.0, "force_max_n", "more than 0", self.force_max_n);
        let devices = [self.modbus.is_some(), self.lines.is_some(), self.iio.is_some()];
        if devices.iter().filter(|is_there| **is_there).count() != 1 {
            problems.add("expected exactly one of modbus, lines and iio");
        }
        if let Some(modbus) = &self.modbus {
            modbus.problems(self.range_mpa, &mut problems.part("modbus"));
            if let Some(watchdog) = &modbus.watchdog {
                let least_ms = WATCHDOG_PERIODS * 1e3 / self.write_hz;
                let fits = watchdog.scale_ms.is_finite() && watchdog.ms() >= least_ms;
                let expected = format!(
                    "raw x scale_ms of at least {least_ms} ms ({WATCHDOG_PERIODS} periods of write_hz)"
                );
                problems.expect(fits, "modbus.watchdog", &expected, format_args!("{} ms", watchdog.ms()));
            }
        }
        if let Some(lines) = &self.lines {
            lines.problems(&mut problems.part("lines"));
        }
        if let Some(iio) = &self.iio {
            iio.problems(self.range_mpa, &mut problems.part("iio"));
        }
    }

    /// Longest time in ms between two decisions after which the device surely still has the value of the first. While the bridge runs, at most the
    /// wait for an answer and a period lie between them; the device's own time-out must not have ended either.
    pub(super) fn silence_max_ms(&self) -> f64 {
        let period_ms = 1e3 / self.write_hz;
        let answer_ms = match (&self.modbus, &self.lines) {
            (Some(modbus), _) => modbus.timeout_ms,
            (None, Some(lines)) => lines.timeout_ms,
            (None, None) => 0.0,
        };
        let usual_ms = (SILENT_PERIODS * period_ms).max(2.0 * period_ms + answer_ms);
        let watchdog = self.modbus.as_ref().and_then(|modbus| modbus.watchdog);
        watchdog.map_or(usual_ms, |watchdog| usual_ms.min(watchdog.ms() - period_ms))
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

impl ModbusValve {
    fn problems(&self, range_mpa: [f64; 2], problems: &mut Problems) {
        ModbusPath::problems(self.tcp.as_deref(), self.serial.as_ref(), problems);
        problems.range("timeout_ms", self.timeout_ms, [0.1, 60_000.0]);
        let before = problems.count();
        let mut value = problems.part("value");
        self.value.from.problems(self.serial.is_some(), &mut value.part("from"));
        self.value.problems(&mut value);
        SensorQuantity::Pressure.check_unit(self.value.unit.as_deref(), &mut value);
        let ValueSpec { points, filter, sigma, .. } = &self.value;
        if !points.is_empty() || *filter != FilterSpec::Off || sigma.is_some() {
            value.add("expected scale, offset and unit only, found points, filter or sigma");
        }
        if value.count() == before {
            for end in range_mpa.into_iter().filter(|end| self.registers(*end).is_none()) {
                value.add(format_args!(
                    "{end} MPa of range_mpa does not fit into a register of this encoding, scale and offset"
                ));
            }
        }
    }

    /// The registers of a pressure; `None` if it does not fit.
    pub fn registers(&self, pressure_mpa: f64) -> Option<Vec<u16>> {
        let ValueSpec { from, scale, offset, unit, .. } = &self.value;
        let factor = SensorQuantity::Pressure.factor(unit.as_deref())?;
        from.encode((pressure_mpa / factor - offset) / scale)
    }
}

impl LinesValve {
    fn problems(&self, problems: &mut Problems) {
        ModbusPath::problems(self.tcp.as_deref(), self.serial.as_ref(), problems);
        problems.range("timeout_ms", self.timeout_ms, [0.1, 60_000.0]);
        let fits = self.format.contains("{value}") && self.format.ends_with(['\n', '\r']);
        let expected = r#"a line with {value} and its ending, such as "SP {value}\r\n""#;
        problems.expect(fits, "format", expected, format_args!("{:?}", self.format));
        problems.expect(self.decimals <= 9, "decimals", "0 to 9", self.decimals);
        SensorQuantity::Pressure.check_unit(self.unit.as_deref(), problems);
    }

    /// The line for a pressure in MPa.
    pub fn line(&self, pressure_mpa: f64) -> String {
        let factor = SensorQuantity::Pressure.factor(self.unit.as_deref()).unwrap_or(f64::NAN);
        self.format.replace("{value}", &format!("{:.*}", self.decimals, pressure_mpa / factor))
    }
}

impl IioValve {
    fn problems(&self, range_mpa: [f64; 2], problems: &mut Problems) {
        let fits = !self.device.is_empty() && !self.device.contains('/');
        problems.expect(fits, "device", "a name such as iio:device0", format_args!("`{}`", self.device));
        if !(self.scale.is_finite() && self.scale != 0.0 && self.offset.is_finite()) {
            let found = format!("{} and {}", self.scale, self.offset);
            let expected = "finite numbers, a scale other than 0";
            return problems.expect(false, "scale, offset", expected, found);
        }
        for end in range_mpa.into_iter().filter(|end| self.raw(*end).is_none()) {
            let (steps, most) = (((end - self.offset) / self.scale).round(), self.raw_max);
            problems.add(format_args!(
                "{end} MPa of range_mpa is {steps} steps; the converter takes 0 to {most}"
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
