//! Where a model needs further states, and what they gained.
//!
//! A plan of states cannot know where an actuator's force bends: a database that is too thin there gives wrong forces without a word. The
//! leave-one-out errors tell where. The next state is the one with the largest product of the nearest sample's error, in half-widths of
//! the model, and the distance to it.

use crate::datasheet::{CaseError, DataSheet, RegimeSheet};
use crate::draws::{Draws, DrawsError};
use crate::evaluate::{CaseReport, EvaluateError, evaluate};
use rom::halfwidths::Errors;
use rom::hull::DomainStatus;
use rom::inputs::Inputs;
use rom::model::{Model, RegimeModel};
use rom::snapshots::{Database, FieldKind, RegimeKind, Split};
use rom::statistics::{mean, median};
use serde::Serialize;

/// Places among which the next states are chosen.
pub const CANDIDATES: usize = 1500;
/// Weight of the stress beside displacement and force: at the worst node it depends on single elements, and more states reduce its error
/// least.
const STRESS_WEIGHT: f64 = 0.3;

/// States inside the training range of a regime where the leave-one-out errors of a model ask for them, the most wanted first.
///
/// # Errors
/// The database has no training case of the regime.
pub fn places(
    database: &Database,
    (model, sheet): (&Model, &DataSheet),
    kind: RegimeKind,
    count: usize,
    seed: u64,
) -> Result<Vec<Inputs>, DrawsError> {
    let regime = model.regime(kind).zip(sheet.regimes.iter().find(|r| r.kind == kind));
    let (regime, sheet) = regime.ok_or(DrawsError::NoRegime(kind.name()))?;
    let samples = infill_errors(database, sheet, |inputs| scale(regime, inputs));
    let mut draws = Draws::new(model, kind, seed)?;
    // A state of the other regime, or beyond the samples, would not refine this one.
    let places: Vec<Inputs> = (0..CANDIDATES).filter_map(|_| draws.draw(|state| state)).collect();
    let scaled: Vec<_> = places.iter().map(|place| scale(regime, place)).collect();
    Ok(infill(count, &samples, &scaled).into_iter().map(|i| places[i]).collect())
}

/// A state's scaled inputs; the second is 0 where the regime has one.
fn scale(regime: &RegimeModel, inputs: &Inputs) -> [f64; 2] {
    let scaled = regime.inputs.scale(inputs);
    [scaled[0], scaled[1]]
}

/// Places and leave-one-out errors of the training cases, in half-widths of the model. Leaving out a corner measures
/// extrapolation, which refinement inside cannot cure: corners take the median of the others.
fn infill_errors(
    database: &Database,
    sheet: &RegimeSheet,
    scale: impl Fn(&Inputs) -> [f64; 2],
) -> Vec<InfillError> {
    let halfwidths = &sheet.halfwidths;
    let share = |error: f64, bar: f64| if bar > 0.0 { error / bar } else { 0.0 };
    let error = |e: &CaseError| {
        share(e.displacement_mm, halfwidths.displacement_mm)
            .max(share(e.stress_mpa, halfwidths.stress_mpa))
            .max(share(e.force_n, halfwidths.force_n))
    };
    let median = median(sheet.leave_one_out.iter().filter(|e| !e.on_hull).map(error)).unwrap_or(1.0);
    let place = |e: &CaseError| {
        let case = database.cases.iter().find(|c| c.name == e.case)?;
        Some(InfillError { at: scale(&case.inputs()), error: if e.on_hull { median } else { error(e) } })
    };
    sheet.leave_one_out.iter().filter_map(place).collect()
}

/// Sample with the error of a model trained without it, in any unit.
#[derive(Clone, Copy, Debug, PartialEq)]
struct InfillError {
    /// Scaled inputs.
    at: [f64; 2],
    /// Leave-one-out error, 0 or more.
    error: f64,
}

/// Indices of the `n` candidates (fewer when there are fewer) with the largest expected error, largest first.
///
/// One after another: the candidate with the largest `(error of the nearest sample) x (distance to it)`, as in
/// cross-validation Voronoi sampling. A chosen candidate then counts as a sample with its neighbour's error, so that the next one is
/// elsewhere. `O(n x candidates x samples)`.
fn infill(n: usize, samples: &[InfillError], candidates: &[[f64; 2]]) -> Vec<usize> {
    let mut samples = samples.to_vec();
    let mut chosen = Vec::new();
    for _ in 0..n.min(candidates.len()) {
        let expected = |at: &[f64; 2]| -> Option<(f64, f64)> {
            let distance = |s: &InfillError| (s.at[0] - at[0]).hypot(s.at[1] - at[1]);
            let nearest = samples.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
            Some((nearest.error * distance(nearest), nearest.error))
        };
        let open = (0..candidates.len()).filter(|i| !chosen.contains(i));
        let best = open
            .filter_map(|i| expected(&candidates[i]).map(|(expected, error)| (i, expected, error)))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((index, _, error)) = best else { break };
        samples.push(InfillError { at: candidates[index], error });
        chosen.push(index);
    }
    chosen
}

/// The worst leave-one-out error of a regime inside the training range, as a fraction of the largest displacement or force of all
/// states, whose largest values these are.
pub fn worst_share(values: &[Errors], sheet: &DataSheet, kind: RegimeKind) -> f64 {
    let largest = |value: fn(&Errors) -> f64| values.iter().map(value).fold(0.0, f64::max);
    let (largest_mm, largest_n) = (largest(|v| v.displacement_mm), largest(|v| v.force_n));
    let largest_mpa = largest(|v| v.stress_mpa);
    let share =
        |error: f64, largest: f64| if largest > 0.0 && error.is_finite() { error / largest } else { 0.0 };
    let worst = |error: &CaseError| {
        let stress = STRESS_WEIGHT * share(error.stress_mpa, largest_mpa);
        share(error.displacement_mm, largest_mm).max(share(error.force_n, largest_n)).max(stress)
    };
    let regimes = sheet.regimes.iter().filter(|regime| regime.kind == kind);
    let inner = regimes.flat_map(|regime| &regime.leave_one_out).filter(|error| !error.on_hull);
    inner.map(worst).fold(0.0, f64::max)
}

/// Mean over cases of the worst node's displacement error (mm) and stress error (MPa), and of the force error (N).
pub type MeanErrors = [f64; 3];

/// How good a model is.
#[derive(Debug, Serialize)]
pub struct RefinementErrors {
    /// Leave-one-out over training cases inside the hull.
    pub leave_one_out: Option<MeanErrors>,
    /// Errors on the added states, held out for the unrefined model only.
    pub added: Option<MeanErrors>,
    /// On test and check cases inside the training range: blind for both.
    pub held_out: Option<MeanErrors>,
    /// Number of these cases.
    pub held_out_cases: usize,
}

impl RefinementErrors {
    /// Measures a model on the refined database.
    pub fn new(
        (model, sheet): (&Model, &DataSheet),
        database: &Database,
        kind: RegimeKind,
        added: &[&str],
    ) -> Result<Self, EvaluateError> {
        let is_added = |i: &usize| added.contains(&database.cases[*i].name.as_str());
        let all = || (0..database.cases.len()).filter(|i| database.cases[*i].regime == kind);
        let new: Vec<usize> = all().filter(is_added).collect();
        let kept: Vec<usize> = all().filter(|i| database.cases[*i].split != Split::Train).collect();
        let report = |cases: &[usize]| evaluate(model, database, cases);
        let mut held_out = report(&kept)?.cases;
        held_out.retain(|case| case.domain == DomainStatus::Inside);
        let left_out = sheet.regimes.iter().find(|r| r.kind == kind).and_then(|regime| {
            let inner = regime.leave_one_out.iter().filter(|e| !e.on_hull);
            mean_of(inner.map(|e| [e.displacement_mm, e.stress_mpa, e.force_n]))
        });
        let errors = |cases: &[CaseReport]| mean_of(cases.iter().map(|case| errors(database, case)));
        Ok(Self {
            leave_one_out: left_out,
            added: errors(&report(&new)?.cases),
            held_out: errors(&held_out),
            held_out_cases: held_out.len(),
        })
    }
}

fn errors(database: &Database, case: &CaseReport) -> MeanErrors {
    let worst = |kind: FieldKind| {
        let fields = database.fields.iter().zip(&case.fields).filter(|(spec, _)| spec.kind == kind);
        fields.map(|(_, e)| e.max).fold(0.0, f64::max)
    };
    [worst(FieldKind::Magnitude), worst(FieldKind::Stress), (case.force_n - case.force_true_n).abs()]
}

fn mean_of(errors: impl Iterator<Item = MeanErrors>) -> Option<MeanErrors> {
    let errors: Vec<MeanErrors> = errors.collect();
    (!errors.is_empty()).then(|| [0, 1, 2].map(|k| mean(errors.iter().map(|e| e[k]))))
}

#[cfg(test)]
#[path = "../tests/unit/refinement.rs"]
mod tests;
