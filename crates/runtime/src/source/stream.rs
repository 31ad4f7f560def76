//! Lines from a serial line, a TCP connection, UDP datagrams, the standard input, or a user's program. Each path has one
//! thread; every sensor of the path gets every line.

use super::lines::{Cells, LineBuffer, LineError, parse_cells};
use super::plugin::{Plugin, PluginSpec};
use super::reading::{MARKERS, SensorCounters, slot};
use super::sensor::{Backoff, Feed, STOP_CHECK};
use super::serial::SerialSpec;
use crate::problems::Problems;
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::sync::atomic::AtomicU64;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt};
use tokio::net::{TcpStream, UdpSocket};
use tokio::runtime::Runtime;
use tokio::time::{Instant, timeout};
use wire::now_ns;

/// Longest pause between attempts to open the path again.
const MAX_BACKOFF: Duration = Duration::from_secs(5);
/// Longest wait for a TCP connection.
const CONNECT: Duration = Duration::from_secs(2);
/// Silence after which a TCP connection is reopened: a pulled cable does not end a connection.
const TCP_SILENCE: Duration = Duration::from_secs(2);
/// Largest datagram.
const DATAGRAM: usize = 65_536;

/// Where lines come from.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum LinesPath {
    Stdin,
    Serial(SerialSpec),
    /// `host:port` to connect to.
    Tcp(String),
    /// `address:port` to listen on.
    Udp(String),
    Plugin(PluginSpec),
}

impl LinesPath {
    /// Names the path among those of a scene.
    pub(super) fn key(&self) -> String {
        match self {
            Self::Stdin => "the standard input".into(),
            Self::Serial(serial) => format!("serial {}", serial.port.display()),
            Self::Tcp(address) => format!("lines tcp {address}"),
            Self::Udp(address) => format!("udp {address}"),
            Self::Plugin(plugin) => format!("command {plugin:?}"),
        }
    }

    /// Text for the log.
    pub(super) fn place(&self) -> String {
        match self {
            Self::Stdin => "standard input".into(),
            Self::Serial(serial) => serial.port.display().to_string(),
            Self::Tcp(address) | Self::Udp(address) => address.clone(),
            Self::Plugin(plugin) => plugin.place(),
        }
    }

    async fn open(&self) -> Result<Input, String> {
        let text = |error: std::io::Error| error.to_string();
        match self {
            Self::Serial(serial) => Ok(Input::Stream(Box::new(serial.open().map_err(text)?))),
            Self::Tcp(address) => match timeout(CONNECT, TcpStream::connect(address)).await {
                Ok(stream) => Ok(Input::Stream(Box::new(stream.map_err(text)?))),
                Err(_) => Err("no answer to the attempt to connect".into()),
            },
            Self::Udp(address) => Ok(Input::Datagrams(UdpSocket::bind(address).await.map_err(text)?)),
            Self::Plugin(plugin) => plugin.start().map(Input::Plugin).map_err(text),
            Self::Stdin => Err("it is read by a separate loop".into()),
        }
    }
}

enum Input {
    Stream(Box<dyn AsyncRead + Unpin>),
    Datagrams(UdpSocket),
    Plugin(Plugin),
}

impl Input {
    /// The next bytes; none at the end. A datagram ends its last line.
    async fn read(&mut self, bytes: &mut Vec<u8>) -> std::io::Result<usize> {
        bytes.resize(DATAGRAM, 0);
        let count = match self {
            Self::Stream(stream) => stream.read(bytes).await?,
            Self::Plugin(plugin) => plugin.read(bytes).await?,
            Self::Datagrams(socket) => {
                let count = socket.recv(bytes).await?;
                bytes.truncate(count);
                bytes.push(b'\n');
                return Ok(bytes.len());
            }
        };
        bytes.truncate(count);
        Ok(count)
    }
}

/// Place of a value in a line: the number of its cell, from 1, or its key in a JSON object.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Cell {
    /// Cell, from 1.
    Number(usize),
    Key(String),
}

impl Cell {
    pub(super) fn problems(&self, problems: &mut Problems) {
        let found = match self {
            Self::Number(number) if (1..=64).contains(number) => return,
            Self::Key(name) if !name.is_empty() => return,
            Self::Number(number) => number.to_string(),
            Self::Key(_) => "no text".into(),
        };
        problems.add(format_args!("expected a cell, 1 to 64, or a JSON key, found {found}"));
    }
}

/// Positions of a sensor's values in a line, in the feed's order.
#[derive(Debug)]
pub(super) struct Pick(Vec<Picked>);

/// Position of one value in a line.
#[derive(Debug)]
struct Picked {
    cell: Cell,
    /// Whether the value is a marker's: its cell is empty when it was not seen.
    is_marker: bool,
}

impl Pick {
    /// Cells of values by name.
    pub(super) fn new<'a>(values: impl Iterator<Item = (&'a String, &'a Cell)>) -> Self {
        let is_marker = |name: &str| slot(name).is_some_and(|slot| slot >= MARKERS);
        Self(values.map(|(name, cell)| Picked { cell: cell.clone(), is_marker: is_marker(name) }).collect())
    }

    /// The raw numbers of a line, each with the position of its value; `None` for a line without any.
    fn numbers(&self, line: &[u8], comma_separates: bool) -> Result<Option<Vec<(usize, f64)>>, LineError> {
        let Some(cells) = parse_cells(line, comma_separates)? else { return Ok(None) };
        let mut found = Vec::with_capacity(self.0.len());
        for (position, Picked { cell, is_marker }) in self.0.iter().enumerate() {
            let number = match (cell, &cells) {
                (Cell::Number(number), Cells::Numbers(cells)) => match cells.get(number - 1) {
                    Some(Ok(Some(number))) => *number,
                    Some(Ok(None)) if *is_marker => f64::NAN,
                    Some(Err(error)) => return Err(error.clone()),
                    _ => return Err(LineError::NoCell { cell: *number, found: cells.len() }),
                },
                (Cell::Key(key), Cells::Json(object)) => match object.get(key) {
                    // A line may carry some of the values only.
                    None => continue,
                    Some(serde_json::Value::Null) => f64::NAN,
                    Some(value) => value.as_f64().ok_or_else(|| LineError::NotANumber {
                        found: value.to_string().chars().take(40).collect(),
                    })?,
                },
                (Cell::Number(_), Cells::Json(_)) | (Cell::Key(_), Cells::Numbers(_)) => continue,
            };
            found.push((position, number));
        }
        if found.is_empty() { Err(LineError::NoValue) } else { Ok(Some(found)) }
    }
}

/// A sensor on a path of lines.
#[derive(Debug)]
pub(super) struct LineSensor {
    pub(super) feed: Feed,
    pub(super) pick: Pick,
    pub(super) comma_separates: bool,
}

impl LineSensor {
    fn take(&mut self, t_ns: u64, line: &[u8]) {
        match self.pick.numbers(line, self.comma_separates) {
            Ok(Some(numbers)) => self.feed.send(t_ns, numbers),
            Ok(None) => {}
            Err(error) => self.feed.failed(|c| &c.garbage, &error.to_string()),
        }
    }
}

/// The work of a path's thread.
#[derive(Debug)]
pub(super) struct LinesThread {
    pub(super) path: LinesPath,
    sensors: Vec<LineSensor>,
    buffer: LineBuffer,
    /// The line that is on its way when a serial line is opened has lost its beginning.
    skip_line: bool,
}

impl LinesThread {
    pub(super) fn new(path: LinesPath) -> Self {
        Self { path, sensors: Vec::new(), buffer: LineBuffer::default(), skip_line: false }
    }

    pub(super) fn add(&mut self, sensor: LineSensor) {
        self.sensors.push(sensor);
    }

    /// Reads until all sensors are stopped, or to the end of standard input.
    pub(super) fn run(mut self, runtime: &Runtime) {
        if self.path == LinesPath::Stdin { self.read_stdin() } else { runtime.block_on(self.serve()) }
    }

    fn is_wanted(&mut self) -> bool {
        self.sensors.retain(|sensor| !sensor.feed.is_stopped());
        !self.sensors.is_empty()
    }

    fn failed(&mut self, counter: impl Fn(&SensorCounters) -> &AtomicU64, what: &str) {
        for sensor in &mut self.sensors {
            sensor.feed.failed(&counter, what);
        }
    }

    fn push(&mut self, bytes: &[u8]) {
        let (t_ns, sensors) = (now_ns(), &mut self.sensors);
        let end = bytes.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
        let bytes = match (self.skip_line, end) {
            (false, _) => bytes,
            (true, None) => return,
            (true, Some(end)) => bytes.get(end..).unwrap_or_default(),
        };
        self.skip_line = false;
        self.buffer.split(bytes, |line| sensors.iter_mut().for_each(|sensor| sensor.take(t_ns, line)));
    }

    async fn serve(&mut self) {
        let mut backoff = Backoff::new(MAX_BACKOFF);
        while self.is_wanted() {
            match self.path.open().await {
                Ok(input) => {
                    (self.buffer, self.skip_line) =
                        (LineBuffer::default(), matches!(self.path, LinesPath::Serial(_)));
                    let (began, is_plugin) = (Instant::now(), matches!(input, Input::Plugin(_)));
                    // A program that says something and ends at once is no success.
                    if self.read(input).await && (!is_plugin || began.elapsed() > MAX_BACKOFF) {
                        backoff.reset();
                    }
                }
                Err(cause) => self.failed(|c| &c.refusals, &format!("cannot open it: {cause}")),
            }
            let end = Instant::now() + backoff.take();
            while self.is_wanted() && Instant::now() < end {
                tokio::time::sleep(STOP_CHECK.min(end - Instant::now())).await;
            }
        }
    }

    /// Reads to the end of the input; says whether anything came.
    async fn read(&mut self, mut input: Input) -> bool {
        let (mut bytes, mut last, mut has_come) = (Vec::new(), Instant::now(), false);
        while self.is_wanted() {
            match timeout(STOP_CHECK, input.read(&mut bytes)).await {
                Ok(Ok(count)) if count > 0 => {
                    (last, has_come) = (Instant::now(), true);
                    self.push(&bytes);
                }
                Ok(end) => {
                    let cause = end.err().map_or("end of file".into(), |error| error.to_string());
                    self.failed(|c| &c.disconnects, &cause);
                    break;
                }
                Err(_) if matches!(self.path, LinesPath::Tcp(_)) && last.elapsed() > TCP_SILENCE => {
                    let silence = format!("nothing for {} s: reconnecting", TCP_SILENCE.as_secs());
                    self.failed(|c| &c.timeouts, &silence);
                    break;
                }
                Err(_) => {} // nothing sent: check the stop flag, go on reading
            }
        }
        has_come
    }

    fn read_stdin(&mut self) {
        let mut bytes = [0; 1024];
        let mut input = std::io::stdin().lock();
        while self.is_wanted() {
            match input.read(&mut bytes) {
                Ok(0) => return,
                Ok(count) => self.push(bytes.get(..count).unwrap_or_default()),
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => return self.failed(|c| &c.disconnects, &error.to_string()),
            }
        }
    }
}
