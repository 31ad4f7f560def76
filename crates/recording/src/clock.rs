//! Time of a recording whose runs, clocks and metadata are in any order.
//!
//! A run is what one recorder wrote; its metadata have the machine's boot and the offset from the monotonic clock to the wall clock.
//! Runs of one boot follow each other by the monotonic clock, whatever was done to the wall clock between them. A run of another boot
//! begins where the wall clock says, never before the last time of the run before.

use crate::{ABOUT, Item};

/// Key of the offset from a monotonic stamp to the time since 1970, ns.
pub(crate) const OFFSET: &str = "wall_minus_monotonic_ns";
/// Key of the boot whose monotonic clock it is.
pub(crate) const BOOT: &str = "boot_id";

/// Which clock the stamps are of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stamps {
    /// Monotonic clock, in payloads.
    Monotonic,
    /// Wall clock, in messages: `log_time_ns`.
    Wall,
}

/// Brings stamps of all runs onto one axis. Only differences of its times mean something.
#[derive(Debug)]
pub struct RunClock {
    stamps: Stamps,
    run: Option<(String, i128)>,
    /// Added to a stamp.
    shift_ns: i128,
    last_ns: i128,
    /// No stamp of the run came yet.
    begins: bool,
}

impl RunClock {
    /// Before the first item.
    pub fn new(stamps: Stamps) -> Self {
        Self { stamps, run: None, shift_ns: 0, last_ns: i128::MIN, begins: false }
    }

    /// Takes the metadata of a run. Metadata behind the first messages of their run change nothing for it.
    pub fn take(&mut self, item: &Item) {
        let Item::Metadata { name, entries } = item else { return };
        let offset = entries.get(OFFSET).filter(|_| name == ABOUT).and_then(|text| text.parse::<i128>().ok());
        let Some(offset) = offset else { return };
        let boot = entries.get(BOOT).cloned().unwrap_or_default();
        if let Some((known, before)) = self.run.replace((boot.clone(), offset)) {
            let same_boot = boot == known && !boot.is_empty();
            self.begins = (known, before) != (boot, offset);
            self.shift_ns += match (self.stamps, same_boot) {
                (Stamps::Monotonic, true) | (Stamps::Wall, false) => 0,
                (Stamps::Monotonic, false) => offset - before,
                (Stamps::Wall, true) => before - offset,
            };
        }
    }

    /// Monotonic time at which a message was recorded, ns; `None` if the recorder's clocks are not known.
    pub fn recorded_at(&self, log_time_ns: u64) -> Option<i128> {
        self.run.as_ref().map(|(_, offset)| i128::from(log_time_ns) - offset)
    }

    /// Time of a stamp, ns. Within a run it may go back as the stamps do.
    pub fn at(&mut self, stamp_ns: u64) -> i128 {
        if std::mem::take(&mut self.begins) {
            self.shift_ns += (self.last_ns.saturating_sub(self.shift_ns + i128::from(stamp_ns))).max(0);
        }
        let t_ns = i128::from(stamp_ns) + self.shift_ns;
        self.last_ns = self.last_ns.max(t_ns);
        t_ns
    }
}

/// The machine's boot; empty where the system does not say.
pub(crate) fn boot_id() -> String {
    std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default().trim().to_owned()
}
