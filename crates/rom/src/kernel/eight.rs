//! Eight f64 in the registers of each instruction set. Products and sums are rounded separately: results are bit-identical.
//!
//! No closures around intrinsics, here and in their callers: a closure does not have the instruction set of the function that it stands
//! in, so that neither it nor the intrinsics in it would be inlined.

/// Eight values of f64.
///
/// # Safety
/// Every method needs the instruction set of the implementation.
pub(super) trait Eight: Copy {
    /// All of them `value`.
    unsafe fn splat(value: f64) -> Self;
    /// These values.
    unsafe fn load(from: &[f64; 8]) -> Self;
    /// Writes them.
    unsafe fn store(self, to: &mut [f64; 8]);
    /// `self + other`.
    unsafe fn add(self, other: Self) -> Self;
    /// `self - other`.
    unsafe fn sub(self, other: Self) -> Self;
    /// `self * other`.
    unsafe fn mul(self, other: Self) -> Self;
}

/// Plain Rust, left to the compiler.
impl Eight for [f64; 8] {
    #[inline(always)]
    unsafe fn splat(value: f64) -> Self {
        [value; 8]
    }

    #[inline(always)]
    unsafe fn load(from: &[f64; 8]) -> Self {
        *from
    }

    #[inline(always)]
    unsafe fn store(self, to: &mut [f64; 8]) {
        *to = self;
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] + other[k])
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] - other[k])
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] * other[k])
    }
}

// Register by register, without iterators: what an iterator leaves to other functions is inlined only where code generation happens to
// see both.
#[cfg(target_arch = "x86_64")]
macro_rules! registers {
    ($name:ident, $register:ty, $count:literal [$($r:literal)*], $splat:ident, $load:ident, $store:ident, $add:ident, $sub:ident, $mul:ident) => {
        /// In registers of this instruction set.
        #[derive(Clone, Copy)]
        pub(in super::super) struct $name([$register; $count]);

        // SAFETY (all methods): the trait's contract gives the instruction set; register r holds values 8 r / count and on.
        impl Eight for $name {
            #[inline(always)]
            unsafe fn splat(value: f64) -> Self {
                // SAFETY: see the impl.
                Self([unsafe { $splat(value) }; $count])
            }

            #[inline(always)]
            unsafe fn load(from: &[f64; 8]) -> Self {
                // SAFETY: see the impl.
                unsafe { Self([$($load(from.as_ptr().add(8 / $count * $r))),*]) }
            }

            #[inline(always)]
            unsafe fn store(self, to: &mut [f64; 8]) {
                // SAFETY: see the impl.
                unsafe { $($store(to.as_mut_ptr().add(8 / $count * $r), self.0[$r]);)* }
            }

            #[inline(always)]
            unsafe fn add(self, other: Self) -> Self {
                // SAFETY: see the impl.
                unsafe { Self([$($add(self.0[$r], other.0[$r])),*]) }
            }

            #[inline(always)]
            unsafe fn sub(self, other: Self) -> Self {
                // SAFETY: see the impl.
                unsafe { Self([$($sub(self.0[$r], other.0[$r])),*]) }
            }

            #[inline(always)]
            unsafe fn mul(self, other: Self) -> Self {
                // SAFETY: see the impl.
                unsafe { Self([$($mul(self.0[$r], other.0[$r])),*]) }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::Eight;
    use std::arch::x86_64::*;

    registers!(
        Avx512,
        __m512d,
        1[0],
        _mm512_set1_pd,
        _mm512_loadu_pd,
        _mm512_storeu_pd,
        _mm512_add_pd,
        _mm512_sub_pd,
        _mm512_mul_pd
    );
    registers!(
        Avx2,
        __m256d,
        2 [0 1],
        _mm256_set1_pd,
        _mm256_loadu_pd,
        _mm256_storeu_pd,
        _mm256_add_pd,
        _mm256_sub_pd,
        _mm256_mul_pd
    );
}

#[cfg(target_arch = "x86_64")]
pub(super) use x86::{Avx2, Avx512};
