//! What a reconstruction needs, whatever kernel runs it: per field, a mean, modes and where its coefficients lie.
//!
//! A field is `y = mean + Phi a[coefficients]` (Eq. 7, centred), with `Phi` stored mode by mode. The optimised kernel
//! packs a [`FieldBasis`] its own way; [`reconstruct_reference`] is the plain sum it is tested against.

use std::ops::Range;

/// Where the values of one output field come from.
#[derive(Clone, Debug, PartialEq)]
pub enum FieldSource {
    /// `mean + Phi a`.
    Modes {
        /// One value a row (zeros when the POD was not centred).
        mean: Vec<f32>,
        /// `rows x modes`, one mode after the other.
        modes: Vec<f32>,
        /// Which of the regime's coefficients multiply the modes; as many as there are modes.
        coefficients: Range<usize>,
        /// Physics forbids negative values (stress): they are lifted to zero.
        non_negative: bool,
    },
    /// `|x - x0|` from three output fields of the same reconstruction.
    Magnitude {
        /// Output positions of x, y and z.
        axes: [usize; 3],
        /// Undeformed coordinates, axis by axis, one value a row.
        undeformed: [Vec<f32>; 3],
    },
}

/// The basis of one regime for one selection of fields and nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct RegimeBasis {
    /// Rows (nodes) of each field.
    pub rows: usize,
    /// Length of the regime's coefficient vector.
    pub coefficient_count: usize,
    /// Output fields in order; the output is field-major, `fields.len() * rows` long.
    pub fields: Vec<FieldSource>,
}

/// Plain reconstruction: for every field, `mean + sum_k a_k phi_k`, summed in f64, then the derived magnitudes.
///
/// `out` is field-major, `fields x rows`. Cost `O(rows x modes)`. This is the oracle for the optimised kernel.
///
/// # Panics
/// When `out` or `coefficients` do not have the length the basis states.
pub fn reconstruct_reference(basis: &RegimeBasis, coefficients: &[f64], out: &mut [f32]) {
    assert_eq!(out.len(), basis.fields.len() * basis.rows, "output length");
    assert_eq!(coefficients.len(), basis.coefficient_count, "coefficient count");
    for (f, field) in basis.fields.iter().enumerate() {
        let FieldSource::Modes { mean, modes, coefficients: range, non_negative } = field else { continue };
        let a = &coefficients[range.clone()];
        for row in 0..basis.rows {
            let sum: f64 =
                a.iter().enumerate().map(|(k, a)| a * f64::from(modes[k * basis.rows + row])).sum();
            let value = (f64::from(mean[row]) + sum) as f32;
            out[f * basis.rows + row] = if *non_negative { value.max(0.0) } else { value };
        }
    }
    for (f, field) in basis.fields.iter().enumerate() {
        let FieldSource::Magnitude { axes, undeformed } = field else { continue };
        for row in 0..basis.rows {
            let square = |k: usize| (out[axes[k] * basis.rows + row] - undeformed[k][row]).powi(2);
            out[f * basis.rows + row] = (square(0) + square(1) + square(2)).sqrt();
        }
    }
}
