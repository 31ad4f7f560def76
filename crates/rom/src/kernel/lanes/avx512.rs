//! AVX-512 F: two registers.

use std::arch::x86_64::*;

use super::super::TILE_NODES;
use super::Lanes;

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
}
