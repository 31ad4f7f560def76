//! NEON: eight registers.

use std::arch::aarch64::*;

use super::super::TILE_NODES;
use super::Lanes;

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
}
