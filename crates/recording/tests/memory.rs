//! A length in a file is a claim: nothing is reserved for it before the bytes are there.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use recording::{Ending, RecordingReader};

/// The largest piece of memory that was ever asked for, bytes.
static LARGEST: AtomicUsize = AtomicUsize::new(0);

struct Measured;

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Measured {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as the caller's.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        LARGEST.fetch_max(bytes, Ordering::Relaxed);
        // SAFETY: as the caller's.
        unsafe { System.realloc(pointer, layout, bytes) }
    }
}

#[global_allocator]
static ALLOCATOR: Measured = Measured;

const SCHEMA: u8 = 3;
const CHUNK: u8 = 6;
const METADATA: u8 = 12;

/// A record of this opcode whose first text claims 4 GB; so does the record itself if `is_long`.
fn claim(opcode: u8, before: usize, is_long: bool) -> Vec<u8> {
    let body = [vec![1; before], u32::MAX.to_le_bytes().to_vec(), b"name".to_vec()].concat();
    let length = if is_long { 1 << 32 } else { body.len() as u64 };
    [recording::MAGIC.to_vec(), vec![opcode], length.to_le_bytes().to_vec(), body].concat()
}

#[test]
fn a_claimed_length_reserves_nothing() {
    for (opcode, before) in [(SCHEMA, 2), (METADATA, 0), (CHUNK, 28)] {
        for is_long in [false, true] {
            let bytes = claim(opcode, before, is_long);
            let mut reader = RecordingReader::new(bytes.as_slice()).expect("the head is whole");
            assert_eq!(reader.next_item().expect("readable"), None);
            assert!(matches!(reader.ending(), Some(Ending::Truncated { .. })), "{:?}", reader.ending());
        }
    }
    let largest = LARGEST.load(Ordering::Relaxed);
    assert!(largest < 1 << 20, "{largest} bytes were reserved at once");
}
