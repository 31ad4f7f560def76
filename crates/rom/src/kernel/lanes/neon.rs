//! NEON: eight registers.

use std::arch::aarch64::*;

use super::super::TILE_NODES;
use super::super::whole::LOW_PARTS;
use super::{BYTE_ZERO, FourFactors, Lanes, PairFactors};

/// f32 a register.
const WIDTH: usize = 4;
const REGISTERS: usize = TILE_NODES / WIDTH;
const HALF: usize = REGISTERS / 2;

/// A row in registers.
#[derive(Clone, Copy)]
pub(in super::super) struct Neon([float32x4_t; REGISTERS]);

/// One value a register; the loop is unrolled.
#[inline(always)]
unsafe fn each(register: impl Fn(usize) -> float32x4_t) -> Neon {
    // SAFETY: NEON is part of every aarch64 target of Rust's standard library.
    let mut all = [unsafe { vdupq_n_f32(0.0) }; REGISTERS];
    for (r, one) in all.iter_mut().enumerate() {
        *one = register(r);
    }
    Neon(all)
}

// SAFETY (all methods): NEON is there (see `each`); the trait's contract gives valid, aligned pointers to a row, of
// which register r takes elements 4 r to 4 r + 3.
impl Lanes for Neon {
    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|_| vdupq_n_f32(value)) }
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|r| vld1q_f32(from.add(r * WIDTH))) }
    }

    #[inline(always)]
    unsafe fn load_pairs(from: *const i32) -> Self {
        // SAFETY: see the impl.
        unsafe {
            each(|r| {
                let (words, low) = if r < HALF { (r, true) } else { (r - HALF, false) };
                let pairs = vld1q_s32(from.add(words * WIDTH));
                vcvtq_f32_s32(if low { vshlq_n_s32::<16>(pairs) } else { pairs })
            })
        }
    }

    #[inline(always)]
    unsafe fn add_pairs(self, from: *const u8, factors: &PairFactors<'_>) -> Self {
        // SAFETY: see the impl; two rows of i16 are 64 words.
        unsafe {
            let (mut highs, mut lows) = ([vdupq_n_s32(0); REGISTERS], [vdupq_n_s32(0); REGISTERS]);
            let mut from: *const i32 = from.cast();
            for (high, low) in factors.high.iter().zip(factors.low) {
                let (high, low) = (high.map(i32::from), low.map(i32::from));
                for r in 0..REGISTERS {
                    let words = vld1q_s32(from.add(r * WIDTH));
                    let (first, second) =
                        (vshrq_n_s32::<16>(vshlq_n_s32::<16>(words)), vshrq_n_s32::<16>(words));
                    highs[r] = vmlaq_n_s32(vmlaq_n_s32(highs[r], first, high[0]), second, high[1]);
                    lows[r] = vmlaq_n_s32(vmlaq_n_s32(lows[r], first, low[0]), second, low[1]);
                }
                from = from.add(TILE_NODES);
            }
            let (unit, part) = (vdupq_n_f32(factors.unit), vdupq_n_f32(factors.unit / LOW_PARTS));
            let mut sums = self.0;
            for r in 0..REGISTERS {
                let with_low = vfmaq_f32(sums[r], vcvtq_f32_s32(lows[r]), part);
                sums[r] = vfmaq_f32(with_low, vcvtq_f32_s32(highs[r]), unit);
            }
            Self(sums)
        }
    }

    #[inline(always)]
    unsafe fn add_fours(self, from: *const u8, factors: &FourFactors<'_>) -> Self {
        // SAFETY: see the impl; four rows of bytes are 64 words.
        unsafe {
            let [high, low] = factors.sums;
            let mut wholes = [vdupq_n_s32((256 * high + low).wrapping_mul(-BYTE_ZERO)); REGISTERS];
            let byte = vdupq_n_u32(0xff);
            let mut from: *const u32 = from.cast();
            for values in factors.values {
                let [a, b, c, d] = values.map(i32::from);
                for (r, whole) in wholes.iter_mut().enumerate() {
                    let words = vld1q_u32(from.add(r * WIDTH));
                    let bytes = |shifted| vreinterpretq_s32_u32(vandq_u32(shifted, byte));
                    *whole = vmlaq_n_s32(*whole, bytes(words), a);
                    *whole = vmlaq_n_s32(*whole, bytes(vshrq_n_u32::<8>(words)), b);
                    *whole = vmlaq_n_s32(*whole, bytes(vshrq_n_u32::<16>(words)), c);
                    *whole = vmlaq_n_s32(*whole, bytes(vshrq_n_u32::<24>(words)), d);
                }
                from = from.add(TILE_NODES);
            }
            let unit = vdupq_n_f32(factors.unit);
            let mut sums = self.0;
            for r in 0..REGISTERS {
                sums[r] = vfmaq_f32(sums[r], vcvtq_f32_s32(wholes[r]), unit);
            }
            Self(sums)
        }
    }

    #[inline(always)]
    unsafe fn sixteen_sums(values: *const f32, factors: *const f32, rows: usize, to: *mut f32) {
        // SAFETY: see the impl; there are so many rows and factors.
        unsafe {
            let fours = rows / 4 * 4;
            for part in (0..16).step_by(WIDTH) {
                let mut sums = [vdupq_n_f32(0.0); 4];
                for row in (0..fours).step_by(4) {
                    for (k, sum) in sums.iter_mut().enumerate() {
                        let value = vld1q_f32(values.add((row + k) * 16 + part));
                        *sum = vfmaq_f32(*sum, value, vdupq_n_f32(*factors.add(row + k)));
                    }
                }
                for row in fours..rows {
                    let value = vld1q_f32(values.add(row * 16 + part));
                    sums[0] = vfmaq_f32(sums[0], value, vdupq_n_f32(*factors.add(row)));
                }
                let [a, b, c, d] = sums;
                vst1q_f32(to.add(part), vaddq_f32(vaddq_f32(a, b), vaddq_f32(c, d)));
            }
        }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        for (r, register) in self.0.into_iter().enumerate() {
            // SAFETY: see the impl.
            unsafe { vst1q_f32(to.add(r * WIDTH), register) }
        }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|r| vfmaq_f32(addend.0[r], self.0[r], factor.0[r])) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|r| vaddq_f32(self.0[r], other.0[r])) }
    }

    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|r| vsqrtq_f32(self.0[r])) }
    }

    #[inline(always)]
    unsafe fn at_least_zero(self) -> Self {
        // The instruction returns NaN when either operand is NaN.
        // SAFETY: see the impl.
        unsafe { each(|r| vmaxq_f32(vdupq_n_f32(0.0), self.0[r])) }
    }

    #[inline(always)]
    unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|r| vbslq_f32(vcgtq_f32(self.0[r], than.0[r]), yes.0[r], no.0[r])) }
    }

    #[inline(always)]
    unsafe fn fold(self, row: *const f32) -> Self {
        // SAFETY: see the impl.
        unsafe {
            each(|r| {
                let words = vld1q_u32(row.cast::<u32>().add(r * WIDTH));
                vreinterpretq_f32_u32(vaddq_u32(vreinterpretq_u32_f32(self.0[r]), words))
            })
        }
    }
}
