//! NEON: four registers.

use std::arch::aarch64::*;

use super::Lanes;

/// 16 lanes in four registers.
#[derive(Clone, Copy)]
pub(in super::super) struct Neon([float32x4_t; 4]);

/// One value a register.
#[inline(always)]
fn each(register: impl Fn(usize) -> float32x4_t) -> Neon {
    Neon([register(0), register(1), register(2), register(3)])
}

// SAFETY (all methods): NEON is part of every aarch64 target of Rust's standard library; the trait's contract gives
// pointers to 16 elements, of which register r takes elements 4r to 4r + 3.
impl Lanes for Neon {
    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        // SAFETY: see the impl.
        each(|_| unsafe { vdupq_n_f32(value) })
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: see the impl.
        each(|r| unsafe { vld1q_f32(from.add(4 * r)) })
    }

    #[inline(always)]
    unsafe fn load_i16(from: *const i16) -> Self {
        // SAFETY: see the impl.
        each(|r| unsafe { vcvtq_f32_s32(vmovl_s16(vld1_s16(from.add(4 * r)))) })
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        for (r, register) in self.0.into_iter().enumerate() {
            // SAFETY: see the impl.
            unsafe { vst1q_f32(to.add(4 * r), register) }
        }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        // SAFETY: see the impl.
        each(|r| unsafe { vfmaq_f32(addend.0[r], self.0[r], factor.0[r]) })
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        // SAFETY: see the impl.
        each(|r| unsafe { vsubq_f32(self.0[r], other.0[r]) })
    }

    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        // SAFETY: see the impl.
        each(|r| unsafe { vsqrtq_f32(self.0[r]) })
    }

    #[inline(always)]
    unsafe fn at_least_zero(self) -> Self {
        // The instruction returns NaN when either operand is NaN.
        // SAFETY: see the impl.
        each(|r| unsafe { vmaxq_f32(vdupq_n_f32(0.0), self.0[r]) })
    }

    #[inline(always)]
    unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self {
        // SAFETY: see the impl.
        each(|r| unsafe { vbslq_f32(vcgtq_f32(self.0[r], than.0[r]), yes.0[r], no.0[r]) })
    }

    #[inline(always)]
    unsafe fn fold_line(self, line: *const f32) -> Self {
        // SAFETY: see the impl.
        each(|r| unsafe {
            let line = vld1q_u32(line.cast::<u32>().add(4 * r));
            vreinterpretq_f32_u32(vaddq_u32(vreinterpretq_u32_f32(self.0[r]), line))
        })
    }
}
