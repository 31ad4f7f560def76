//! Substitute for the crate `nano-gemm-f32` in this workspace: products of small matrices of f32, which nothing here
//! computes. The real one generates some 97,000 lines that would be compiled with the linear algebra. A product that needs it
//! ends with a message instead of a result.
#![no_std]

use nano_gemm_core::{MicroKernel, MicroKernelData};

type Number = f32;

/// In the place of every kernel.
unsafe fn missing(_: &MicroKernelData<Number>, _: *mut Number, _: *const Number, _: *const Number) {
    panic!("products of f32 are left out of this build: third_party/nano-gemm-f32");
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
    pub mod f32 {
        kernels!(f32x1, 1, 4, 1);
        kernels!(f32x2, 1, 4, 2);
        kernels!(f32x4, 1, 4, 4);
        kernels!(avx, 2, 4, 8);
        kernels!(avx512, 2, 4, 16);
    }
}

pub mod aarch64 {
    pub mod f32 {
        kernels!(neon, 8, 4, 1);
    }
}
