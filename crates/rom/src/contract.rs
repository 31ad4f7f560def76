//! The part of a model that some points of its mesh need: interpolants of their coordinates instead of modal coefficients.
//!
//! A point's coordinate is `x = m + sum_k phi_k c_k(inputs)` and each coefficient a sum of kernel terms, `c_k = sum_t w_tk g_t`, so
//! that `x = m + sum_t (sum_k w_tk phi_k) g_t`: the inner sum is done once. An evaluation then costs `terms x coordinates`
//! products instead of `terms x modes`, and only requested fields and stresses are computed.

use crate::difference::FieldDifference;
use crate::interpolant::Interpolant;
use crate::model::{FarOnset, GroupModel, ModelHeader, RegimeModel};
use crate::snapshots::RegimeKind;

/// A wanted output of a regime: a weighted sum of the coefficients of groups with one kernel.
#[derive(Clone, Debug)]
pub(crate) struct Output {
    /// Position of each group and weight of each of its coefficients; at least one.
    pub(crate) parts: Vec<(usize, Vec<f64>)>,
}

/// The header with these outputs, by regime, in place of its groups; and by regime where each output then lies in the
/// coefficients. Force, onset and domain stay.
pub(crate) fn contracted(header: &ModelHeader, outputs: &[Vec<Output>]) -> (ModelHeader, Vec<Vec<usize>>) {
    let mut out = header.clone();
    out.fields.truncate(1);
    out.fields.iter_mut().for_each(|field| field.magnitude_of = None);
    out.node_sets.clear();
    out.body = None; // its rows are those of the modes
    let mut places = Vec::new();
    for ((new, old), wanted) in out.regimes.iter_mut().zip(&header.regimes).zip(outputs) {
        // The onset is solved from a group of the free model.
        let kept = out.clearance.as_mut().filter(|_| old.kind == RegimeKind::Free);
        let (regime, place) = of_regime(old, wanted, kept.as_ref().map(|clearance| clearance.group));
        if let Some(clearance) = kept {
            clearance.group = regime.groups.len() - 1;
        }
        *new = regime;
        places.push(place);
    }
    (out, places)
}

/// One regime; the group `kept` follows the outputs unchanged.
fn of_regime(old: &RegimeModel, wanted: &[Output], kept: Option<usize>) -> (RegimeModel, Vec<usize>) {
    let mut new = RegimeModel {
        groups: Vec::new(),
        local_halfwidths: None,
        far_onset: None,
        difference: None,
        ..old.clone()
    };
    let surrogate = |output: &Output| &old.groups[output.parts[0].0].surrogate;
    let (mut place, mut next, mut corrections) = (Vec::new(), 0, Vec::new());
    let alike = |a: &Output, b: &Output| {
        surrogate(a).shares_kernel_with(surrogate(b)) && surrogate(a).tail == surrogate(b).tail
    };
    for outputs in wanted.chunk_by(alike) {
        let surrogate = weighed(old, outputs);
        place.extend(next..next + outputs.len());
        corrections.extend(outputs);
        next = push(&mut new, next, surrogate);
    }
    if let Some(kept) = kept.and_then(|kept| old.groups.get(kept)) {
        push(&mut new, next, kept.surrogate.clone());
    } else if let (true, Some(first)) = (new.groups.is_empty(), old.groups.first()) {
        let nothing = Interpolant {
            outputs: 0,
            weights: Vec::new(),
            tail_weights: Vec::new(),
            ..first.surrogate.clone()
        };
        push(&mut new, next, nothing);
    }
    new.far_onset = old.far_onset.as_ref().map(|far| FarOnset {
        gap_mm: far.gap_mm.clone(),
        corrections: summed(old, &far.corrections, &corrections),
    });
    new.difference = old.difference.as_ref().map(|difference| differing(old, difference, &corrections));
    (new, place)
}

/// Adds a group; returns where the next one begins.
fn push(regime: &mut RegimeModel, begin: usize, surrogate: Interpolant) -> usize {
    let coefficients = begin..begin + surrogate.outputs;
    let (name, end) = (String::from("points"), coefficients.end);
    regime.groups.push(GroupModel {
        name,
        fields: vec![0],
        coefficients,
        surrogate,
        singular_values: Vec::new(),
    });
    end
}

/// The interpolant of outputs whose groups share their kernel.
fn weighed(old: &RegimeModel, outputs: &[Output]) -> Interpolant {
    let first = &old.groups[outputs[0].parts[0].0].surrogate;
    let width = outputs.len();
    let sums = |terms: usize, weights_of: &dyn Fn(&Interpolant) -> &[f64]| {
        let mut sums = vec![0.0; terms * width];
        let parts = outputs
            .iter()
            .enumerate()
            .flat_map(|(index, output)| output.parts.iter().map(move |part| (index, part)));
        for (index, (group, weights)) in parts {
            let source = &old.groups[*group].surrogate;
            let rows = weights_of(source).chunks_exact(source.outputs.max(1));
            for (row, sums) in rows.zip(sums.chunks_exact_mut(width)) {
                sums[index] += dot(weights, row);
            }
        }
        sums
    };
    Interpolant {
        weights: sums(first.terms(), &|source| &source.weights),
        tail_weights: sums(first.tail.terms(first.dimensions), &|source| &source.tail_weights),
        outputs: width,
        ..first.clone()
    }
}

/// The outputs' part of rows over all coefficients.
fn summed(old: &RegimeModel, rows: &[f64], outputs: &[&Output]) -> Vec<f64> {
    let rows = rows.chunks_exact(old.coefficient_count().max(1));
    let weighted_sum = |row: &[f64], output: &Output| -> f64 {
        let part = |(group, weights): &(usize, Vec<f64>)| {
            dot(weights, &row[old.groups[*group].coefficients.clone()])
        };
        output.parts.iter().map(part).sum()
    };
    rows.flat_map(|row| outputs.iter().map(move |output| weighted_sum(row, output))).collect()
}

/// The measured difference of the outputs.
fn differing(old: &RegimeModel, difference: &FieldDifference, outputs: &[&Output]) -> FieldDifference {
    let count = old.coefficient_count();
    let mut rows = vec![0.0; difference.centres.len() * count];
    let weights = difference.weights.chunks_exact(difference.coefficients.len().max(1));
    for (row, weights) in rows.chunks_exact_mut(count.max(1)).zip(weights) {
        difference.coefficients.iter().zip(weights).for_each(|(index, w)| row[*index] += w);
    }
    let (coefficients, weights) = ((0..outputs.len()).collect(), summed(old, &rows, outputs));
    FieldDifference { coefficients, weights, ..difference.clone() }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
