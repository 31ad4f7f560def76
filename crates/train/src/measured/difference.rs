//! What measurements add to a finite-element model. `modes.rs` corrects its leading modes; this file corrects what is then left of each
//! observable and marker, by one ridge regression each ([`Correction`]).
//!
//! ```text
//! offset(x) = sum_k w_k g(|x - c_k|),     w = argmin mean_i (r_i - offset(x_i))^2 + lambda |w|^2
//! ```
//!
//! `r` is measured minus predicted with the modes' difference, `x` the inputs scaled as in the model, centres `c` the means of cells of the
//! measured states. Segments of the runs that are left out choose `R` and `lambda`, and decide whether there is an offset at all.

use super::data::{
    COVERAGE, MIN_STATES, MOST_LEFT, MeasuredError, MeasuredStates, REACHES, SMOOTHINGS, regime_name,
};
use super::modes::{self, ModesDifference};
use super::segments::{FOLDS, SEGMENTS, centres, fold, half_width};
use rom::dense::Dense;
use rom::difference::terms;
use rom::evaluator::Evaluator;
use rom::inputs::{Inputs, Point};
use rom::model::{BlockKind, Model, ModelError, ModelFileError};
use rom::observable::{Correction, Definition, MAX_OBSERVABLES, ObservableKind, Observables, PointSpec};
use rom::snapshots::{RegimeKind, marker_axis};
use rom::statistics::{mean, quantile};
use serde::Serialize;
use std::collections::BTreeMap;

/// Figures of one output in one regime.
#[derive(Clone, Debug, Serialize)]
pub struct Difference {
    /// Name of the observable or marker coordinate.
    pub name: String,
    /// Regime.
    #[serde(serialize_with = "regime_name")]
    pub regime: RegimeKind,
    /// Number of measured states that it was fitted to.
    pub states: usize,
    /// RMS of measured minus predicted by the finite elements.
    pub rms: f64,
    /// RMS on segments that were left out, with the modes' difference and the offset that are kept.
    pub rms_left_out: f64,
    /// Offset with the largest size at a measured state.
    pub largest_offset: f64,
    /// Half-width at measured states.
    pub half_width: f64,
    /// True if the model has the offset; false where it does not lower the error on left-out segments.
    #[serde(rename = "kept")]
    pub is_kept: bool,
}

/// Measured differences of a model.
#[derive(Clone, Debug, Serialize)]
pub struct Corrected {
    /// Modes by regime.
    pub modes: Vec<ModesDifference>,
    /// Offsets by output and regime.
    pub offsets: Vec<Difference>,
}

/// Rows of one output in one regime.
#[derive(Default)]
struct Rows {
    x: Vec<Point>,
    /// Measured minus predicted by the finite elements.
    of_elements: Vec<f64>,
    /// Measured minus predicted with the modes' difference.
    r: Vec<f64>,
    fold: Vec<usize>,
    run: Vec<usize>,
}

/// Puts the measured differences of `outputs` into the model, whose coordinates must be loaded, in place of those that it has. Outputs are
/// observables of the model or coordinates of its node sets, which become observables. Cost `O(states centres^2)`.
///
/// # Errors
/// [`MeasuredError`]; the model is then unchanged.
pub fn correct(
    model: &mut Model,
    outputs: &[String],
    runs: &[MeasuredStates],
    remarks: &mut Vec<String>,
) -> Result<Corrected, MeasuredError> {
    let mut corrected = model.clone();
    let found = correct_in_place(&mut corrected, outputs, runs, remarks)?;
    *model = corrected;
    Ok(found)
}

fn correct_in_place(
    model: &mut Model,
    outputs: &[String],
    runs: &[MeasuredStates],
    remarks: &mut Vec<String>,
) -> Result<Corrected, MeasuredError> {
    let mut observables = Observables::of(model)?;
    observables.clear_corrections();
    model.header.regimes.iter_mut().for_each(|regime| regime.difference = None);
    let places = places(model, outputs, &mut observables, remarks)?;
    let modes = modes::correct(model, &places, &observables, runs)?;
    let optimism = |kind: RegimeKind| {
        modes.iter().find(|found| found.regime == kind && found.is_kept).map(|found| found.optimism)
    };
    let mut found = Vec::new();
    let refused = |error: ModelError| ModelFileError::Header(error.to_string());
    let evaluator = Evaluator::new(&model.header).map_err(refused)?;
    let mut evaluation = evaluator.evaluation();
    for (output, at) in places {
        let mut by_regime: Vec<(RegimeKind, Rows)> = Vec::new();
        for (number, run) in runs.iter().enumerate() {
            let both = run.states.iter().zip(&run.outputs[output]);
            let known: Vec<(Inputs, f64)> = both
                .filter_map(|(state, value)| Some(((*state)?, *value)))
                .filter(|(_, v)| v.is_finite())
                .collect();
            for (row, (inputs, value)) in known.iter().enumerate() {
                evaluator.evaluate(*inputs, &mut evaluation);
                let Some(regime) = model.regime(evaluation.regime) else { continue };
                let predicted = observables.value(at, &evaluation);
                let rest = value - predicted.value;
                if by_regime.iter().all(|(kind, _)| *kind != regime.kind) {
                    by_regime.push((regime.kind, Rows::default()));
                }
                let own = by_regime.iter_mut().find(|(kind, _)| *kind == regime.kind);
                let Some((_, rows)) = own.filter(|_| rest.is_finite()) else { continue };
                rows.x.push(regime.inputs.scale(inputs));
                rows.of_elements.push(rest + predicted.offset);
                rows.r.push(rest);
                rows.fold.push(fold(row, known.len(), SEGMENTS));
                rows.run.push(number);
            }
        }
        for (kind, rows) in by_regime {
            if rows.r.len() < MIN_STATES {
                let (name, count) = (&outputs[output], rows.r.len());
                remarks.push(format!(
                    "{name}: {count} states of the {} regime, expected at least {MIN_STATES}: no offset",
                    kind.name()
                ));
                continue;
            }
            let Some(regime) = model.regime(kind) else { continue };
            let (correction, report) = rows
                .correction(kind, &regime.inputs, &outputs[output], optimism(kind))
                .ok_or(MeasuredError::Singular)?;
            if report.is_kept || optimism(kind).is_some() {
                observables.correct(at, correction);
            }
            found.push(report);
        }
    }
    if !found.iter().any(|report| report.is_kept) && !modes.iter().any(|found| found.is_kept) {
        let reason = |report: &Difference| {
            format!("{}: RMS {:.3e}, {:.3e} on left-out parts", report.name, report.rms, report.rms_left_out)
        };
        let reasons: Vec<String> = found.iter().map(reason).chain(std::mem::take(remarks)).collect();
        return Err(MeasuredError::NoDifference { reasons: reasons.join("; ") });
    }
    model.set_record(BlockKind::Observables, &observables)?;
    Ok(Corrected { modes, offsets: found })
}

/// Output and observable of each output that the model has; markers become observables.
fn places(
    model: &Model,
    outputs: &[String],
    observables: &mut Observables,
    remarks: &mut Vec<String>,
) -> Result<Vec<(usize, usize)>, MeasuredError> {
    let has_set = |name: &str| model.header.node_sets.iter().any(|set| set.name == name);
    let mut found = Vec::new();
    for (output, name) in outputs.iter().enumerate() {
        if observables.names().all(|known| known != name)
            && let Some((marker, axis)) = marker_axis(name).filter(|(marker, _)| has_set(marker))
            && observables.count() < MAX_OBSERVABLES
        {
            let mut direction = [0.0; 3];
            direction[axis] = 1.0;
            let (kind, points) = (ObservableKind::Position, vec![PointSpec::Set(marker.to_owned())]);
            let definition = Definition { kind, points, axis: Some(direction) };
            let added = Observables::define(model, &BTreeMap::from([(name.clone(), definition)]));
            observables.append(added.map_err(|problems| ModelFileError::Header(problems.join("; ")))?);
        }
        match observables.names().position(|known| known == name) {
            Some(at) => found.push((output, at)),
            None => remarks
                .push(format!("{name}: no observable of the model, and no coordinate of its node sets")),
        }
    }
    if !found.is_empty() {
        return Ok(found);
    }
    let sets = model.header.node_sets.iter().map(|set| set.name.as_str());
    let known: Vec<&str> = observables.names().chain(sets).collect();
    Err(MeasuredError::NoSuchOutput { found: outputs.join(", "), known: known.join(", ") })
}

impl Rows {
    fn correction(
        &self,
        regime: RegimeKind,
        inputs: &rom::inputs::InputMap,
        name: &str,
        of_modes: Option<f64>,
    ) -> Option<(Correction, Difference)> {
        let centres = centres(&self.x, inputs.dimensions());
        let mean_square = |errors: &[f64]| mean(errors.iter().map(|e| e * e));
        let mut best: Option<(f64, f64, f64, Vec<f64>)> = None;
        for reach in REACHES.map(|reach| reach * (inputs.dimensions() as f64).sqrt()) {
            let rows: Vec<Vec<f64>> = self.x.iter().map(|x| terms(&centres, reach, x).collect()).collect();
            for smoothing in SMOOTHINGS {
                let Some(errors) = self.left_out(&rows, smoothing) else { continue };
                let square = mean_square(&errors);
                if best.as_ref().is_none_or(|(least, ..)| square < *least) {
                    best = Some((square, reach, smoothing, errors));
                }
            }
        }
        let (square, reach, smoothing, mut errors) = best?;
        let terms: Vec<Vec<f64>> = self.x.iter().map(|x| terms(&centres, reach, x).collect()).collect();
        let mut weights = self.weights(&terms, smoothing, |_| true)?;
        let is_kept = square.sqrt() < MOST_LEFT * mean_square(&self.r).sqrt();
        if let (false, Some(_)) = (is_kept, of_modes) {
            // The modes' difference alone.
            weights.fill(0.0);
            errors.clone_from(&self.r);
        }
        // The modes' difference was fitted to all of these rows.
        errors.iter_mut().for_each(|error| *error *= of_modes.unwrap_or(1.0));
        let offset = |row: &Vec<f64>| row.iter().zip(&weights).map(|(g, w)| g * w).sum::<f64>();
        let largest_offset =
            terms.iter().map(offset).fold(0.0, |most: f64, v| if v.abs() > most.abs() { v } else { most });
        let residual = half_width(&self.run, &errors);
        let report = Difference {
            name: name.to_owned(),
            regime,
            states: self.r.len(),
            rms: mean_square(&self.of_elements).sqrt(),
            rms_left_out: mean_square(&errors).sqrt(),
            largest_offset,
            half_width: residual,
            is_kept,
        };
        let (inputs, difference) = (inputs.clone(), quantile(self.r.iter().map(|r| r.abs()), COVERAGE));
        Some((Correction { regime, inputs, reach, centres, weights, residual, difference }, report))
    }

    fn left_out(&self, terms: &[Vec<f64>], smoothing: f64) -> Option<Vec<f64>> {
        let mut errors = self.r.clone();
        for part in 0..FOLDS {
            let weights = self.weights(terms, smoothing, |at| self.fold[at] != part)?;
            for at in (0..terms.len()).filter(|at| self.fold[*at] == part) {
                errors[at] -= terms[at].iter().zip(&weights).map(|(g, w)| g * w).sum::<f64>();
            }
        }
        Some(errors)
    }

    fn weights(
        &self,
        terms: &[Vec<f64>],
        smoothing: f64,
        is_used: impl Fn(usize) -> bool,
    ) -> Option<Vec<f64>> {
        let count = terms.first()?.len();
        let (mut system, mut right) = (Dense::zeros(count), vec![0.0; count]);
        let mut rows = 0.0;
        for at in (0..terms.len()).filter(|at| is_used(*at)) {
            rows += 1.0;
            for (i, own) in terms[at].iter().enumerate() {
                right[i] += own * self.r[at];
                terms[at].iter().enumerate().for_each(|(j, v)| system[(i, j)] += own * v);
            }
        }
        (0..count).for_each(|i| system[(i, i)] += smoothing * f64::max(rows, 1.0));
        system.solve(&mut right, 1)?;
        Some(right)
    }
}
