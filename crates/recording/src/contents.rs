//! Contents of a recording, record by record.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use mcap::records::op;

use crate::parse::RecordBody;

/// Largest number of channels that a reader stores.
const MAX_CHANNELS: usize = 4096;

/// Channel of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelInfo {
    /// Topic, such as `softtwin/finger/state`.
    pub topic: String,
    /// Name of the schema; empty when the channel has none.
    pub schema_name: String,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    pub channel: Arc<ChannelInfo>,
    /// Low 32 bits of the publisher's sequence number.
    pub sequence: u32,
    /// Time of recording, ns since 1970.
    pub log_time_ns: u64,
    /// Time of publication, ns since 1970.
    pub publish_time_ns: u64,
    pub data: Vec<u8>,
}

/// Item of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Item {
    Message(Message),
    /// A named table of strings.
    Metadata {
        name: String,
        entries: BTreeMap<String, String>,
    },
}

/// Channels and counts of the records read so far.
#[derive(Default)]
pub struct Contents {
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, Arc<ChannelInfo>>,
    delivered: u64,
    /// Message count in the statistics of the file.
    announced: Option<u64>,
    /// Damaged chunks and records.
    pub skipped: u64,
}

impl Contents {
    /// Takes a record; counts a malformed one as skipped.
    pub fn take(&mut self, opcode: u8, record: &[u8]) -> Option<Item> {
        let mut body = RecordBody(record);
        let known = match opcode {
            op::SCHEMA => self.schema(&mut body).map(|()| None),
            op::CHANNEL => self.channel(&mut body).map(|()| None),
            op::MESSAGE => self.message(&mut body).map(Some),
            op::METADATA => metadata(&mut body).map(Some),
            op::STATISTICS => body.u64().map(|announced| {
                self.announced = Some(announced);
                None
            }),
            _ => Some(None),
        };
        self.skipped += u64::from(known.is_none());
        known.flatten()
    }

    /// Number of chunks and records left out. The message count of the file reveals an unrecognised chunk.
    pub fn damage(&self) -> u64 {
        let is_short = self.announced.is_some_and(|announced| announced != self.delivered);
        self.skipped.max(is_short.into())
    }

    fn schema(&mut self, body: &mut RecordBody) -> Option<()> {
        let (id, name) = (body.u16()?, body.string()?);
        if self.schemas.len() < MAX_CHANNELS {
            self.schemas.insert(id, name.to_owned());
        }
        Some(())
    }

    fn channel(&mut self, body: &mut RecordBody) -> Option<()> {
        let (id, schema, topic) = (body.u16()?, body.u16()?, body.string()?);
        let info = ChannelInfo {
            topic: topic.to_owned(),
            schema_name: self.schemas.get(&schema).cloned().unwrap_or_default(),
        };
        // Channels are repeated with every chunk: messages continue to share the same one.
        let is_known = self.channels.get(&id).is_some_and(|known| **known == info);
        if !is_known && (self.channels.len() < MAX_CHANNELS || self.channels.contains_key(&id)) {
            self.channels.insert(id, Arc::new(info));
        }
        Some(())
    }

    fn message(&mut self, body: &mut RecordBody) -> Option<Item> {
        let channel = self.channels.get(&body.u16()?)?.clone();
        let (sequence, log_time_ns, publish_time_ns) = (body.u32()?, body.u64()?, body.u64()?);
        self.delivered += 1;
        let data = body.0.to_vec();
        Some(Item::Message(Message { channel, sequence, log_time_ns, publish_time_ns, data }))
    }
}

fn metadata(body: &mut RecordBody) -> Option<Item> {
    let name = body.string()?.to_owned();
    let mut pairs = RecordBody(body.bytes()?);
    let mut entries = BTreeMap::new();
    while !pairs.0.is_empty() {
        entries.insert(pairs.string()?.to_owned(), pairs.string()?.to_owned());
    }
    Some(Item::Metadata { name, entries })
}
