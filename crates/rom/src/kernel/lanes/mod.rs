//! A tile row of f32 lanes in the registers of each instruction set.
//!
//! The sweep is written once over [`Lanes`]; each implementation is a handful of one-line intrinsics. All of them are
//! `inline(always)` so that they melt into the caller, which carries the `target_feature`.

#[cfg(target_arch = "x86_64")]
pub(super) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(super) mod avx512;
#[cfg(target_arch = "aarch64")]
pub(super) mod neon;
pub(super) mod portable;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod registers;

/// [`TILE_NODES`](super::TILE_NODES) values of f32.
///
/// # Safety
/// Every method needs the instruction set of the implementation; those that take a pointer need it valid for
/// a row, and aligned to a cache line for loads.
pub(super) trait Lanes: Copy {
    /// All lanes `value`, bit for bit.
    unsafe fn splat(value: f32) -> Self;
    /// A row of f32.
    unsafe fn load(from: *const f32) -> Self;
    /// A row of i16 pairs (see [`modes`](super::modes)), as 65536 times their value.
    unsafe fn load_pairs(from: *const i32) -> Self;
    /// Writes a row of f32, unaligned.
    unsafe fn store(self, to: *mut f32);
    /// `self * factor + addend`.
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self;
    /// `self + other`.
    unsafe fn add(self, other: Self) -> Self;
    /// Square root, correctly rounded.
    unsafe fn sqrt(self) -> Self;
    /// `max(self, 0)`; NaN stays NaN, so that a damaged input cannot pass for a number.
    unsafe fn at_least_zero(self) -> Self;
    /// Per lane: `self > than ? yes : no`, the bits of `yes` and `no` untouched.
    unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self;
}
