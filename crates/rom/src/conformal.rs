//! Split-conformal half-widths from leave-one-out residuals.
//!
//! The half-width is the `ceil((n + 1) c)`-th smallest of `n` worst-node residuals: exchangeable states err by less with
//! probability at least `c`. Leave-one-out removes a neighbour from every case and so over-states the error a little; the
//! half-widths hold for the domain as a whole and do not track the local error.

use crate::datasheet::CaseError;
use crate::model::HalfWidths;

/// Half-widths for a share `coverage`, from all cases: those on the hull stand for the untouched states that lie near the edge.
pub(crate) fn halfwidths(errors: &[CaseError], coverage: f64) -> HalfWidths {
    let halfwidth = |of: fn(&CaseError) -> f64| quantile(errors.iter().map(of).collect(), coverage);
    HalfWidths {
        coverage,
        displacement_mm: halfwidth(|e| e.displacement_mm),
        stress_mpa: halfwidth(|e| e.stress_mpa),
        force_n: halfwidth(|e| e.force_n),
    }
}

/// The conformal quantile: the largest value when there are too few for the share asked.
fn quantile(mut values: Vec<f64>, coverage: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let rank = ((values.len() as f64 + 1.0) * coverage).ceil() as usize;
    values.get(rank.clamp(1, values.len().max(1)) - 1).copied().unwrap_or(f64::NAN)
}
