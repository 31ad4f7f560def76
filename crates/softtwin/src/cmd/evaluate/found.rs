//! What an evaluation found: for scripts, for people, and as a picture.

use crate::picture::{Axis, Figure, Mark, Panel, Series};
use rom::halfwidths::Errors;
use rom::hull::DomainStatus;
use rom::snapshots::RegimeKind;
use serde::Serialize;
use std::path::Path;
use train::datasheet::CaseError;
use train::datasheet::DataSheet;
use train::evaluate::{CaseReport, EvaluationReport, FieldErrors, Summary, spread};

/// What scripts read.
#[derive(Serialize)]
pub struct Printed<'a> {
    #[serde(flatten)]
    pub report: &'a EvaluationReport,
    pub leave_one_out: Vec<LeftOut>,
}

/// What people read: a line for each case in place of the errors of all its fields.
#[derive(Serialize)]
pub struct PrintedEvaluation<'a> {
    pub floor: f64,
    pub regimes: &'a [Summary],
    pub cases: Vec<CaseRow<'a>>,
    pub leave_one_out: Vec<LeftOut>,
}

#[derive(Serialize)]
pub struct CaseRow<'a> {
    case: &'a str,
    regime: RegimeKind,
    pressure_mpa: f64,
    gap_mm: Option<f64>,
    domain: DomainStatus,
    displacement_error_mm: f64,
    stress_error_mpa: f64,
    force_error_n: f64,
    mse: f64,
}

impl<'a> CaseRow<'a> {
    pub fn of(case: &'a CaseReport) -> Self {
        let Errors { displacement_mm, stress_mpa, force_n, .. } = case.errors;
        Self {
            case: &case.case,
            regime: case.regime,
            pressure_mpa: case.pressure_mpa,
            gap_mm: case.gap_mm,
            domain: case.domain,
            displacement_error_mm: displacement_mm,
            stress_error_mpa: stress_mpa,
            force_error_n: force_n,
            mse: case.mse,
        }
    }
}

/// Leave-one-out errors of a regime's training cases: mean, 95th percentile, maximum over cases of the worst node's.
#[derive(Debug, Serialize)]
pub struct LeftOut {
    pub regime: RegimeKind,
    /// Cases inside the hull of the others; leaving a corner out measures extrapolation.
    pub cases: usize,
    /// In mm.
    pub displacement_mm: [f64; 3],
    /// In MPa; `None` if the model has no stress.
    pub stress_mpa: Option<[f64; 3]>,
    /// In N; `None` if the model has no forces.
    pub force_n: Option<[f64; 3]>,
}

/// From the data sheet beside the model; none without one.
pub fn leave_one_out(model: &Path) -> Vec<LeftOut> {
    let Some(sheet) = DataSheet::read_beside(model) else {
        tracing::warn!("no data sheet beside the model: leave-one-out errors are not shown");
        return Vec::new();
    };
    let left_out = |regime: &train::datasheet::RegimeSheet| {
        let inner: Vec<&CaseError> = regime.leave_one_out.iter().filter(|c| !c.on_hull).collect();
        let column =
            |get: fn(&CaseError) -> f64| spread(&mut inner.iter().map(|c| get(c)).collect::<Vec<_>>());
        LeftOut {
            regime: regime.kind,
            cases: inner.len(),
            displacement_mm: column(|c| c.displacement_mm),
            stress_mpa: sheet.has_stress().then(|| column(|c| c.stress_mpa)),
            force_n: sheet.has_forces().then(|| column(|c| c.force_n)),
        }
    };
    sheet.regimes.iter().map(left_out).collect()
}

/// Normalised errors by case, one panel per regime.
pub fn picture(report: &EvaluationReport) -> Figure {
    let panel = |regime: RegimeKind| {
        let cases: Vec<&CaseReport> = report.cases.iter().filter(|c| c.is_of(regime)).collect();
        let dots = |(f, field): (usize, &FieldErrors)| {
            let errors = cases.iter().enumerate().map(|(i, c)| (i as f64, 100.0 * c.fields[f].normalised));
            Series::new(&field.field, f, Mark::Dots, errors)
        };
        let series = cases.first()?.fields.iter().enumerate().map(dots).collect();
        // Names are unreadable beyond a few dozen; then the position is enough.
        let names = if cases.len() > 24 { vec![] } else { cases.iter().map(|c| c.case.clone()).collect() };
        let error = Axis::log("largest error over nodes / largest value [%]");
        Some(Panel::new(format!("Regime {}", regime.name()), Axis::names("case", names), error, series))
    };
    let panels: Vec<Panel> = [RegimeKind::Free, RegimeKind::Contact].into_iter().filter_map(panel).collect();
    Figure { title: "Errors by case".into(), columns: panels.len().max(1), panels }
}
