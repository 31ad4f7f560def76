//! Modbus RTU and TCP. One thread has a path (an address, a serial port) and asks every sensor behind it in turn, and writes
//! what others want written, one request at a time.
//!
//! After anything but a clean answer the connection is thrown away: on a serial line a late answer carries no number that
//! would tell it from the answer to the next request. There the line is listened to until it has been silent for as long as
//! the device had for its answer. A device that does not answer is asked less and less often, so that others on the path go on.

use super::sensor::{Backoff, Feed, STOP_CHECK};
use super::serial::ModbusPath;
use crate::problems::Problems;
use serde::{Deserialize, Serialize};
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;
use tokio::io::AsyncReadExt;
use tokio::runtime::Runtime;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, WeakUnboundedSender, unbounded_channel};
use tokio::time::{Instant, sleep_until, timeout};
use tokio_modbus::client::{Client, Context, rtu, tcp};
use tokio_modbus::slave::SlaveContext;
use tokio_modbus::{Error, ExceptionCode, Request, Response, Slave};
use wire::now_ns;

/// Least time for an attempt to connect.
const CONNECT: Duration = Duration::from_secs(1);
/// A line that never becomes silent is used again after this multiple of the required silence.
const DRAIN_TIMES: u32 = 10;

/// The system's errors that a connection can end with.
const OF_CONNECTIONS: [i32; 7] = [
    libc::ECONNRESET,
    libc::ECONNABORTED,
    libc::EPIPE,
    libc::ETIMEDOUT,
    libc::EHOSTUNREACH,
    libc::ENETUNREACH,
    libc::EIO,
];

/// Register of a number in a device, and its encoding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegisterAt {
    /// Unit identifier ("slave address") of the device: 1-247 on a serial line, 0-255 on TCP, where many devices ignore it.
    #[serde(default = "first_unit")]
    pub unit_id: u8,
    /// Address of the first register, from 0.
    pub register: u16,
    /// Which table it stands in.
    #[serde(default)]
    pub table: Table,
    /// How the number is written.
    #[serde(default)]
    pub encoding: Encoding,
    /// Order of the bytes of a number.
    #[serde(default)]
    pub byte_order: ByteOrder,
}

fn first_unit() -> u8 {
    1
}

/// Modbus tables that hold numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Table {
    /// Input registers, function 4.
    #[default]
    Input,
    /// Holding registers, function 3.
    Holding,
}

/// How a number is written into registers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Encoding {
    /// One register, unsigned.
    U16,
    /// One register, two's complement.
    #[default]
    I16,
    /// Two registers, unsigned.
    U32,
    /// Two registers, two's complement.
    I32,
    /// Two registers, IEEE 754.
    F32,
    /// Four registers, IEEE 754.
    F64,
}

/// Order of the bytes of a number, as manuals name it by the bytes of a 32-bit one from high (a) to low (d).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ByteOrder {
    /// High register first, high byte first, as Modbus itself.
    #[default]
    Abcd,
    /// High register first, low byte first.
    Badc,
    /// Low register first, high byte first.
    Cdab,
    /// Low register first, low byte first.
    Dcba,
}

impl RegisterAt {
    /// How many registers to ask for.
    pub fn count(&self) -> u16 {
        match self.encoding {
            Encoding::U16 | Encoding::I16 => 1,
            Encoding::U32 | Encoding::I32 | Encoding::F32 => 2,
            Encoding::F64 => 4,
        }
    }

    /// The number; `None` when the device sent another number of registers than was asked for.
    pub fn raw(&self, registers: &[u16]) -> Option<f64> {
        if registers.len() != usize::from(self.count()) {
            return None;
        }
        let join = |bits: u64, word: u16| bits << 16 | u64::from(self.swapped(word));
        let bits = if self.is_low_first() {
            registers.iter().rev().copied().fold(0, join)
        } else {
            registers.iter().copied().fold(0, join)
        };
        Some(match self.encoding {
            Encoding::U16 | Encoding::U32 => bits as f64,
            Encoding::I16 => f64::from(bits as i16),
            Encoding::I32 => f64::from(bits as i32),
            Encoding::F32 => f64::from(f32::from_bits(bits as u32)),
            Encoding::F64 => f64::from_bits(bits),
        })
    }

    fn is_low_first(&self) -> bool {
        matches!(self.byte_order, ByteOrder::Cdab | ByteOrder::Dcba)
    }

    fn swapped(&self, word: u16) -> u16 {
        if matches!(self.byte_order, ByteOrder::Badc | ByteOrder::Dcba) { word.swap_bytes() } else { word }
    }

    /// All errors in it; `key` is its place in the file.
    pub fn problems(&self, is_serial: bool, problems: &mut Problems) {
        let fits = !is_serial || (1..=247).contains(&self.unit_id);
        problems.expect(fits, "unit_id", "1-247 on a serial line", self.unit_id);
        let fits = self.register.checked_add(self.count() - 1).is_some();
        let expected = format!("room for {} registers", self.count());
        problems.expect(fits, "register", &expected, self.register);
    }

    /// The registers for a number; `None` when it does not fit. Integers are rounded to the nearest.
    pub fn encode(&self, raw: f64) -> Option<Vec<u16>> {
        let whole = |min: f64, max: f64| {
            let rounded = raw.round();
            (min..=max).contains(&rounded).then_some(rounded as i64)
        };
        let bits = match self.encoding {
            Encoding::U16 => whole(0.0, f64::from(u16::MAX))?.cast_unsigned(),
            Encoding::I16 => whole(f64::from(i16::MIN), f64::from(i16::MAX))?.cast_unsigned(),
            Encoding::U32 => whole(0.0, f64::from(u32::MAX))?.cast_unsigned(),
            Encoding::I32 => whole(f64::from(i32::MIN), f64::from(i32::MAX))?.cast_unsigned(),
            Encoding::F32 => Some(raw as f32).filter(|raw| raw.is_finite())?.to_bits().into(),
            Encoding::F64 => Some(raw).filter(|raw| raw.is_finite())?.to_bits(),
        };
        let mut words: Vec<u16> =
            (0..self.count()).rev().map(|k| self.swapped((bits >> (16 * k)) as u16)).collect();
        if self.is_low_first() {
            words.reverse();
        }
        Some(words)
    }
}

/// A sensor on a path: what it is asked, and when.
#[derive(Debug)]
pub(super) struct Polled {
    feed: Feed,
    registers: Vec<RegisterAt>,
    period: Duration,
    /// For all answers of one poll.
    timeout: Duration,
    due: Instant,
    backoff: Backoff,
}

impl Polled {
    /// `registers` in the order of the feed's values.
    pub(super) fn new(
        feed: Feed,
        registers: Vec<RegisterAt>,
        rate_hz: f64,
        timeout_ms: f64,
        backoff_max_ms: f64,
    ) -> Self {
        Self {
            feed,
            registers,
            period: Duration::from_secs_f64(1.0 / rate_hz),
            timeout: Duration::from_secs_f64(timeout_ms * 1e-3),
            due: Instant::now(),
            backoff: Backoff::new(Duration::from_secs_f64(backoff_max_ms * 1e-3)),
        }
    }
}

/// Registers to be written.
#[derive(Debug)]
pub(super) struct Write {
    unit_id: u8,
    register: u16,
    words: Vec<u16>,
    timeout: Duration,
    /// Not sent later: its caller has given up.
    begin_by: Instant,
    done: SyncSender<Result<u64, String>>,
}

/// Job for a running thread.
#[derive(Debug)]
pub(super) enum Job {
    /// Registers to be written.
    Write(Write),
    /// One more sensor.
    Add(Polled),
}

/// The way to write to the devices of a path that sensors may be read on, too. Clones share the connection.
#[derive(Debug, Clone)]
pub struct ModbusConnection {
    jobs: UnboundedSender<Job>,
}

impl ModbusConnection {
    pub(super) fn new(jobs: UnboundedSender<Job>) -> Self {
        Self { jobs }
    }

    /// Writes holding registers and waits for the device's confirmation: one register by function 6, several by function
    /// 16. It goes before all questions; for the one on its way it waits for `timeout` at most, and then as long for its own
    /// answer. Gives the number of the connection, from 1: a new one may be that of a device that was off meanwhile.
    ///
    /// # Errors
    /// Message for the log: no connection, no answer in time, an exception, another answer. A request that could not be sent in
    /// time is never sent.
    pub fn write(&self, unit_id: u8, register: u16, words: &[u16], timeout: Duration) -> Result<u64, String> {
        let (done, result) = sync_channel(1);
        let begin_by = Instant::now() + timeout;
        let write = Write { unit_id, register, words: words.to_vec(), timeout, begin_by, done };
        self.jobs.send(Job::Write(write)).map_err(|_| "the connection's thread has ended".to_owned())?;
        match result.recv_timeout(2 * timeout) {
            Ok(result) => result,
            Err(RecvTimeoutError::Timeout) => Err(NoAnswer::Silence(2 * timeout).text()),
            Err(RecvTimeoutError::Disconnected) => Err("the connection's thread has ended".to_owned()),
        }
    }
}

/// The work of a path's thread.
#[derive(Debug)]
pub(super) struct ModbusThread {
    pub(super) path: ModbusPath,
    sensors: Vec<Polled>,
    jobs: UnboundedReceiver<Job>,
    /// Given away on demand; the thread itself must not keep its own queue open.
    sender: Option<UnboundedSender<Job>>,
    is_reachable: bool,
    /// Connections made so far.
    connections: u64,
}

/// Why a request gave no answer.
#[derive(Debug)]
enum NoAnswer {
    Silence(Duration),
    Exception(ExceptionCode),
    Garbage(String),
    Broken(String),
}

impl NoAnswer {
    fn text(&self) -> String {
        match self {
            Self::Silence(limit) => format!("no answer within {} ms", limit.as_secs_f64() * 1e3),
            Self::Exception(code) => format!("exception {} ({code})", u8::from(*code)),
            Self::Garbage(cause) => format!("not understood: {cause}"),
            Self::Broken(cause) => format!("connection lost: {cause}"),
        }
    }
}

/// Why a connection is given up, with the silence to wait for before the next question on a serial line.
enum GivenUp {
    /// A device's answer was not clean.
    Unclean(Duration),
    Broken,
    /// The requester has stopped waiting.
    Unwanted,
}

impl ModbusThread {
    pub(super) fn new(path: ModbusPath) -> Self {
        let (sender, jobs) = unbounded_channel();
        Self { path, sensors: Vec::new(), jobs, sender: Some(sender), is_reachable: false, connections: 0 }
    }

    pub(super) fn add(&mut self, sensor: Polled) {
        self.sensors.push(sensor);
    }

    /// Weak sender of write requests.
    pub(super) fn reach(&self) -> Option<WeakUnboundedSender<Job>> {
        self.sender.as_ref().map(UnboundedSender::downgrade)
    }

    /// Sender of write requests; the thread runs while a sender exists.
    pub(super) fn jobs(&mut self) -> Option<UnboundedSender<Job>> {
        self.is_reachable = true;
        self.sender.clone()
    }

    /// Runs until all sensors are stopped and all writers gone.
    pub(super) fn run(mut self, runtime: &Runtime) {
        self.sender = None;
        runtime.block_on(self.serve());
    }

    fn is_wanted(&mut self) -> bool {
        self.sensors.retain(|sensor| !sensor.feed.is_stopped());
        !self.sensors.is_empty() || self.is_reachable
    }

    async fn serve(&mut self) {
        let longest = self.sensors.iter().map(|sensor| sensor.backoff.max()).max();
        let mut pauses = Backoff::new(longest.unwrap_or(CONNECT));
        let mut silence = Duration::ZERO;
        while self.is_wanted() {
            let cause = match self.connect(silence).await {
                Ok(mut context) => {
                    self.connections += 1;
                    match self.use_connection(&mut context, &mut pauses).await {
                        GivenUp::Unwanted => return,
                        GivenUp::Unclean(wanted) => {
                            silence = wanted;
                            continue;
                        }
                        GivenUp::Broken => "the connection was lost".to_owned(),
                    }
                }
                Err(cause) => {
                    for sensor in &mut self.sensors {
                        sensor.feed.failed(|c| &c.refusals, &format!("cannot connect: {cause}"));
                    }
                    format!("cannot connect: {cause}")
                }
            };
            self.pause(pauses.take(), &cause).await;
        }
    }

    /// Waits; what is to be written meanwhile is refused with the cause.
    async fn pause(&mut self, pause: Duration, cause: &str) {
        let end = Instant::now() + pause;
        while self.is_wanted() && Instant::now() < end {
            let until = end.min(Instant::now() + STOP_CHECK);
            match next_job(&mut self.jobs, &mut self.is_reachable, until).await {
                Some(Job::Write(write)) => drop(write.done.try_send(Err(cause.to_owned()))),
                Some(Job::Add(sensor)) => self.sensors.push(sensor),
                None => {}
            }
        }
    }

    async fn connect(&self, silence: Duration) -> Result<Context, String> {
        match &self.path {
            ModbusPath::Serial(serial) => {
                let mut port = serial.open().map_err(|error| error.to_string())?;
                let end = Instant::now() + silence * DRAIN_TIMES;
                let mut late = [0; 256];
                while !silence.is_zero()
                    && Instant::now() < end
                    && timeout(silence, port.read(&mut late))
                        .await
                        .is_ok_and(|read| read.is_ok_and(|n| n > 0))
                {}
                Ok(rtu::attach(port))
            }
            ModbusPath::Tcp(address) => {
                let open = async {
                    let stream = tokio::net::TcpStream::connect(address).await?;
                    // Requests are a dozen bytes: waiting to fill a packet would cost 40 ms each.
                    stream.set_nodelay(true)?;
                    Ok::<_, std::io::Error>(tcp::attach(stream))
                };
                match timeout(CONNECT, open).await {
                    Ok(result) => result.map_err(|error| error.to_string()),
                    Err(_) => Err("no answer to the attempt to connect".into()),
                }
            }
        }
    }

    /// Writes first, then the sensor that has waited longest.
    async fn use_connection(&mut self, context: &mut Context, pauses: &mut Backoff) -> GivenUp {
        loop {
            if !self.is_wanted() {
                return GivenUp::Unwanted;
            }
            let due = self.sensors.iter().map(|sensor| sensor.due).min();
            let look = Instant::now() + STOP_CHECK;
            let until = due.map_or(look, |due| due.min(look));
            match next_job(&mut self.jobs, &mut self.is_reachable, until).await {
                Some(Job::Write(write)) => {
                    if let Some(given_up) = confirm(context, write, self.connections).await {
                        return given_up;
                    }
                    pauses.reset();
                    continue;
                }
                Some(Job::Add(sensor)) => self.sensors.push(sensor),
                None => {}
            }
            let next = self.sensors.iter_mut().min_by_key(|sensor| sensor.due);
            let Some(sensor) = next.filter(|sensor| sensor.due <= Instant::now()) else { continue };
            match sensor.poll(context).await {
                None => pauses.reset(),
                Some(given_up) => return given_up,
            }
        }
    }
}

/// Next job before `until`.
async fn next_job(jobs: &mut UnboundedReceiver<Job>, is_reachable: &mut bool, until: Instant) -> Option<Job> {
    if !*is_reachable {
        sleep_until(until).await;
        return None;
    }
    tokio::select! {
        biased;
        job = jobs.recv() => {
            *is_reachable = job.is_some();
            job
        }
        () = sleep_until(until) => None,
    }
}

impl Polled {
    /// Asks for all values once. `None`: the connection is good.
    async fn poll(&mut self, context: &mut Context) -> Option<GivenUp> {
        // A slow device is asked as fast as it answers; missed polls are not made up for.
        self.due = (self.due + self.period).max(Instant::now());
        let answer = match timeout(self.timeout, read_all(&self.registers, context)).await {
            Ok(answer) => answer,
            Err(_) => Err(NoAnswer::Silence(self.timeout)),
        };
        let error = match answer {
            Ok((t_ns, raw)) => {
                self.feed.send(t_ns, raw.into_iter().enumerate());
                self.backoff.reset();
                return None;
            }
            Err(error) => error,
        };
        match &error {
            // The device answers that it cannot: the twin gets the fault code, and the connection is kept.
            NoAnswer::Exception(code) => {
                self.feed.failed(|c| &c.exceptions, &error.text());
                self.feed.fault(u8::from(*code).into());
                self.backoff.reset();
                return None;
            }
            NoAnswer::Silence(_) => self.feed.failed(|c| &c.timeouts, &error.text()),
            NoAnswer::Garbage(_) => self.feed.failed(|c| &c.garbage, &error.text()),
            NoAnswer::Broken(_) => {
                self.feed.failed(|c| &c.disconnects, &error.text());
                return Some(GivenUp::Broken);
            }
        }
        self.due = Instant::now() + self.backoff.take();
        Some(GivenUp::Unclean(self.timeout))
    }
}

/// All values of a sensor as the device has them, with the time of the last answer.
async fn read_all(registers: &[RegisterAt], context: &mut Context) -> Result<(u64, Vec<f64>), NoAnswer> {
    let mut raw = Vec::with_capacity(registers.len());
    for register in registers {
        raw.push(read(context, register).await?);
    }
    Ok((now_ns(), raw))
}

async fn read(context: &mut Context, at: &RegisterAt) -> Result<f64, NoAnswer> {
    // The library's typed readers assert that the device sent as many registers as were asked for; a device may not.
    let request = match at.table {
        Table::Input => Request::ReadInputRegisters(at.register, at.count()),
        Table::Holding => Request::ReadHoldingRegisters(at.register, at.count()),
    };
    match call(context, at.unit_id, request).await? {
        Response::ReadInputRegisters(registers) | Response::ReadHoldingRegisters(registers) => {
            at.raw(&registers).ok_or_else(|| {
                NoAnswer::Garbage(format!("{} registers, {} asked for", registers.len(), at.count()))
            })
        }
        other => Err(NoAnswer::Garbage(format!("registers asked for, {other:?} sent"))),
    }
}

/// Carries out a write and tells its caller. `None`: the connection is good.
async fn confirm(context: &mut Context, write: Write, connection: u64) -> Option<GivenUp> {
    let Write { unit_id, register, words, timeout: limit, begin_by, done } = write;
    if Instant::now() > begin_by {
        let _caller_gone = done.try_send(Err("not sent: the connection was busy".to_owned()));
        return None;
    }
    let (request, expected) = match words.as_slice() {
        [word] => {
            (Request::WriteSingleRegister(register, *word), Response::WriteSingleRegister(register, *word))
        }
        _ => {
            let count = words.len() as u16;
            let request = Request::WriteMultipleRegisters(register, words.into());
            (request, Response::WriteMultipleRegisters(register, count))
        }
    };
    let result = match timeout(limit, call(context, unit_id, request)).await {
        Ok(Ok(answer)) if answer == expected => Ok(connection),
        Ok(Ok(answer)) => {
            Err(NoAnswer::Garbage(format!("expected {expected:?}, the device sent {answer:?}")))
        }
        Ok(Err(error)) => Err(error),
        Err(_) => Err(NoAnswer::Silence(limit)),
    };
    let given_up = match &result {
        Ok(_) | Err(NoAnswer::Exception(_)) => None,
        Err(NoAnswer::Broken(_)) => Some(GivenUp::Broken),
        Err(_) => Some(GivenUp::Unclean(limit)),
    };
    let _caller_gone = done.try_send(result.map_err(|error| error.text()));
    given_up
}

async fn call(context: &mut Context, unit_id: u8, request: Request<'_>) -> Result<Response, NoAnswer> {
    context.set_slave(Slave(unit_id));
    match context.call(request).await {
        Ok(Ok(response)) => Ok(response),
        Ok(Err(code)) => Err(NoAnswer::Exception(code)),
        Err(Error::Protocol(error)) => Err(NoAnswer::Garbage(error.to_string())),
        // A frame with a wrong checksum ends as "invalid data".
        Err(Error::Transport(error)) if error.kind() == std::io::ErrorKind::InvalidData => {
            Err(NoAnswer::Garbage(error.to_string()))
        }
        // At the end of the stream the library gives the system's last error, whatever it was about.
        Err(Error::Transport(error))
            if error.raw_os_error().is_some_and(|code| !OF_CONNECTIONS.contains(&code)) =>
        {
            Err(NoAnswer::Broken("the device closed it".into()))
        }
        Err(Error::Transport(error)) => Err(NoAnswer::Broken(error.to_string())),
    }
}

#[cfg(test)]
#[path = "../../tests/unit/source_modbus.rs"]
mod tests;
