//! Modbus RTU and TCP: gauge, gap sensor and load cell polled at a fixed rate.
//!
//! After anything but a clean answer the connection is thrown away: on a serial line a late answer carries no number that
//! would tell it from the answer to the next request.

use super::device::{Backoff, Device, Feed, Sensor};
use super::filter::{Filter, FilterSpec};
use super::register::{Quantity, RegisterSpec, Table};
use super::serial::SerialSpec;
use crate::source::reading::{Reading, Source};
use serde::{Deserialize, Serialize};
use std::time::Duration;
use tokio::runtime::Runtime;
use tokio::time::{MissedTickBehavior, interval, timeout};
use tokio_modbus::client::{Client, Context, rtu, tcp};
use tokio_modbus::slave::SlaveContext;
use tokio_modbus::{Error, ExceptionCode, Request, Response, Slave};

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
        if self.tcp.is_some() == self.serial.is_some() {
            problems.push("source.tcp, source.serial: expected exactly one of them".into());
        }
        if let Some(address) = &self.tcp
            && !address
                .rsplit_once(':')
                .is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok())
        {
            problems.push(format!("source.tcp: expected `host:port`, found `{address}`"));
        }
        if let Some(serial) = &self.serial {
            serial.problems("source.serial", &mut problems);
        }
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
    pub(crate) fn open(&self) -> Result<Box<dyn Source>, Vec<String>> {
        Sensor::open(self.clone(), self.problems())
    }

    fn timeout(&self) -> Duration {
        Duration::from_secs_f64(self.timeout_ms * 1e-3)
    }
}

impl Device for ModbusSpec {
    fn place(&self) -> String {
        match (&self.tcp, &self.serial) {
            (Some(address), _) => address.clone(),
            (None, Some(serial)) => serial.port.display().to_string(),
            (None, None) => "nowhere".into(),
        }
    }

    fn run(&self, feed: Feed, runtime: &Runtime) {
        runtime.block_on(run(self, feed));
    }
}

/// Why a poll gave no reading.
enum NoReading {
    Exception(ExceptionCode),
    Garbage(String),
    Broken(String),
}

/// Polls until the stop flag is set.
async fn run(spec: &ModbusSpec, mut feed: Feed) {
    let mut backoff = Backoff::new(Duration::from_secs_f64(spec.backoff_max_ms * 1e-3));
    let mut filter = Filter::new(spec.filter);
    while !feed.is_stopped() {
        match connect(spec).await {
            Ok(mut context) => poll(spec, &mut context, &mut feed, &mut backoff, &mut filter).await,
            Err(cause) => feed.failed(|c| &c.refusals, &format!("cannot connect: {cause}")),
        }
        backoff.wait(&feed).await;
    }
}

async fn connect(spec: &ModbusSpec) -> Result<Context, String> {
    let first = Slave(spec.pressure.unit_id);
    if let Some(serial) = &spec.serial {
        return serial.open().map(|port| rtu::attach_slave(port, first)).map_err(|error| error.to_string());
    }
    let address = spec.tcp.as_deref().unwrap_or_default();
    let open = async {
        let stream = tokio::net::TcpStream::connect(address).await?;
        // Requests are a dozen bytes: waiting to fill a packet would cost 40 ms each.
        stream.set_nodelay(true)?;
        Ok::<_, std::io::Error>(tcp::attach_slave(stream, first))
    };
    match timeout(spec.timeout().max(Duration::from_secs(1)), open).await {
        Ok(result) => result.map_err(|error| error.to_string()),
        Err(_) => Err("no answer to the attempt to connect".into()),
    }
}

/// Polls one connection until it breaks or the stop flag is set.
async fn poll(
    spec: &ModbusSpec,
    context: &mut Context,
    feed: &mut Feed,
    backoff: &mut Backoff,
    filter: &mut Filter,
) {
    let mut ticks = interval(Duration::from_secs_f64(1.0 / spec.poll_hz));
    // A slow device is polled as fast as it answers; missed polls are not made up for.
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        if feed.is_stopped() {
            return;
        }
        let Ok(answer) = timeout(spec.timeout(), read_all(spec, context)).await else {
            return feed.failed(|c| &c.timeouts, &format!("no answer within {} ms", spec.timeout_ms));
        };
        match answer {
            Ok(reading) => {
                let pressure_mpa = filter.apply(reading.t_sensor_ns, reading.pressure_mpa);
                feed.send(Reading { pressure_mpa, ..reading });
                feed.recovered();
                backoff.reset();
            }
            // The device answers that it cannot: the twin gets the fault code, and the connection is kept.
            Err(NoReading::Exception(code)) => {
                let number = u32::from(u8::from(code));
                feed.failed(|c| &c.exceptions, &format!("exception {number} ({code})"));
                feed.send(Reading { status: number.max(1), ..Reading::now() });
                backoff.reset();
            }
            Err(NoReading::Garbage(cause)) => {
                return feed.failed(|c| &c.garbage, &format!("not understood: {cause}"));
            }
            Err(NoReading::Broken(cause)) => {
                return feed.failed(|c| &c.disconnects, &format!("connection lost: {cause}"));
            }
        }
    }
}

/// One reading of all quantities, stamped when the last answer has come.
async fn read_all(spec: &ModbusSpec, context: &mut Context) -> Result<Reading, NoReading> {
    let mut values = [f64::NAN; 3];
    let wanted = [
        (Some(&spec.pressure), Quantity::Pressure),
        (spec.gap.as_ref(), Quantity::Gap),
        (spec.force.as_ref(), Quantity::Force),
    ];
    for (value, (register, quantity)) in values.iter_mut().zip(wanted) {
        let Some(register) = register else { continue };
        *value = read(context, register, quantity).await?;
    }
    let [pressure_mpa, gap_mm, measured_force_n] = values;
    Ok(Reading { pressure_mpa, gap_mm, measured_force_n, ..Reading::now() })
}

async fn read(context: &mut Context, spec: &RegisterSpec, quantity: Quantity) -> Result<f64, NoReading> {
    context.set_slave(Slave(spec.unit_id));
    // The library's typed readers assert that the device sent as many registers as were asked for; a device may not.
    let request = match spec.table {
        Table::Input => Request::ReadInputRegisters(spec.register, spec.count()),
        Table::Holding => Request::ReadHoldingRegisters(spec.register, spec.count()),
    };
    match context.call(request).await {
        Ok(Ok(Response::ReadInputRegisters(registers) | Response::ReadHoldingRegisters(registers))) => {
            spec.decode(quantity, &registers).ok_or_else(|| {
                NoReading::Garbage(format!("{} registers, {} asked for", registers.len(), spec.count()))
            })
        }
        Ok(Ok(other)) => Err(NoReading::Garbage(format!("registers asked for, {other:?} sent"))),
        Ok(Err(code)) => Err(NoReading::Exception(code)),
        Err(Error::Protocol(error)) => Err(NoReading::Garbage(error.to_string())),
        // A frame with a wrong checksum ends as "invalid data".
        Err(Error::Transport(error)) if error.kind() == std::io::ErrorKind::InvalidData => {
            Err(NoReading::Garbage(error.to_string()))
        }
        Err(Error::Transport(error)) => Err(NoReading::Broken(error.to_string())),
    }
}
