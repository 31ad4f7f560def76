//! Roots of a function of one variable. A [`Root`] exists only where an evaluation gave the asked value back: there is no
//! other way to make one, so a search that did not close cannot be mistaken for an answer.

/// Steps that close a bracket in. Every third one halves it, which alone reaches neighbouring numbers.
const STEPS: usize = 200;
/// Fraction of the tolerance at which a search ends early. Rounding of large terms may prevent it.
const ENOUGH: f64 = 0.01;

/// Target of a search.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target {
    /// The value to be met.
    pub value: f64,
    /// Tolerance, in the same unit.
    pub tolerance: f64,
}

/// A place where the function was evaluated and met the target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Root(f64);

impl Root {
    pub fn at(self) -> f64 {
        self.0
    }

    fn check(at: f64, value: f64, target: Target) -> Option<Self> {
        ((value - target.value).abs() <= target.tolerance).then_some(Self(at))
    }
}

/// A place and the function's value there.
pub(super) type Sample = (f64, f64);

/// The first root along the samples, whose places rise or fall. None when no two neighbours have the target between them,
/// or when the function jumps over it.
pub(super) fn first_root(samples: &[Sample], target: Target, f: &mut impl FnMut(f64) -> f64) -> Option<Root> {
    let found = samples.first().and_then(|(at, value)| Root::check(*at, *value, target));
    found
        .or_else(|| samples.iter().zip(samples.iter().skip(1)).find_map(|(a, b)| close_in(*a, *b, target, f)))
}

/// Closes in on a root between two samples by secant steps and bisection.
fn close_in(a: Sample, b: Sample, target: Target, f: &mut impl FnMut(f64) -> f64) -> Option<Root> {
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
        let at = if step % 3 == 2 || !inside { middle } else { secant };
        let sample = (at, f(at));
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
