//! The inverse questions: which pressure gives a force, which gap explains one.
//!
//! Both are one equation in one unknown, `F(P, gap) = F*`, along a line through the contact training range. The range is
//! convex, so the line meets it in one interval. The interval is found first, then sampled, and the first crossing of `F*` is
//! bracketed. An answer is a [`Root`], where the model reproduces the force. Half-widths follow to first order:
//! `dP = dF / (dF/dP)`, `dgap = dF / |dF/dgap|`.

use rom::evaluation::Evaluation;
use rom::evaluator::{Evaluator, Query};
use rom::hull::DomainStatus;
use rom::inputs::Inputs;
use rom::model::ModelError;
use rom::snapshots::RegimeKind;
use wire::QueryStatus;

/// Intervals between the samples of a line; the force is smooth, so crossings that come in pairs within one are too.
const GRID: usize = 24;
/// Steps that find the training range along a line; each leaves two thirds.
const THIRDS: usize = 60;
/// Steps that find one of its ends, to the last digits of a number.
const HALVES: usize = 60;
/// Steps that find the nearest gap with samples, to a millionth of the way.
const NEAREST: usize = 20;
/// Margin inside the sampled gaps, as a fraction of them, against rounding.
const NEARBY: f64 = 1e-6;
/// A force is met when it differs by less, N: above the rounding of the model's sums, far below its half-widths.
const TOLERANCE_N: f64 = 1e-7;

/// Why there is no solution, with the number that belongs to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoSolution {
    pub status: QueryStatus,
    /// See [`wire::QueryStatus`].
    pub limit: f64,
}

impl NoSolution {
    fn new(status: QueryStatus, limit: f64) -> Self {
        Self { status, limit }
    }
}

/// A solution and what explains the question within the half-widths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// The pressure in MPa or the gap in mm.
    pub value: f64,
    /// Its half-width, same unit.
    pub uncertainty: f64,
    /// Lower end of the explanation, cut at the sampled states.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// The states among which an answer is searched.
#[derive(Debug, Clone, Copy)]
enum Line {
    /// All pressures at a gap in mm.
    AtGap(f64),
    /// All gaps at a pressure in MPa.
    AtPressure(f64),
}

impl Line {
    /// Inputs on the line, by the one that varies along it.
    fn inputs(self, along: f64) -> Inputs {
        match self {
            Self::AtGap(gap_mm) => Inputs::new(along, gap_mm),
            Self::AtPressure(pressure_mpa) => Inputs::new(pressure_mpa, along),
        }
    }
}

/// A model as the solver sees it.
#[derive(Debug)]
pub struct Solver {
    evaluator: Evaluator,
    evaluation: Evaluation,
    /// Sampled pressures, MPa.
    pub pressure_mpa: [f64; 2],
    /// Sampled gaps, mm; the same twice: the gap is no input.
    pub gap_mm: [f64; 2],
}

impl Solver {
    /// A solver over the sampled ranges.
    pub fn new(evaluator: Evaluator, pressure_mpa: [f64; 2], gap_mm: [f64; 2]) -> Self {
        let evaluation = evaluator.evaluation();
        Self { evaluator, evaluation, pressure_mpa, gap_mm }
    }

    /// Whether the model has the regime of the last state; without it that evaluation says nothing.
    pub fn is_known(&self) -> bool {
        self.evaluator.has_regime(self.evaluation.regime)
    }

    /// Sets the parameters to the values of a state; NaN leaves a parameter unchanged.
    ///
    /// # Errors
    /// The free model sinks at no pressure there; the previous values are kept.
    pub(super) fn set_parameters(&mut self, inputs: &Inputs) -> Result<(), ModelError> {
        self.evaluator.set_parameters(inputs, &mut self.evaluation)
    }

    pub fn evaluate(&mut self, pressure_mpa: f64, gap_mm: f64) -> &Evaluation {
        self.evaluator.evaluate(Inputs::new(pressure_mpa, gap_mm), &mut self.evaluation);
        &self.evaluation
    }

    /// True if the model was trained on contact forces.
    pub fn has_forces(&self) -> bool {
        self.evaluator.has_forces()
    }

    pub fn evaluation(&self) -> &Evaluation {
        &self.evaluation
    }

    /// The lowest sampled pressure at which the force at this gap is `force_n`. About 200 evaluations.
    ///
    /// # Errors
    /// [`NoSolution`] with the largest or smallest force that the sampled states give at this gap, or where they lie.
    pub fn pressure_for_force(&mut self, gap_mm: f64, force_n: f64) -> Result<Solution, NoSolution> {
        let reach_mm = self.reach_mm();
        if gap_mm > reach_mm {
            return Err(NoSolution::new(QueryStatus::OutOfReach, reach_mm));
        }
        let line = Line::AtGap(gap_mm);
        let Some(sampled) = self.sampled_pressures(gap_mm) else {
            return Err(NoSolution::new(QueryStatus::OutsideDomain, self.nearest_gap_mm(gap_mm)));
        };
        let root = self.solve(line, sampled, force_n)?;
        let found = self.evaluate_on(line, root.at());
        let uncertainty = found.halfwidths.force_n / found.force_by_pressure_n_per_mpa().abs();
        Ok(bounded(root, uncertainty, sampled))
    }

    /// The largest sampled gap at which the force at this pressure is `force_n`, known to `force_halfwidth_n` (0: exact): the
    /// model's own half-width and the measurement's are added in squares. About 200 evaluations.
    ///
    /// # Errors
    /// [`NoSolution`]: no force (then only a smallest gap is known), less or more force than any sampled gap gives, a gap
    /// that is no input.
    pub fn gap_for_force(
        &mut self,
        pressure_mpa: f64,
        force_n: f64,
        force_halfwidth_n: f64,
    ) -> Result<Solution, NoSolution> {
        let [nearest, farthest] = self.gap_mm;
        if nearest == farthest {
            return Err(NoSolution::new(QueryStatus::GapIsFixed, nearest));
        }
        let line = Line::AtPressure(pressure_mpa);
        let closed = self.evaluator.onset().map_or(farthest, |table| table.closed_gap_mm(pressure_mpa));
        // From the far end: the force begins at 0 there and grows towards the plate.
        let Some(sampled) = self.sampled(line, [closed.min(farthest), nearest]) else {
            let [low, high] = self.pressure_mpa;
            return Err(NoSolution::new(QueryStatus::OutsideDomain, pressure_mpa.clamp(low, high)));
        };
        if force_n <= 0.0 {
            return Err(NoSolution::new(QueryStatus::NoContact, closed));
        }
        let root = self.solve(line, sampled, force_n)?;
        let found = self.evaluate_on(line, root.at());
        let halfwidth_n = found.halfwidths.force_n.hypot(force_halfwidth_n);
        let uncertainty = halfwidth_n / found.force_by_gap_n_per_mm().abs();
        Ok(bounded(root, uncertainty, sampled))
    }

    /// The first place from one end of a sampled interval to the other at which the force is `force_n`.
    fn solve(&mut self, line: Line, [from, to]: [f64; 2], force_n: f64) -> Result<Root, NoSolution> {
        let grid_point = |i: usize| from + (to - from) * i as f64 / GRID as f64;
        let mut force = |at: f64| self.force(line, at);
        let mut samples: Vec<Sample> = (0..GRID).map(|i| (grid_point(i), force(grid_point(i)))).collect();
        samples.push((to, force(to)));
        let target = SearchTarget { value: force_n, tolerance: TOLERANCE_N };
        let found = if force_n > 0.0 { first_root(&samples, target, &mut force) } else { None };
        let first = samples.first().map_or(f64::NAN, |sample| sample.1);
        let most = samples.iter().map(|sample| sample.1).fold(f64::NEG_INFINITY, f64::max);
        found.ok_or(match force_n > most {
            true => NoSolution::new(QueryStatus::ForceTooHigh, most),
            false => NoSolution::new(QueryStatus::ForceTooLow, first),
        })
    }

    /// Largest gap that the pressures of the free model can close; infinite for a model without an onset.
    fn reach_mm(&self) -> f64 {
        self.evaluator.onset().map_or(f64::INFINITY, |table| table.reach_mm())
    }

    /// The sampled pressures in contact at a gap, the lowest first.
    fn sampled_pressures(&mut self, gap_mm: f64) -> Option<[f64; 2]> {
        let [lowest, highest] = self.pressure_mpa;
        self.evaluator.answer(Inputs::new(highest, gap_mm), Query::REGIME, &mut self.evaluation);
        let onset = self.evaluation.onset_pressure_mpa.unwrap_or(lowest).max(lowest);
        self.sampled(Line::AtGap(gap_mm), [onset, highest])
    }

    /// The nearest gap towards the middle of the sampled ones at which some pressure is sampled, mm; NaN when there is none.
    fn nearest_gap_mm(&mut self, gap_mm: f64) -> f64 {
        let [low, high] = self.gap_mm;
        let edge = NEARBY * (high - low);
        // Nearly always the end of the sampled gaps itself.
        let end = gap_mm.max(low + edge).min(high - edge);
        if end != gap_mm && self.sampled_pressures(end).is_some() {
            return end;
        }
        let (mut without, mut with) = (gap_mm, 0.5 * (low + high));
        if self.sampled_pressures(with).is_none() {
            return f64::NAN;
        }
        for _ in 0..NEAREST {
            let middle = 0.5 * (without + with);
            if self.sampled_pressures(middle).is_some() { with = middle } else { without = middle }
        }
        with
    }

    fn evaluate_on(&mut self, line: Line, along: f64) -> &Evaluation {
        self.evaluator.evaluate(line.inputs(along), &mut self.evaluation);
        &self.evaluation
    }

    fn force(&mut self, line: Line, along: f64) -> f64 {
        self.evaluator.answer(line.inputs(along), Query::STATE, &mut self.evaluation);
        self.evaluation.contact_force_n
    }

    /// Distance to the sampled states in contact; infinite for a state without contact.
    fn distance(&mut self, line: Line, along: f64) -> f64 {
        self.evaluator.answer(line.inputs(along), Query::REGIME, &mut self.evaluation);
        let found = &self.evaluation;
        if found.regime == RegimeKind::Contact { found.domain_distance } else { f64::INFINITY }
    }

    fn is_sampled(&mut self, line: Line, along: f64) -> bool {
        self.distance(line, along).is_finite() && self.evaluation.domain == DomainStatus::Inside
    }

    /// Part of a line between two places, in their order, inside the contact training range.
    fn sampled(&mut self, line: Line, [from, to]: [f64; 2]) -> Option<[f64; 2]> {
        let inside = self.inside(line, from, to)?;
        Some([self.edge(line, inside, from), self.edge(line, inside, to)])
    }

    /// A place inside the training range. The distance to a convex range is convex, so the third with the larger distance is left
    /// out until a place is inside, or the rest is shorter than the distance.
    fn inside(&mut self, line: Line, from: f64, to: f64) -> Option<f64> {
        if let Some(end) = [from, to].into_iter().find(|end| self.is_sampled(line, *end)) {
            return Some(end);
        }
        let [low, high] = match line {
            Line::AtGap(_) => self.pressure_mpa,
            Line::AtPressure(_) => self.gap_mm,
        };
        let (mut from, mut to) = (from, to);
        for _ in 0..THIRDS {
            let (a, b) = (from + (to - from) / 3.0, to - (to - from) / 3.0);
            if self.is_sampled(line, a) {
                return Some(a);
            }
            let distance = self.distance(line, a);
            // Distances are over inputs scaled by their ranges in contact, more than half of these, and change by no more
            // than the scaled inputs do.
            if distance.is_finite() && distance > 2.0 * (to - from).abs() / (high - low) {
                return None;
            }
            if self.is_sampled(line, b) {
                return Some(b);
            }
            if distance > self.distance(line, b) { from = a } else { to = b }
        }
        None
    }

    /// Last place inside the training range on the way from an inside one to `end`.
    fn edge(&mut self, line: Line, inside: f64, end: f64) -> f64 {
        if self.is_sampled(line, end) {
            return end;
        }
        let (mut inside, mut outside) = (inside, end);
        for _ in 0..HALVES {
            let middle = 0.5 * (inside + outside);
            if self.is_sampled(line, middle) { inside = middle } else { outside = middle }
        }
        inside
    }
}

/// The explanation to first order, cut at the sampled states.
fn bounded(root: Root, uncertainty: f64, [a, b]: [f64; 2]) -> Solution {
    let value = root.at();
    let (low, high) = ((value - uncertainty).max(a.min(b)), (value + uncertainty).min(a.max(b)));
    Solution { value, uncertainty, low, high }
}

/// Steps that close a bracket in. Every third one halves it, which alone reaches neighbouring numbers.
const STEPS: usize = 200;
/// Fraction of the tolerance at which a search ends early. Rounding of large terms may prevent it.
const ENOUGH: f64 = 0.01;

/// Target of a search.
#[derive(Debug, Clone, Copy)]
struct SearchTarget {
    /// The value to be met.
    value: f64,
    /// Tolerance, in the same unit.
    tolerance: f64,
}

/// A place where the function was evaluated and met the target. There is no other way to make one, so a search that did not close cannot
/// be mistaken for an answer.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Root(f64);

impl Root {
    fn at(self) -> f64 {
        self.0
    }

    fn check(place: f64, value: f64, target: SearchTarget) -> Option<Self> {
        ((value - target.value).abs() <= target.tolerance).then_some(Self(place))
    }
}

/// A place and the function's value there.
type Sample = (f64, f64);

/// The first root along the samples, whose places rise or fall. None when no two neighbours have the target between them,
/// or when the function jumps over it.
fn first_root(samples: &[Sample], target: SearchTarget, f: &mut impl FnMut(f64) -> f64) -> Option<Root> {
    let found = samples.first().and_then(|(index, value)| Root::check(*index, *value, target));
    found
        .or_else(|| samples.iter().zip(samples.iter().skip(1)).find_map(|(a, b)| close_in(*a, *b, target, f)))
}

/// Closes in on a root between two samples by secant steps and bisection.
fn close_in(a: Sample, b: Sample, target: SearchTarget, f: &mut impl FnMut(f64) -> f64) -> Option<Root> {
    let below = |sample: Sample| sample.1 < target.value;
    let off = |sample: Sample| (sample.1 - target.value).abs();
    if below(a) == below(b) || !(a.1.is_finite() && b.1.is_finite()) {
        return Root::check(b.0, b.1, target);
    }
    let (mut a, mut b) = (a, b);
    let mut best = if off(a) < off(b) { a } else { b };
    for step in 0..STEPS {
        let middle = 0.5 * (a.0 + b.0);
        if off(best) <= ENOUGH * target.tolerance || middle == a.0 || middle == b.0 {
            break;
        }
        let secant = a.0 + (b.0 - a.0) * (target.value - a.1) / (b.1 - a.1);
        let inside = secant > a.0.min(b.0) && secant < a.0.max(b.0);
        let next = if step % 3 == 2 || !inside { middle } else { secant };
        let sample = (next, f(next));
        if !sample.1.is_finite() {
            return None;
        }
        best = if off(sample) < off(best) { sample } else { best };
        if below(sample) == below(a) { a = sample } else { b = sample }
    }
    Root::check(best.0, best.1, target)
}

#[cfg(test)]
#[path = "../../tests/unit/query_root.rs"]
mod tests;
