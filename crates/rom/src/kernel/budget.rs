//! Which step each row of a basis may have, so that it is as small as an accepted error lets it be.
//!
//! Rounding a row `phi` to steps `s` adds `a e` to a field, with `e` evenly spread over `+- s/2`. Errors of different rows
//! have nothing to do with each other, so their squares add up:
//!
//! ```text
//! sum over rows of a^2 mean(e^2) <= accepted^2       mean(e^2) = s^2 / 12, of a value that rounds to 0 its square
//! ```
//! where `a` is the largest magnitude in use of the row's coefficient (1 for means and the rest shape). Every row begins in
//! f32; then the coarser step that saves most bytes for the error it adds is taken, as long as one fits. The largest error
//! of any value is a different matter: [`Basis::error_bound`](super::Basis::error_bound).

use super::TILE_NODES;
use super::mixed::{bytes, width};
use super::plan::{Op, Plan};
use super::spec::{BasisError, Shortfall, Spec};
use super::tiles::{RowOf, gather, rows};

/// The error that storing a basis may add.
#[derive(Debug, Clone, Copy)]
pub struct Budget<'a> {
    /// By coefficient: its largest magnitude in use.
    pub largest: &'a [f64],
    /// By field of the spec: root mean square over the nodes of what storage may add to its values, in its unit. Of a
    /// magnitude nothing is asked: its coordinates have theirs.
    pub accepted: &'a [f64],
    /// A field of which f32 adds more than is accepted stays in f32; otherwise it is an error.
    pub or_f32: bool,
}

/// Steps tried by row: half an octave apart, from one that i16 holds nowhere to one that nothing is left of.
const TRIED: i32 = 52;
/// Octaves of the finest step below a row's largest value.
const OCTAVES: f64 = 24.0;
/// Mean square of the rounding of an f32 by that of the value: half of 2^-23, evenly spread.
const F32_ROUNDING: f64 = 1.0 / (3.0 * (1_u64 << 48) as f64);

/// A step of a row and what it costs.
#[derive(Clone, Copy)]
struct Choice {
    step: f64,
    bytes: usize,
    /// What it adds to the mean square error of the field.
    square: f64,
}

/// A step for every row of the plan.
pub(super) fn steps(spec: &Spec<'_>, plan: &Plan, budget: &Budget<'_>) -> Result<Vec<f64>, BasisError> {
    let (mut steps, mut short) = (Vec::with_capacity(plan.rows), Vec::new());
    for op in &plan.ops {
        let accepted = budget.accepted.get(op.field).copied().unwrap_or(0.0).max(0.0);
        let largest = |at: usize| budget.largest.get(at).copied().unwrap_or(f64::INFINITY);
        let mut choices = Vec::new();
        for (row, coefficient) in rows(spec, op).iter().zip(op.coefficients_of_rows()) {
            choices.push(tried(spec, plan, op, row, coefficient.map_or(1.0, largest))?);
        }
        let least: f64 = choices.iter().map(|row| row[0].square).sum();
        let left = accepted * accepted - least;
        if left < 0.0 && budget.or_f32 {
            steps.extend(choices.iter().map(|row| row[0].step));
            continue;
        }
        if left.is_nan() || left < 0.0 {
            short.push(Shortfall { field: op.field, accepted, least: least.sqrt() });
            continue;
        }
        steps.extend(coarsest(&choices, left));
    }
    if short.is_empty() { Ok(steps) } else { Err(BasisError::Budget(short)) }
}

/// The steps that a row may have, f32 everywhere first.
fn tried(
    spec: &Spec<'_>,
    plan: &Plan,
    op: &Op,
    row: &RowOf<'_>,
    coefficient: f64,
) -> Result<Vec<Choice>, BasisError> {
    let mut tiles = Vec::with_capacity(plan.tiles()); // nodes, largest magnitude, sum of squares
    for tile in 0..plan.tiles() {
        let values = gather(spec, op.field, tile, &|node| row.value(node))?;
        let nodes = TILE_NODES.min(plan.nodes - tile * TILE_NODES);
        let largest = values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        tiles.push((nodes as f64, largest, values[..nodes].iter().map(|v| v * v).sum::<f64>()));
    }
    let largest = tiles.iter().fold(0.0_f64, |most, tile| most.max(tile.1));
    if largest == 0.0 {
        return Ok(vec![Choice { step: 1.0, bytes: 0, square: 0.0 }]);
    }
    let one = |at: i32| {
        let step = largest * (f64::from(at) / 2.0 - OCTAVES).exp2();
        let (mut sum, mut all) = (0.0, 0);
        for &(nodes, largest, squares) in &tiles {
            let width = width(largest, step);
            all += bytes(width);
            sum += match width {
                None => squares,
                Some(0) => squares * F32_ROUNDING,
                Some(_) => nodes * step * step / 12.0,
            };
        }
        Choice { step, bytes: all, square: coefficient * coefficient * sum / plan.nodes as f64 }
    };
    Ok((0..TRIED).map(one).collect())
}

/// Step by step the change that saves most bytes for its error, of those that still fit.
fn coarsest(rows: &[Vec<Choice>], mut left: f64) -> Vec<f64> {
    let mut taken = vec![0; rows.len()];
    loop {
        let mut best: Option<(f64, usize, usize, f64)> = None;
        for (row, choices) in rows.iter().enumerate() {
            let now = choices[taken[row]];
            for (at, next) in choices.iter().enumerate().skip(taken[row] + 1) {
                let adds = next.square - now.square;
                if next.bytes < now.bytes && adds <= left {
                    let worth = (now.bytes - next.bytes) as f64 / adds.max(f64::MIN_POSITIVE);
                    if best.is_none_or(|(most, ..)| worth > most) {
                        best = Some((worth, row, at, adds));
                    }
                }
            }
        }
        let Some((_, row, at, adds)) = best else { break };
        taken[row] = at;
        left -= adds.max(0.0);
    }
    rows.iter().zip(taken).map(|(choices, at)| choices[at].step).collect()
}
