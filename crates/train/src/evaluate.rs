//! Errors of a model on cases of a database: truncation and interpolation error separately, per field and for the force.
//!
//! Per case and field: mean squared error (the summand of Eq. 15), largest error over nodes, and the relative errors of
//! Eq. (16), `|prediction - truth| / max(|truth|, floor)`, where the floor is a fraction of the field's largest
//! value: stress is exactly 0 at some nodes. *Normalised* is the largest error over nodes by the field's maximum in that
//! case. *Truncation* is what the modes alone cannot represent: the distance of the true field from its best
//! approximation in the basis; *interpolation* is the distance of the prediction from that best approximation.

use rom::halfwidths::Errors;
use rom::hull::DomainStatus;
use rom::inputs::{Inputs, PARAMETERS};
use rom::model::{Model, ModelError, RegimeModel, Selection};
use rom::model_state::ModelState;
use rom::snapshots::{Database, FieldKind, RegimeKind};
use serde::Serialize;
use thiserror::Error;

/// Floor of Eq. (16), as a fraction of a field's largest value.
pub const FLOOR: f64 = 0.01;

/// Why a model could not be evaluated on a database.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs)] // the messages say what the values are
pub enum EvaluateError {
    /// The model cannot predict.
    #[error(transparent)]
    Predict(#[from] ModelError),
    /// Fields or nodes differ.
    #[error(
        "the model has {expected}, the database {found}; evaluate on a database of the same actuator and mesh"
    )]
    Mismatch { expected: String, found: String },
}

/// Errors of one field in one case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FieldErrors {
    /// Field name.
    pub field: String,
    /// Mean squared error over nodes, in unit^2.
    pub mse: f64,
    /// Largest error over nodes, in the field's unit.
    pub max: f64,
    /// Node it is at.
    pub worst_node: usize,
    /// Largest error over the field's largest value in this case.
    pub normalised: f64,
    /// Mean of Eq. (16) over nodes.
    pub relative_mean: f64,
    /// Its 95th percentile over nodes.
    pub relative_p95: f64,
    /// Its maximum over nodes.
    pub relative_max: f64,
    /// Largest truncation error over nodes; `None` for a derived field.
    pub truncation_max: Option<f64>,
    /// Largest interpolation error over nodes; `None` for a derived field.
    pub interpolation_max: Option<f64>,
}

/// Errors of one case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaseReport {
    /// Case name.
    pub case: String,
    /// Regime that answered.
    pub regime: RegimeKind,
    /// Regime the case was sampled for.
    #[serde(skip)]
    pub sampled: RegimeKind,
    /// All inputs by position.
    #[serde(skip)]
    pub inputs: Inputs,
    /// Pressure in MPa; NaN if the model has none.
    pub pressure_mpa: f64,
    /// Gap in mm.
    pub gap_mm: Option<f64>,
    /// Position with respect to the training range.
    pub domain: DomainStatus,
    /// Scaled distance to the training range.
    pub domain_distance: f64,
    /// Errors per field.
    pub fields: Vec<FieldErrors>,
    /// Mean squared error over all entries: the summand of Eq. (15).
    pub mse: f64,
    /// True force in N; NaN, as the predicted one, if the model has no forces.
    pub force_true_n: f64,
    /// Predicted force in N.
    pub force_n: f64,
    /// Relative force error; `None` if there is no true force or it is 0.
    pub force_relative: Option<f64>,
    /// Displacement (mm, the length of the coordinate error) and stress (MPa) of the worst node, force (N); NaN for what the model does
    /// not have.
    pub errors: Errors,
    /// Errors within the half-widths.
    pub covered: Covered,
}

impl CaseReport {
    /// True if the case counts for a regime: contact for cases with a gap, free for the others.
    pub fn is_of(&self, regime: RegimeKind) -> bool {
        self.gap_mm.is_some() == (regime == RegimeKind::Contact)
    }
}

/// Errors within the model's half-widths.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Covered {
    /// Displacement (the length of the coordinate error) at the worst node; all `None` outside the training range.
    pub displacement: Option<bool>,
    /// Stress at the worst node; `None` if the model has no stress.
    pub stress: Option<bool>,
    /// Force; `None` if the model has no forces.
    pub force: Option<bool>,
}

/// Errors of a set of cases.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EvaluationReport {
    /// Floor of the relative errors, as a fraction of the field's maximum.
    pub floor: f64,
    /// Errors per case.
    pub cases: Vec<CaseReport>,
    /// Summary by regime.
    pub regimes: Vec<Summary>,
}

/// Summary over the cases of a regime.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Regime the cases were sampled for.
    pub regime: RegimeKind,
    /// Cases inside the training range or near it, or all if there is none. The figures below are of these.
    pub cases: usize,
    /// Names of the other cases: outside the training range a model extrapolates.
    pub outside: Vec<String>,
    /// Eq. (15): mean over cases and entries.
    pub mse: f64,
    /// Per field: mean, 95th percentile and maximum over cases of the normalised error; the worst case and node.
    pub fields: Vec<FieldSummary>,
    /// Force error over the largest force: mean, 95th percentile, maximum; NaN if the model has no forces.
    pub force_normalised: [f64; 3],
    /// Share of cases within the displacement, stress and force half-widths; NaN of a quantity that the model does not have.
    pub coverage: [f64; 3],
}

/// A field over the cases of a regime.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FieldSummary {
    /// Name of the field.
    pub field: String,
    /// Normalised error over cases: mean, 95th percentile, maximum.
    pub normalised: [f64; 3],
    /// Case with the largest normalised error.
    pub worst_case: String,
    /// Node it is at.
    pub worst_node: usize,
}

/// Evaluates a model on the given cases of a database. Cost `O(cases x nodes x modes)`.
///
/// # Errors
/// [`EvaluateError`] when model and database do not belong together.
pub fn evaluate(
    model: &Model,
    database: &Database,
    cases: &[usize],
) -> Result<EvaluationReport, EvaluateError> {
    let names = |fields: Vec<&str>, nodes: usize| format!("fields {} over {nodes} nodes", fields.join(", "));
    let expected =
        names(model.header.fields.iter().map(|f| f.spec.name.as_str()).collect(), model.header.node_count);
    let found = names(database.fields.iter().map(|f| f.name.as_str()).collect(), database.node_count);
    if expected != found {
        return Err(EvaluateError::Mismatch { expected, found });
    }
    let further =
        model.header.inputs.iter().skip(PARAMETERS).map(|input| input.name.as_str()).collect::<Vec<_>>();
    let own: Vec<&str> = database.parameters.iter().map(|parameter| parameter.name.as_str()).collect();
    if !own.is_empty() && own != further {
        let names = |names: Vec<&str>| format!("parameters {}", names.join(", "));
        return Err(EvaluateError::Mismatch { expected: names(further), found: names(own) });
    }
    let mut state = ModelState::new(model, &Selection::default())?;
    let cases: Vec<CaseReport> = cases.iter().map(|&i| one_case(model, database, &mut state, i)).collect();
    let regimes = [RegimeKind::Free, RegimeKind::Contact]
        .into_iter()
        .filter_map(|kind| summary(database, kind, cases.iter().filter(|c| c.sampled == kind).collect()))
        .collect();
    Ok(EvaluationReport { floor: FLOOR, cases, regimes })
}

fn one_case(model: &Model, database: &Database, state: &mut ModelState, index: usize) -> CaseReport {
    let case = &database.cases[index];
    let nodes = database.node_count;
    // A model of few states refuses one that is far outside of them: no answer has no error.
    let is_answered = state.update(case.inputs()).is_ok();
    let nothing = if is_answered { Vec::new() } else { vec![f32::NAN; state.fields().len()] };
    let (evaluation, out) = (state.evaluation(), if is_answered { state.fields() } else { &nothing[..] });
    let regime = model.regime(evaluation.regime);
    let mut displacement = vec![0.0; nodes];
    let (mut magnitude, mut stress, mut fields) = (0.0_f64, 0.0_f64, Vec::new());
    for (f, spec) in database.fields.iter().enumerate() {
        let truth: Vec<f64> = database.field(index, f).map(f64::from).collect();
        let prediction = &out[f * nodes..(f + 1) * nodes];
        let mut best = regime.and_then(|r| best_approximation(model, r, f, &truth));
        if spec.kind == FieldKind::Stress {
            // As the reconstruction does: otherwise its clamp would pass for an error of interpolation.
            best.iter_mut().flatten().for_each(|value| *value = value.max(0.0));
        }
        let errors = field_errors(&spec.name, &truth, prediction, best.as_deref());
        match spec.kind {
            FieldKind::Coordinate(_) => {
                let pairs = truth.iter().zip(prediction);
                displacement.iter_mut().zip(pairs).for_each(|(d, (t, p))| *d += (t - f64::from(*p)).powi(2));
            }
            FieldKind::Stress => stress = stress.max(errors.max),
            FieldKind::Magnitude => magnitude = magnitude.max(errors.max),
            FieldKind::Other => {}
        }
        fields.push(errors);
    }
    let (needs, has_stress) = (model.header.needs(), model.header.has_stress());
    let force_true_n = if model.header.has_forces() { case.contact_force_n } else { f64::NAN };
    let error_n = (evaluation.contact_force_n - force_true_n).abs();
    let error_mpa = if has_stress { stress } else { f64::NAN };
    let (halfwidths, is_inside) = (evaluation.halfwidths, evaluation.domain == DomainStatus::Inside);
    let error_mm = displacement.iter().copied().fold(0.0, f64::max).sqrt().max(magnitude);
    CaseReport {
        case: case.name.clone(),
        regime: evaluation.regime,
        sampled: case.regime,
        inputs: case.inputs(),
        errors: Errors { displacement_mm: error_mm, stress_mpa: error_mpa, force_n: error_n },
        pressure_mpa: if needs.pressure { case.pressure_mpa } else { f64::NAN },
        gap_mm: case.gap_mm,
        domain: evaluation.domain,
        domain_distance: evaluation.domain_distance,
        mse: fields.iter().map(|f| f.mse).sum::<f64>() / fields.len() as f64,
        fields,
        force_true_n,
        force_n: evaluation.contact_force_n,
        force_relative: (force_true_n > 0.0).then(|| error_n / force_true_n),
        covered: Covered {
            displacement: is_inside.then_some(error_mm <= halfwidths.displacement_mm),
            stress: (is_inside && has_stress).then_some(stress <= halfwidths.stress_mpa),
            force: (is_inside && model.header.has_forces()).then_some(error_n <= halfwidths.force_n),
        },
    }
}

/// Projections on the modes, each of which leaves a few percent of what the one before missed.
const PROJECTIONS: usize = 4;

/// The nearest field to the truth that the modes can give. They are orthonormal up to their rounding, so a few repeated projections find it.
/// `None` for derived fields and fields of a joint group.
fn best_approximation(model: &Model, regime: &RegimeModel, field: usize, truth: &[f64]) -> Option<Vec<f64>> {
    let group = regime.groups.iter().find(|g| g.fields == [field])?;
    let (kind, field) = (regime.kind, field as u32);
    let mean = model.mean(kind, field)?;
    let modes = model.modes(kind, field).ok()?;
    let mut best: Vec<f64> = mean.iter().map(|m| f64::from(*m)).collect();
    let mode = |mode| (0..truth.len()).map(|node| modes.value(mode, node)).collect();
    let modes: Vec<Vec<f64>> = (0..group.coefficients.len()).map(mode).collect();
    for _ in 0..PROJECTIONS {
        for mode in &modes {
            let a: f64 = mode.iter().zip(truth.iter().zip(&best)).map(|(phi, (t, b))| phi * (t - b)).sum();
            best.iter_mut().zip(mode).for_each(|(b, phi)| *b += a * phi);
        }
    }
    Some(best)
}

fn field_errors(name: &str, truth: &[f64], prediction: &[f32], best: Option<&[f64]>) -> FieldErrors {
    let largest = truth.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let errors: Vec<f64> = truth.iter().zip(prediction).map(|(t, p)| (f64::from(*p) - t).abs()).collect();
    let (worst_node, max) =
        errors.iter().enumerate().fold((0, 0.0), |w, (i, e)| if *e > w.1 { (i, *e) } else { w });
    let least = (FLOOR * largest).max(f64::MIN_POSITIVE);
    let mut relative: Vec<f64> = errors.iter().zip(truth).map(|(e, t)| e / t.abs().max(least)).collect();
    let [relative_mean, relative_p95, relative_max] = spread(&mut relative);
    let farthest = |a: &dyn Fn(usize) -> f64| (0..truth.len()).map(|i| a(i).abs()).fold(0.0, f64::max);
    FieldErrors {
        field: name.to_owned(),
        mse: errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64,
        max,
        worst_node,
        normalised: if largest > 0.0 { max / largest } else { max },
        relative_mean,
        relative_p95,
        relative_max,
        truncation_max: best.map(|b| farthest(&|i| truth[i] - b[i])),
        interpolation_max: best.map(|b| farthest(&|i| f64::from(prediction[i]) - b[i])),
    }
}

fn summary(database: &Database, regime: RegimeKind, cases: Vec<&CaseReport>) -> Option<Summary> {
    let (outside, inside): (Vec<&CaseReport>, Vec<&CaseReport>) =
        cases.into_iter().partition(|case| case.domain == DomainStatus::Outside);
    let (cases, outside) = if inside.is_empty() { (outside, inside) } else { (inside, outside) };
    if cases.is_empty() {
        return None;
    }
    let mean =
        |value: &dyn Fn(&CaseReport) -> f64| cases.iter().map(|c| value(c)).sum::<f64>() / cases.len() as f64;
    let largest = database.cases.iter().map(|c| c.contact_force_n).fold(f64::MIN_POSITIVE, f64::max);
    let mut forces: Vec<f64> = cases.iter().map(|c| (c.force_n - c.force_true_n).abs() / largest).collect();
    let share = |is_true: fn(&CaseReport) -> Option<bool>| {
        let known: Vec<bool> = cases.iter().filter_map(|case| is_true(case)).collect();
        known.iter().filter(|is_within| **is_within).count() as f64 / known.len() as f64
    };
    let fields = database.fields.iter().enumerate().map(|(f, spec)| {
        let worst = cases
            .iter()
            .fold(cases[0], |w, c| if c.fields[f].normalised > w.fields[f].normalised { c } else { w });
        FieldSummary {
            field: spec.name.clone(),
            normalised: spread(&mut cases.iter().map(|c| c.fields[f].normalised).collect::<Vec<_>>()),
            worst_case: worst.case.clone(),
            worst_node: worst.fields[f].worst_node,
        }
    });
    Some(Summary {
        regime,
        cases: cases.len(),
        outside: outside.iter().map(|case| case.case.clone()).collect(),
        mse: mean(&|c| c.mse),
        fields: fields.collect(),
        force_normalised: spread(&mut forces),
        coverage: [
            share(|c| c.covered.displacement),
            share(|c| c.covered.stress),
            share(|c| c.covered.force),
        ],
    })
}

/// Mean, 95th percentile (nearest rank) and maximum.
pub fn spread(values: &mut [f64]) -> [f64; 3] {
    if values.is_empty() {
        return [f64::NAN; 3];
    }
    values.sort_by(f64::total_cmp);
    let rank = ((values.len() as f64) * 0.95).ceil() as usize;
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    [mean, values[rank.clamp(1, values.len()) - 1], values[values.len() - 1]]
}
