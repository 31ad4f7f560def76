//! Measured difference in the coefficients of the leading modes: [`FieldDifference`] by ridge regression, so that the whole field moves.
//!
//! ```text
//! r_i = sum_j J_ij a_j(x_i) + rest,     a_j(x) = s_j sum_k u_kj g(|x - c_k|),     u = argmin mean_i rest_i^2 + lambda |u|^2
//! ```
//!
//! `r` is measured minus predicted and `J` the derivative by the coefficients, both over the output's `sum |dq/dx|`: lengths in mm, whatever
//! the unit. `s_j` is the standard deviation of the coefficient over the training states, the prior of the ridge. Angles are linearised
//! again at the state found. Segments of the runs that are left out choose `R` and `lambda`, and decide whether there is a difference.

use super::data::{
    COVERAGE, MIN_STATES, MOST_LEFT, MeasuredError, MeasuredStates, REACHES, SMOOTHINGS, regime_name,
};
use super::segments::{FOLDS, SEGMENTS, centres, fold, half_width};
use rom::dense::Dense;
use rom::difference::{FieldDifference, terms};
use rom::evaluator::Evaluator;
use rom::inputs::Point;
use rom::model::{Model, ModelFileError, RegimeModel};
use rom::observable::Observables;
use rom::snapshots::{FieldKind, RegimeKind};
use rom::statistics::{mean, quantile};
use serde::Serialize;

/// Most modes.
const MODES: usize = 4;
/// Times that the model is linearised anew at the corrected modes.
const ROUNDS: usize = 3;
/// Most states of a regime; of more, one in several is used.
const MAX_STATES: usize = 2000;

/// Figures of the modes' difference in one regime.
#[derive(Clone, Debug, Serialize)]
pub struct ModesDifference {
    /// Regime.
    #[serde(serialize_with = "regime_name")]
    pub regime: RegimeKind,
    /// Number of modes that are corrected.
    pub modes: usize,
    /// Measured values.
    pub values: usize,
    /// RMS of measured minus predicted over `sum |dq/dx|`, mm.
    pub rms_mm: f64,
    /// The same on segments that were left out, with the difference.
    pub rms_left_out_mm: f64,
    /// RMS of what the modes' difference changes at measured values, mm.
    pub share_mm: f64,
    /// Displacement's half-width at measured states that comes from the difference, mm.
    pub half_width_mm: f64,
    /// RMS on left-out segments over that on the rows that were fitted, at least 1.
    #[serde(skip)]
    pub(super) optimism: f64,
    /// True if the model has it; false where it does not lower the error on left-out segments.
    #[serde(rename = "kept")]
    pub is_kept: bool,
}

/// A coefficient and its standard deviation over the training states.
type LeadingModes = Vec<(usize, f64)>;

/// Measured values of one regime.
#[derive(Default)]
struct ModeRows {
    x: Vec<Point>,
    r: Vec<f64>,
    by: Vec<[f64; MODES]>,
    fold: Vec<usize>,
    run: Vec<usize>,
}

/// Chosen on left-out segments.
struct RidgeChoice {
    reach: f64,
    smoothing: f64,
    errors: Vec<f64>,
}

/// Sets the differences of the regimes in which they lower the error on left-out segments. `places`: output and observable.
pub(super) fn correct(
    model: &mut Model,
    places: &[(usize, usize)],
    observables: &Observables,
    runs: &[MeasuredStates],
) -> Result<Vec<ModesDifference>, MeasuredError> {
    let mut found = Vec::new();
    let kinds: Vec<RegimeKind> = model.header.regimes.iter().map(|regime| regime.kind).collect();
    for kind in kinds {
        let Some(leading) = model.regime(kind).map(|regime| leading(model, regime)) else { continue };
        let first = rows(model, kind, &leading, places, observables, runs)?;
        if leading.is_empty() || first.r.len() < MIN_STATES {
            continue;
        }
        let dimensions = model.regime(kind).map_or(1, |regime| regime.inputs.dimensions());
        let centres = centres(&first.x, dimensions);
        let mut choice = first.choose(&centres, leading.len(), dimensions).ok_or(MeasuredError::Singular)?;
        let rms = |errors: &[f64]| mean(errors.iter().map(|e| e * e)).sqrt();
        let rms_mm = rms(&first.r);
        let (mut last, mut changes) = (first, Vec::new());
        for round in 0..ROUNDS {
            if round > 0 {
                last = rows(model, kind, &leading, places, observables, runs)?;
            }
            let terms = last.terms(&centres, choice.reach);
            let systems = last.systems(&terms, centres.len(), leading.len());
            choice.errors = last
                .left_out(&terms, &systems, leading.len(), choice.smoothing)
                .ok_or(MeasuredError::Singular)?;
            let u = weights(&systems, None, choice.smoothing).ok_or(MeasuredError::Singular)?;
            changes = (0..last.r.len()).map(|at| last.change(at, &terms[at], &u, leading.len())).collect();
            let scale = leading.iter().map(|(_, deviation)| *deviation).cycle();
            let difference = FieldDifference {
                reach: choice.reach,
                centres: centres.clone(),
                coefficients: leading.iter().map(|(index, _)| *index).collect(),
                weights: u.iter().zip(scale).map(|(u, s)| u * s).collect(),
                residual_mm: half_width(&last.run, &choice.errors),
                difference_mm: quantile(last.r.iter().map(|r| r.abs()), COVERAGE),
            };
            set(model, kind, Some(difference));
        }
        let rms_left_out_mm = rms(&choice.errors);
        let is_kept = rms_left_out_mm < MOST_LEFT * rms_mm;
        let rest: Vec<f64> = last.r.iter().zip(&changes).map(|(r, change)| r - change).collect();
        let own = model.regime(kind).and_then(|regime| regime.difference.as_ref());
        found.push(ModesDifference {
            regime: kind,
            modes: leading.len(),
            values: last.r.len(),
            rms_mm,
            rms_left_out_mm,
            share_mm: rms(&changes),
            half_width_mm: own.map_or(f64::NAN, |fit| fit.residual_mm),
            optimism: (rms_left_out_mm / rms(&rest)).max(1.0),
            is_kept,
        });
        if !is_kept {
            set(model, kind, None);
        }
    }
    Ok(found)
}

fn set(model: &mut Model, kind: RegimeKind, difference: Option<FieldDifference>) {
    let own = model.header.regimes.iter_mut().find(|regime| regime.kind == kind);
    own.into_iter().for_each(|regime| regime.difference.clone_from(&difference));
}

/// The modes of the coordinates with the largest variance over the training states.
fn leading(model: &Model, regime: &RegimeModel) -> LeadingModes {
    let is_coordinate = |field: &usize| {
        let spec = model.header.fields.get(*field).map(|field| field.spec.kind);
        matches!(spec, Some(FieldKind::Coordinate(_)))
    };
    let groups = regime.groups.iter().filter(|group| group.fields.iter().any(is_coordinate));
    let mut all: LeadingModes = groups
        .flat_map(|group| {
            let states = group.surrogate.centre_count().max(1) as f64;
            let deviations = group.singular_values.iter().map(move |s| s / states.sqrt());
            group.coefficients.clone().zip(deviations)
        })
        .filter(|(_, deviation)| *deviation > 0.0)
        .collect();
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    all.truncate(MODES);
    all
}

/// Measured values of a regime around the model with its present difference; `r` is that without it, to first order.
fn rows(
    model: &Model,
    kind: RegimeKind,
    leading: &LeadingModes,
    places: &[(usize, usize)],
    observables: &Observables,
    runs: &[MeasuredStates],
) -> Result<ModeRows, MeasuredError> {
    let refused = |error: rom::model::ModelError| ModelFileError::Header(error.to_string());
    let evaluator = Evaluator::new(&model.header).map_err(refused)?;
    let mut evaluation = evaluator.evaluation();
    let mut found = ModeRows::default();
    let Some(regime) = model.regime(kind) else { return Ok(found) };
    let step = runs.iter().map(|run| run.states.len()).sum::<usize>().div_ceil(MAX_STATES).max(1);
    let directions: Vec<Vec<f64>> = leading
        .iter()
        .map(|(index, deviation)| {
            let mut direction = vec![0.0; regime.coefficient_count()];
            direction[*index] = *deviation;
            direction
        })
        .collect();
    for (number, run) in runs.iter().enumerate() {
        for row in (0..run.states.len()).step_by(step) {
            let Some(inputs) = run.states[row] else { continue };
            evaluator.evaluate(inputs, &mut evaluation);
            if evaluation.regime != kind {
                continue;
            }
            for (output, at) in places {
                let value = run.outputs[*output][row];
                let Some(shape) = observables.of_shape(*at, &evaluation) else { continue };
                let along = |direction: &[f64]| {
                    observables.along(*at, &evaluation, direction).map_or(0.0, |change| change / shape.reach)
                };
                let present = match evaluation.coefficient_difference() {
                    [] => 0.0,
                    difference => along(difference),
                };
                let r = (value - shape.value) / shape.reach + present;
                if !r.is_finite() {
                    continue;
                }
                let mut by = [0.0; MODES];
                by.iter_mut().zip(&directions).for_each(|(by, direction)| *by = along(direction));
                found.x.push(regime.inputs.scale(&inputs));
                found.r.push(r);
                found.by.push(by);
                found.fold.push(fold(row, run.states.len(), SEGMENTS));
                found.run.push(number);
            }
        }
    }
    Ok(found)
}

/// Normal equations of a part of the values, with the scale of the ridge in its number of rows.
#[derive(Clone)]
struct NormalEquations {
    matrix: Vec<f64>,
    right: Vec<f64>,
    weight: f64,
}

impl ModeRows {
    /// Centres with a part in each row.
    fn terms(&self, centres: &[Point], reach: f64) -> Vec<Vec<(usize, f64)>> {
        let active_terms =
            |x: &Point| terms(centres, reach, x).enumerate().filter(|(_, g)| *g > 0.0).collect();
        self.x.iter().map(active_terms).collect()
    }

    /// Normal equations by fold.
    fn systems(&self, terms: &[Vec<(usize, f64)>], centres: usize, modes: usize) -> Vec<NormalEquations> {
        let n = centres * modes;
        let mut systems =
            vec![NormalEquations { matrix: vec![0.0; n * n], right: vec![0.0; n], weight: 0.0 }; FOLDS];
        for (index, own) in terms.iter().enumerate() {
            let NormalEquations { matrix, right, weight } = &mut systems[self.fold[index]];
            let by = &self.by[index][..modes];
            *weight += by.iter().map(|b| b * b).sum::<f64>();
            for ((k, g), (i, b)) in own.iter().flat_map(|k| by.iter().enumerate().map(move |i| (*k, i))) {
                let value = g * b;
                right[k * modes + i] += value * self.r[index];
                let row = &mut matrix[(k * modes + i) * n..][..n];
                for (l, h) in own {
                    row[l * modes..][..modes].iter_mut().zip(by).for_each(|(to, c)| *to += value * h * c);
                }
            }
        }
        systems
    }

    /// Change of a value by these weights.
    fn change(&self, row: usize, terms: &[(usize, f64)], u: &[f64], modes: usize) -> f64 {
        let contribution = |(k, g): &(usize, f64)| {
            g * u[k * modes..][..modes].iter().zip(&self.by[row]).map(|(u, by)| u * by).sum::<f64>()
        };
        terms.iter().map(contribution).sum()
    }

    fn left_out(
        &self,
        terms: &[Vec<(usize, f64)>],
        systems: &[NormalEquations],
        modes: usize,
        smoothing: f64,
    ) -> Option<Vec<f64>> {
        let mut errors = self.r.clone();
        for part in 0..FOLDS {
            let u = weights(systems, Some(part), smoothing)?;
            for at in (0..errors.len()).filter(|at| self.fold[*at] == part) {
                errors[at] -= self.change(at, &terms[at], &u, modes);
            }
        }
        Some(errors)
    }

    fn choose(&self, centres: &[Point], modes: usize, dimensions: usize) -> Option<RidgeChoice> {
        let mut best: Option<(f64, RidgeChoice)> = None;
        for reach in REACHES.map(|reach| reach * (dimensions as f64).sqrt()) {
            let terms = self.terms(centres, reach);
            let systems = self.systems(&terms, centres.len(), modes);
            for smoothing in SMOOTHINGS {
                let Some(errors) = self.left_out(&terms, &systems, modes, smoothing) else { continue };
                let square = mean(errors.iter().map(|e| e * e));
                if best.as_ref().is_none_or(|(least, _)| square < *least) {
                    best = Some((square, RidgeChoice { reach, smoothing, errors }));
                }
            }
        }
        best.map(|(_, choice)| choice)
    }
}

/// Weights from all parts but one.
fn weights(systems: &[NormalEquations], without: Option<usize>, smoothing: f64) -> Option<Vec<f64>> {
    let mut right = vec![0.0; systems.first()?.right.len()];
    let used =
        || systems.iter().enumerate().filter(|(part, _)| Some(*part) != without).map(|(_, system)| system);
    used().for_each(|system| right.iter_mut().zip(&system.right).for_each(|(sum, part)| *sum += part));
    let n = right.len();
    let ridge = smoothing * used().map(|system| system.weight).sum::<f64>().max(f64::MIN_POSITIVE);
    let entry = |i: usize, j: usize| {
        let sum: f64 = used().map(|system| system.matrix[i * n + j]).sum();
        if i == j { sum + ridge } else { sum }
    };
    Dense::from_fn(n, entry).solve(&mut right, 1)?;
    Some(right)
}
