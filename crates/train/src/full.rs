//! Leave-one-out with the POD redone for every left-out case: what the closed form leaves out, and at what price.
//!
//! All snapshots are columns of `Q R`, so dropping a case means dropping a column of `R`, centring again and repeating a
//! small SVD: `O(m^3)` a case instead of `O(n m^2)`. Interpolation is linear in its data: the prediction of the left-out
//! column from the others, before truncation, is the column minus its closed-form residual. It is then truncated to the
//! basis the other cases span. Exact for kernels that reproduce constants (any tail but none).

use crate::config::KernelSpec;
use crate::fit::{Samples, fit};
use crate::pod::{Compact, decompose};
use crate::select::States;
use faer::{Col, Mat};
use rom::interpolant::Interpolant;

/// Mean over the scored states of `|r_i - mean - U U^T (p_i - mean)|`; none when the chosen kernel cannot be refitted.
pub(crate) fn full_leave_one_out(
    compact: &Compact,
    centred: bool,
    modes: usize,
    chosen: &Interpolant,
    states: States,
) -> Option<f64> {
    let r = &compact.r;
    let (rank, m, all) = (r.nrows(), states.inputs.len(), r.ncols()); // beyond the states: directions, without a mean
    let values: Vec<f64> = (0..m).flat_map(|j| r.col(j).iter().copied().collect::<Vec<_>>()).collect();
    let samples = Samples {
        dimensions: states.dimensions,
        inputs: states.inputs,
        values: &values,
        outputs: rank,
        slopes: &[],
        slope_values: &[],
    };
    let spec = KernelSpec { kernel: chosen.kernel, tail: chosen.tail };
    let residuals = fit(&samples, spec, chosen.metric, chosen.smoothing).ok()?.residuals;
    let scored: Vec<usize> = (0..m).filter(|&i| states.score[i] > 0.0).collect();
    let mut total = 0.0;
    for &i in &scored {
        let others: Vec<usize> = (0..all).filter(|&j| j != i).collect();
        let mean = Col::from_fn(rank, |k| match centred {
            true => others.iter().filter(|j| **j < m).map(|&j| r[(k, j)]).sum::<f64>() / (m - 1) as f64,
            false => 0.0,
        });
        let deviation = |k: usize, j: usize| r[(k, j)] - if j < m { mean[k] } else { 0.0 };
        let rest = Mat::from_fn(rank, others.len(), |k, j| deviation(k, others[j]));
        let pod = decompose(rest.as_ref()).ok()?;
        let u = pod.u.get(.., ..modes.min(pod.rank));
        let truth = r.col(i) - &mean;
        let predicted = Col::from_fn(rank, |k| truth[k] - residuals[i * rank + k]);
        let error = &truth - u * (u.transpose() * predicted);
        total += error.norm_l2();
    }
    Some(total / scored.len() as f64)
}
