//! Checks of the machine: shared memory, the folder of management files, real-time rights.

use super::finding::Finding;
use runtime::config::Settings;
use runtime::machine;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

/// A full field topic takes 58 MB (see `wire::qos`); two of them and the small topics fit into this.
const SHM_WANTED_BYTES: u64 = 128 << 20;

/// Free space and rights of /dev/shm.
pub fn shared_memory() -> Finding {
    let subject = "/dev/shm";
    let room = match machine::space(Path::new(subject)) {
        Ok(room) => room,
        Err(error) => return Finding::bad(subject, error, "mount it: mount -t tmpfs tmpfs /dev/shm"),
    };
    let found = format!("{} MB free of {} MB", room.free_bytes >> 20, room.total_bytes >> 20);
    if !machine::is_writable(Path::new(subject)) {
        return Finding::bad(subject, "not writable for this user", "chmod 1777 /dev/shm");
    }
    if room.free_bytes < SHM_WANTED_BYTES {
        let remedy = format!(
            "free space, or enlarge it: mount -o remount,size=1G /dev/shm; a full field topic and the small ones need {} MB",
            SHM_WANTED_BYTES >> 20
        );
        return Finding::bad(subject, found, remedy);
    }
    Finding::good(subject, found)
}

/// The folder of management files belongs to one user. A program that opens a topic writes there and waits while its disk is busy.
pub fn management_files(folder: &Path) -> Finding {
    let subject = "management files";
    let mode = std::fs::metadata(folder).map_or(0, |found| found.permissions().mode() & 0o777);
    if mode & 0o077 != 0 {
        let found = format!("other users can enter or list {} (mode {mode:o})", folder.display());
        return Finding::bad(subject, found, format!("chmod 700 {}", folder.display()));
    }
    if let Some((above, mode)) = replaceable_above(folder) {
        let found = format!(
            "other users can put another folder in the place of {}: they can write in {} (mode {mode:o})",
            folder.display(),
            above.display()
        );
        return Finding::bad(subject, found, format!("chmod go-w {}", above.display()));
    }
    match machine::is_in_memory(folder) {
        Err(error) => Finding::warning(subject, format!("{}: {error}", folder.display()), "check its rights"),
        Ok(true) => Finding::good(subject, format!("{}, in memory", folder.display())),
        Ok(false) => Finding::warning(
            subject,
            format!("{}, on a disk: while it is busy, programs start late", folder.display()),
            "SOFTTWIN_ROOT=/run/softtwin for all programs, as in the units, or another folder in memory",
        ),
    }
}

/// The first folder above `folder` in which others can rename what is not theirs.
fn replaceable_above(folder: &Path) -> Option<(&Path, u32)> {
    folder.ancestors().skip(1).filter(|above| !above.as_os_str().is_empty()).find_map(|above| {
        let mode = std::fs::metadata(above).ok()?.permissions().mode() & 0o7777;
        (mode & 0o022 != 0 && mode & 0o1000 == 0).then_some((above, mode))
    })
}

/// Rights for real time: bad only where the settings ask for them.
pub fn real_time(settings: Option<&Settings>) -> [Finding; 2] {
    let remedy =
        |line: &str| format!("systemd: {line} in the unit; by hand: the same in /etc/security/limits.conf");
    let wanted = settings.map(|settings| &settings.realtime);

    let subject = "real-time priority";
    let priority = wanted.map_or(0, |wanted| u64::from(wanted.fifo_priority));
    let priority = match machine::fifo_priority_limit() {
        None => Finding::good(subject, "any"),
        Some(limit) if limit >= priority.max(1) => Finding::good(subject, format!("up to {limit}")),
        Some(limit) => {
            let found = match priority {
                0 => format!("up to {limit}"),
                _ => format!("up to {limit}, {priority} wanted"),
            };
            Finding::missing(priority > 0, subject, found, remedy("LimitRTPRIO=60"))
        }
    };

    let subject = "locked memory";
    let is_wanted = wanted.is_some_and(|wanted| wanted.lock_memory);
    let memory = match machine::locked_memory_limit() {
        None => Finding::good(subject, "no limit"),
        Some(limit) => {
            let found = format!("{} MB", limit >> 20);
            Finding::missing(is_wanted, subject, found, remedy("LimitMEMLOCK=infinity"))
        }
    };
    [priority, memory]
}
