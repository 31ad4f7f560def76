//! Membership of a program in a shared-memory domain, and the domain's topics.

use crate::leftover::{Places, SweepThread};
use crate::port::memory::require_headroom;
use crate::port::retry::{Refusal, within};
use crate::sys::Ipc;
use crate::{Domain, KeyExpr, Removed, Topic, WireError};
use iceoryx2::node::NodeCreationFailure;
use iceoryx2::prelude::*;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// A program's membership in a [`Domain`]. Cheap to clone; not `Send`: ports live in the thread that made them.
///
/// Joining removes what dead programs left behind. Signals stay the program's own business.
#[derive(Debug, Clone)]
pub struct Bus {
    pub(crate) places: Places,
    removed: Removed,
    member: Rc<Member>,
}

#[derive(Debug)]
struct Member {
    node: Node<Ipc>,
    places: Places,
    _watch: SweepThread,
}

impl Drop for Member {
    /// The last one to leave leaves nothing of others behind, either.
    fn drop(&mut self) {
        self.places.sweep(Duration::ZERO);
    }
}

/// Time that opening a bus waits for programs that create resources, before it continues without a full clean-up. Missing space
/// is freed on demand, see `port::retry`.
const SWEEP_PATIENCE: Duration = Duration::from_millis(200);

/// Time that opening a bus tries again while another user takes its names in /dev/shm.
const CLAIM_PATIENCE: Duration = Duration::from_secs(2);

/// Topic found in the shared-memory domain.
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
    /// Joins `domain`. Takes some milliseconds; at most 3 s when another program is in the way.
    ///
    /// # Errors
    /// [`WireError::BadDomain`] for names that cannot be files, [`WireError::LongDomain`] for names that are too long,
    /// [`WireError::OthersDomain`] when it is another user's, [`WireError::OpenFolder`] when others can write in its folder,
    /// [`WireError::Node`] when the folders cannot be written, [`WireError::NoMemory`] when /dev/shm is full,
    /// [`WireError::TooManyFiles`], [`WireError::NoFiles`], [`WireError::StartLocked`].
    pub fn open(domain: &Domain) -> Result<Self, WireError> {
        set_log_level(LogLevel::Fatal); // failures come back as errors; iceoryx2 would print kilobytes besides
        let begin = Instant::now();
        loop {
            let places = domain.places()?;
            let joined = Self::join(domain, &places);
            // A stranger may take a name in /dev/shm after it was found free. The next one counts then.
            if begin.elapsed() > CLAIM_PATIENCE || domain.claimed_prefix() == places.prefix {
                return joined;
            }
        }
    }

    fn join(domain: &Domain, places: &Places) -> Result<Self, WireError> {
        places.require_own_folder()?;
        places.remove_files_of_others();
        require_headroom("the shared-memory domain", 0)?;
        let watch = SweepThread::start(places.clone());
        let removed = places.sweep(SWEEP_PATIENCE);
        let refusal = |cause: String| match domain.claimed_prefix() == places.prefix {
            true => Refusal::Passing(cause),
            false => Refusal::Final(WireError::Node { cause }),
        };
        let node = within(places, "the shared-memory domain", || {
            NodeBuilder::new()
                .config(&places.config)
                .signal_handling_mode(SignalHandlingMode::Disabled)
                .create::<Ipc>()
                .map_err(|error| {
                    if error == NodeCreationFailure::UnableToGenerateUniqueNodeId {
                        places.remove_damaged_counter();
                    }
                    refusal(format!("{error:?}"))
                })
                .and_then(|node| match places.restrict_counter() {
                    true => Ok(node),
                    false => Err(refusal("another user takes the names in /dev/shm".into())),
                })
        });
        let node = node.map_err(|error| match error {
            WireError::InFlux { cause, .. } => WireError::Node { cause },
            other => other,
        })?;
        let member = Rc::new(Member { node, places: places.clone(), _watch: watch });
        Ok(Self { places: places.clone(), removed, member })
    }

    pub(crate) fn node(&self) -> &Node<Ipc> {
        &self.member.node
    }

    /// All topics whose name `key` matches, sorted by name. Reads the management files and writes none: for programs that
    /// poll.
    ///
    /// # Errors
    /// [`WireError::List`] when the management files cannot be read.
    pub fn names(&self, key: &KeyExpr) -> Result<Vec<Topic>, WireError> {
        Ok(self.listed(key)?.into_iter().map(|info| info.topic).collect())
    }

    /// Topics without those who take part.
    pub(crate) fn listed(&self, key: &KeyExpr) -> Result<Vec<TopicInfo>, WireError> {
        let mut found = Vec::new();
        let listed = Ipc::list(&self.places.config, |details| {
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

    /// Removes what dead programs left behind, waiting at most `timeout` for others that are just creating something.
    pub fn clean_up(&self, timeout: Duration) -> Removed {
        self.places.sweep(timeout)
    }

    /// Files of dead programs that were removed when the bus was opened.
    pub fn removed(&self) -> Removed {
        self.removed
    }

    /// Folder of the management files.
    pub fn folder(&self) -> PathBuf {
        self.places.root.clone()
    }
}

use iceoryx2::service::static_config::messaging_pattern::MessagingPattern as MessagingPatternConfig;

#[cfg(test)]
#[path = "../tests/unit/bus.rs"]
mod tests;
