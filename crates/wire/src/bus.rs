//! A program's place in a domain, and what else is there.

use crate::port::{require_headroom, service};
use crate::{Domain, KeyExpr, Topic, WireError};
use iceoryx2::prelude::*;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::Duration;

/// The transport: inter-process, single-threaded ports.
pub(crate) type Ipc = ipc::Service;

/// A program's membership in a [`Domain`]. Cheap to clone; not `Send`: ports live in the thread that made them.
///
/// Joining removes what dead programs left behind. Signals stay the program's own business.
#[derive(Debug, Clone)]
pub struct Bus {
    pub(crate) node: Rc<Node<Ipc>>,
}

/// One topic as found in the domain.
#[derive(Debug, Clone)]
pub struct TopicInfo {
    /// The topic.
    pub topic: Topic,
    /// Type of the payload with its layout version.
    pub payload_type: String,
    /// Type of the header with its layout version; empty: none.
    pub header_type: String,
    /// Bytes of a payload element.
    pub payload_bytes: usize,
    /// Process ids of the writers (at most one).
    pub writers: Vec<u32>,
    /// Process ids of the readers.
    pub readers: Vec<u32>,
}

impl Bus {
    /// Joins `domain`.
    ///
    /// # Errors
    /// [`WireError::BadDomain`] for names that cannot be files, [`WireError::Node`] when the folders cannot be written,
    /// [`WireError::NoMemory`] when /dev/shm is full.
    pub fn open(domain: &Domain) -> Result<Self, WireError> {
        set_log_level(LogLevel::Fatal); // failures come back as errors; iceoryx2 would print kilobytes besides
        let config = domain.config()?;
        require_headroom("the shared-memory domain", 0)?;
        let node = NodeBuilder::new()
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Ipc>()
            .map_err(|error| WireError::Node { cause: format!("{error:?}") })?;
        Ok(Self { node: Rc::new(node) })
    }

    /// All topics whose name `key` matches, sorted by name. Looks at the management files and leaves them alone: for programs
    /// that look again and again.
    ///
    /// # Errors
    /// [`WireError::List`] when the management files cannot be read.
    pub fn names(&self, key: &KeyExpr) -> Result<Vec<Topic>, WireError> {
        Ok(self.listed(key)?.into_iter().map(|info| info.topic).collect())
    }

    /// All topics whose name `key` matches, sorted by name, and who takes part. To see that, each is opened for a moment, which
    /// writes to the domain's folder: a busy disk below it holds the caller up, for seconds at worst.
    ///
    /// # Errors
    /// As [`Self::names`].
    pub fn topics(&self, key: &KeyExpr) -> Result<Vec<TopicInfo>, WireError> {
        let mut found = self.listed(key)?;
        for info in &mut found {
            // A topic may vanish between listing and looking: then it simply has nobody.
            if let Ok((writers, readers)) = service::participants(self, &info.topic) {
                info.writers = writers;
                info.readers = readers;
            }
        }
        Ok(found)
    }

    /// Topics without those who take part.
    fn listed(&self, key: &KeyExpr) -> Result<Vec<TopicInfo>, WireError> {
        let mut found = Vec::new();
        let listed = Ipc::list(self.node.config(), |details| {
            let config = &details.static_details;
            if !matches!(config.messaging_pattern(), MessagingPatternConfig::PublishSubscribe(_)) {
                return CallbackProgression::Continue;
            }
            if let Some(topic) = Topic::parse(config.name().as_str()).filter(|topic| topic.matches(key)) {
                let types = config.publish_subscribe().message_type_details();
                found.push(TopicInfo {
                    topic,
                    payload_type: types.payload.type_name().to_string(),
                    header_type: types.user_header.type_name().to_string(),
                    payload_bytes: types.payload.size(),
                    writers: Vec::new(),
                    readers: Vec::new(),
                });
            }
            CallbackProgression::Continue
        });
        listed.map_err(|error| WireError::List { cause: format!("{error:?}") })?;
        found.sort_by(|a, b| a.topic.name().cmp(b.topic.name()));
        Ok(found)
    }

    /// Removes what dead programs left behind, waiting at most `timeout`; returns how many were removed.
    pub fn clean_up(&self, timeout: Duration) -> u64 {
        self.node.blocking_cleanup_dead_nodes(timeout).cleanups
    }

    /// Folder of the domain's management files.
    pub fn folder(&self) -> PathBuf {
        PathBuf::from(String::from_utf8_lossy(self.node.config().global.root_path().as_bytes()).into_owned())
    }

    /// Prefix of the shared-memory names of this domain.
    pub(crate) fn prefix(&self) -> String {
        String::from_utf8_lossy(self.node.config().global.prefix.as_bytes()).into_owned()
    }
}

use iceoryx2::service::static_config::messaging_pattern::MessagingPattern as MessagingPatternConfig;
