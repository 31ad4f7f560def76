//! AVX2 and FMA.

use std::arch::x86_64::*;

super::registers::registers! {
    /// A row in four registers.
    Avx2: __m256, 8;
    splat _mm256_set1_ps, load _mm256_load_ps, load_words _mm256_load_si256, low _mm256_slli_epi32::<16>,
    to_floats _mm256_cvtepi32_ps, store _mm256_storeu_ps;
    mul_add _mm256_fmadd_ps, add _mm256_add_ps, sqrt _mm256_sqrt_ps,
    // It returns its second operand when either is NaN.
    at_least_zero _mm256_max_ps,
    select_greater |a, than, yes, no| _mm256_blendv_ps(no, yes, _mm256_cmp_ps::<_CMP_GT_OQ>(a, than));
}
