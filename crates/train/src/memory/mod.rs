//! Identification of memory from recordings: which blocks, and their constants.
//!
//! ```text
//! minimise over the blocks' constants   sum |y - map(memory(u))|^2       search.rs
//! the map by least squares within                                        map.rs
//! ```
//! Parts of the recordings are left out in turn: four contiguous quarters of one run, or whole runs. Constants and map are fitted without the
//! part and judged on it. Starting from no block, the block that lowers this error most is added, as long as it lowers it by
//! [`KEPT`] and on at least half of the parts. A time constant at the longest that the runs can show is drift and no block. Inputs share
//! their constants. Remarks name what the recordings cannot show.

mod beside;
mod blocks;
mod map;
mod search;
mod slopes;

pub use beside::{FittedUnknowns, MemoryError, identify_beside};
pub use blocks::Block;
pub use map::ModelTerms;
pub use slopes::slopes;

use crate::measured::{Run, max_gap_s};
use blocks::Limits;
use map::Terms;
use rom::halfwidths::HALFWIDTH_SIGMAS;
use rom::memory::MemorySpec;
use rom::statistics::ends;
use search::{Candidate, Problem};
use serde::Serialize;

/// Fraction by which a block must lower the error on left-out parts.
pub const KEPT: f64 = 0.03;
/// Parts of one run that are left out in turn, and most parts of several.
pub const PARTS: usize = 4;
/// Ratio of the ends of an interval from which a constant is not identified.
const WIDE: f64 = 4.0;

/// Fewest rows: two in each of the parts that are left out.
const MIN_ROWS: usize = 2 * PARTS;

/// A constant with its 90 % interval.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Constant {
    /// Name (`filling`).
    pub name: &'static str,
    /// Unit of the constant; empty for a number.
    pub unit: &'static str,
    /// The value that was found.
    pub value: f64,
    /// Its 90 % interval.
    pub interval: [f64; 2],
}

/// Result for a block.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BlockReport {
    /// Which part of the memory it describes.
    pub block: Block,
    /// True if it is part of the memory.
    #[serde(rename = "kept")]
    pub is_kept: bool,
    /// Error on left-out parts without and with it.
    pub left_out: [f64; 2],
    /// Constants, if it is kept.
    pub constants: Vec<Constant>,
}

/// Result of [`identify`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identified {
    /// Blocks for inputs 0, 1, ... in the order of the columns; `None` if none is kept.
    #[serde(skip)]
    pub memory: Option<MemorySpec>,
    /// RMS error on left-out parts in units of the scales: without and with memory.
    pub left_out: [f64; 2],
    /// All blocks.
    pub blocks: Vec<BlockReport>,
    /// Limits of what the recordings can show.
    #[serde(skip)]
    pub remarks: Vec<String>,
}

/// Part of the recordings that each row belongs to, by run: whole runs, or contiguous quarters of one.
#[must_use]
pub fn parts(rows: &[usize]) -> Vec<Vec<usize>> {
    let one = |(run, count): (usize, &usize)| -> Vec<usize> {
        let part = |row: usize| if rows.len() > 1 { run % PARTS.max(2) } else { row * PARTS / count };
        (0..*count).map(part).collect()
    };
    rows.iter().enumerate().map(one).collect()
}

/// Identifies the memory of runs, whose inputs are gauge pressures in MPa or others. `scales` is the unit of each output's error, e.g.
/// the range of the outputs with its unit. The static map is that of a `model` up to weights, or a polynomial. Returns `None` where
/// the least-squares map has no finite solution, as of fewer than 8 rows or without an output. Cost: `O(1000 rows)`.
#[must_use]
pub fn identify(
    runs: &[Run],
    are_pressures: bool,
    scales: &[f64],
    model: Option<&dyn ModelTerms>,
) -> Option<Identified> {
    let inputs = runs.first()?.inputs.len();
    let range = |input: usize| ends(runs.iter().flat_map(|run| &run.inputs[input]));
    let ranges: Vec<[f64; 2]> = (0..inputs).map(range).collect();
    let mut intervals: Vec<f64> =
        runs.iter().flat_map(|run| run.time_s.windows(2).map(|t| t[1] - t[0])).collect();
    intervals.sort_by(f64::total_cmp);
    let interval_s = *intervals.get(intervals.len() / 2)?;
    let duration = |run: &Run| Some(run.time_s.last()? - run.time_s.first()?);
    let duration_s = runs.iter().filter_map(duration).fold(0.0, f64::max);
    let rows: usize = runs.iter().map(|run| run.time_s.len()).sum();
    // Each part is left out once, and without an output nothing is fitted.
    let has_data =
        rows >= MIN_ROWS && !scales.is_empty() && runs.iter().all(|run| run.outputs.len() == scales.len());
    let sound = has_data && ranges.iter().all(|[low, high]| high > low) && interval_s > 0.0;
    if !sound || inputs == 0 {
        return None;
    }
    let limits = Limits { interval_s, duration_s };
    let folds = parts(&runs.iter().map(|run| run.time_s.len()).collect::<Vec<_>>());
    let problem = Problem::new(runs, &folds, ranges.clone(), scales, max_gap_s(interval_s), limits);
    let maps = model.map_or_else(|| vec![Terms::Linear, Terms::Cubic], |model| vec![Terms::Model(model)]);
    let Selected { memoryless, kept, mut reports, mut remarks } =
        select(&problem, &maps, are_pressures, &limits)?;
    add_constants(&problem, &kept, &limits, &mut reports, &mut remarks);
    remarks.extend(unseen(runs, &ranges, &limits));
    let memory = (!kept.blocks.is_empty()).then(|| problem.spec(&kept.blocks, &kept.unknowns));
    Some(Identified { memory, left_out: [memoryless.left_out, kept.left_out], blocks: reports, remarks })
}

/// The best candidate without memory, the one with all blocks that are kept, and what is reported of each block.
struct Selected<'a> {
    memoryless: Candidate<'a>,
    kept: Candidate<'a>,
    reports: Vec<BlockReport>,
    remarks: Vec<String>,
}

/// Adds the block that lowers the left-out error most, one after the other, as long as one lowers it by [`KEPT`].
fn select<'a>(
    problem: &Problem<'a>,
    maps: &[Terms<'a>],
    are_pressures: bool,
    limits: &Limits,
) -> Option<Selected<'a>> {
    let start = Candidate {
        blocks: Vec::new(),
        terms: Terms::Cubic,
        unknowns: Vec::new(),
        left_out: f64::INFINITY,
        by_fold: Vec::new(),
        without: Vec::new(),
    };
    let best = |blocks: &[Block], from: &Candidate<'a>| {
        let found = maps.iter().filter_map(|terms| problem.candidate(blocks, *terms, from));
        found.min_by(|a, b| a.left_out.total_cmp(&b.left_out))
    };
    let memoryless = best(&[], &start)?;
    let mut kept = memoryless.clone();
    let mut reports = Vec::new();
    loop {
        let is_possible = |block: &Block| are_pressures || *block != Block::Orifice;
        let missing: Vec<Block> =
            Block::ALL.into_iter().filter(is_possible).filter(|block| !block.is_in(&kept.blocks)).collect();
        let with = |block: Block| -> Vec<Block> {
            Block::ALL.into_iter().filter(|b| *b == block || kept.blocks.contains(b)).collect()
        };
        let found: Vec<(Block, Candidate<'a>)> =
            missing.iter().filter_map(|block| Some((*block, best(&with(*block), &kept)?))).collect();
        let report = |block: Block, is_kept: bool, with: &Candidate<'a>| BlockReport {
            block,
            is_kept,
            left_out: [kept.left_out, with.left_out],
            constants: Vec::new(),
        };
        let improves = |with: &Candidate<'a>| {
            let better = with.by_fold.iter().zip(&kept.by_fold).filter(|(with, without)| with < without);
            let is_lower = with.left_out < (1.0 - KEPT) * kept.left_out;
            is_lower && 2 * better.count() >= with.by_fold.len() && limits.at_end(with).is_none()
        };
        let added = found.iter().filter(|(_, with)| improves(with));
        let Some((block, next)) = added.min_by(|a, b| a.1.left_out.total_cmp(&b.1.left_out)) else {
            reports.extend(found.iter().map(|(block, with)| report(*block, false, with)));
            let remarks = found.iter().filter_map(|(_, with)| limits.at_end(with)).collect();
            return Some(Selected { memoryless, kept, reports, remarks });
        };
        reports.push(report(*block, true, next));
        kept = next.clone();
    }
}

/// The constants of the blocks that are kept, and a remark for each that the recordings do not tell.
fn add_constants(
    problem: &Problem<'_>,
    kept: &Candidate<'_>,
    limits: &Limits,
    reports: &mut [BlockReport],
    remarks: &mut Vec<String>,
) {
    let deviations = problem.deviations(kept).unwrap_or_default();
    for (index, block) in kept.blocks.iter().enumerate() {
        let constants: Vec<Constant> =
            (0..2).map(|k| constant(*block, k, kept, limits, 2 * index + k, &deviations)).collect();
        for found in &constants {
            let [low, high] = found.interval;
            if high > WIDE * low && high - low > 0.2 {
                remarks.push(format!(
                    "{}, {}: {low:.3} to {high:.3} {}: these recordings do not tell it",
                    block.name(),
                    found.name,
                    found.unit
                ));
            }
        }
        if let Some(report) = reports.iter_mut().find(|report| report.block == *block) {
            report.constants = constants;
        }
    }
}

/// Constant with an interval from the curvature of the error and from its change without each part, whichever is wider.
fn constant(
    block: Block,
    which: usize,
    kept: &Candidate<'_>,
    limits: &Limits,
    at: usize,
    deviations: &[f64],
) -> Constant {
    let value = kept.unknowns[at];
    let count = kept.without.len() as f64;
    let mean = kept.without.iter().map(|own| own[at]).sum::<f64>() / count;
    let jackknife: f64 = kept.without.iter().map(|own| (own[at] - mean) * (own[at] - mean)).sum();
    let jackknife = ((count - 1.0) / count * jackknife).sqrt();
    let half = HALFWIDTH_SIGMAS * deviations.get(at).copied().unwrap_or(f64::INFINITY).max(jackknife);
    let [low, high] = limits.of(block)[which];
    let ends = [(value - half).max(low), (value + half).min(high)];
    let plain = |v: f64| if block.is_log(which) { v.exp() } else { v };
    let (name, unit) = block.constants()[which];
    Constant { name, unit, value: plain(value), interval: ends.map(plain) }
}

impl Limits {
    /// Remark on a set of blocks with a constant at the end of what it can be, which another run will not repeat: a time constant at the longest
    /// that the runs can show, a critical ratio that no valve has.
    fn at_end(&self, candidate: &Candidate<'_>) -> Option<String> {
        let is_longest =
            |block: Block, u: &[f64]| (0..2).any(|k| block.is_time(k) && u[k] > self.of(block)[k][1] - 0.01);
        let both = || candidate.blocks.iter().zip(candidate.unknowns.chunks_exact(2));
        let [low, high] = self.of(Block::Orifice)[1];
        if both().any(|(block, u)| *block == Block::Orifice && !(low + 0.01..high - 0.01).contains(&u[1])) {
            return Some(format!(
                "orifice: its critical ratio came out at the end of {low} to {high}: no orifice, not kept"
            ));
        }
        let (block, _) = both().find(|(block, u)| is_longest(**block, u))?;
        Some(format!(
            "{}: its time constant came out at the longest that a run of {:.3} s can show ({:.3} s): drift, not kept",
            block.name(),
            self.duration_s,
            0.25 * self.duration_s
        ))
    }
}

/// Shortest time in which `values` change by at least `by`, s; infinite if they never do. Cost `O(n log n)`.
///
/// For a rise, the best begin of an end is the latest instant whose value lies low enough. An instant with a later one that lies no
/// higher is never the best, so that the others, by time, also rise in value, and a bisection finds the latest low enough.
#[must_use]
pub fn shortest_crossing_s(time_s: &[f64], values: &[f64], by: f64) -> f64 {
    let mut shortest_s = f64::INFINITY;
    for sign in [1.0, -1.0] {
        let mut begins: Vec<(f64, f64)> = Vec::new();
        for (t_s, value) in time_s.iter().zip(values.iter().map(|value| sign * value)) {
            let low_enough = begins.partition_point(|(_, begin)| *begin <= value - by);
            if let Some((begin_s, _)) = low_enough.checked_sub(1).map(|at| begins[at]) {
                shortest_s = shortest_s.min(t_s - begin_s);
            }
            while begins.last().is_some_and(|(_, begin)| *begin >= value) {
                begins.pop();
            }
            begins.push((*t_s, value));
        }
    }
    shortest_s
}

/// Limits of what any fit to these runs can show.
fn unseen(runs: &[Run], ranges: &[[f64; 2]], limits: &Limits) -> Vec<String> {
    let Limits { interval_s, duration_s } = *limits;
    let mut remarks = vec![format!(
        "creep slower than {:.3} s and lags shorter than {:.3} s are not identifiable from runs of {duration_s:.3} s with a reading each {interval_s:.3} s",
        0.25 * duration_s,
        0.3 * interval_s
    )];
    // Shortest time in which an input crosses half of its range, and its turns.
    let (mut shortest_s, mut turns) = (f64::INFINITY, 0);
    for run in runs {
        for (values, [low, high]) in run.inputs.iter().zip(ranges) {
            shortest_s = shortest_s.min(shortest_crossing_s(&run.time_s, values, 0.5 * (high - low)));
            turns += crate::measured::turns(&crate::measured::directions(&vec![0; values.len()], values));
        }
    }
    remarks.push(if shortest_s.is_finite() {
        format!(
            "inertia is not identified here; no input crosses half of its range in less than {shortest_s:.3} s, so nothing is seen of swings above {:.3} Hz",
            0.35 / shortest_s
        )
    } else {
        "inertia is not identified here".to_owned()
    });
    if turns < 3 {
        remarks.push(format!(
            "the inputs turn {turns} times by more than 5 % of their range: play and slow creep are not told apart"
        ));
    }
    remarks
}
