//! The inverse questions: which pressure gives a force, which gap explains one.
//!
//! Both are one equation in one unknown, `F(P, gap) = F*`, over the sampled states. `F` rises with `P` and falls with the
//! gap, but nothing here relies on it: the range is scanned on a grid, the first crossing is taken, and it is closed in by
//! bisection and secant steps. Error bars follow to first order: `dP = dF / (dF/dP)`, `dgap = dF / |dF/dgap|`.

use rom::evaluation::Evaluation;
use rom::evaluator::Evaluator;
use rom::hull::DomainStatus;
use rom::inputs::Inputs;
use wire::QueryStatus;

/// Points of the scan; the force is smooth, so a crossing pair between two of them would be a wiggle of the model.
const GRID: usize = 24;
/// Steps that close a crossing in; each at least halves the bracket every third step.
const STEPS: usize = 60;
/// A force is met when it differs by less, N.
const TOLERANCE_N: f64 = 1e-9;

/// Why there is no solution, with the number that belongs to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoSolution {
    /// The reason.
    pub status: QueryStatus,
    /// See [`wire::QueryStatus`].
    pub limit: f64,
}

/// A solution and what explains the question within the error bars.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// The pressure in MPa or the gap in mm.
    pub value: f64,
    /// Half width of its error bar, same unit.
    pub uncertainty: f64,
    /// Lower end of the explanation, cut at the sampled states.
    pub low: f64,
    /// Upper end.
    pub high: f64,
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

/// One point of a scan.
#[derive(Debug, Clone, Copy)]
struct Point {
    at: f64,
    force_n: f64,
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

    /// Evaluates one state. Without memory: a question has no history, so no hysteresis.
    pub fn evaluate(&mut self, pressure_mpa: f64, gap_mm: f64) -> &Evaluation {
        self.evaluator.evaluate(Inputs::new(pressure_mpa, gap_mm), &mut self.evaluation);
        &self.evaluation
    }

    /// The last evaluation.
    pub fn evaluation(&self) -> &Evaluation {
        &self.evaluation
    }

    /// The lowest sampled pressure at which the force at this gap is `force_n`. About 40 evaluations.
    ///
    /// # Errors
    /// [`NoSolution`] with the largest or smallest force that the sampled states give at this gap, or where they lie.
    pub fn pressure_for_force(&mut self, gap_mm: f64, force_n: f64) -> Result<Solution, NoSolution> {
        let reach_mm = self.evaluator_reach_mm();
        if gap_mm > reach_mm {
            return Err(NoSolution { status: QueryStatus::OutOfReach, limit: reach_mm });
        }
        let [lowest, highest] = self.pressure_mpa;
        let onset = self.evaluate(highest, gap_mm).onset_pressure_mpa.unwrap_or(lowest).max(lowest);
        let points = self.scan(onset, highest, |solver, p| solver.force_inside(p, gap_mm));
        let (Some(first), Some(top)) = (points.first(), max(&points)) else {
            return Err(NoSolution {
                status: QueryStatus::OutsideDomain,
                limit: self.nearest_gap_mm(gap_mm),
            });
        };
        if force_n < first.force_n || force_n <= 0.0 {
            return Err(NoSolution { status: QueryStatus::ForceTooLow, limit: first.force_n });
        }
        if force_n > top.force_n {
            return Err(NoSolution { status: QueryStatus::ForceTooHigh, limit: top.force_n });
        }
        let value =
            self.close_in(&points, force_n, |solver, p| solver.force_inside(p, gap_mm)).unwrap_or(first.at);
        let found = self.evaluate(value, gap_mm);
        let uncertainty = found.halfwidths.force_n / found.force_by_pressure_n_per_mpa().abs();
        Ok(bounded(value, uncertainty, &points))
    }

    /// The sampled gap at which the force at this pressure is `force_n`, known to `force_halfwidth_n` (0: exact): the model's own
    /// error bar and the measurement's are added in squares. About 40 evaluations.
    ///
    /// # Errors
    /// [`NoSolution`]: no force (then only a smallest gap is known), more force than any sampled gap gives, a gap that is no
    /// input.
    pub fn gap_for_force(
        &mut self,
        pressure_mpa: f64,
        force_n: f64,
        force_halfwidth_n: f64,
    ) -> Result<Solution, NoSolution> {
        let [nearest, farthest] = self.gap_mm;
        if nearest == farthest {
            return Err(NoSolution { status: QueryStatus::GapIsFixed, limit: nearest });
        }
        let mut points = self.scan(nearest, farthest, |solver, gap| solver.force_inside(pressure_mpa, gap));
        // From the far end: the force begins at 0 there and grows towards the plate.
        points.reverse();
        let (Some(far), Some(top)) = (points.first(), max(&points)) else {
            let [low, high] = self.pressure_mpa;
            return Err(NoSolution {
                status: QueryStatus::OutsideDomain,
                limit: pressure_mpa.clamp(low, high),
            });
        };
        if force_n <= 0.0 {
            let limit = self.touching_mm(pressure_mpa);
            return Err(NoSolution { status: QueryStatus::NoContact, limit });
        }
        if force_n < far.force_n {
            return Err(NoSolution { status: QueryStatus::ForceTooLow, limit: far.force_n });
        }
        if force_n > top.force_n {
            return Err(NoSolution { status: QueryStatus::ForceTooHigh, limit: top.force_n });
        }
        let force = |solver: &mut Self, gap| solver.force_inside(pressure_mpa, gap);
        let value = self.close_in(&points, force_n, force).unwrap_or(far.at);
        let found = self.evaluate(pressure_mpa, value);
        let bar_n = found.halfwidths.force_n.hypot(force_halfwidth_n);
        let uncertainty = bar_n / found.force_by_gap_n_per_mm().abs();
        Ok(bounded(value, uncertainty, &points))
    }

    /// Largest gap that the pressures of the free model can close; infinite for a model without an onset.
    fn evaluator_reach_mm(&self) -> f64 {
        self.evaluator.onset().map_or(f64::INFINITY, |table| table.reach_mm())
    }

    /// The largest gap that this pressure closes, mm.
    fn touching_mm(&mut self, pressure_mpa: f64) -> f64 {
        let touches = |solver: &mut Self, gap| {
            solver.evaluate(pressure_mpa, gap).onset_pressure_mpa.is_some_and(|onset| onset <= pressure_mpa)
        };
        let (mut near, mut far) = (self.gap_mm[0].min(0.0), self.evaluator_reach_mm());
        for _ in 0..STEPS {
            let middle = 0.5 * (near + far);
            if touches(self, middle) { near = middle } else { far = middle }
        }
        near
    }

    /// The nearest gap towards the middle of the sampled ones at which some pressure is sampled, mm.
    fn nearest_gap_mm(&mut self, gap_mm: f64) -> f64 {
        let [low, high] = self.pressure_mpa;
        let middle = 0.5 * (self.gap_mm[0] + self.gap_mm[1]);
        for step in 1..=40 {
            let gap = gap_mm + (middle - gap_mm) * f64::from(step) / 40.0;
            let sampled = |p: i32| self.force_inside(low + (high - low) * f64::from(p) / 8.0, gap).is_some();
            if (0..=8).any(sampled) {
                return gap;
            }
        }
        middle
    }

    /// The force at a sampled state; none outside.
    fn force_inside(&mut self, pressure_mpa: f64, gap_mm: f64) -> Option<f64> {
        self.evaluate(pressure_mpa, gap_mm);
        let force_n = self.evaluation.contact_force_n;
        let inside = self.is_known() && self.evaluation.domain == DomainStatus::Inside && force_n.is_finite();
        inside.then_some(force_n)
    }

    /// The sampled points of a grid from `from` to `to`, with both edges of the sampled states found by bisection.
    fn scan(&mut self, from: f64, to: f64, force: impl Fn(&mut Self, f64) -> Option<f64>) -> Vec<Point> {
        let at = |i: usize| from + (to - from) * i as f64 / GRID as f64;
        let grid: Vec<(f64, Option<f64>)> = (0..=GRID).map(|i| (at(i), force(self, at(i)))).collect();
        let mut points: Vec<Point> = Vec::with_capacity(GRID + 3);
        for pair in grid.windows(2) {
            let &[(a, fa), (b, fb)] = pair else { continue };
            points.extend(fa.map(|force_n| Point { at: a, force_n }));
            if fa.is_some() != fb.is_some() {
                let (inside, outside) = if fa.is_some() { (a, b) } else { (b, a) };
                points.extend(self.edge(inside, outside, &force));
            }
        }
        points.extend(grid.last().and_then(|(at, force)| Some(Point { at: *at, force_n: (*force)? })));
        points
    }

    /// The outermost sampled point between one inside and one outside.
    fn edge(
        &mut self,
        inside: f64,
        outside: f64,
        force: &impl Fn(&mut Self, f64) -> Option<f64>,
    ) -> Option<Point> {
        let (mut inside, mut outside, mut found) = (inside, outside, None);
        for _ in 0..24 {
            let middle = 0.5 * (inside + outside);
            match force(self, middle) {
                Some(force_n) => (inside, found) = (middle, Some(Point { at: middle, force_n })),
                None => outside = middle,
            }
        }
        found
    }

    /// Closes in on the first crossing of `force_n` along the points.
    fn close_in(
        &mut self,
        points: &[Point],
        force_n: f64,
        force: impl Fn(&mut Self, f64) -> Option<f64>,
    ) -> Option<f64> {
        let crossing = points.windows(2).find_map(|pair| match pair {
            [a, b] if a.force_n <= force_n && force_n <= b.force_n => Some((*a, *b)),
            _ => None,
        });
        let (mut a, mut b) = crossing?;
        for step in 0..STEPS {
            let rise = b.force_n - a.force_n;
            let secant = a.at + (b.at - a.at) * (force_n - a.force_n) / rise;
            // Every third step halves, so that a bent curve cannot stall the secant at one end.
            let at = if step % 3 == 2 || !secant.is_finite() { 0.5 * (a.at + b.at) } else { secant };
            let found = Point { at, force_n: force(self, at)? };
            if (found.force_n - force_n).abs() < TOLERANCE_N {
                return Some(at);
            }
            if found.force_n < force_n { a = found } else { b = found }
        }
        Some(0.5 * (a.at + b.at))
    }
}

fn max(points: &[Point]) -> Option<Point> {
    points.iter().copied().max_by(|a, b| a.force_n.total_cmp(&b.force_n))
}

/// The explanation to first order, cut at the scanned points.
fn bounded(value: f64, uncertainty: f64, points: &[Point]) -> Solution {
    let ends =
        points.iter().fold((value, value), |(low, high), point| (low.min(point.at), high.max(point.at)));
    let low = (value - uncertainty).max(ends.0);
    let high = (value + uncertainty).min(ends.1);
    Solution { value, uncertainty, low, high }
}
