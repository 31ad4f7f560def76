//! Substitute for the crate `nano-gemm-c32` in this workspace: products of small matrices of complex numbers of f32, which nothing here
//! computes. The real one generates some 97,000 lines that would be compiled with the linear algebra. A product that needs it
//! ends with a message instead of a result.
#![no_std]

use nano_gemm_core::{MicroKernel, MicroKernelData};

type Number = num_complex::Complex32;

/// In the place of every kernel.
unsafe fn missing(_: &MicroKernelData<Number>, _: *mut Number, _: *const Number, _: *const Number) {
    panic!("products of complex numbers of f32 are left out of this build: third_party/nano-gemm-c32");
}

macro_rules! kernels {
    ($name:ident, $rows:literal, $columns:literal, $lanes:literal) => {
        pub mod $name {
            pub const MR_DIV_N: usize = $rows;
            pub const NR: usize = $columns;
            pub const N: usize = $lanes;
            pub static MICROKERNELS: [[[crate::MicroKernel<crate::Number>; $columns]; $rows]; 17] =
                [[[crate::missing; $columns]; $rows]; 17];
            pub static MASKS: [(); $lanes] = [(); $lanes];
        }
    };
}

pub mod x86 {
    pub mod c32 {
        kernels!(c32x1, 1, 2, 1);
        kernels!(c32x2, 1, 2, 2);
        kernels!(avx, 2, 2, 4);
        kernels!(avx512, 2, 2, 8);
    }
}

pub mod aarch64 {
    pub mod c32 {
        kernels!(neon, 4, 4, 1);
    }
}
