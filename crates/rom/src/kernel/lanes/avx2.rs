//! AVX2 and FMA: two registers.

use std::arch::x86_64::*;

use super::Lanes;

/// 16 lanes in two registers.
#[derive(Clone, Copy)]
pub(in super::super) struct Avx2(__m256, __m256);

// SAFETY (all methods): the trait's contract gives AVX2, FMA and valid, aligned pointers to 16 elements, of which the
// second register takes the last 8.
impl Lanes for Avx2 {
    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        // SAFETY: see the impl.
        let register = unsafe { _mm256_set1_ps(value) };
        Self(register, register)
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: see the impl.
        unsafe { Self(_mm256_load_ps(from), _mm256_load_ps(from.add(8))) }
    }

    #[inline(always)]
    unsafe fn load_i16(from: *const i16) -> Self {
        // SAFETY: see the impl.
        unsafe {
            let low = _mm256_cvtepi16_epi32(_mm_load_si128(from.cast()));
            let high = _mm256_cvtepi16_epi32(_mm_load_si128(from.add(8).cast()));
            Self(_mm256_cvtepi32_ps(low), _mm256_cvtepi32_ps(high))
        }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: see the impl.
        unsafe {
            _mm256_storeu_ps(to, self.0);
            _mm256_storeu_ps(to.add(8), self.1);
        }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        // SAFETY: see the impl.
        unsafe {
            Self(_mm256_fmadd_ps(self.0, factor.0, addend.0), _mm256_fmadd_ps(self.1, factor.1, addend.1))
        }
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        // SAFETY: see the impl.
        unsafe { Self(_mm256_sub_ps(self.0, other.0), _mm256_sub_ps(self.1, other.1)) }
    }

    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        // SAFETY: see the impl.
        unsafe { Self(_mm256_sqrt_ps(self.0), _mm256_sqrt_ps(self.1)) }
    }

    #[inline(always)]
    unsafe fn at_least_zero(self) -> Self {
        // The instruction returns its second operand when either is NaN.
        // SAFETY: see the impl.
        unsafe {
            let zero = _mm256_setzero_ps();
            Self(_mm256_max_ps(zero, self.0), _mm256_max_ps(zero, self.1))
        }
    }

    #[inline(always)]
    unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self {
        // SAFETY: see the impl.
        unsafe {
            let low = _mm256_cmp_ps::<_CMP_GT_OQ>(self.0, than.0);
            let high = _mm256_cmp_ps::<_CMP_GT_OQ>(self.1, than.1);
            Self(_mm256_blendv_ps(no.0, yes.0, low), _mm256_blendv_ps(no.1, yes.1, high))
        }
    }

    #[inline(always)]
    unsafe fn fold_line(self, line: *const f32) -> Self {
        // SAFETY: see the impl.
        unsafe {
            let add = |sum: __m256, from: *const f32| {
                _mm256_castsi256_ps(_mm256_add_epi32(
                    _mm256_castps_si256(sum),
                    _mm256_load_si256(from.cast()),
                ))
            };
            Self(add(self.0, line), add(self.1, line.add(8)))
        }
    }
}
