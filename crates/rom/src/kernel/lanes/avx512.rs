//! AVX-512 F: two registers.

use std::arch::x86_64::*;

use super::super::TILE_NODES;
use super::{BYTE_ZERO, FourFactors, LOW_PARTS, Lanes, Pair, word};

/// f32 a register.
const WIDTH: usize = 16;
const REGISTERS: usize = TILE_NODES / WIDTH;
const HALF: usize = REGISTERS / 2;

/// A row in registers.
#[derive(Clone, Copy)]
pub(in super::super) struct Avx512([__m512; REGISTERS]);

/// One value a register; the loop is unrolled.
#[inline(always)]
unsafe fn each(register: impl Fn(usize) -> __m512) -> Avx512 {
    // SAFETY: the caller has AVX-512 F.
    let mut all = [unsafe { _mm512_setzero_ps() }; REGISTERS];
    for (r, one) in all.iter_mut().enumerate() {
        *one = register(r);
    }
    Avx512(all)
}

// SAFETY (all methods): the trait's contract gives AVX-512 F and valid, aligned pointers to a row, of which register r
// takes elements 16 r to 16 r + 15.
impl Lanes for Avx512 {
    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|_| _mm512_set1_ps(value)) }
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|r| _mm512_load_ps(from.add(r * WIDTH))) }
    }

    #[inline(always)]
    unsafe fn load_pairs(from: *const i32) -> Self {
        // SAFETY: see the impl.
        unsafe {
            each(|r| {
                let (words, low) = if r < HALF { (r, true) } else { (r - HALF, false) };
                let pairs = _mm512_load_si512(from.add(words * WIDTH).cast());
                _mm512_cvtepi32_ps(if low { _mm512_slli_epi32::<16>(pairs) } else { pairs })
            })
        }
    }

    #[inline(always)]
    unsafe fn add_pairs(self, from: *const u8, pairs: &[Pair], unit: f32) -> Self {
        // SAFETY: see the impl; two rows of i16 are 64 words.
        unsafe {
            let mut highs = [_mm512_setzero_si512(); REGISTERS];
            let mut lows = [_mm512_setzero_si512(); REGISTERS];
            let mut from: *const i32 = from.cast();
            for pair in pairs {
                let high = _mm512_set1_epi32(word(pair.high[0], pair.high[1]));
                let low = _mm512_set1_epi32(word(pair.low[0], pair.low[1]));
                for r in 0..REGISTERS {
                    let words = _mm512_load_si512(from.add(r * WIDTH).cast());
                    highs[r] = _mm512_dpwssd_epi32(highs[r], words, high);
                    lows[r] = _mm512_dpwssd_epi32(lows[r], words, low);
                }
                from = from.add(TILE_NODES);
            }
            let (unit, part) = (_mm512_set1_ps(unit), _mm512_set1_ps(unit / LOW_PARTS));
            let mut sums = self.0;
            for r in 0..REGISTERS {
                let with_low = _mm512_fmadd_ps(_mm512_cvtepi32_ps(lows[r]), part, sums[r]);
                sums[r] = _mm512_fmadd_ps(_mm512_cvtepi32_ps(highs[r]), unit, with_low);
            }
            Self(sums)
        }
    }

    #[inline(always)]
    unsafe fn add_fours(self, from: *const u8, factors: &FourFactors<'_>) -> Self {
        // SAFETY: see the impl; four rows of bytes are 64 words.
        unsafe {
            let [high, low] = factors.sums;
            let mut highs = [_mm512_set1_epi32(-BYTE_ZERO * high); REGISTERS];
            let mut lows = [_mm512_set1_epi32(-BYTE_ZERO * low); REGISTERS];
            let mut from: *const i32 = from.cast();
            for four in factors.fours {
                let (high, low) = (_mm512_set1_epi32(four.high), _mm512_set1_epi32(four.low));
                for r in 0..REGISTERS {
                    let words = _mm512_load_si512(from.add(r * WIDTH).cast());
                    highs[r] = _mm512_dpbusd_epi32(highs[r], words, high);
                    lows[r] = _mm512_dpbusd_epi32(lows[r], words, low);
                }
                from = from.add(TILE_NODES);
            }
            let unit = _mm512_set1_ps(factors.unit);
            let mut sums = self.0;
            for r in 0..REGISTERS {
                let whole = _mm512_add_epi32(_mm512_slli_epi32::<8>(highs[r]), lows[r]);
                sums[r] = _mm512_fmadd_ps(_mm512_cvtepi32_ps(whole), unit, sums[r]);
            }
            Self(sums)
        }
    }

    #[inline(always)]
    unsafe fn sixteen_sums(values: *const f32, factors: *const f32, rows: usize, to: *mut f32) {
        // SAFETY: see the impl; there are so many rows and factors.
        unsafe {
            let mut sums = [_mm512_setzero_ps(); 4];
            let fours = rows / 4 * 4;
            for row in (0..fours).step_by(4) {
                for (k, sum) in sums.iter_mut().enumerate() {
                    let value = _mm512_load_ps(values.add((row + k) * 16));
                    *sum = _mm512_fmadd_ps(value, _mm512_set1_ps(*factors.add(row + k)), *sum);
                }
            }
            for row in fours..rows {
                let value = _mm512_load_ps(values.add(row * 16));
                sums[0] = _mm512_fmadd_ps(value, _mm512_set1_ps(*factors.add(row)), sums[0]);
            }
            let [a, b, c, d] = sums;
            _mm512_storeu_ps(to, _mm512_add_ps(_mm512_add_ps(a, b), _mm512_add_ps(c, d)));
        }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        for (r, register) in self.0.into_iter().enumerate() {
            // SAFETY: see the impl.
            unsafe { _mm512_storeu_ps(to.add(r * WIDTH), register) }
        }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|r| _mm512_fmadd_ps(self.0[r], factor.0[r], addend.0[r])) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|r| _mm512_add_ps(self.0[r], other.0[r])) }
    }

    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|r| _mm512_sqrt_ps(self.0[r])) }
    }

    #[inline(always)]
    unsafe fn at_least_zero(self) -> Self {
        // The instruction returns its second operand when either is NaN.
        // SAFETY: see the impl.
        unsafe { each(|r| _mm512_max_ps(_mm512_setzero_ps(), self.0[r])) }
    }

    #[inline(always)]
    unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self {
        // SAFETY: see the impl.
        unsafe {
            each(|r| {
                let greater = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(self.0[r], than.0[r]);
                _mm512_mask_blend_ps(greater, no.0[r], yes.0[r])
            })
        }
    }

    #[inline(always)]
    unsafe fn fold(self, row: *const f32) -> Self {
        // SAFETY: see the impl.
        unsafe {
            each(|r| {
                let words = _mm512_load_si512(row.add(r * WIDTH).cast());
                _mm512_castsi512_ps(_mm512_add_epi32(_mm512_castps_si512(self.0[r]), words))
            })
        }
    }
}
