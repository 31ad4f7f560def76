//! AVX-512 F: one register.

use std::arch::x86_64::*;

use super::Lanes;

/// 16 lanes in one register.
#[derive(Clone, Copy)]
pub(in super::super) struct Avx512(__m512);

// SAFETY (all methods): the trait's contract gives AVX-512 F and valid, aligned pointers.
impl Lanes for Avx512 {
    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        // SAFETY: see the impl.
        Self(unsafe { _mm512_set1_ps(value) })
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: see the impl.
        Self(unsafe { _mm512_load_ps(from) })
    }

    #[inline(always)]
    unsafe fn load_i16(from: *const i16) -> Self {
        // SAFETY: see the impl.
        Self(unsafe { _mm512_cvtepi32_ps(_mm512_cvtepi16_epi32(_mm256_load_si256(from.cast()))) })
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: see the impl.
        unsafe { _mm512_storeu_ps(to, self.0) }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        // SAFETY: see the impl.
        Self(unsafe { _mm512_fmadd_ps(self.0, factor.0, addend.0) })
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        // SAFETY: see the impl.
        Self(unsafe { _mm512_sub_ps(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        // SAFETY: see the impl.
        Self(unsafe { _mm512_sqrt_ps(self.0) })
    }

    #[inline(always)]
    unsafe fn at_least_zero(self) -> Self {
        // The instruction returns its second operand when either is NaN.
        // SAFETY: see the impl.
        Self(unsafe { _mm512_max_ps(_mm512_setzero_ps(), self.0) })
    }

    #[inline(always)]
    unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self {
        // SAFETY: see the impl.
        Self(unsafe {
            let greater = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(self.0, than.0);
            _mm512_mask_blend_ps(greater, no.0, yes.0)
        })
    }

    #[inline(always)]
    unsafe fn fold_line(self, line: *const f32) -> Self {
        // SAFETY: see the impl.
        Self(unsafe {
            let sum = _mm512_add_epi32(_mm512_castps_si512(self.0), _mm512_load_si512(line.cast()));
            _mm512_castsi512_ps(sum)
        })
    }
}
