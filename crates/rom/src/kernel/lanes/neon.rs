//! NEON, part of every aarch64 target of Rust's standard library.

use std::arch::aarch64::*;

super::registers::registers! {
    /// A row in eight registers.
    Neon: float32x4_t, 4;
    splat vdupq_n_f32, load vld1q_f32, load_words vld1q_s32, low vshlq_n_s32::<16>, to_floats vcvtq_f32_s32, store vst1q_f32;
    mul_add |a, factor, addend| vfmaq_f32(addend, a, factor), add vaddq_f32, sqrt vsqrtq_f32,
    // It returns NaN when either operand is NaN.
    at_least_zero vmaxq_f32,
    select_greater |a, than, yes, no| vbslq_f32(vcgtq_f32(a, than), yes, no);
}
