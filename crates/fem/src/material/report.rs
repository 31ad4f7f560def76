//! What a fit found, as `softtwin material fit` prints it.

use super::fit::Fitted;
use super::{FittedSpecimens, Specimen};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// What a fit found.
#[derive(Serialize)]
pub struct FitReport {
    law: String,
    constants: BTreeMap<&'static str, f64>,
    /// `None` where the tests leave a constant open.
    half_widths_95: BTreeMap<&'static str, Option<f64>>,
    shear_modulus_mpa: f64,
    rms_percent: f64,
    /// Of the stress at strains of 2 to 30 %.
    working_strains_percent: Option<f64>,
    /// Of the rows beyond a strain, for a law fitted below it.
    beyond_fit_percent: f64,
    stretch_range: [f64; 2],
    stable_to_stretch: Option<f64>,
    tests: Vec<TestReport>,
    candidates: Vec<Candidate>,
    /// The file that was written; none if no law explains the tests.
    material: Option<PathBuf>,
    picture: Option<PathBuf>,
    /// What is suspicious about the tests, and how the file is used.
    pub remarks: Vec<String>,
}

#[derive(Serialize)]
struct TestReport {
    file: String,
    test: &'static str,
    rows: usize,
    largest_stress_mpa: f64,
    rms_percent: f64,
    working_strains_percent: Option<f64>,
    largest_error_percent: f64,
    loops_lost_percent: Vec<f64>,
    notes: Vec<String>,
}

#[derive(Serialize)]
struct Candidate {
    law: String,
    constants: usize,
    rms_percent: f64,
    working_strains_percent: Option<f64>,
    beyond_fit_percent: f64,
    stable_to_stretch: Option<f64>,
    /// A constant whose interval exceeds the constant itself: the law is no candidate.
    undetermined: Option<&'static str>,
}

impl FitReport {
    /// The report of a fit, with the files that were made of it.
    pub fn new(fitted: &FittedSpecimens, material: Option<PathBuf>, picture: Option<PathBuf>) -> Self {
        let (best, law) = (&fitted.best, &fitted.best.law);
        let test = |specimen: &Specimen| {
            let [rms_percent, largest_error_percent] = specimen.test.error_percent(law);
            TestReport {
                file: specimen.name.clone(),
                test: specimen.kind.word(),
                rows: specimen.test.points.len(),
                largest_stress_mpa: specimen.test.largest_mpa(),
                rms_percent,
                working_strains_percent: specimen.test.working_error_percent(law),
                largest_error_percent,
                loops_lost_percent: specimen.loops.iter().map(|lost| 100.0 * lost).collect(),
                notes: specimen.notes.clone(),
            }
        };
        let candidate = |fitted: &Fitted| Candidate {
            law: fitted.law.key(),
            constants: fitted.constants(),
            rms_percent: 100.0 * fitted.error,
            working_strains_percent: fitted.working_error.map(|error| 100.0 * error),
            beyond_fit_percent: 100.0 * fitted.beyond_error,
            stable_to_stretch: fitted.stable_to,
            undetermined: fitted.undetermined(),
        };
        let names = law.constants().into_iter().map(|(name, _)| name);
        Self {
            law: law.key(),
            constants: law.constants().into_iter().collect(),
            half_widths_95: names.zip(best.half_widths.iter().copied()).collect(),
            shear_modulus_mpa: law.shear_modulus_mpa(),
            rms_percent: 100.0 * best.error,
            working_strains_percent: best.working_error.map(|error| 100.0 * error),
            beyond_fit_percent: 100.0 * best.beyond_error,
            stretch_range: fitted.range,
            stable_to_stretch: best.stable_to,
            tests: fitted.specimens.iter().map(test).collect(),
            candidates: fitted.candidates.iter().map(candidate).collect(),
            material,
            picture,
            remarks: fitted.remarks.clone(),
        }
    }
}
