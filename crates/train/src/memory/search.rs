//! Search for the constants of a set of blocks by damped least squares, with the static map fitted at each of them.

use super::blocks::{self, Block, Limits};
use super::map::{Normal, Point, Terms};
use crate::measured::Run;
use rom::least_squares::{Residuals, Search, minimise, normal_matrix, square};

/// Most rows that the static map is fitted to.
const MAX_ROWS: usize = 2000;
/// Iterations of the search over all rows, and of that without one fold.
const ITERATIONS: usize = 12;
const FOLD_ITERATIONS: usize = 5;
/// Starting points, the best of the grid, from which the search begins.
const STARTS: usize = 3;
/// Decrease of the squared error below which the search ends.
const STOP: f64 = 1e-4;
/// Step of the difference quotients.
const STEP: f64 = 1e-3;

/// Recordings, prepared.
pub(super) struct Problem<'a> {
    runs: &'a [Run],
    /// Rows that are fitted, as run and row.
    rows: Vec<(usize, usize)>,
    /// Fold of each of them.
    fold: Vec<usize>,
    folds: usize,
    /// Range of each input, and the unit of each output's error.
    ranges: Vec<[f64; 2]>,
    scales: &'a [f64],
    max_gap_s: f64,
    limits: Limits,
    /// Begin and duration of each run.
    spans: Vec<[f64; 2]>,
}

/// Set of blocks with their constants.
#[derive(Clone)]
pub(super) struct Candidate<'a> {
    pub blocks: Vec<Block>,
    pub terms: Terms<'a>,
    pub unknowns: Vec<f64>,
    /// RMS error on left-out folds, all together and by fold.
    pub left_out: f64,
    pub by_fold: Vec<f64>,
    /// Unknowns without each fold.
    pub without: Vec<Vec<f64>>,
}

/// Fitted map on all rows: terms by row and output, and weights by output.
struct Fitted {
    count: usize,
    terms: Vec<f64>,
    weights: Vec<f64>,
}

impl<'a> Problem<'a> {
    pub(super) fn new(
        runs: &'a [Run],
        folds: &[Vec<usize>],
        ranges: Vec<[f64; 2]>,
        scales: &'a [f64],
        max_gap_s: f64,
        limits: Limits,
    ) -> Self {
        let usable = |(run, row): &(usize, usize)| runs[*run].outputs.iter().any(|y| y[*row].is_finite());
        let all = (0..runs.len()).flat_map(|run| (0..runs[run].time_s.len()).map(move |row| (run, row)));
        let all: Vec<(usize, usize)> = all.filter(usable).collect();
        let step = all.len().div_ceil(MAX_ROWS).max(1);
        let rows: Vec<(usize, usize)> = all.into_iter().step_by(step).collect();
        let fold: Vec<usize> = rows.iter().map(|(run, row)| folds[*run][*row]).collect();
        let count = fold.iter().max().map_or(0, |fold| fold + 1);
        let span = |run: &Run| {
            let [first, last] =
                [run.time_s.first(), run.time_s.last()].map(|t| t.copied().unwrap_or_default());
            [first, (last - first).max(f64::MIN_POSITIVE)]
        };
        let spans = runs.iter().map(span).collect();
        Self { runs, rows, fold, folds: count, ranges, scales, max_gap_s, limits, spans }
    }

    pub(super) fn spec(&self, blocks: &[Block], unknowns: &[f64]) -> rom::memory::MemorySpec {
        blocks::spec(blocks, unknowns, &self.ranges, self.max_gap_s)
    }

    /// Inputs behind the memory at all fitted rows, input after input.
    fn behind(&self, blocks: &[Block], unknowns: &[f64]) -> Vec<Vec<f64>> {
        let spec = self.spec(blocks, unknowns);
        let one = |input: usize| {
            let memory = &spec.inputs[input];
            let runs: Vec<Vec<f64>> = self
                .runs
                .iter()
                .map(|run| match blocks.is_empty() {
                    true => run.inputs[input].clone(),
                    false => memory.responses(&run.time_s, &run.inputs[input]),
                })
                .collect();
            self.rows.iter().map(|(run, row)| runs[*run][*row]).collect()
        };
        (0..self.ranges.len()).map(one).collect()
    }

    fn output(&self, fitted: usize, k: usize) -> f64 {
        let (run, row) = self.rows[fitted];
        self.runs[run].outputs[k][row]
    }

    /// Terms of all rows, and the weights fitted to those outside a fold.
    fn fit(
        &self,
        blocks: &[Block],
        terms: Terms<'_>,
        unknowns: &[f64],
        without: Option<usize>,
    ) -> Option<Fitted> {
        let x = self.behind(blocks, unknowns);
        let (count, outputs) = (terms.count(x.len(), self.runs.len()), self.scales.len());
        let mut all = Vec::with_capacity(count * outputs * self.rows.len());
        let mut normal = Normal::new(count, outputs);
        let (mut inputs, mut scaled) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        for (index, row) in self.rows.iter().enumerate() {
            for (input, (x, [low, high])) in x.iter().zip(&self.ranges).enumerate() {
                (inputs[input], scaled[input]) = (x[index], (x[index] - low) / (high - low));
            }
            let begin = all.len();
            let [begin_s, duration_s] = self.spans[row.0];
            let elapsed = (self.runs[row.0].time_s[row.1] - begin_s) / duration_s;
            let point = Point { row: *row, runs: self.runs.len(), elapsed, inputs: &inputs, scaled: &scaled };
            terms.push(&point, outputs, &mut all);
            if Some(self.fold[index]) != without {
                normal.add(&all[begin..], (0..outputs).map(|k| self.output(index, k)));
            }
        }
        Some(Fitted { count, terms: all, weights: normal.solve()? })
    }

    /// Scaled errors at the rows in whose fold `is_selected` is true; 0 where nothing was measured.
    fn errors(&self, fitted: &Fitted, is_selected: impl Fn(usize) -> bool) -> Vec<f64> {
        let mut errors = Vec::new();
        let rows = fitted.terms.chunks_exact(fitted.count * self.scales.len());
        for (index, row) in rows.enumerate().filter(|(index, _)| is_selected(self.fold[*index])) {
            let both = row.chunks_exact(fitted.count).zip(fitted.weights.chunks_exact(fitted.count));
            for (k, (row, weights)) in both.enumerate() {
                let predicted: f64 = row.iter().zip(weights).map(|(a, b)| a * b).sum();
                let error = (self.output(index, k) - predicted) / self.scales[k];
                errors.push(if error.is_finite() { error } else { 0.0 });
            }
        }
        errors
    }

    fn residuals(
        &self,
        blocks: &[Block],
        terms: Terms<'_>,
        unknowns: &[f64],
        without: Option<usize>,
    ) -> Option<Vec<f64>> {
        let fitted = self.fit(blocks, terms, unknowns, without)?;
        Some(self.errors(&fitted, |fold| Some(fold) != without))
    }

    /// The unknowns with the smallest projected residuals near `start`.
    fn minimise(
        &self,
        blocks: &[Block],
        terms: Terms<'_>,
        start: &[f64],
        without: Option<usize>,
        steps: usize,
    ) -> Option<Vec<f64>> {
        let search = Search {
            steps,
            tries: 5,
            damping: 1e-2,
            by_unknown: true,
            largest_change: 1.0,
            met: 0.0,
            least_decrease: STOP,
        };
        let mut projected = Projected { problem: self, blocks, terms, without };
        minimise(&mut projected, start, &search).map(|minimum| minimum.unknowns)
    }

    /// Derivatives of the residuals, one column per unknown.
    fn jacobian(
        &self,
        blocks: &[Block],
        terms: Terms<'_>,
        unknowns: &[f64],
        without: Option<usize>,
        residuals: &[f64],
    ) -> Option<Vec<Vec<f64>>> {
        let column = |k: usize| {
            let mut moved = unknowns.to_vec();
            let high = self.limits.of(blocks[k / 2])[k % 2][1];
            let step = if unknowns[k] + STEP > high { -STEP } else { STEP };
            moved[k] += step;
            let found = self.residuals(blocks, terms, &moved, without)?;
            Some(found.iter().zip(residuals).map(|(a, b)| (a - b) / step).collect())
        };
        (0..unknowns.len()).map(column).collect()
    }

    /// Standard deviations of the unknowns by the curvature of the error.
    pub(super) fn deviations(&self, candidate: &Candidate<'_>) -> Option<Vec<f64>> {
        let Candidate { blocks, terms, unknowns, .. } = candidate;
        let residuals = self.residuals(blocks, *terms, unknowns, None)?;
        let jacobian = self.jacobian(blocks, *terms, unknowns, None, &residuals)?;
        let variance = square(&residuals) / residuals.len() as f64;
        let one = |k: usize| {
            let mut unit = vec![0.0; unknowns.len()];
            unit[k] = 1.0;
            normal_matrix(&jacobian, 1e-12).solve(&mut unit, 1)?;
            Some((variance * unit[k]).sqrt())
        };
        (0..unknowns.len()).map(one).collect()
    }

    /// Starting points of a set of blocks: a grid of the added one, the others as in `from`; a single other one also from a coarse grid,
    /// because alone it has taken on what the added one explains.
    fn starts(&self, blocks: &[Block], from: &Candidate<'_>) -> Vec<Vec<f64>> {
        let Some(added) = blocks.iter().position(|block| !from.blocks.contains(block)) else {
            return vec![from.unknowns.clone()];
        };
        let mut others = vec![from.unknowns.clone()];
        if let [only] = from.blocks[..] {
            others.extend(self.limits.starts(only).into_iter().step_by(3).map(Vec::from));
        }
        let insert = |others: &Vec<f64>, start: [f64; 2]| {
            let mut unknowns = others.clone();
            unknowns.splice(2 * added..2 * added, start);
            unknowns
        };
        let grid = self.limits.starts(blocks[added]);
        others.iter().flat_map(|others| grid.iter().map(|start| insert(others, *start))).collect()
    }

    /// A set of blocks, its added block started from a grid, the others from `from`.
    pub(super) fn candidate<'m>(
        &self,
        blocks: &[Block],
        terms: Terms<'m>,
        from: &Candidate<'_>,
    ) -> Option<Candidate<'m>> {
        let cost = |start: &Vec<f64>| {
            let found = self.residuals(blocks, terms, start, None);
            found.map_or(f64::INFINITY, |residuals| square(&residuals))
        };
        let mut starts: Vec<(f64, Vec<f64>)> =
            self.starts(blocks, from).into_iter().map(|start| (cost(&start), start)).collect();
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let minima = starts.iter().take(STARTS).filter_map(|(_, start)| {
            let found = self.minimise(blocks, terms, start, None, ITERATIONS)?;
            Some((cost(&found), found))
        });
        let (_, unknowns) = minima.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let (mut without, mut by_fold, mut sum, mut count) = (Vec::new(), Vec::new(), 0.0, 0.0);
        for fold in 0..self.folds {
            let own = self.minimise(blocks, terms, &unknowns, Some(fold), FOLD_ITERATIONS)?;
            let fitted = self.fit(blocks, terms, &own, Some(fold))?;
            let errors = self.errors(&fitted, |at| at == fold);
            let rows = errors.len() as f64 / self.scales.len() as f64;
            by_fold.push((square(&errors) / rows.max(1.0)).sqrt());
            sum += square(&errors);
            count += rows;
            without.push(own);
        }
        let left_out = (sum / count).sqrt();
        left_out.is_finite().then(|| Candidate {
            blocks: blocks.to_vec(),
            terms,
            unknowns,
            left_out,
            by_fold,
            without,
        })
    }
}

/// Residuals of the constants of blocks, the static map fitted at each of them.
struct Projected<'a> {
    problem: &'a Problem<'a>,
    blocks: &'a [Block],
    terms: Terms<'a>,
    without: Option<usize>,
}

impl Residuals for Projected<'_> {
    fn at(&mut self, unknowns: &[f64]) -> Option<Vec<f64>> {
        self.problem.residuals(self.blocks, self.terms, unknowns, self.without)
    }

    fn jacobian(&mut self, unknowns: &[f64], residuals: &[f64]) -> Option<Vec<Vec<f64>>> {
        self.problem.jacobian(self.blocks, self.terms, unknowns, self.without, residuals)
    }

    fn bounds(&self, unknown: usize) -> [f64; 2] {
        self.problem.limits.of(self.blocks[unknown / 2])[unknown % 2]
    }
}
