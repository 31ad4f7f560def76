//! Sixteen f32 lanes in the registers of each instruction set.
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

/// [`TILE_NODES`](super::TILE_NODES) values of f32.
///
/// # Safety
/// Every method needs the instruction set of the implementation; those that take a pointer need it valid for
/// 16 elements, the loads aligned to the size of 16 elements.
pub(super) trait Lanes: Copy {
    /// All lanes `value`, bit for bit.
    unsafe fn splat(value: f32) -> Self;
    /// 16 aligned f32.
    unsafe fn load(from: *const f32) -> Self;
    /// 16 aligned i16, converted.
    unsafe fn load_i16(from: *const i16) -> Self;
    /// Writes 16 f32, unaligned.
    unsafe fn store(self, to: *mut f32);
    /// `self * factor + addend`.
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self;
    /// `self - other`.
    unsafe fn sub(self, other: Self) -> Self;
    /// Square root, correctly rounded.
    unsafe fn sqrt(self) -> Self;
    /// `max(self, 0)`; NaN stays NaN, so that a damaged input cannot pass for a number.
    unsafe fn at_least_zero(self) -> Self;
    /// Per lane: `self > than ? yes : no`, the bits of `yes` and `no` untouched.
    unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self;
    /// Folds 64 bytes into a checksum: a load that cannot be left out.
    unsafe fn fold_line(self, line: *const f32) -> Self;
}
