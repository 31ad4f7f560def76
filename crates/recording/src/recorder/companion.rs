//! Further messages that go beside a topic's own, such as those that viewers draw unasked.

use std::fmt;
use std::sync::Arc;

use wire::{AnySample, Topic};

use crate::writer::Channel;

/// Makes further messages of the samples of one topic, in their order, in the topic's thread.
pub trait Companion: Send {
    /// The messages of `sample`, which was published at `publish_time_ns` since 1970. Most samples may have none.
    fn messages(&mut self, sample: &AnySample, publish_time_ns: u64) -> Vec<(Arc<Channel>, Vec<u8>)>;
}

type Make = dyn Fn(&Topic) -> Option<Box<dyn Companion>> + Send + Sync;

/// Makes the companion of each topic; none for a topic that needs none.
#[derive(Clone)]
pub struct Companions(Arc<Make>);

impl Companions {
    /// From a function.
    pub fn new(make: impl Fn(&Topic) -> Option<Box<dyn Companion>> + Send + Sync + 'static) -> Self {
        Self(Arc::new(make))
    }

    /// The companion of `topic`.
    pub fn of(&self, topic: &Topic) -> Option<Box<dyn Companion>> {
        (self.0)(topic)
    }
}

impl fmt::Debug for Companions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Companions")
    }
}
