//! Tests of `src/retention.rs` that need its private parts.

use super::*;

/// A disk with space for a number of files; every further one fills it.
struct SmallDisk {
    folder: PathBuf,
    most_files: usize,
    written: Vec<u8>,
}

impl Write for SmallDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if fs::read_dir(&self.folder)?.count() > self.most_files {
            return Err(ErrorKind::StorageFull.into());
        }
        self.written.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Store for SmallDisk {
    fn cut_to(&mut self, len: u64) -> io::Result<()> {
        self.written.cut_to(len)
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn files(folder: &Path, count: usize) -> Vec<PathBuf> {
    let make = |number| {
        let path = folder.join(format!("run-{number:04}.mcap"));
        fs::write(&path, [0; 100]).expect("written");
        path
    };
    (0..count).map(make).collect()
}

fn keep(files: usize) -> Retention {
    Retention { files: Some(files), ..Retention::default() }
}

#[test]
fn a_full_disk_costs_the_oldest_files_and_no_byte_of_the_new_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let earlier = files(folder.path(), 5);
    let shared = SharedFiles::new(SeriesFiles::new(folder.path().to_owned(), keep(1000), earlier.clone()));
    let disk = SmallDisk { folder: folder.path().to_owned(), most_files: 3, written: Vec::new() };
    let mut store = RoomyStore::new(disk, shared.clone());
    store.write_all(b"a chunk").expect("room was made");
    assert_eq!(store.inner().written, b"a chunk");
    let there: Vec<bool> = earlier.iter().map(|path| path.exists()).collect();
    assert_eq!(there, [false, false, true, true, true]);
    assert_eq!(shared.lock().removed(), 2);
}

#[test]
fn without_leave_to_remove_anything_a_full_disk_is_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let earlier = files(folder.path(), 2);
    let none = Retention::default();
    let shared = SharedFiles::new(SeriesFiles::new(folder.path().to_owned(), none, earlier.clone()));
    let disk = SmallDisk { folder: folder.path().to_owned(), most_files: 1, written: Vec::new() };
    let error = RoomyStore::new(disk, shared).write_all(b"x").expect_err("full");
    assert_eq!(error.kind(), ErrorKind::StorageFull);
    assert!(earlier.iter().all(|path| path.exists()));
}

#[test]
fn a_file_that_another_recorder_writes_is_not_removed() {
    let folder = tempfile::tempdir().expect("a folder");
    let earlier = files(folder.path(), 4);
    let written = File::open(&earlier[0]).expect("there");
    written.try_lock().expect("free");
    let mut series = SeriesFiles::new(folder.path().to_owned(), keep(2), earlier.clone());
    series.enforce(0);
    let there: Vec<bool> = earlier.iter().map(|path| path.exists()).collect();
    assert_eq!(there, [true, false, false, false], "the locked file and the one that is written are left");
}

#[test]
fn size_and_free_space_remove_the_oldest_first_and_stop_at_the_limit() {
    let folder = tempfile::tempdir().expect("a folder");
    let by_size = Retention { total_bytes: Some(350), ..Retention::default() };
    let earlier = files(folder.path(), 5);
    SeriesFiles::new(folder.path().to_owned(), by_size, earlier).enforce(100);
    let left = |folder: &Path| fs::read_dir(folder).expect("a folder").count();
    assert_eq!(left(folder.path()), 2, "two of 100 bytes and the 100 that are being written");

    // 1,000 bytes of disk, of which each file takes 100.
    let measure = |folder: &Path| Ok(1000 - 100 * fs::read_dir(folder)?.count() as u64);
    let by_free = Retention { free: Some(FreeSpace { bytes: 700, measure }), ..Retention::default() };
    let earlier = files(folder.path(), 6);
    SeriesFiles::new(folder.path().to_owned(), by_free, earlier).enforce(100);
    assert_eq!(left(folder.path()), 3);
}
