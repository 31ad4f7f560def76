//! Half-widths from the errors of held-out states (split conformal): the error of a new state is smaller with the nominal
//! probability. Half-widths from leave-one-out are slightly too large, since it removes a neighbour of every case.

use crate::datasheet::DataSheet;
use crate::error::TrainError;
use crate::group::Plan;
use crate::regime::TrainedRegime;
use crate::sort::TrainingCases;
use faer::Mat;
use rom::evaluator::Evaluator;
use rom::halfwidths::{Errors, HalfWidths, LocalHalfWidths};
use rom::hull::DomainStatus;
use rom::inputs::{Inputs, Point};
use rom::model::{Model, ModelError};
use rom::observable::OnMesh;
use rom::snapshots::{Database, RegimeKind};
use thiserror::Error;

/// Smallest number of states from which a regime's half-widths are set: with fewer the quantile of 90 % is little more than the largest error.
pub const MIN_STATES: usize = 20;

/// Held-out state and the model's largest error over its nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct UnseenState {
    /// Regime that answered.
    pub regime: RegimeKind,
    /// Inputs by position.
    pub inputs: Inputs,
    /// Position with respect to the training range; only states inside count, since half-widths hold only there.
    pub domain: DomainStatus,
    /// Displacement (mm), stress (MPa), force (N).
    pub errors: Errors,
}

/// Why half-widths could not be set.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs)] // the messages say what the values are
pub enum CalibrationError {
    /// No regime has enough states.
    #[error(
        "expected at least {MIN_STATES} states inside the training range of a regime, found {found} at most; measure on more states"
    )]
    TooFew { found: usize },
    /// An error is negative or not finite.
    #[error("state {state}: expected errors of 0 or more, found {found}")]
    NoError { state: usize, found: f64 },
}

/// Sets the half-widths of every regime with at least [`MIN_STATES`] states; the others stay unchanged. The data sheet
/// contains the number of states. Training cases must not be among the states. `O(states^2)`.
///
/// # Errors
/// [`CalibrationError`]; the model is then unchanged.
pub fn calibrate(
    model: &mut Model,
    sheet: &mut DataSheet,
    states: &[UnseenState],
) -> Result<(), CalibrationError> {
    for (state, unseen) in states.iter().enumerate() {
        if let Some(found) = unseen.errors.values().into_iter().find(|e| !(e.is_finite() && *e >= 0.0)) {
            return Err(CalibrationError::NoError { state, found });
        }
    }
    let mut most = 0;
    for regime in &mut model.header.regimes {
        let inside = |s: &&UnseenState| s.regime == regime.kind && s.domain == DomainStatus::Inside;
        let (points, errors): (Vec<Point>, Vec<Errors>) =
            states.iter().filter(inside).map(|s| (regime.inputs.scale(&s.inputs), s.errors)).unzip();
        most = most.max(points.len());
        if points.len() < MIN_STATES {
            continue;
        }
        let (dimensions, coverage) = (regime.inputs.dimensions(), regime.halfwidths.coverage);
        regime.halfwidths = HalfWidths::of_all(&errors, coverage);
        regime.local_halfwidths = Some(LocalHalfWidths::of_unseen(dimensions, &points, &errors, coverage));
        for part in sheet.regimes.iter_mut().filter(|part| part.kind == regime.kind) {
            (part.halfwidths, part.unseen_states) = (regime.halfwidths, points.len());
        }
    }
    if most < MIN_STATES { Err(CalibrationError::TooFew { found: most }) } else { Ok(()) }
}

// ---- leave-one-out errors of the observables, as ratios to the bound that the displacement's half-width gives ----

/// Ratio of each case by regime and observable.
pub(crate) type Ratios = Vec<(RegimeKind, Vec<Vec<f64>>)>;

/// The ratios of a trained model.
pub(crate) fn observable_ratios(
    database: &Database,
    plan: &Plan,
    parts: &[TrainedRegime],
    sorted: &TrainingCases,
    model: &Model,
    on_mesh: &OnMesh,
) -> Result<Ratios, TrainError> {
    let refused = |error: ModelError| TrainError::Config(vec![error.to_string()]);
    let evaluator = Evaluator::new(&model.header).map_err(refused)?;
    let mut evaluation = evaluator.evaluation();
    let mut found = Vec::new();
    for part in parts {
        let cases = sorted.of(part.kind);
        let Some(errors) = coordinate_errors(database, plan, part, cases.len()) else { continue };
        let mut own: Vec<Vec<f64>> = vec![Vec::with_capacity(cases.len()); on_mesh.count()];
        for (i, &case) in cases.iter().enumerate() {
            evaluator.evaluate(database.cases[case].inputs(), &mut evaluation);
            if evaluation.halfwidths.displacement_mm.is_nan() {
                continue; // outside, which a training case is only without its regime's inputs
            }
            let width = evaluation.halfwidths.displacement_mm.max(f64::MIN_POSITIVE);
            let snapshot = database.snapshot(case);
            let count = database.fields.len();
            let there = |node: usize| [0, 1, 2].map(|k| f64::from(snapshot[node * count + errors[k].0]));
            let left_out = |node: usize| {
                let x = there(node);
                [0, 1, 2].map(|k| x[k] - errors[k].1[(errors[k].2 + node, i)])
            };
            for (index, ratios) in own.iter_mut().enumerate() {
                let ((value, reach), (predicted, _)) =
                    (on_mesh.measure(index, there), on_mesh.measure(index, left_out));
                let ratio = on_mesh.difference(index, value, predicted).abs() / (reach * width);
                ratios.extend(Some(ratio).filter(|ratio| ratio.is_finite()));
            }
        }
        found.push((part.kind, own));
    }
    Ok(found)
}

/// Per axis: field, leave-one-out errors of its group, and its first row there.
fn coordinate_errors(
    database: &Database,
    plan: &Plan,
    part: &TrainedRegime,
    cases: usize,
) -> Option<[(usize, Mat<f64>, usize); 3]> {
    let of_axis = |axis: u8| {
        let field = database.coordinate(axis)?;
        let (group, at) = plan.find(field)?;
        let fit = &part.groups[group];
        Some((field, fit.error_fields(cases), at * database.node_count))
    };
    Some([of_axis(0)?, of_axis(1)?, of_axis(2)?])
}
