//! Checks of the shared-memory domain and its topics.

use super::finding::Finding;
use std::time::Duration;
use wire::{AnyReader, Bus, KeyExpr, TopicInfo, WireError};

/// How long the removal of what dead programs left may take.
const CLEAN_UP_TIMEOUT: Duration = Duration::from_secs(2);

/// Checks that the shared-memory domain can be joined. Joining removes files of ended programs.
pub fn domain(bus: &Result<Bus, WireError>) -> Finding {
    let subject = "domain";
    let bus = match bus {
        Ok(bus) => bus,
        Err(error) => {
            let remedy = match error {
                WireError::OpenFolder { folder, .. } => format!("chmod 700 {folder}"),
                _ => "run as the user that runs the twin, with its SOFTTWIN_ROOT and SOFTTWIN_DOMAIN".into(),
            };
            return Finding::bad(subject, error, remedy);
        }
    };
    let mut removed = bus.removed();
    removed += bus.clean_up(CLEAN_UP_TIMEOUT);
    let after = format!("after dead programs: {} nodes, {} files", removed.nodes, removed.files);
    match removed.failed {
        0 if !removed.any() => Finding::good(subject, "joined, nothing left behind by dead programs"),
        0 => Finding::good(subject, format!("joined; removed {after}")),
        failed => Finding::bad(
            subject,
            format!("joined; removed {after}; {failed} nodes of dead programs could not be removed"),
            format!("stop all programs that use it, then empty {}", bus.folder().display()),
        ),
    }
}

/// Opens every topic as a reader: programs of another version have other types.
pub fn topics(bus: &Bus) -> Vec<Finding> {
    match KeyExpr::new("softtwin/**").map(|key| bus.topics(&key)) {
        Err(error) => vec![Finding::bad("topics", error, "report this: the key is the program's own")],
        Ok(Err(error)) => {
            vec![Finding::bad("topics", error, "check the rights on the folder of management files")]
        }
        Ok(Ok(topics)) if topics.is_empty() => {
            vec![Finding::warning(
                "topics",
                "no topic in this shared memory",
                "start `softtwind twin` and `softtwind bridge`",
            )]
        }
        Ok(Ok(topics)) => topics.iter().map(|info| topic(bus, info)).collect(),
    }
}

fn topic(bus: &Bus, info: &TopicInfo) -> Finding {
    let subject = info.topic.name();
    match AnyReader::open(bus, &info.topic) {
        Err(error @ WireError::Incompatible { .. }) => {
            Finding::bad(subject, error, "run the same release everywhere; restart the older program")
        }
        Err(error) => Finding::bad(subject, error, "remove the cause that the text names, then try again"),
        Ok(_) if info.writers.is_empty() => {
            Finding::warning(subject, "no writer", "start its bridge or twin; readers wait for it")
        }
        Ok(_) => Finding::good(subject, format!("{}, {} readers", info.payload_type, info.readers.len())),
    }
}
