//! AVX-512 F: two registers.

use std::arch::x86_64::*;

use super::super::TILE_NODES;
use super::super::whole::{self, LOW_PARTS};
use super::{BYTE_ZERO, FourFactors, Lanes, PairFactors, word};

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

/// Four i8 as a word, the first in its lowest byte.
#[inline(always)]
fn bytes(of: [i8; 4]) -> i32 {
    i32::from_le_bytes(of.map(|value| value as u8))
}

/// Sixteen values from place `at` on; what is beyond the last is 0, and not read.
#[inline(always)]
unsafe fn sixteen(values: &[f32], at: usize) -> __m512 {
    let left = values.len() - at;
    let those = if left < WIDTH { (1 << left) - 1 } else { u16::MAX };
    // SAFETY: the caller has AVX-512 F, and `at` is the place of a value.
    unsafe { _mm512_maskz_loadu_ps(those, values.as_ptr().add(at)) }
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
    unsafe fn add_pairs(self, from: *const u8, factors: &PairFactors<'_>) -> Self {
        // SAFETY: see the impl; two rows of i16 are 64 words.
        unsafe {
            let mut highs = [_mm512_setzero_si512(); REGISTERS];
            let mut lows = [_mm512_setzero_si512(); REGISTERS];
            let mut from: *const i32 = from.cast();
            for (high, low) in factors.high.iter().zip(factors.low) {
                let (high, low) = (_mm512_set1_epi32(word(*high)), _mm512_set1_epi32(word(*low)));
                for r in 0..REGISTERS {
                    let words = _mm512_load_si512(from.add(r * WIDTH).cast());
                    highs[r] = _mm512_dpwssd_epi32(highs[r], words, high);
                    lows[r] = _mm512_dpwssd_epi32(lows[r], words, low);
                }
                from = from.add(TILE_NODES);
            }
            let (unit, part) = (_mm512_set1_ps(factors.unit), _mm512_set1_ps(factors.unit / LOW_PARTS));
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
            for (high, low) in factors.high.iter().zip(factors.low) {
                let (high, low) = (_mm512_set1_epi32(bytes(*high)), _mm512_set1_epi32(bytes(*low)));
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
    unsafe fn whole_pairs(factors: &[f32], high: &mut [i16], low: &mut [i16]) -> f32 {
        // SAFETY: see the impl; there is room for sixteen at each place.
        unsafe {
            let mut sums = _mm512_setzero_ps();
            for at in (0..factors.len()).step_by(WIDTH) {
                sums = _mm512_add_ps(sums, _mm512_abs_ps(sixteen(factors, at)));
            }
            let sum = _mm512_reduce_add_ps(sums);
            let (by, unit) = whole::scale(whole::PAIRS_MAX, sum, sum);
            let parts = _mm512_set1_ps(LOW_PARTS);
            for at in (0..factors.len()).step_by(WIDTH) {
                let steps = _mm512_mul_ps(sixteen(factors, at), _mm512_set1_ps(by));
                let wholes = _mm512_cvtps_epi32(steps);
                let rest = _mm512_mul_ps(_mm512_sub_ps(steps, _mm512_cvtepi32_ps(wholes)), parts);
                let (high, low) = (high.as_mut_ptr().add(at), low.as_mut_ptr().add(at));
                _mm256_storeu_si256(high.cast(), _mm512_cvtepi32_epi16(wholes));
                _mm256_storeu_si256(low.cast(), _mm512_cvtepi32_epi16(_mm512_cvtps_epi32(rest)));
            }
            unit
        }
    }

    #[inline(always)]
    unsafe fn whole_fours(
        factors: &[f32],
        _: &mut [i16],
        high: &mut [i8],
        low: &mut [i8],
    ) -> ([i32; 2], f32) {
        // SAFETY: see the impl; there is room for sixteen at each place.
        unsafe {
            let (mut sizes, mut largest) = (_mm512_setzero_ps(), _mm512_setzero_ps());
            for at in (0..factors.len()).step_by(WIDTH) {
                let size = _mm512_abs_ps(sixteen(factors, at));
                sizes = _mm512_add_ps(sizes, size);
                largest = _mm512_max_ps(largest, size);
            }
            let (sum, largest) = (_mm512_reduce_add_ps(sizes), _mm512_reduce_max_ps(largest));
            let (by, unit) = whole::scale(whole::FOURS_MAX, largest, sum);
            let mut sums = [_mm512_setzero_si512(); 2];
            for at in (0..factors.len()).step_by(WIDTH) {
                let steps = _mm512_mul_ps(sixteen(factors, at), _mm512_set1_ps(by));
                let wholes = _mm512_cvtps_epi32(steps);
                let of_256 = _mm512_srai_epi32::<8>(_mm512_add_epi32(wholes, _mm512_set1_epi32(128)));
                let rest = _mm512_sub_epi32(wholes, _mm512_slli_epi32::<8>(of_256));
                sums = [_mm512_add_epi32(sums[0], of_256), _mm512_add_epi32(sums[1], rest)];
                let (high, low) = (high.as_mut_ptr().add(at), low.as_mut_ptr().add(at));
                _mm_storeu_si128(high.cast(), _mm512_cvtepi32_epi8(of_256));
                _mm_storeu_si128(low.cast(), _mm512_cvtepi32_epi8(rest));
            }
            ([_mm512_reduce_add_epi32(sums[0]), _mm512_reduce_add_epi32(sums[1])], unit)
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
