//! The device paths of a scene: one thread for each, whatever the number of sensors and actuators behind it.
//!
//! A path (an address, a serial port, an interface) is named by the first sensor that uses it; the next ones join. Threads
//! start together with the first source, when all sensors of the scene are known.

use super::modbus::{Job, ModbusConnection, ModbusThread, Polled};
use super::reading::BridgeWaker;
use super::sensor::{Channel, Ended, Feed, Inbox, connect};
use super::serial::ModbusPath;
use super::stream::{LineSensor, LinesPath, LinesThread};
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::Builder;
use tokio::sync::mpsc::{UnboundedSender, WeakUnboundedSender};
use wire::thread_group::panic_text;

/// The device paths of a bridge; clones share them.
#[derive(Debug, Clone, Default)]
pub struct Devices(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    waker: Arc<OnceLock<BridgeWaker>>,
    waiting: Mutex<BTreeMap<String, Path>>,
    /// Modbus paths whose thread has started.
    running: Mutex<BTreeMap<String, Running>>,
}

/// A Modbus path whose thread runs as long as a sensor or a writer has the way to it.
#[derive(Debug)]
struct Running {
    path: ModbusPath,
    ended: Ended,
    reach: WeakUnboundedSender<Job>,
}

/// A path whose thread has not started.
#[derive(Debug)]
struct Path {
    ended: Ended,
    work: Work,
}

#[derive(Debug)]
enum Work {
    Modbus(ModbusThread),
    Lines(LinesThread),
}

impl Devices {
    fn waiting(&self) -> MutexGuard<'_, BTreeMap<String, Path>> {
        self.0.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The way to the thread of a path that runs.
    fn running(&self, path: &ModbusPath) -> Result<Option<(UnboundedSender<Job>, Ended)>, String> {
        let running = self.0.running.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(found) = running.get(&path.key()) else { return Ok(None) };
        match found.reach.upgrade() {
            Some(jobs) if found.path == *path => Ok(Some((jobs, found.ended.clone()))),
            Some(_) => Err(used_otherwise(&path.key())),
            None => Ok(None),
        }
    }

    /// Adds a sensor that is asked on a Modbus path.
    ///
    /// # Errors
    /// Another sensor uses the path otherwise.
    pub(super) fn poll_modbus(
        &self,
        path: &ModbusPath,
        channels: Vec<Channel>,
        label: &str,
        polled: impl FnOnce(Feed) -> Polled,
    ) -> Result<Inbox, String> {
        if let Some((jobs, ended)) = self.running(path)? {
            let place = label_of(label, &path.place());
            let (feed, mut inbox) = connect(place, channels, self.0.waker.clone(), ended);
            let added = jobs.send(Job::Add(polled(feed)));
            inbox.path = Some(Box::new(jobs));
            return added.map(|()| inbox).map_err(|_| format!("the thread of {} has ended", path.place()));
        }
        let mut waiting = self.waiting();
        let (thread, ended) = modbus(&mut waiting, path)?;
        let place = label_of(label, &path.place());
        let (feed, mut inbox) = connect(place, channels, self.0.waker.clone(), ended);
        inbox.path = thread.jobs().map(|jobs| Box::new(jobs) as Box<dyn Debug + Send>);
        thread.add(polled(feed));
        Ok(inbox)
    }

    /// Connection of a Modbus path, for writers to its devices; sensors on the same path use it too.
    ///
    /// # Errors
    /// A sensor uses the path otherwise (other serial settings, another protocol).
    pub fn modbus(&self, path: &ModbusPath) -> Result<ModbusConnection, String> {
        let running = self.running(path)?.map(|(jobs, _)| jobs);
        let jobs = match running {
            Some(jobs) => Some(jobs),
            None => modbus(&mut self.waiting(), path)?.0.jobs(),
        };
        jobs.map(ModbusConnection::new).ok_or_else(|| format!("the thread of {} has ended", path.place()))
    }

    /// Adds a sensor that reads the lines of a path.
    ///
    /// # Errors
    /// As [`Self::modbus`].
    pub(super) fn read_lines(
        &self,
        path: &LinesPath,
        channels: Vec<Channel>,
        label: &str,
        sensor: impl FnOnce(Feed) -> LineSensor,
    ) -> Result<Inbox, String> {
        let mut waiting = self.waiting();
        let key = path.key();
        let entry = waiting.entry(key.clone()).or_insert_with(|| Path {
            ended: Ended::default(),
            work: Work::Lines(LinesThread::new(path.clone())),
        });
        match &mut entry.work {
            Work::Lines(thread) if thread.path == *path => {
                let place = label_of(label, &path.place());
                let (feed, inbox) = connect(place, channels, self.0.waker.clone(), entry.ended.clone());
                thread.add(sensor(feed));
                Ok(inbox)
            }
            _ => Err(used_otherwise(&key)),
        }
    }

    /// Starts the threads of all paths that have none yet.
    ///
    /// # Errors
    /// A thread cannot be started.
    pub fn start(&self, waker: Option<&BridgeWaker>) -> std::io::Result<()> {
        if let Some(waker) = waker {
            let _the_bridges_only_one = self.0.waker.set(waker.clone());
        }
        for (_, Path { ended, work }) in std::mem::take(&mut *self.waiting()) {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
            if let Work::Modbus(thread) = &work
                && let Some(reach) = thread.reach()
            {
                let mut running = self.0.running.lock().unwrap_or_else(PoisonError::into_inner);
                let (path, ended) = (thread.path.clone(), ended.clone());
                running.insert(path.key(), Running { path, ended, reach });
            }
            spawn(ended, self.0.waker.clone(), move || match work {
                Work::Modbus(thread) => thread.run(&runtime),
                Work::Lines(thread) => thread.run(&runtime),
            })?;
        }
        Ok(())
    }
}

/// Runs a device's thread. After a panic its sensors have failed, and the bridge ends with their names.
fn spawn(
    ended: Ended,
    waker: Arc<OnceLock<BridgeWaker>>,
    run: impl FnOnce() + Send + 'static,
) -> std::io::Result<()> {
    let guarded = move || {
        let panic = catch_unwind(AssertUnwindSafe(run)).err();
        let _first = ended.set(panic.map(|panic| panic_text(panic.as_ref()).to_owned()));
        // The bridge wakes once more and sees the end.
        if let Some(waker) = waker.get() {
            let _woken_already = waker.try_send(());
        }
    };
    Builder::new().name("sensor".into()).spawn(guarded).map(drop)
}

/// The thread of a Modbus path, made where there is none.
fn modbus<'a>(
    waiting: &'a mut BTreeMap<String, Path>,
    path: &ModbusPath,
) -> Result<(&'a mut ModbusThread, Ended), String> {
    let key = path.key();
    let refusal = used_otherwise(&key);
    let entry = waiting.entry(key).or_insert_with(|| Path {
        ended: Ended::default(),
        work: Work::Modbus(ModbusThread::new(path.clone())),
    });
    match &mut entry.work {
        Work::Modbus(thread) if thread.path == *path => Ok((thread, entry.ended.clone())),
        _ => Err(refusal),
    }
}

fn used_otherwise(path: &str) -> String {
    format!(
        "expected the same settings wherever a path is used, found others for {path} (kind, baud, parity, data and stop \
         bits); while a bridge uses it, it changes with a restart"
    )
}

/// The name of a sensor for the log: its own, if it has one, and the device's address.
fn label_of(label: &str, place: &str) -> String {
    if label.is_empty() { place.to_owned() } else { format!("{label} ({place})") }
}

#[cfg(test)]
#[path = "../../tests/unit/source_devices.rs"]
mod tests;
