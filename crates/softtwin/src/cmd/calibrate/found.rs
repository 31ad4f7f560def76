//! What a calibration found: the report, and measured values beside the model's before and after.

use crate::picture::{Figure, Mark, Panel, Series};
use estimate::{Curves, Estimate, Fit, Measurement, Setup, Structure};
use serde::Serialize;
use std::collections::BTreeMap;
use train::memory::Identified;

/// Correlation from which two unknowns can hardly be told apart.
const ALIKE: f64 = 0.9;

/// What the command found.
#[derive(Serialize)]
pub struct Summary<'a> {
    readings: usize,
    readings_skipped: usize,
    values_used: usize,
    outliers: usize,
    chi2_per_dof: f64,
    converged: bool,
    is_explained: bool,
    estimates: BTreeMap<&'a str, FittedUnknown>,
    residuals: BTreeMap<&'a str, &'a Structure>,
    /// Pairs of unknowns.
    correlations: Vec<(&'a str, &'a str, f64)>,
    unexplained: &'a [String],
    #[serde(skip_serializing_if = "Option::is_none")]
    memory: Option<&'a Identified>,
    remarks: Vec<String>,
}

/// An estimate beside its prior.
#[derive(Serialize)]
struct FittedUnknown {
    #[serde(flatten)]
    estimate: Estimate,
    prior: f64,
    prior_sigma: f64,
}

impl<'a> Summary<'a> {
    pub fn new(
        setup: &'a Setup,
        fit: &Fit,
        readings: usize,
        structures: &'a [(String, Structure)],
        unexplained: &'a [String],
        memory: Option<&'a Identified>,
    ) -> Self {
        let both = || setup.unknowns.iter().zip(&fit.estimates);
        let estimates = both().map(|(unknown, estimate)| {
            let fitted =
                FittedUnknown { estimate: *estimate, prior: unknown.prior, prior_sigma: unknown.sigma };
            (unknown.name.as_str(), fitted)
        });
        let count = setup.unknowns.len();
        let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
        let name = |index: usize| setup.unknowns[index].name.as_str();
        let correlations: Vec<_> = pairs.map(|(a, b)| (name(a), name(b), fit.correlation(a, b))).collect();
        let mut remarks = memory.map_or_else(Vec::new, |found| found.remarks.clone());
        for (unknown, _) in both().filter(|(_, estimate)| !estimate.identifiable) {
            remarks
                .push(format!("{}: not identifiable from this recording, rests on the prior", unknown.name));
        }
        for (a, b, correlation) in correlations.iter().filter(|pair| pair.2.abs() > ALIKE) {
            remarks.push(format!("{a} and {b} can hardly be told apart: correlation {correlation:.3}"));
        }
        Self {
            readings,
            readings_skipped: fit.skipped,
            values_used: fit.used,
            outliers: fit.outliers,
            chi2_per_dof: fit.chi2_per_dof,
            converged: fit.converged,
            is_explained: unexplained.is_empty(),
            estimates: estimates.collect(),
            residuals: structures.iter().map(|(name, found)| (name.as_str(), found)).collect(),
            correlations,
            unexplained,
            memory,
            remarks,
        }
    }
}

/// Measured values, predictions before and after the fit, residuals after it; one row of panels a measured quantity.
pub fn figure(setup: &Setup, readings: &[Measurement], curves: &Curves) -> Figure {
    let Curves { before, after, .. } = curves;
    let begin_s = readings.first().map_or(0.0, |reading| reading.t_s);
    let mut panels = Vec::new();
    for (index, row) in setup.rows.iter().enumerate() {
        if !readings.iter().any(|reading| reading.rows[index].is_finite()) {
            continue;
        }
        let series = |name: &str, colour, mark, value: &dyn Fn(usize) -> f64| {
            let points = readings.iter().enumerate().map(|(i, reading)| (reading.t_s - begin_s, value(i)));
            Series::new(name, colour, mark, points)
        };
        let values = vec![
            series("measured", 0, Mark::Dots, &|i| readings[i].rows[index]),
            series("predicted with the priors", 1, Mark::Line, &|i| before[i][index]),
            series("predicted after the fit", 2, Mark::Line, &|i| after[i][index]),
        ];
        panels.push(Panel::new("", "time [s]", row.name.as_str(), values));
        let residuals =
            series("measured - predicted", 0, Mark::Dots, &|i| readings[i].rows[index] - after[i][index]);
        let label = format!("{}: residual", row.name);
        panels.push(Panel::new("", "time [s]", label.as_str(), vec![residuals]));
    }
    Figure { title: format!("Fit to {} readings", readings.len()), panels, columns: 2 }
}
