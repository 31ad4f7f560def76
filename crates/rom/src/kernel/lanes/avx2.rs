//! AVX2 and FMA: four registers.

use std::arch::x86_64::*;

use super::super::TILE_NODES;
use super::super::whole::LOW_PARTS;
use super::{BYTE_ZERO, FourFactors, Lanes, PairFactors, word};

/// f32 a register.
const WIDTH: usize = 8;
const REGISTERS: usize = TILE_NODES / WIDTH;
const HALF: usize = REGISTERS / 2;

/// A row in registers.
#[derive(Clone, Copy)]
pub(in super::super) struct Avx2([__m256; REGISTERS]);

/// One value a register; the loop is unrolled.
#[inline(always)]
unsafe fn each(register: impl Fn(usize) -> __m256) -> Avx2 {
    // SAFETY: the caller has AVX2.
    let mut all = [unsafe { _mm256_setzero_ps() }; REGISTERS];
    for (r, one) in all.iter_mut().enumerate() {
        *one = register(r);
    }
    Avx2(all)
}

// SAFETY (all methods): the trait's contract gives AVX2, FMA and valid, aligned pointers to a row, of which register r
// takes elements 8 r to 8 r + 7.
impl Lanes for Avx2 {
    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|_| _mm256_set1_ps(value)) }
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|r| _mm256_load_ps(from.add(r * WIDTH))) }
    }

    #[inline(always)]
    unsafe fn load_pairs(from: *const i32) -> Self {
        // SAFETY: see the impl.
        unsafe {
            each(|r| {
                let (words, low) = if r < HALF { (r, true) } else { (r - HALF, false) };
                let pairs = _mm256_load_si256(from.add(words * WIDTH).cast());
                _mm256_cvtepi32_ps(if low { _mm256_slli_epi32::<16>(pairs) } else { pairs })
            })
        }
    }

    #[inline(always)]
    unsafe fn add_pairs(self, from: *const u8, factors: &PairFactors<'_>) -> Self {
        // SAFETY: see the impl; two rows of i16 are 64 words.
        unsafe {
            let mut highs = [_mm256_setzero_si256(); REGISTERS];
            let mut lows = [_mm256_setzero_si256(); REGISTERS];
            let mut from: *const i32 = from.cast();
            for (high, low) in factors.high.iter().zip(factors.low) {
                let (high, low) = (_mm256_set1_epi32(word(*high)), _mm256_set1_epi32(word(*low)));
                for r in 0..REGISTERS {
                    let words = _mm256_load_si256(from.add(r * WIDTH).cast());
                    highs[r] = _mm256_add_epi32(highs[r], _mm256_madd_epi16(words, high));
                    lows[r] = _mm256_add_epi32(lows[r], _mm256_madd_epi16(words, low));
                }
                from = from.add(TILE_NODES);
            }
            let (unit, part) = (_mm256_set1_ps(factors.unit), _mm256_set1_ps(factors.unit / LOW_PARTS));
            let mut sums = self.0;
            for r in 0..REGISTERS {
                let with_low = _mm256_fmadd_ps(_mm256_cvtepi32_ps(lows[r]), part, sums[r]);
                sums[r] = _mm256_fmadd_ps(_mm256_cvtepi32_ps(highs[r]), unit, with_low);
            }
            Self(sums)
        }
    }

    #[inline(always)]
    unsafe fn add_fours(self, from: *const u8, factors: &FourFactors<'_>) -> Self {
        // SAFETY: see the impl; four rows of bytes are 64 words.
        unsafe {
            let [high, low] = factors.sums;
            let mut wholes = [_mm256_set1_epi32((256 * high + low).wrapping_mul(-BYTE_ZERO)); REGISTERS];
            let every_second = _mm256_set1_epi16(0xff);
            let mut from: *const i32 = from.cast();
            for [a, b, c, d] in factors.values {
                let even = _mm256_set1_epi32(word([*a, *c]));
                let odd = _mm256_set1_epi32(word([*b, *d]));
                for (r, whole) in wholes.iter_mut().enumerate() {
                    let words = _mm256_load_si256(from.add(r * WIDTH).cast());
                    let evens = _mm256_madd_epi16(_mm256_and_si256(words, every_second), even);
                    let odds = _mm256_madd_epi16(_mm256_srli_epi16::<8>(words), odd);
                    *whole = _mm256_add_epi32(*whole, _mm256_add_epi32(evens, odds));
                }
                from = from.add(TILE_NODES);
            }
            let unit = _mm256_set1_ps(factors.unit);
            let mut sums = self.0;
            for r in 0..REGISTERS {
                sums[r] = _mm256_fmadd_ps(_mm256_cvtepi32_ps(wholes[r]), unit, sums[r]);
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
                let mut sums = [_mm256_setzero_ps(); 4];
                for row in (0..fours).step_by(4) {
                    for (k, sum) in sums.iter_mut().enumerate() {
                        let value = _mm256_load_ps(values.add((row + k) * 16 + part));
                        *sum = _mm256_fmadd_ps(value, _mm256_set1_ps(*factors.add(row + k)), *sum);
                    }
                }
                for row in fours..rows {
                    let value = _mm256_load_ps(values.add(row * 16 + part));
                    sums[0] = _mm256_fmadd_ps(value, _mm256_set1_ps(*factors.add(row)), sums[0]);
                }
                let [a, b, c, d] = sums;
                _mm256_storeu_ps(to.add(part), _mm256_add_ps(_mm256_add_ps(a, b), _mm256_add_ps(c, d)));
            }
        }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        for (r, register) in self.0.into_iter().enumerate() {
            // SAFETY: see the impl.
            unsafe { _mm256_storeu_ps(to.add(r * WIDTH), register) }
        }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|r| _mm256_fmadd_ps(self.0[r], factor.0[r], addend.0[r])) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|r| _mm256_add_ps(self.0[r], other.0[r])) }
    }

    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        // SAFETY: see the impl.
        unsafe { each(|r| _mm256_sqrt_ps(self.0[r])) }
    }

    #[inline(always)]
    unsafe fn at_least_zero(self) -> Self {
        // The instruction returns its second operand when either is NaN.
        // SAFETY: see the impl.
        unsafe { each(|r| _mm256_max_ps(_mm256_setzero_ps(), self.0[r])) }
    }

    #[inline(always)]
    unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self {
        // SAFETY: see the impl.
        unsafe {
            each(|r| {
                let greater = _mm256_cmp_ps::<_CMP_GT_OQ>(self.0[r], than.0[r]);
                _mm256_blendv_ps(no.0[r], yes.0[r], greater)
            })
        }
    }

    #[inline(always)]
    unsafe fn fold(self, row: *const f32) -> Self {
        // SAFETY: see the impl.
        unsafe {
            each(|r| {
                let words = _mm256_load_si256(row.add(r * WIDTH).cast());
                _mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(self.0[r]), words))
            })
        }
    }
}
