//! Eight f64 in the registers of each instruction set. Products and sums are rounded apart: all give the same bits.
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

#[cfg(target_arch = "x86_64")]
macro_rules! registers {
    ($name:ident, $register:ty, $count:literal, $splat:ident, $load:ident, $store:ident, $add:ident, $sub:ident, $mul:ident) => {
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
                let mut out = [unsafe { $load(from.as_ptr()) }; $count];
                for (r, register) in out.iter_mut().enumerate().skip(1) {
                    // SAFETY: see the impl.
                    *register = unsafe { $load(from.as_ptr().add(8 / $count * r)) };
                }
                Self(out)
            }

            #[inline(always)]
            unsafe fn store(self, to: &mut [f64; 8]) {
                for (r, register) in self.0.into_iter().enumerate() {
                    // SAFETY: see the impl.
                    unsafe { $store(to.as_mut_ptr().add(8 / $count * r), register) }
                }
            }

            #[inline(always)]
            unsafe fn add(mut self, other: Self) -> Self {
                for (own, other) in self.0.iter_mut().zip(other.0) {
                    // SAFETY: see the impl.
                    *own = unsafe { $add(*own, other) };
                }
                self
            }

            #[inline(always)]
            unsafe fn sub(mut self, other: Self) -> Self {
                for (own, other) in self.0.iter_mut().zip(other.0) {
                    // SAFETY: see the impl.
                    *own = unsafe { $sub(*own, other) };
                }
                self
            }

            #[inline(always)]
            unsafe fn mul(mut self, other: Self) -> Self {
                for (own, other) in self.0.iter_mut().zip(other.0) {
                    // SAFETY: see the impl.
                    *own = unsafe { $mul(*own, other) };
                }
                self
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
        1,
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
        2,
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
