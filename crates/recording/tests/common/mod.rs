//! A small recording that all tests share.
#![allow(dead_code)] // each test file is its own crate and uses some of this

use std::collections::BTreeMap;

use recording::{Channel, Ending, Item, RecordingReader, Store, WriteError, Writer};

pub fn channel(topic: &str) -> Channel {
    Channel {
        topic: topic.into(),
        schema_name: "softtwin.Test".into(),
        schema: r#"{"type":"object","properties":{"value":{"type":"number"}}}"#.into(),
    }
}

pub fn metadata() -> BTreeMap<String, String> {
    BTreeMap::from([("model_hash".to_owned(), "00ff".to_owned()), ("version".to_owned(), "0.1.0".to_owned())])
}

/// The text of message `index`; long enough to compress, different for every index.
pub fn text(index: u64) -> String {
    format!(r#"{{"value":{},"index":{index},"note":"pressure in MPa"}}"#, (index as f64) * 0.1)
}

/// Writes `count` messages on two topics with a flush after each `flush_every`; stops at the first error.
pub fn write_some<S: Store>(store: S, count: u64, flush_every: u64) -> Result<S, WriteError> {
    let mut writer = Writer::new(store)?;
    writer.metadata("softtwin.model", &metadata())?;
    for index in 0..count {
        let topic = if index % 3 == 0 { "softtwin/finger/state" } else { "softtwin/finger/sensor" };
        let id = writer.channel(&channel(topic))?;
        writer.message(id, index as u32, 1_000 + index, 900 + index, text(index).as_bytes())?;
        if (index + 1) % flush_every == 0 {
            writer.flush()?;
        }
    }
    writer.finish()
}

/// All messages and how the recording ended.
pub fn read_all(bytes: &[u8]) -> (Vec<String>, Ending) {
    let mut reader = RecordingReader::new(bytes).expect("the head is whole");
    let mut messages = Vec::new();
    while let Some(item) = reader.next_item().expect("readable") {
        if let Item::Message(message) = item {
            messages.push(String::from_utf8(message.data).expect("text"));
        }
    }
    (messages, reader.ending().expect("at the end").clone())
}
