//! A tile row of f32 lanes in the registers of each instruction set.
//!
//! The sweep is written once over [`Lanes`]; each implementation is a handful of one-line intrinsics. All of them are
//! `inline(always)` so that they melt into the caller, which carries the `target_feature`.

use super::TILE_NODES;

/// [`TILE_NODES`] values of f32.
///
/// # Safety
/// Every method needs the instruction set of the implementation; those that take a pointer need it valid for
/// a row, and aligned to a cache line for loads.
pub(super) trait Lanes: Copy {
    /// All lanes `value`, bit for bit.
    unsafe fn splat(value: f32) -> Self;
    /// A row of f32.
    unsafe fn load(from: *const f32) -> Self;
    /// A row of integers of 4, 8 or 16 bits (see [`modes`](super::modes)), each at the top of a word of 32 bits.
    unsafe fn load_integers<const BITS: usize>(from: *const u8) -> Self;
    /// Writes a row of f32, unaligned.
    unsafe fn store(self, to: *mut f32);
    /// `self * factor + addend`.
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self;
    /// `self + other`.
    unsafe fn add(self, other: Self) -> Self;
    /// Square root, correctly rounded.
    unsafe fn sqrt(self) -> Self;
    /// `max(self, 0)`; NaN stays NaN, so that a damaged input cannot pass for a number.
    unsafe fn at_least_zero(self) -> Self;
    /// Per lane: `self > than ? yes : no`, the bits of `yes` and `no` untouched.
    unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self;
}

/// A row of which register `r` is `$one`. Not a closure: that would be a function without the instruction set of the one it stands in, and
/// intrinsics would not be inlined.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
macro_rules! each {
    ($splat:expr, $r:ident => $one:expr) => {{
        let mut all = [$splat(0.0); REGISTERS];
        let mut $r = 0;
        while $r < REGISTERS {
            all[$r] = $one;
            $r += 1;
        }
        Self(all)
    }};
}

/// Defines the lanes of an instruction set: registers, their f32, what guarantees it, and its intrinsics, one call a register.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
macro_rules! registers {
    (
        $(#[doc = $about:literal])+
        $name:ident: $register:ty, $width:literal;
        splat $splat:expr, load $load:expr, load_words $load_words:expr, load_halves $load_halves:expr, shift $shift:ident, to_floats $to_floats:expr, store $store:expr;
        mul_add $mul_add:expr, add $add:expr, sqrt $sqrt:expr, at_least_zero $at_least_zero:expr, select_greater $select:expr;
    ) => {
        use super::super::TILE_NODES;

        const WIDTH: usize = $width;
        const REGISTERS: usize = TILE_NODES / WIDTH;

        $(#[doc = $about])+
        #[derive(Clone, Copy)]
        pub(in super::super) struct $name([$register; REGISTERS]);

        // SAFETY (all methods): the trait's contract gives the instruction set and valid, aligned pointers to a row, of which register
        // r takes the elements from r WIDTH on.
        impl super::Lanes for $name {
            #[inline(always)]
            unsafe fn splat(value: f32) -> Self {
                // SAFETY: see the impl.
                unsafe { each!($splat, r => $splat(value)) }
            }

            #[inline(always)]
            unsafe fn load(from: *const f32) -> Self {
                // SAFETY: see the impl.
                unsafe { each!($splat, r => $load(from.add(r * WIDTH))) }
            }

            #[inline(always)]
            unsafe fn load_integers<const BITS: usize>(from: *const u8) -> Self {
                // SAFETY: see the impl.
                unsafe {
                    each!($splat, r => {
                        let of_words = if BITS == 16 { REGISTERS / 2 } else { REGISTERS / 4 };
                        let (at, below) = (r % of_words, r / of_words);
                        let words = if BITS == 4 {
                            $load_halves(from.add(2 * at * WIDTH).cast())
                        } else {
                            $load_words(from.add(4 * at * WIDTH).cast())
                        };
                        // Constant in the unrolled loop.
                        $to_floats(match 32 - BITS * (below + 1) {
                            0 => words,
                            8 => $shift::<8>(words),
                            16 => $shift::<16>(words),
                            20 => $shift::<20>(words),
                            24 => $shift::<24>(words),
                            _ => $shift::<28>(words),
                        })
                    })
                }
            }

            #[inline(always)]
            unsafe fn store(self, to: *mut f32) {
                for (r, register) in self.0.into_iter().enumerate() {
                    // SAFETY: see the impl.
                    unsafe { $store(to.add(r * WIDTH), register) }
                }
            }

            #[inline(always)]
            unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
                // SAFETY: see the impl.
                unsafe { each!($splat, r => $mul_add(self.0[r], factor.0[r], addend.0[r])) }
            }

            #[inline(always)]
            unsafe fn add(self, other: Self) -> Self {
                // SAFETY: see the impl.
                unsafe { each!($splat, r => $add(self.0[r], other.0[r])) }
            }

            #[inline(always)]
            unsafe fn sqrt(self) -> Self {
                // SAFETY: see the impl.
                unsafe { each!($splat, r => $sqrt(self.0[r])) }
            }

            #[inline(always)]
            unsafe fn at_least_zero(self) -> Self {
                // SAFETY: see the impl.
                unsafe { each!($splat, r => $at_least_zero($splat(0.0), self.0[r])) }
            }

            #[inline(always)]
            unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self {
                // SAFETY: see the impl.
                unsafe { each!($splat, r => $select(self.0[r], than.0[r], yes.0[r], no.0[r])) }
            }
        }
    };
}

/// AVX-512 F.
#[cfg(target_arch = "x86_64")]
pub(super) mod avx512 {
    use std::arch::x86_64::*;

    #[inline(always)]
    unsafe fn load_halves(from: *const __m256i) -> __m512i {
        // SAFETY: that of the row they are part of.
        unsafe { _mm512_cvtepi16_epi32(_mm256_load_si256(from)) }
    }

    registers! {
        /// A row in two registers.
        Avx512: __m512, 16;
        splat _mm512_set1_ps, load _mm512_load_ps, load_words _mm512_load_si512,
        load_halves load_halves, shift _mm512_slli_epi32,
        to_floats _mm512_cvtepi32_ps, store _mm512_storeu_ps;
        mul_add _mm512_fmadd_ps, add _mm512_add_ps, sqrt _mm512_sqrt_ps,
        // It returns its second operand when either is NaN.
        at_least_zero _mm512_max_ps,
        select_greater |a, than, yes, no| _mm512_mask_blend_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(a, than), no, yes);
    }
}

/// AVX2 and FMA.
#[cfg(target_arch = "x86_64")]
pub(super) mod avx2 {
    use std::arch::x86_64::*;

    #[inline(always)]
    unsafe fn load_halves(from: *const __m128i) -> __m256i {
        // SAFETY: that of the row they are part of.
        unsafe { _mm256_cvtepi16_epi32(_mm_load_si128(from)) }
    }

    registers! {
        /// A row in four registers.
        Avx2: __m256, 8;
        splat _mm256_set1_ps, load _mm256_load_ps, load_words _mm256_load_si256,
        load_halves load_halves, shift _mm256_slli_epi32,
        to_floats _mm256_cvtepi32_ps, store _mm256_storeu_ps;
        mul_add _mm256_fmadd_ps, add _mm256_add_ps, sqrt _mm256_sqrt_ps,
        // It returns its second operand when either is NaN.
        at_least_zero _mm256_max_ps,
        select_greater |a, than, yes, no| _mm256_blendv_ps(no, yes, _mm256_cmp_ps::<_CMP_GT_OQ>(a, than));
    }
}

/// NEON, part of every aarch64 target of Rust's standard library.
#[cfg(target_arch = "aarch64")]
pub(super) mod neon {
    use std::arch::aarch64::*;

    #[inline(always)]
    unsafe fn load_halves(from: *const i16) -> int32x4_t {
        // SAFETY: that of the row they are part of.
        unsafe { vmovl_s16(vld1_s16(from)) }
    }

    registers! {
        /// A row in eight registers.
        Neon: float32x4_t, 4;
        splat vdupq_n_f32, load vld1q_f32, load_words vld1q_s32,
        load_halves load_halves, shift vshlq_n_s32, to_floats vcvtq_f32_s32, store vst1q_f32;
        mul_add |a, factor, addend| vfmaq_f32(addend, a, factor), add vaddq_f32, sqrt vsqrtq_f32,
        // It returns NaN when either operand is NaN.
        at_least_zero vmaxq_f32,
        select_greater |a, than, yes, no| vbslq_f32(vcgtq_f32(a, than), yes, no);
    }
}

/// A row in a plain array, for the compiler to vectorise with what every processor of the target has.
#[derive(Clone, Copy)]
pub(super) struct Portable([f32; TILE_NODES]);

#[inline(always)]
fn portable(value: impl Fn(usize) -> f32) -> Portable {
    let mut lanes = [0.0; TILE_NODES];
    for (i, lane) in lanes.iter_mut().enumerate() {
        *lane = value(i);
    }
    Portable(lanes)
}

// SAFETY (all methods): no instruction set is needed; the trait's contract gives pointers to a row.
impl Lanes for Portable {
    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        Self([value; TILE_NODES])
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: see the impl.
        Self(unsafe { from.cast::<[f32; TILE_NODES]>().read() })
    }

    #[inline(always)]
    unsafe fn load_integers<const BITS: usize>(from: *const u8) -> Self {
        let mut lanes = [0.0; TILE_NODES];
        let words = if BITS == 16 { TILE_NODES / 2 } else { TILE_NODES / 4 };
        for below in 0..TILE_NODES / words {
            let shift = 32 - BITS * (below + 1);
            for i in 0..words {
                // SAFETY: see the impl.
                let word = unsafe {
                    if BITS == 4 {
                        i32::from(from.cast::<i16>().add(i).read())
                    } else {
                        from.cast::<i32>().add(i).read()
                    }
                };
                lanes[below * words + i] = (word << shift) as f32;
            }
        }
        Self(lanes)
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: see the impl.
        unsafe { to.cast::<[f32; TILE_NODES]>().write_unaligned(self.0) }
    }

    /// Rounded twice: without the instruction, a fused `mul_add` is a library call a hundred times as slow.
    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        portable(|i| self.0[i] * factor.0[i] + addend.0[i])
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        portable(|i| self.0[i] + other.0[i])
    }

    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        portable(|i| self.0[i].sqrt())
    }

    #[inline(always)]
    unsafe fn at_least_zero(self) -> Self {
        portable(|i| if 0.0 > self.0[i] { 0.0 } else { self.0[i] })
    }

    #[inline(always)]
    unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self {
        portable(|i| if self.0[i] > than.0[i] { yes.0[i] } else { no.0[i] })
    }
}
