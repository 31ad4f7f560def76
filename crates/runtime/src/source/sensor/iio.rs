//! A converter from voltage to number, through the kernel's industrial I/O: files of its folder in /sys.

use super::devices::Device;
use super::feed::{Backoff, Feed, STOP_CHECK};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;
use wire::now_ns;

/// Longest pause after a failure.
const MAX_BACKOFF: Duration = Duration::from_secs(5);

/// Channels of one device, read at a fixed rate.
#[derive(Debug)]
pub(super) struct IioDevice {
    /// Folder of the devices.
    pub(super) root: PathBuf,
    /// The device's folder, or what its file `name` says.
    pub(super) device: String,
    /// `voltage0`, ...; in the order of the feed's values.
    pub(super) channels: Vec<String>,
    pub(super) rate_hz: f64,
}

/// Where a channel's number is, and what makes mV of it.
struct Channel {
    raw: PathBuf,
    scale: f64,
    offset: f64,
}

impl Device for IioDevice {
    fn run(self: Box<Self>, mut feed: Feed, _: &Runtime) {
        let mut backoff = Backoff::new(MAX_BACKOFF);
        while !feed.is_stopped() {
            match self.open() {
                Ok(channels) => self.read(&channels, &mut feed, &mut backoff),
                Err(cause) => feed.failed(|c| &c.refusals, &format!("cannot open it: {cause}")),
            }
            backoff.sleep(|| !feed.is_stopped());
        }
    }
}

impl IioDevice {
    fn open(&self) -> Result<Vec<Channel>, String> {
        let folder = self.folder()?;
        let channel = |name: &String| {
            let raw = folder.join(format!("in_{name}_raw"));
            number(&raw)?;
            // A file of the channel, of its kind (`in_voltage_scale`), or the default.
            let kind = name.trim_end_matches(|c: char| c.is_ascii_digit());
            let setting = |what: &str, default: f64| {
                let files = [format!("in_{name}_{what}"), format!("in_{kind}_{what}")];
                let found = files.iter().map(|file| folder.join(file)).find(|path| path.exists());
                found.map_or(Ok(default), |path| number(&path))
            };
            Ok(Channel { scale: setting("scale", 1.0)?, offset: setting("offset", 0.0)?, raw })
        };
        self.channels.iter().map(channel).collect()
    }

    /// By the folder's name, or by the device's, which stays the same when devices are plugged in another order.
    fn folder(&self) -> Result<PathBuf, String> {
        let folder = self.root.join(&self.device);
        if folder.is_dir() {
            return Ok(folder);
        }
        let entries =
            fs::read_dir(&self.root).map_err(|error| format!("{}: {error}", self.root.display()))?;
        let is_named = |folder: &PathBuf| {
            fs::read_to_string(folder.join("name")).is_ok_and(|name| name.trim() == self.device)
        };
        let mut found: Vec<PathBuf> =
            entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_named).collect();
        match (found.pop(), found.len()) {
            (Some(folder), 0) => Ok(folder),
            (Some(_), others) => Err(format!(
                "{} devices in {} are called `{}`; name the folder",
                others + 1,
                self.root.display(),
                self.device
            )),
            (None, _) => Err(format!("no device in {} is called `{}`", self.root.display(), self.device)),
        }
    }

    fn read(&self, channels: &[Channel], feed: &mut Feed, backoff: &mut Backoff) {
        let period = Duration::from_secs_f64(1.0 / self.rate_hz);
        let mut due = Instant::now();
        while !feed.is_stopped() {
            let left = due.saturating_duration_since(Instant::now());
            if !left.is_zero() {
                std::thread::sleep(left.min(STOP_CHECK));
                continue;
            }
            due = (due + period).max(Instant::now());
            let millivolt =
                |channel: &Channel| number(&channel.raw).map(|raw| (raw + channel.offset) * channel.scale);
            match channels.iter().map(millivolt).collect::<Result<Vec<f64>, _>>() {
                Ok(values) => {
                    feed.send(now_ns(), values.into_iter().enumerate());
                    backoff.reset();
                }
                Err(cause) => return feed.failed(|c| &c.disconnects, &cause),
            }
        }
    }
}

fn number(path: &Path) -> Result<f64, String> {
    let text = fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let found = text.trim();
    found.parse().map_err(|_| {
        let found: String = found.chars().take(40).collect();
        format!("{}: expected a number, found `{found}`", path.display())
    })
}
