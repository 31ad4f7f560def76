//! Which case comes next and where it starts from: the nearest solved state in scaled (pressure, gap).
//!
//! The problem is conservative and frictionless, so the path does not matter and the shortest is the cheapest. Cases and
//! solved states grow into a minimum spanning tree (Prim 1957): a free thread takes the shortest branch.

use super::store::Solved;
use crate::cases::Case;
use std::sync::Arc;

/// One unit of distance in pressure and in gap: about the extent of the paper's domain.
const PRESSURE_UNIT_MPA: f64 = 0.09;
const GAP_UNIT_MM: f64 = 40.0;
/// How often a case is tried.
const TRIES: usize = 2;

/// The branches still to grow.
#[derive(Debug, Default)]
pub(super) struct Schedule {
    /// Indices of cases not yet taken, with the number of failed tries.
    waiting: Vec<(usize, usize)>,
    solved: Vec<(usize, Arc<Solved>)>,
    /// Cases in work.
    pub(super) running: usize,
}

/// What a thread is to do.
pub(super) enum Next {
    /// Solve this case from that state; the last number counts its failed tries.
    Solve(usize, Arc<Solved>, usize),
    /// Nothing to start from yet, or only cases that may profit from what is in work.
    Wait,
    /// All done.
    Done,
}

impl Schedule {
    pub fn new(waiting: Vec<usize>, solved: Vec<(usize, Arc<Solved>)>) -> Self {
        Self { waiting: waiting.into_iter().map(|case| (case, 0)).collect(), solved, running: 0 }
    }

    /// Takes the shortest branch among the most urgent cases; failed ones come last.
    pub fn next(&mut self, cases: &[Case]) -> Next {
        let rank = |&(case, tries): &(usize, usize)| (tries, cases[case].urgency());
        let Some(first) = self.waiting.iter().map(rank).min() else {
            return if self.running == 0 { Next::Done } else { Next::Wait };
        };
        // A second try is worth its time only from what all others have left.
        if first.0 > 0 && self.running > 0 {
            return Next::Wait;
        }
        let mut best: Option<(f64, usize, usize)> = None;
        for (place, entry) in self.waiting.iter().enumerate().filter(|(_, e)| rank(e) == first) {
            for (at, (_, solved)) in self.solved.iter().enumerate() {
                let distance = distance(&cases[entry.0], solved);
                if distance.is_finite() && best.is_none_or(|b| distance < b.0) {
                    best = Some((distance, place, at));
                }
            }
        }
        let Some((_, place, at)) = best else { return Next::Wait };
        let (case, tries) = self.waiting.swap_remove(place);
        self.running += 1;
        Next::Solve(case, Arc::clone(&self.solved[at].1), tries)
    }

    pub fn finished(&mut self, case: usize, solved: Arc<Solved>) {
        self.running -= 1;
        self.solved.push((case, solved));
    }

    /// Puts a failed case back once; returns whether it will be tried again.
    pub fn failed(&mut self, case: usize, tries: usize) -> bool {
        self.running -= 1;
        let again = tries + 1 < TRIES;
        if again {
            self.waiting.push((case, tries + 1));
        }
        again
    }
}

/// Scaled distance from a solved state to a case; infinite where no path should be tried.
fn distance(case: &Case, solved: &Solved) -> f64 {
    let pressure = (case.pressure_mpa - solved.state.load.pressure_mpa) / PRESSURE_UNIT_MPA;
    let from_gap = solved.state.load.obstacle.gap_mm();
    let gap = match (case.gap_mm, from_gap) {
        (None, None) => 0.0,
        // A plate would have to be withdrawn first, and there is always a free state.
        (None, Some(_)) => return f64::INFINITY,
        // The obstacle comes up from where it just clears the free state.
        (Some(gap), None) => gap.max(solved.clearance_mm) - gap,
        (Some(gap), Some(from)) => gap - from,
    };
    pressure.hypot(gap / GAP_UNIT_MM)
}
