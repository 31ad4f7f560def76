//! A tile row of f32 lanes in the registers of each instruction set.
//!
//! The sweep is written once over [`Lanes`]; each implementation is a handful of one-line intrinsics. All of them are
//! `inline(always)` so that they melt into the caller, which carries the `target_feature`.

use super::whole;

#[cfg(target_arch = "x86_64")]
pub(super) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(super) mod avx512;
#[cfg(target_arch = "aarch64")]
pub(super) mod neon;
pub(super) mod portable;

/// What the i16 of a list are multiplied by, two rows at a time: `high + low / 256` of a unit.
#[derive(Debug, Clone, Copy)]
pub(super) struct PairFactors<'a> {
    pub high: &'a [[i16; 2]],
    pub low: &'a [[i16; 2]],
    pub unit: f32,
}

/// Two i16 as a word, the first in its low half.
#[inline(always)]
pub(super) fn word([low, high]: [i16; 2]) -> i32 {
    i32::from(low as u16) | i32::from(high) << 16
}

/// What the i8 of a list are multiplied by, four rows at a time: whole numbers of a unit.
#[cfg_attr(not(target_arch = "x86_64"), expect(dead_code, reason = "only AVX-512 multiplies the parts"))]
#[derive(Debug, Clone, Copy)]
pub(super) struct FourFactors<'a> {
    pub values: &'a [[i16; 4]],
    /// The same in parts: 256 times a high part and the low one are a value.
    pub high: &'a [[i8; 4]],
    pub low: &'a [[i8; 4]],
    /// Sums of high and low parts.
    pub sums: [i32; 2],
    pub unit: f32,
}

/// An i8 is stored as so much more.
pub(super) const BYTE_ZERO: i32 = 128;

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
    /// A row of i16 pairs (see [`tiles`](super::tiles)), as 65536 times their value.
    unsafe fn load_pairs(from: *const i32) -> Self;
    /// Adds rows of i16, two at a time (see [`local`](super::local)), times their factors, in whole numbers of the unit.
    unsafe fn add_pairs(self, from: *const u8, factors: &PairFactors<'_>) -> Self;
    /// Adds rows of i8, four at a time, likewise.
    unsafe fn add_fours(self, from: *const u8, factors: &FourFactors<'_>) -> Self;
    /// Sixteen sums of `rows` rows of sixteen values, each row times its factor, written to `to`, unaligned: rows in turn to four sums, what is left
    /// of them to the first, and those added up.
    unsafe fn sixteen_sums(values: *const f32, factors: *const f32, rows: usize, to: *mut f32);
    /// [`whole::pairs`], with room for as many as there are factors, rounded up to sixteen.
    #[inline(always)]
    unsafe fn whole_pairs(factors: &[f32], high: &mut [i16], low: &mut [i16]) -> f32 {
        whole::pairs(factors, high, low)
    }
    /// [`whole::fours`], likewise. Values are written where [`Lanes::add_fours`] reads them.
    #[inline(always)]
    unsafe fn whole_fours(
        factors: &[f32],
        values: &mut [i16],
        high: &mut [i8],
        low: &mut [i8],
    ) -> ([i32; 2], f32) {
        whole::fours(factors, values, high, low)
    }
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
    /// Adds a row, as integers, to a checksum: a load that cannot be left out.
    unsafe fn fold(self, row: *const f32) -> Self;
}
