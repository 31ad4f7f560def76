//! What a fit found, as a report and as a picture.

use crate::picture::{Axis, Figure, Mark, Panel, Series};
use fem::material::fit::Fitted;
use fem::material::{FittedSpecimens, Hyperelastic, Specimen};
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

/// `yeoh`, as files name the law.
fn key(law: &Hyperelastic) -> String {
    law.name().to_lowercase()
}

impl FitReport {
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
            law: key(&fitted.law),
            constants: fitted.constants(),
            rms_percent: 100.0 * fitted.error,
            working_strains_percent: fitted.working_error.map(|error| 100.0 * error),
            beyond_fit_percent: 100.0 * fitted.beyond_error,
            stable_to_stretch: fitted.stable_to,
            undetermined: fitted.undetermined(),
        };
        let names = law.constants().into_iter().map(|(name, _)| name);
        Self {
            law: key(law),
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

/// Most points of a drawn test.
const DRAWN: usize = 400;

/// Tests with the law, and their differences.
pub fn figure(fitted: &FittedSpecimens) -> Figure {
    let law = &fitted.best.law;
    let mut panels = Vec::new();
    for specimen in &fitted.specimens {
        let thinned = |points: &[[f64; 2]]| -> Vec<(f64, f64)> {
            let step = points.len().div_ceil(DRAWN).max(1);
            points.iter().step_by(step).map(|p| (p[0], p[1])).collect()
        };
        let points = &specimen.test.points;
        let (low, high) = points.iter().fold((1.0_f64, 1.0_f64), |(a, b), p| (a.min(p[0]), b.max(p[0])));
        let curve: Vec<(f64, f64)> = (0..=200)
            .map(|k| low + (high - low) * f64::from(k) / 200.0)
            .filter_map(|l| Some((l, law.nominal_stress_mpa(specimen.test.deformation, l)?)))
            .collect();
        let within: Vec<[f64; 2]> = specimen
            .rows
            .iter()
            .copied()
            .filter(|row| row[0] <= high + 0.02 && row[0] >= low - 0.02)
            .collect();
        let largest = specimen.test.largest_mpa();
        let off: Vec<(f64, f64)> = points
            .iter()
            .filter_map(|p| {
                Some((
                    p[0],
                    100.0 * (law.nominal_stress_mpa(specimen.test.deformation, p[0])? - p[1]) / largest,
                ))
            })
            .collect();
        let series = |name: &str, colour, mark, points| Series { name: name.into(), colour, mark, points };
        let mut drawn = vec![series("measured", 4, Mark::Line, thinned(&within))];
        drawn.push(series("fitted rows", 0, Mark::Dots, thinned(points)));
        drawn.push(series(&key(law), 1, Mark::Line, curve));
        panels.push(Panel {
            title: format!("{} ({})", specimen.name, specimen.kind.word()),
            x: Axis::linear("stretch"),
            y: Axis::linear("nominal stress [MPa]"),
            series: drawn,
            map: None,
        });
        panels.push(Panel {
            title: String::new(),
            x: Axis::linear("stretch"),
            y: Axis::linear("law - measured [% of the largest stress]"),
            series: vec![series("", 1, Mark::Dots, off)],
            map: None,
        });
    }
    let title = format!("{}: RMS {:.2} % of the largest stress", key(law), 100.0 * fitted.best.error);
    Figure { title, panels, columns: 2 }
}
