//! Many files as one recording, over several runs.

use std::path::Path;

use crate::common::{channel, text};
use recording::{Ending, Item, ReadItems, RecordingFiles, Retention, RotateOptions, RotatingWriter};

const ROTATE: RotateOptions = RotateOptions {
    max_bytes: None,
    max_time_ns: Some(1_000),
    keep: Retention { files: None, total_bytes: None, free: None },
};

/// One run of a recorder: messages `from` to `to`.
fn run(base: &Path, options: RotateOptions, from: u64, to: u64) -> Vec<std::path::PathBuf> {
    let mut writer = RotatingWriter::create(base, options).expect("a file");
    for index in from..to {
        let data = text(index);
        writer.message(&channel("a"), index as u32, index * 100, 0, data.as_bytes()).expect("written");
    }
    writer.finish().expect("closed").files
}

fn read(path: &Path) -> (Vec<String>, String) {
    let mut reader = RecordingFiles::open(path).expect("a recording").reader();
    let mut messages = Vec::new();
    while let Some(item) = reader.next_item().expect("readable") {
        if let Item::Message(message) = item {
            messages.push(String::from_utf8(message.data).expect("text"));
        }
    }
    (messages, reader.ending())
}

fn expected(range: std::ops::Range<u64>) -> Vec<String> {
    range.map(text).collect()
}

#[test]
fn restart_continues_the_series_and_a_folder_is_one_recording() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = folder.path().join("run.mcap");
    let first = run(&base, ROTATE, 0, 25);
    let second = run(&base, ROTATE, 25, 60);
    assert!(first.iter().all(|path| !second.contains(path)), "{first:?} {second:?}");
    assert_eq!(read(folder.path()), (expected(0..60), "complete".into()));
    assert_eq!(read(&folder.path().join("run")).0.len(), 60, "by its name, too");
    // A file alone is that file.
    assert_eq!(read(&second[0]).0, expected(25..35));
}

#[test]
fn retention_counts_the_files_of_earlier_runs_only() {
    let folder = tempfile::tempdir().expect("a folder");
    run(&folder.path().join("run.mcap"), ROTATE, 0, 40);
    let keep = Retention { files: Some(3), ..Retention::default() };
    run(&folder.path().join("run.mcap"), RotateOptions { keep, ..ROTATE }, 40, 50);
    assert_eq!(read(folder.path()), (expected(20..50), "complete".into()));
    // Files with similar names are not part of the series.
    for name in ["run.mcap", "run-2.mcap", "run-test-0001.mcap", "other-0001.mcap"] {
        std::fs::write(folder.path().join(name), b"kept").expect("written");
    }
    let keep = Retention { files: Some(1), ..Retention::default() };
    run(&folder.path().join("run.mcap"), RotateOptions { keep, ..ROTATE }, 50, 60);
    for name in ["run.mcap", "run-2.mcap", "run-test-0001.mcap", "other-0001.mcap"] {
        assert!(folder.path().join(name).exists(), "{name}");
    }
    let several = RecordingFiles::open(folder.path()).expect_err("which one?").to_string();
    assert!(several.contains("run") && several.contains("other"), "{several}");
}

#[test]
fn the_size_of_a_series_stays_below_its_limit_at_every_flush_of_every_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = folder.path().join("run.mcap");
    let size = || -> u64 {
        let entries = std::fs::read_dir(folder.path()).expect("a folder").flatten();
        entries.map(|entry| entry.metadata().map_or(0, |about| about.len())).sum()
    };
    let keep = Retention { total_bytes: Some(40_000), ..Retention::default() };
    let options = RotateOptions { max_bytes: Some(1 << 30), max_time_ns: None, keep };
    for start in 0..5u64 {
        let mut writer = RotatingWriter::create(&base, options).expect("a file");
        for index in 0..300 {
            let data = text(start * 300 + index);
            writer.message(&channel("a"), 0, index, 0, data.as_bytes()).expect("written");
            writer.flush().expect("written");
            assert!(size() <= 40_000, "{} bytes", size());
        }
        writer.finish().expect("closed");
    }
    assert!(size() > 20_000, "much of what fits is kept: {}", size());
}

#[test]
fn damaged_and_empty_files_of_a_series_cost_only_themselves() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = folder.path().join("run.mcap");
    let files = run(&base, ROTATE, 0, 40);
    std::fs::write(&files[1], b"").expect("emptied, as after a power cut");
    let (messages, ending) = read(folder.path());
    assert_eq!(messages, [expected(0..10), expected(20..40)].concat());
    assert!(ending.contains("run-0002.mcap"), "{ending}");
    let alone =
        RecordingFiles::open(&files[1]).expect("there").reader().next_item().expect_err("no recording");
    assert!(alone.to_string().contains("an empty file"), "{alone}");
}

#[test]
fn a_new_file_on_request_loses_nothing_and_does_nothing_without_rotation() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = folder.path().join("run.mcap");
    let options = RotateOptions { max_time_ns: Some(u64::MAX), ..ROTATE };
    let mut writer = RotatingWriter::create(&base, options).expect("a file");
    for index in 0..10 {
        writer.message(&channel("a"), 0, index, 0, text(index).as_bytes()).expect("written");
        writer.begin_new_file().expect("begun");
        writer.begin_new_file().expect("an empty file is not ended");
    }
    assert_eq!(writer.finish().expect("closed").files.len(), 11);
    assert_eq!(read(folder.path()), (expected(0..10), Ending::Complete.to_string()));

    let single = folder.path().join("single.mcap");
    let mut writer = RotatingWriter::create(&single, RotateOptions::default()).expect("a file");
    writer.message(&channel("a"), 0, 0, 0, text(0).as_bytes()).expect("written");
    writer.begin_new_file().expect("a flush");
    assert_eq!(writer.finish().expect("closed").files, [single]);
}
