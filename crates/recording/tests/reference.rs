//! Our files under the format's reference implementation, and its files under our reader.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::Arc;

use crate::common::{metadata, read_all, text, write_some};
use recording::{Ending, Item, ReadError, RecordingReader, Writer};
use wire::layout::LAYOUT_VERSION;

#[test]
fn the_reference_reader_finds_every_message_and_the_summary() {
    let bytes = write_some(Vec::new(), 1_000, 70).expect("memory does not refuse");
    let messages: Vec<_> = mcap::MessageStream::new(&bytes)
        .expect("a valid file")
        .collect::<Result<_, _>>()
        .expect("valid messages");
    assert_eq!(messages.len(), 1_000);
    for (index, message) in (0u64..).zip(&messages) {
        assert_eq!(message.data, text(index).as_bytes());
        assert_eq!(
            (message.sequence, message.log_time, message.publish_time),
            (index as u32, 1_000 + index, 900 + index)
        );
        let schema = message.channel.schema.as_ref().expect("each channel has a schema");
        assert_eq!(
            (schema.encoding.as_str(), message.channel.message_encoding.as_str()),
            ("jsonschema", "json")
        );
    }
    let summary = mcap::Summary::read(&bytes).expect("a valid summary").expect("there is one");
    let stats = summary.stats.as_ref().expect("statistics");
    assert_eq!((stats.message_count, stats.channel_count, stats.metadata_count), (1_000, 2, 1));
    assert_eq!((stats.message_start_time, stats.message_end_time), (1_000, 1_999));
    assert_eq!(summary.chunk_indexes.len(), 15);
    let found: usize = summary
        .chunk_indexes
        .iter()
        .map(|index| summary.stream_chunk(&bytes, index).expect("the index points at a chunk").count())
        .sum();
    assert_eq!(found, 1_000, "every chunk is reached through the index");
    let offsets = summary.read_message_indexes(&bytes, &summary.chunk_indexes[3]).expect("message indexes");
    assert_eq!(offsets.values().map(Vec::len).sum::<usize>(), 70);
}

#[test]
fn the_reference_reader_accepts_every_checksum() {
    let bytes = write_some(Vec::new(), 200, 50).expect("memory does not refuse");
    let options = mcap::sans_io::LinearReaderOptions::default()
        .with_validate_chunk_crcs(true)
        .with_validate_summary_section_crc(true)
        .with_validate_data_section_crc(true);
    let mut reader = mcap::sans_io::LinearReader::new_with_options(options);
    let (mut at, mut records) = (0, 0);
    while let Some(event) = reader.next_event() {
        match event.expect("no checksum complains") {
            mcap::sans_io::LinearReadEvent::ReadRequest(want) => {
                let count = want.min(bytes.len() - at);
                reader.insert(want)[..count].copy_from_slice(&bytes[at..at + count]);
                reader.notify_read(count);
                at += count;
            }
            mcap::sans_io::LinearReadEvent::Record { .. } => records += 1,
        }
    }
    assert!(records > 200, "{records} records");
}

fn reference_file(compression: Option<mcap::Compression>, count: u64) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    let mut writer = mcap::WriteOptions::new()
        .compression(compression)
        .chunk_size(Some(2_000))
        .create(&mut out)
        .expect("head");
    let schema = Arc::new(mcap::Schema {
        id: 7,
        name: "other.Schema".into(),
        encoding: "jsonschema".into(),
        data: Cow::Borrowed(b"{}"),
    });
    let channel = Arc::new(mcap::Channel {
        id: 3,
        topic: "gauge".into(),
        schema: Some(schema),
        message_encoding: "json".into(),
        metadata: Default::default(),
    });
    for index in 0..count {
        let message = mcap::Message {
            channel: channel.clone(),
            sequence: index as u32,
            log_time: index,
            publish_time: index,
            data: Cow::Owned(text(index).into_bytes()),
        };
        writer.write(&message).expect("memory");
    }
    let notes = mcap::records::Metadata { name: "notes".into(), metadata: metadata() };
    writer.write_metadata(&notes).expect("memory");
    writer.finish().expect("memory");
    drop(writer);
    out.into_inner()
}

#[test]
fn our_reader_reads_the_reference_writer() {
    for compression in [None, Some(mcap::Compression::Lz4)] {
        let bytes = reference_file(compression, 300);
        let mut reader = RecordingReader::new(bytes.as_slice()).expect("head");
        let (mut messages, mut notes) = (0, 0);
        while let Some(item) = reader.next_item().expect("readable") {
            match item {
                Item::Message(message) => {
                    assert_eq!(message.data, text(messages).into_bytes());
                    assert_eq!(
                        (message.channel.topic.as_str(), message.channel.schema_name.as_str()),
                        ("gauge", "other.Schema")
                    );
                    messages += 1;
                }
                Item::Metadata { name, entries } => {
                    assert_eq!((name.as_str(), entries), ("notes", metadata()));
                    notes += 1;
                }
            }
        }
        assert_eq!((messages, notes), (300, 1));
        assert_eq!(reader.ending(), Some(&Ending::Complete));
    }
}

#[test]
fn another_compression_is_named_with_its_remedy() {
    let mut bytes = write_some(Vec::new(), 10, 10).expect("memory");
    let at = bytes
        .windows(7)
        .position(|window| window == b"\x03\0\0\0lz4")
        .expect("a chunk names its compression");
    bytes[at + 4..at + 7].copy_from_slice(b"zzz");
    let mut reader = RecordingReader::new(bytes.as_slice()).expect("head");
    let error = loop {
        match reader.next_item() {
            Ok(Some(_)) => {}
            Ok(None) => panic!("a chunk of unknown compression was skipped without an error"),
            Err(error) => break error,
        }
    };
    assert!(matches!(&error, ReadError::Compression { found } if found == "zzz"));
}

#[test]
fn invalid_file_is_refused() {
    for bytes in [&b""[..], b"time,pressure", b"\x89MCAP1\r\n"] {
        let error = RecordingReader::new(bytes).err().expect("refused");
        assert!(matches!(error, ReadError::NotMcap { .. }), "{error}");
    }
    assert_eq!(read_all(&write_some(Vec::new(), 0, 1).expect("memory")), (Vec::new(), Ending::Complete));
}

#[test]
fn a_recording_of_another_layout_is_refused_and_names_the_command_that_makes_it() {
    for (entries, wanted) in [
        (
            BTreeMap::from([("layout".to_owned(), (LAYOUT_VERSION - 1).to_string())]),
            (LAYOUT_VERSION - 1).to_string(),
        ),
        (BTreeMap::from([("version".to_owned(), "0.1.0".to_owned())]), "none".to_owned()),
    ] {
        let mut writer = Writer::new(Vec::new()).expect("memory");
        writer.metadata("softtwin.recording", &entries).expect("memory");
        let bytes = writer.finish().expect("memory");
        let error = RecordingReader::new(bytes.as_slice()).expect("head").next_item().expect_err("refused");
        assert!(matches!(&error, ReadError::Layout { found } if *found == wanted), "{error}");
    }
}
