//! Substitute for the crate `nano-gemm-c64` in this workspace: products of small matrices of complex numbers of f64, which nothing here
//! computes. The real one generates some 97,000 lines that would be compiled with the linear algebra. A product that needs it
//! ends with a message instead of a result.
#![no_std]

use nano_gemm_core::{MicroKernel, MicroKernelData};

type Number = num_complex::Complex64;

/// In the place of every kernel.
unsafe fn missing(_: &MicroKernelData<Number>, _: *mut Number, _: *const Number, _: *const Number) {
    panic!("products of complex numbers of f64 are left out of this build: third_party/nano-gemm-c64");
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
    pub mod c64 {
        kernels!(c64x1, 1, 2, 1);
        kernels!(avx, 2, 2, 2);
        kernels!(avx512, 2, 2, 4);
    }
}

pub mod aarch64 {
    pub mod c64 {
        kernels!(neon, 2, 4, 1);
    }
}
