//! What a model tells about the error that storing its basis may add: its own error, and its coefficients as they come in use.
//!
//! The own error of a field has two parts, both as root mean squares over the nodes: what leaving a state out costs, in
//! closed form from the interpolants that the model holds, of all states the median; and what the modes leave out, by the
//! singular values beyond them. Errors that have nothing to do with each other add in squares, so the own error grows by a
//! share `s` when `own^2 s (2 + s)` is added to its square.

use crate::inputs::{GAP, Point, square_distance};
use crate::interpolant::Interpolant;
use crate::kernel::Shortfall;
use crate::model::{GroupModel, RegimeModel};
use crate::sums::{Room, Sums};
use crate::system::left_out_of;

/// A state's neighbours between which coefficients are looked at as well: an interpolant's peaks lie between its samples.
const NEIGHBOURS: usize = 16;

/// Coefficients of a regime as they come in use.
pub(crate) struct Typical {
    /// Scaled inputs.
    pub states: Vec<Point>,
    /// By state.
    pub coefficients: Vec<Vec<f64>>,
}

/// At the training states, half way to their neighbours, and beyond the onset. `O(states^2 (log states + coefficients))`.
pub(crate) fn typical_coefficients(regime: &RegimeModel) -> Typical {
    let mut states = regime.groups.first().map(|group| states(&group.surrogate)).unwrap_or_default();
    let mut coefficients = vec![vec![0.0; regime.coefficient_count()]; states.len()];
    for group in &regime.groups {
        let sums = Sums::new(&[&group.surrogate]);
        let mut room = Room::of([&sums].into_iter());
        for (x, coefficients) in states.iter().zip(&mut coefficients) {
            sums.evaluate(x, &mut room, &mut coefficients[group.coefficients.clone()], None);
        }
    }
    if let Some(far) = &regime.far_onset {
        // Corrections begin at the last onset state: about the one of the largest gap.
        let gap = regime.inputs.axes.iter().position(|axis| axis.input == GAP).unwrap_or(0);
        if let Some(last) = (0..states.len()).max_by(|a, b| states[*a][gap].total_cmp(&states[*b][gap])) {
            for by in far.corrections.chunks_exact(regime.coefficient_count().max(1)) {
                states.push(states[last]);
                coefficients.push(coefficients[last].iter().zip(by).map(|(a, by)| a + by).collect());
            }
        }
    }
    Typical { states, coefficients }
}

/// Of these the largest magnitude of every coefficient.
pub(crate) fn largest_coefficients(regime: &RegimeModel) -> Vec<f64> {
    let mut largest = vec![0.0_f64; regime.coefficient_count()];
    for vector in typical_coefficients(regime).coefficients {
        largest.iter_mut().zip(vector).for_each(|(most, value)| *most = most.max(value.abs()));
    }
    largest
}

/// Scaled inputs of the samples, and half way to their nearest ones.
fn states(fit: &Interpolant) -> Vec<Point> {
    let centre = |row: &[f64]| std::array::from_fn(|i| row.get(i).copied().unwrap_or(0.0));
    let centres: Vec<Point> = fit.centres.chunks_exact(fit.dimensions).map(centre).collect();
    let mut all = Vec::new();
    for own in &centres {
        let mut others: Vec<&Point> = centres.iter().filter(|other| *other != own).collect();
        others.sort_by(|a, b| square_distance(a, own).total_cmp(&square_distance(b, own)));
        let between = others.into_iter().take(NEIGHBOURS).map(|other| {
            let middle: Point = std::array::from_fn(|i| 0.5 * (own[i] + other[i]));
            middle
        });
        all.push(fit.metric.undo(own));
        all.extend(between.map(|middle| fit.metric.undo(&middle)));
    }
    all
}

/// Own errors of the fields of a regime, worked out once for all of them.
pub(crate) struct OwnErrors<'a> {
    groups: Vec<(&'a GroupModel, Vec<f64>)>,
}

impl<'a> OwnErrors<'a> {
    /// Cost: a dense inverse of the size of each kernel's samples and derivatives.
    pub fn new(regime: &'a RegimeModel) -> Self {
        let mut groups = Vec::new();
        for alike in regime.groups.chunk_by(|a, b| a.surrogate.shares_kernel_with(&b.surrogate)) {
            let fits: Vec<&Interpolant> = alike.iter().map(|group| &group.surrogate).collect();
            // A system that cannot be inverted says nothing: its fields then have no error that may grow.
            groups.extend(alike.iter().zip(left_out_of(&fits).unwrap_or_default()));
        }
        Self { groups }
    }

    /// Of one field, in its unit, over `nodes` of its modes: `modes` holds one after the other, `stride` apart.
    pub fn of(&self, field: usize, modes: &[f32], stride: usize, nodes: &[usize]) -> f64 {
        let Some((group, residuals)) = self.groups.iter().find(|(group, _)| group.fields.contains(&field))
        else {
            return 0.0;
        };
        let count = group.surrogate.outputs;
        let products = products(modes, stride, count, nodes);
        let mean_square = |left_out: &[f64]| -> f64 {
            let row = |j: usize| -> f64 {
                products[j * count..][..count].iter().zip(left_out).map(|(p, e)| p * e).sum()
            };
            left_out.iter().enumerate().map(|(j, e)| e * row(j)).sum::<f64>() / nodes.len().max(1) as f64
        };
        let mut errors: Vec<f64> = residuals.chunks_exact(count.max(1)).map(mean_square).collect();
        errors.sort_by(f64::total_cmp);
        let left_out = errors.get(errors.len() / 2).map_or(0.0, |square| square.max(0.0));
        (left_out + truncated(group, stride)).sqrt()
    }
}

/// Mean square of what the modes leave out of a snapshot.
fn truncated(group: &GroupModel, node_count: usize) -> f64 {
    let beyond: f64 = group.singular_values.iter().skip(group.surrogate.outputs).map(|s| s * s).sum();
    let entries = group.singular_values.len() * group.fields.len() * node_count;
    beyond / entries.max(1) as f64
}

/// Products of the modes with each other over these nodes.
fn products(modes: &[f32], stride: usize, count: usize, nodes: &[usize]) -> Vec<f64> {
    let gathered: Vec<Vec<f64>> =
        (0..count).map(|j| nodes.iter().map(|&node| f64::from(modes[j * stride + node])).collect()).collect();
    let mut products = vec![0.0; count * count];
    for j in 0..count {
        for k in 0..=j {
            let product: f64 = gathered[j].iter().zip(&gathered[k]).map(|(a, b)| a * b).sum();
            products[j * count + k] = product;
            products[k * count + j] = product;
        }
    }
    products
}

/// What may be added to an own error that may grow by `share`.
pub(crate) fn added(own: f64, share: f64) -> f64 {
    own * (share * (2.0 + share)).max(0.0).sqrt()
}

/// The least share for which a field is not short.
pub(crate) fn least_share(short: &Shortfall, own: f64) -> f64 {
    let ratio = short.least / own;
    ratio * ratio / (1.0 + ratio.hypot(1.0))
}
