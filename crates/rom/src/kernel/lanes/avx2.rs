//! AVX2 and FMA: four registers.

use std::arch::x86_64::*;

use super::super::TILE_NODES;
use super::Lanes;

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
}
