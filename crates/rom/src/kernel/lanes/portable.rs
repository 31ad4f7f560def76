//! A plain array, for the compiler to vectorise with what every processor of the target has.

use super::super::TILE_NODES;
use super::super::whole::LOW_PARTS;
use super::{BYTE_ZERO, FourFactors, Lanes, PairFactors};

const PAIRS: usize = TILE_NODES / 2;

/// A row in an array.
#[derive(Clone, Copy)]
pub(in super::super) struct Portable([f32; TILE_NODES]);

#[inline(always)]
fn each(value: impl Fn(usize) -> f32) -> Portable {
    let mut lanes = [0.0; TILE_NODES];
    for (i, lane) in lanes.iter_mut().enumerate() {
        *lane = value(i);
    }
    Portable(lanes)
}

// SAFETY (all methods): no instruction set is needed; the trait's contract gives pointers to a row.
impl Lanes for Portable {
    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        Self([value; TILE_NODES])
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: see the impl.
        Self(unsafe { from.cast::<[f32; TILE_NODES]>().read() })
    }

    #[inline(always)]
    unsafe fn load_pairs(from: *const i32) -> Self {
        // SAFETY: see the impl.
        let pairs = unsafe { from.cast::<[i32; PAIRS]>().read() };
        let mut lanes = [0.0; TILE_NODES];
        for (i, pair) in pairs.into_iter().enumerate() {
            lanes[i] = (pair << 16) as f32;
            lanes[PAIRS + i] = pair as f32;
        }
        Self(lanes)
    }

    #[inline(always)]
    unsafe fn add_pairs(self, from: *const u8, factors: &PairFactors<'_>) -> Self {
        let (mut highs, mut lows) = ([0; TILE_NODES], [0; TILE_NODES]);
        for (at, (high, low)) in factors.high.iter().zip(factors.low).enumerate() {
            // SAFETY: there are so many times two rows.
            let rows = unsafe { from.cast::<[[i16; 2]; TILE_NODES]>().add(at).read() };
            for (node, [a, b]) in rows.into_iter().enumerate() {
                let sum = |of: &[i16; 2]| i32::from(a) * i32::from(of[0]) + i32::from(b) * i32::from(of[1]);
                highs[node] += sum(high);
                lows[node] += sum(low);
            }
        }
        let (unit, part) = (factors.unit, factors.unit / LOW_PARTS);
        each(|i| highs[i] as f32 * unit + (lows[i] as f32 * part + self.0[i]))
    }

    #[inline(always)]
    unsafe fn add_fours(self, from: *const u8, factors: &FourFactors<'_>) -> Self {
        let [high, low] = factors.sums;
        // Sums of stored bytes may leave an i32 on the way; what is left after BYTE_ZERO was taken off does not.
        let mut wholes = [(256 * high + low).wrapping_mul(-BYTE_ZERO); TILE_NODES];
        for (at, values) in factors.values.iter().enumerate() {
            // SAFETY: there are so many times four rows.
            let rows = unsafe { from.cast::<[[u8; 4]; TILE_NODES]>().add(at).read() };
            for (whole, bytes) in wholes.iter_mut().zip(rows) {
                for (byte, factor) in bytes.into_iter().zip(values) {
                    *whole = whole.wrapping_add(i32::from(byte) * i32::from(*factor));
                }
            }
        }
        each(|i| wholes[i] as f32 * factors.unit + self.0[i])
    }

    #[inline(always)]
    unsafe fn sixteen_sums(values: *const f32, factors: *const f32, rows: usize, to: *mut f32) {
        let (mut sums, fours) = ([[0.0_f32; 16]; 4], rows / 4 * 4);
        for row in 0..rows {
            // SAFETY: there are so many rows and factors.
            let (values, factor) =
                unsafe { (values.add(row * 16).cast::<[f32; 16]>().read(), *factors.add(row)) };
            let sum = &mut sums[if row < fours { row % 4 } else { 0 }];
            sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value * factor);
        }
        let [a, b, c, d] = sums;
        // SAFETY: there are sixteen to write.
        unsafe {
            to.cast::<[f32; 16]>().write_unaligned(std::array::from_fn(|k| (a[k] + b[k]) + (c[k] + d[k])))
        }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: see the impl.
        unsafe { to.cast::<[f32; TILE_NODES]>().write_unaligned(self.0) }
    }

    /// Rounded twice: without the instruction, a fused `mul_add` is a library call a hundred times as slow.
    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        each(|i| self.0[i] * factor.0[i] + addend.0[i])
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        each(|i| self.0[i] + other.0[i])
    }

    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        each(|i| self.0[i].sqrt())
    }

    #[inline(always)]
    unsafe fn at_least_zero(self) -> Self {
        each(|i| if 0.0 > self.0[i] { 0.0 } else { self.0[i] })
    }

    #[inline(always)]
    unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self {
        each(|i| if self.0[i] > than.0[i] { yes.0[i] } else { no.0[i] })
    }

    #[inline(always)]
    unsafe fn fold(self, row: *const f32) -> Self {
        // SAFETY: see the impl.
        let words = unsafe { row.cast::<[u32; TILE_NODES]>().read() };
        each(|i| f32::from_bits(self.0[i].to_bits().wrapping_add(words[i])))
    }
}
