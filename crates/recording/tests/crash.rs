//! A writer that is killed, a disk that fills up, bytes that rot.

use std::io::{self, Write};

use crate::common::{read_all, text, write_some};
use proptest::prelude::*;
use recording::{Ending, RecordingReader, Retention, RotateOptions, RotatingWriter, Store, WriteError};

const MESSAGES: u64 = 24;
const FLUSH_EVERY: u64 = 6;

fn small() -> Vec<u8> {
    write_some(Vec::new(), MESSAGES, FLUSH_EVERY).expect("memory does not refuse")
}

fn expected(count: usize) -> Vec<String> {
    (0..count as u64).map(text).collect()
}

/// A file cut at any byte gives the messages of its whole chunks, in order, and the place of the cut.
#[test]
fn a_file_cut_at_any_byte_is_read_up_to_its_last_whole_chunk() {
    let bytes = small();
    let mut previous = 0;
    for cut in recording::MAGIC.len()..bytes.len() - recording::MAGIC.len() {
        let (messages, ending) = read_all(&bytes[..cut]);
        assert_eq!(messages, expected(messages.len()), "cut at {cut}");
        assert_eq!(messages.len() as u64 % FLUSH_EVERY, 0, "cut at {cut}: a chunk is whole or absent");
        assert!(messages.len() >= previous, "cut at {cut}: more bytes never mean fewer messages");
        assert!(
            matches!(ending, Ending::Truncated { at_byte, .. } if at_byte <= cut as u64),
            "cut at {cut}: {ending:?}"
        );
        previous = messages.len();
    }
    assert_eq!(previous as u64, MESSAGES);
    assert_eq!(read_all(&bytes), (expected(MESSAGES as usize), Ending::Complete));
}

/// Refuses after a number of bytes, in the middle of a write as a full disk does.
struct FullDisk {
    bytes: Vec<u8>,
    room: usize,
}

impl Write for FullDisk {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        match self.room - self.bytes.len() {
            0 => Err(io::Error::from(io::ErrorKind::StorageFull)),
            left => self.bytes.write(&data[..data.len().min(left)]),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Store for &mut FullDisk {
    fn cut_to(&mut self, len: u64) -> io::Result<()> {
        self.bytes.truncate(len as usize);
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// For any free space, the file has exactly the messages that the writer reports as kept.
#[test]
fn a_disk_full_at_any_byte_leaves_a_readable_file_and_a_true_count() {
    let whole = small().len();
    for room in recording::MAGIC.len()..whole {
        let mut disk = FullDisk { bytes: Vec::new(), room };
        let Err(WriteError::Store { source, kept_messages, .. }) =
            write_some(&mut disk, MESSAGES, FLUSH_EVERY)
        else {
            panic!("a disk with room for {room} of {whole} bytes must refuse");
        };
        assert_eq!(source.kind(), io::ErrorKind::StorageFull);
        if disk.bytes.is_empty() {
            assert_eq!(kept_messages, 0, "room {room}: not even the head fitted");
            continue;
        }
        let (messages, _) = read_all(&disk.bytes);
        assert_eq!(messages, expected(kept_messages as usize), "room {room}");
    }
}

/// After a refusal nothing more is written, so a later chunk cannot land behind a hole.
#[test]
fn a_failed_writer_stays_failed() {
    let mut disk = FullDisk { bytes: Vec::new(), room: 600 };
    let mut writer = recording::Writer::new(&mut disk).expect("the head fits");
    let id = writer.channel(&crate::common::channel("a")).expect("a channel");
    let data = vec![b'x'; 300_000];
    let first = (0..10)
        .find_map(|n| writer.message(id, n, 0, 0, &noise(&data, n)).err())
        .expect("a chunk is refused");
    assert!(matches!(first, WriteError::Store { .. }), "{first}");
    assert!(matches!(writer.message(id, 0, 0, 0, b"{}"), Err(WriteError::Ended)));
    assert!(matches!(writer.flush(), Err(WriteError::Ended)));
}

/// Incompressible bytes.
fn noise(data: &[u8], seed: u32) -> Vec<u8> {
    let mut state = seed.wrapping_mul(2_654_435_761) | 1;
    data.iter()
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            state as u8
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Flipped bits: no panic, no endless loop; every delivered message was written, because each chunk is checked before its
    /// messages are delivered.
    #[test]
    fn flipped_bits_never_deliver_a_wrong_message(flips in prop::collection::vec((any::<prop::sample::Index>(), 0u8..8), 1..6)) {
        let mut bytes = small();
        for (at, bit) in flips {
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
        }
        let all = expected(MESSAGES as usize);
        if let Ok(mut reader) = RecordingReader::new(bytes.as_slice()) {
            while let Ok(Some(item)) = reader.next_item() {
                if let recording::Item::Message(message) = item {
                    let text = String::from_utf8(message.data).expect("only whole messages");
                    prop_assert!(all.contains(&text), "{text}");
                }
            }
        }
    }

    /// Anything behind the magic: the reader ends.
    #[test]
    fn random_bytes_are_read_to_an_end(noise in prop::collection::vec(any::<u8>(), 0..2_000)) {
        let mut bytes = recording::MAGIC.to_vec();
        bytes.extend(noise);
        let mut reader = RecordingReader::new(bytes.as_slice()).expect("head");
        while let Ok(Some(_)) = reader.next_item() {}
    }

    /// Records with plausible opcodes and lengths get deeper than noise does.
    #[test]
    fn plausible_records_are_read_to_an_end(
        records in prop::collection::vec((0u8..18, prop::collection::vec(any::<u8>(), 0..80), any::<bool>()), 0..40)
    ) {
        let mut bytes = recording::MAGIC.to_vec();
        for (opcode, body, honest) in records {
            bytes.push(opcode);
            let length = if honest { body.len() as u64 } else { u64::from_le_bytes([body.len() as u8, 0, 0, 0, 1, 0, 0, 0]) };
            bytes.extend(length.to_le_bytes());
            bytes.extend(body);
        }
        let mut reader = RecordingReader::new(bytes.as_slice()).expect("head");
        while let Ok(Some(_)) = reader.next_item() {}
    }
}

/// A damaged chunk loses its messages and no others: each chunk has its channels.
#[test]
fn a_damaged_chunk_is_left_out_alone() {
    let mut bytes = small();
    let at = bytes.windows(7).position(|window| window == b"\x03\0\0\0lz4").expect("the first chunk");
    bytes[at + 40] ^= 0xff;
    let (messages, ending) = read_all(&bytes);
    assert_eq!(messages, expected(MESSAGES as usize)[FLUSH_EVERY as usize..]);
    assert_eq!(ending, Ending::Damaged { skipped: 1 });
}

/// A chunk with a damaged opcode is ignored; the message count of the file reveals it.
#[test]
fn a_chunk_that_is_no_longer_one_is_noticed() {
    let mut bytes = small();
    let at = bytes.windows(7).position(|window| window == b"\x03\0\0\0lz4").expect("the first chunk") - 37;
    assert_eq!(bytes[at], 6, "the chunk's opcode");
    bytes[at] = 7;
    let (messages, ending) = read_all(&bytes);
    assert_eq!(messages, expected(MESSAGES as usize)[FLUSH_EVERY as usize..]);
    assert_eq!(ending, Ending::Damaged { skipped: 1 });
}

/// A length field of gigabytes allocates nothing.
#[test]
fn a_chunk_that_claims_to_be_huge_is_left_out() {
    let mut body = vec![0u8; 16];
    body.extend((1u64 << 40).to_le_bytes());
    body.extend([1, 0, 0, 0]);
    body.extend(b"\x03\0\0\0lz4");
    body.extend(0u64.to_le_bytes());
    let mut bytes = recording::MAGIC.to_vec();
    bytes.push(6);
    bytes.extend((body.len() as u64).to_le_bytes());
    bytes.extend(body);
    let (messages, ending) = read_all(&bytes);
    assert!(messages.is_empty());
    assert!(matches!(ending, Ending::Truncated { .. }));
}

/// A record longer than what a reader takes into memory costs itself, not what follows it; cut within it, the file ends there.
#[test]
fn an_over_long_record_is_left_out_alone() {
    let whole = small();
    let header = recording::MAGIC.len() + 9 + usize::from(whole[recording::MAGIC.len() + 1]);
    for opcode in [5, 9, 0x91] {
        let length = recording::MAX_RECORD_BYTES + 1;
        let mut bytes = whole[..header].to_vec();
        bytes.push(opcode);
        bytes.extend(length.to_le_bytes());
        bytes.resize(bytes.len() + length as usize, 6);
        let cut = bytes.len() - 1;
        bytes.extend(&whole[header..]);
        let expected = (expected(MESSAGES as usize), Ending::Damaged { skipped: 1 });
        assert_eq!(read_all(&bytes), expected, "opcode {opcode}");
        assert!(matches!(read_all(&bytes[..cut]).1, Ending::Truncated { .. }));
    }
}

/// Inside a chunk as well, whether it is compressed or too long for memory itself.
#[test]
fn an_over_long_record_in_a_chunk_is_left_out_alone() {
    for compression in [None, Some(mcap::Compression::Lz4), Some(mcap::Compression::Zstd)] {
        let options = mcap::WriteOptions::new().compression(compression).chunk_size(None);
        let mut file = io::Cursor::new(Vec::new());
        let mut writer = options.create(&mut file).expect("a writer");
        let channel =
            writer.add_channel(0, "a", "json", &std::collections::BTreeMap::new()).expect("a channel");
        let mut send = |sequence: u64, bytes: &[u8]| {
            let header = mcap::records::MessageHeader {
                channel_id: channel,
                sequence: sequence as u32,
                log_time: sequence,
                publish_time: sequence,
            };
            writer.write_to_known_channel(&header, bytes).expect("memory does not refuse");
        };
        (0..3).for_each(|k| send(k, text(k).as_bytes()));
        send(3, &vec![7; recording::MAX_RECORD_BYTES as usize]);
        (3..6).for_each(|k| send(k + 1, text(k).as_bytes()));
        writer.finish().expect("memory does not refuse");
        drop(writer);
        let mut bytes = file.into_inner();
        assert_eq!(read_all(&bytes), (expected(6), Ending::Damaged { skipped: 1 }), "{compression:?}");
        if compression.is_none() {
            // A chunk that is too long for memory is checked behind its records.
            let at = bytes.len() / 2;
            bytes[at] ^= 1;
            assert!(matches!(read_all(&bytes).1, Ending::Damaged { skipped } if skipped >= 2));
        }
    }
}

/// A chunk without compression and checksum whose only record claims more bytes than the chunk holds; they are there, as
/// padding behind its records.
#[test]
fn a_record_that_reaches_into_the_padding_of_its_chunk_is_left_out() {
    let record = [&[5u8][..], &64u64.to_le_bytes(), &[0; 8]].concat();
    let mut body = [0u8; 16].to_vec(); // times
    body.extend((record.len() as u64).to_le_bytes());
    body.extend(0u32.to_le_bytes()); // no checksum
    body.extend(0u32.to_le_bytes()); // no compression
    body.extend((record.len() as u64).to_le_bytes());
    body.extend(record);
    body.extend([0; 200]);
    let mut bytes = recording::MAGIC.to_vec();
    bytes.push(6);
    bytes.extend((body.len() as u64).to_le_bytes());
    bytes.extend(body);
    bytes.extend([2, 20, 0, 0, 0, 0, 0, 0, 0]);
    bytes.extend([0; 20]);
    assert_eq!(read_all(&bytes), (Vec::new(), Ending::Damaged { skipped: 1 }));
}

#[test]
fn rotation_by_size_and_time_keeps_every_message_and_removes_the_oldest() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = folder.path().join("run.mcap");
    let options = RotateOptions { max_bytes: None, max_time_ns: Some(1_000), keep: Retention::default() };
    let mut writer = RotatingWriter::create(&base, options).expect("a file");
    writer.metadata("softtwin.model", &crate::common::metadata()).expect("written");
    for index in 0..50u64 {
        writer
            .message(&crate::common::channel("a"), index as u32, index * 100, 0, text(index).as_bytes())
            .expect("written");
    }
    let summary = writer.finish().expect("closed");
    assert_eq!((summary.messages, summary.files.len(), summary.removed), (50, 5, 0));
    let mut messages = Vec::new();
    for path in &summary.files {
        let bytes = std::fs::read(path).expect("there");
        assert!(bytes.windows(14).any(|window| window == b"softtwin.model"), "each file can be read alone");
        let (mut part, ending) = read_all(&bytes);
        assert_eq!(ending, Ending::Complete);
        messages.append(&mut part);
    }
    assert_eq!(messages, expected(50));

    let keep = Retention { files: Some(2), ..Retention::default() };
    let kept = RotateOptions { max_bytes: Some(600), max_time_ns: None, keep };
    let mut writer = RotatingWriter::create(&folder.path().join("few.mcap"), kept).expect("a file");
    for index in 0..50u64 {
        writer.message(&crate::common::channel("a"), 0, index, 0, text(index).as_bytes()).expect("written");
    }
    let summary = writer.finish().expect("closed");
    assert_eq!(summary.files.len(), 2);
    assert!(summary.removed >= 3, "{} removed", summary.removed);
    let left = std::fs::read_dir(folder.path()).expect("a folder").flatten();
    assert_eq!(left.filter(|entry| entry.file_name().to_string_lossy().starts_with("few")).count(), 2);
}

/// Writing to a deleted file succeeds; its contents are lost when the recorder ends.
#[test]
fn a_file_deleted_while_it_is_recorded_is_noticed() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = folder.path().join("run.mcap");
    let create = || RotatingWriter::create(&base, RotateOptions::default()).expect("a file");
    let mut flushed = create();
    flushed.flush().expect("still there");
    std::fs::remove_file(&base).expect("removed");
    for error in [flushed.flush().err(), flushed.finish().err()] {
        assert!(matches!(&error, Some(WriteError::Deleted { path }) if *path == base), "{error:?}");
    }
    let renamed = create();
    std::fs::rename(&base, folder.path().join("other.mcap")).expect("renamed");
    renamed.finish().expect("a renamed file keeps what is written");
}

#[test]
fn an_existing_recording_is_never_overwritten() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = folder.path().join("run.mcap");
    std::fs::write(&base, b"precious").expect("written");
    let error = RotatingWriter::create(&base, RotateOptions::default()).err().expect("refused");
    assert!(matches!(&error, WriteError::Exists { path } if *path == base), "{error}");
    assert_eq!(std::fs::read(&base).expect("there"), b"precious");
}

#[test]
fn a_folder_that_is_not_there_is_no_full_disk() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = folder.path().join("nowhere/run.mcap");
    let error = RotatingWriter::create(&base, RotateOptions::default()).err().expect("refused");
    assert!(matches!(error, WriteError::Create { .. }), "{error}");
    assert!(error.to_string().contains("nowhere/run.mcap"), "{error}");
}
