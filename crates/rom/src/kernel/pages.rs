//! Memory that a sweep reads from its start to its end, in large pages where the system has them (transparent huge pages of Linux, where they
//! are allowed at all or on request). A processor follows a stream of addresses within a page and looks up where each page lies: from
//! memory that no cache holds, a basis in large pages is read in little more than half the time.

use std::alloc::{Layout, alloc, dealloc, handle_alloc_error};
use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;

/// Bytes a cache line.
pub(super) const LINE: usize = 64;

/// One cache line, so that the storage is aligned to one.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Line(pub [u8; LINE]);

/// A large page: 2 MiB on x86-64, and on aarch64 with pages of 4 KiB.
const LARGE: usize = 2 << 20;

/// Cache lines in a row.
pub(crate) struct Lines {
    start: NonNull<Line>,
    len: usize,
}

// SAFETY: it owns its memory, as a vector does.
unsafe impl Send for Lines {}
// SAFETY: it has no interior mutability.
unsafe impl Sync for Lines {}

impl Lines {
    /// `len` lines of zeros.
    pub fn zeroed(len: usize) -> Self {
        // SAFETY: zero bytes are lines, and the memory is for `len` of them.
        unsafe { Self::filled(len, |start| start.write_bytes(0, len)) }
    }

    /// # Safety
    /// `fill` writes `len` lines.
    unsafe fn filled(len: usize, fill: impl FnOnce(*mut Line)) -> Self {
        let Some(layout) = layout(len) else { return Self { start: NonNull::dangling(), len: 0 } };
        // SAFETY: the layout is not empty.
        let Some(start) = NonNull::new(unsafe { alloc(layout) }.cast::<Line>()) else {
            handle_alloc_error(layout)
        };
        let is_long = layout.align() == LARGE;
        if is_long {
            advise(start, layout.size(), FOR_NEW);
        }
        fill(start.as_ptr());
        if is_long {
            advise(start, layout.size(), FOR_WRITTEN);
        }
        Self { start, len }
    }
}

impl Lines {
    /// The bytes of all lines.
    pub fn bytes(&self) -> &[u8] {
        // SAFETY: a line is an array of bytes, and the lines follow one another.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr().cast(), self.len * LINE) }
    }

    /// The bytes of all lines, to write.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        // SAFETY: as for `bytes`, borrowed alone.
        unsafe { std::slice::from_raw_parts_mut(self.start.as_ptr().cast(), self.len * LINE) }
    }
}

impl From<&[Line]> for Lines {
    fn from(lines: &[Line]) -> Self {
        // SAFETY: the copy writes all lines, to memory that is new.
        unsafe {
            Self::filled(lines.len(), |start| start.copy_from_nonoverlapping(lines.as_ptr(), lines.len()))
        }
    }
}

/// Layout of `len` cache lines, page-aligned from one large page on; `None` for 0.
fn layout(len: usize) -> Option<Layout> {
    let layout = Layout::array::<Line>(len).ok().filter(|layout| layout.size() > 0)?;
    if layout.size() < LARGE { Some(layout) } else { layout.align_to(LARGE).ok() }
}

/// Large pages for what is not mapped yet ...
#[cfg(target_os = "linux")]
const FOR_NEW: libc::c_int = libc::MADV_HUGEPAGE;
/// Advice for memory in use, from Linux 6.1 on: an allocator may return memory that was used before.
#[cfg(target_os = "linux")]
const FOR_WRITTEN: libc::c_int = libc::MADV_COLLAPSE;

/// A refusal leaves pages unchanged.
#[cfg(target_os = "linux")]
fn advise(start: NonNull<Line>, bytes: usize, advice: libc::c_int) {
    // SAFETY: the range is one that was just allocated, and neither advice changes content.
    let _small_otherwise = unsafe { libc::madvise(start.as_ptr().cast(), bytes, advice) };
}

#[cfg(not(target_os = "linux"))]
const FOR_NEW: i32 = 0;
#[cfg(not(target_os = "linux"))]
const FOR_WRITTEN: i32 = 0;

#[cfg(not(target_os = "linux"))]
fn advise(_: NonNull<Line>, _: usize, _: i32) {}

impl Drop for Lines {
    fn drop(&mut self) {
        if let Some(layout) = layout(self.len) {
            // SAFETY: allocated with this layout, and lines need no drop.
            unsafe { dealloc(self.start.as_ptr().cast(), layout) };
        }
    }
}

impl Deref for Lines {
    type Target = [Line];

    fn deref(&self) -> &[Line] {
        // SAFETY: `len` lines were written from `start` on, which is aligned and not null even where there are none.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.len) }
    }
}

impl DerefMut for Lines {
    fn deref_mut(&mut self) -> &mut [Line] {
        // SAFETY: as above, and it is borrowed alone.
        unsafe { std::slice::from_raw_parts_mut(self.start.as_ptr(), self.len) }
    }
}

impl Clone for Lines {
    fn clone(&self) -> Self {
        Self::from(&self[..])
    }
}

impl std::fmt::Debug for Lines {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} cache lines", self.len)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_keep_their_values_and_long_ones_start_at_a_large_page() {
        for len in [0, 1, 1000, LARGE / LINE - 1, LARGE / LINE, LARGE / LINE + 77] {
            let mut lines = Lines::zeroed(len);
            assert!(lines.len() == len && lines.iter().all(|line| line.0 == [0; LINE]));
            lines.iter_mut().enumerate().for_each(|(k, line)| line.0 = [k as u8; LINE]);
            let copy = lines.clone();
            lines.iter_mut().for_each(|line| line.0 = [1; LINE]);
            drop(lines);
            assert!(copy.len() == len && copy.iter().enumerate().all(|(k, line)| line.0 == [k as u8; LINE]));
            let alignment = if len * LINE < LARGE { LINE } else { LARGE };
            assert!((copy.as_ptr() as usize).is_multiple_of(alignment), "{len}");
        }
    }
}
