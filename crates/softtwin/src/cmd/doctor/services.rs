//! Checks of other services: the folder of a recorder, the configuration of a gateway.

use super::finding::Finding;
use recording::RecordingFiles;
use runtime::machine;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

/// A recorder writes twice a second; a series that is older is not being recorded.
const SILENCE: Duration = Duration::from_secs(10);
/// Below this a recorder without `--free-mb` is about to meet a full disk.
const FREE_WANTED_BYTES: u64 = 1 << 30;

/// Space, and every series of recordings in the folder.
pub fn recordings(folder: &Path) -> Vec<Finding> {
    let subject = "recordings";
    let series = match RecordingFiles::all_in(folder) {
        Ok(series) => series,
        Err(error) => {
            let remedy = "name the folder of --out, as a user that may read it";
            return vec![Finding::bad(subject, format!("{}: {error}", folder.display()), remedy)];
        }
    };
    let space = match machine::space(folder) {
        Ok(space) if space.free_bytes < FREE_WANTED_BYTES => Finding::bad(
            subject,
            format!("{} MB free of {} MB", space.free_bytes >> 20, space.total_bytes >> 20),
            "record with --free-mb or --keep-mb, or free space",
        ),
        Ok(space) => Finding::good(subject, format!("{} MB free", space.free_bytes >> 20)),
        Err(error) => Finding::warning(subject, error, "check the folder's file system"),
    };
    let none = || Finding::warning(subject, "none in the folder", "start `softtwin record`");
    let found = series.iter().map(self::series);
    let none = series.is_empty().then(none);
    [space].into_iter().chain(found).chain(none).collect()
}

fn series(series: &RecordingFiles) -> Finding {
    let subject = format!("recording {}", series.name);
    let about = series.files.iter().filter_map(|file| std::fs::metadata(file).ok());
    let (mut bytes, mut empty, mut newest) = (0, 0, None);
    for file in about {
        bytes += file.len();
        empty += usize::from(file.len() == 0);
        newest = newest.max(file.modified().ok());
    }
    let age = newest.and_then(|newest| newest.elapsed().ok()).unwrap_or_default();
    let found = format!("{} files, {} MB, written {} s ago", series.files.len(), bytes >> 20, age.as_secs());
    match (empty, age > SILENCE) {
        (0, false) => Finding::good(&subject, found),
        (0, true) => {
            Finding::warning(&subject, found, "no recorder runs: `systemctl status softtwin-record@...`")
        }
        (count, _) => {
            let remedy = "left by a power cut; readers pass them over, they may be removed";
            Finding::warning(&subject, format!("{found}, {count} of them empty"), remedy)
        }
    }
}

/// The gateway's own check of its configuration: certificates, passwords, addresses.
pub fn gateway(config: &Path) -> Finding {
    let subject = "gateway";
    let program = std::env::current_exe().map(|own| own.with_file_name("softtwin-gateway"));
    let beside = program.ok().filter(|path| path.exists()).unwrap_or_else(|| "softtwin-gateway".into());
    match Command::new(&beside).arg("--config").arg(config).arg("--check").output() {
        Err(error) => {
            let remedy =
                "install softtwin-gateway beside this program (scripts/package.sh deb OUT --gateway)";
            Finding::bad(subject, format!("{}: {error}", beside.display()), remedy)
        }
        Ok(output) => {
            let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            if output.status.success() {
                Finding::good(subject, said)
            } else {
                Finding::bad(subject, said, "correct the file; `softtwin-gateway --check` again")
            }
        }
    }
}
