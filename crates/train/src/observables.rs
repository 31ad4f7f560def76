//! Leave-one-out errors of the observables, as ratios to the bound that the displacement's half-width gives.

use crate::error::TrainError;
use crate::group::Plan;
use crate::regime::Part;
use crate::sort::Sorted;
use faer::Mat;
use rom::evaluator::Evaluator;
use rom::model::{Model, modes_within};
use rom::observable::OnMesh;
use rom::reconstructor::BasisOptions;
use rom::snapshots::{Database, RegimeKind};

/// Ratio of each case by regime and observable.
pub(crate) type Ratios = Vec<(RegimeKind, Vec<Vec<f64>>)>;

/// The ratios of a trained model.
pub(crate) fn ratios(
    database: &Database,
    plan: &Plan,
    parts: &[Part],
    sorted: &Sorted,
    model: &Model,
    on_mesh: &OnMesh,
) -> Result<Ratios, TrainError> {
    let refused = |error: rom::model::ModelError| TrainError::Config(vec![error.to_string()]);
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
            for (at, ratios) in own.iter_mut().enumerate() {
                let ((value, reach), (predicted, _)) =
                    (on_mesh.measure(at, there), on_mesh.measure(at, left_out));
                let ratio = on_mesh.difference(at, value, predicted).abs() / (reach * width);
                ratios.extend(Some(ratio).filter(|ratio| ratio.is_finite()));
            }
        }
        found.push((part.kind, own));
    }
    Ok(found)
}

/// Per axis: field, leave-one-out errors of its group with the modes of a default reconstruction, and its first row there.
fn coordinate_errors(
    database: &Database,
    plan: &Plan,
    part: &Part,
    cases: usize,
) -> Option<[(usize, Mat<f64>, usize); 3]> {
    let of = |axis: u8| {
        let field = database.coordinate(axis)?;
        let (group, at) = plan.find(field)?;
        let fit = &part.groups[group];
        let used = modes_within(&fit.choice.leave_one_out, BasisOptions::ACCEPTED_ERROR);
        Some((field, fit.error_fields(cases, used), at * database.node_count))
    };
    Some([of(0)?, of(1)?, of(2)?])
}
