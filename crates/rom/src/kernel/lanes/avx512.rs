//! AVX-512 F.

use std::arch::x86_64::*;

super::registers::registers! {
    /// A row in two registers.
    Avx512: __m512, 16;
    splat _mm512_set1_ps, load _mm512_load_ps, load_words _mm512_load_si512, low _mm512_slli_epi32::<16>,
    to_floats _mm512_cvtepi32_ps, store _mm512_storeu_ps;
    mul_add _mm512_fmadd_ps, add _mm512_add_ps, sqrt _mm512_sqrt_ps,
    // It returns its second operand when either is NaN.
    at_least_zero _mm512_max_ps,
    select_greater |a, than, yes, no| _mm512_mask_blend_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(a, than), no, yes);
}
