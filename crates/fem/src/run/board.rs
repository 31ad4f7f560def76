//! What is solved, failed, in work or ready: a case is ready when it is known where it starts from.

use super::schedule::Start;
use super::store::Solved;
use std::sync::Arc;

/// Where a case stands.
#[derive(Clone, Debug)]
enum Stage {
    /// Not taken yet; the number of the start to try.
    Open(usize),
    Running(usize),
    Solved(Arc<Solved>),
    Failed,
}

/// All cases of a list.
#[derive(Debug)]
pub(super) struct Board {
    starts: Vec<Vec<Start>>,
    stages: Vec<Stage>,
}

/// What a thread is to do.
pub(super) enum Next {
    /// Any of these cases, from these starts, the most wanted first; none while those in work decide what comes next.
    Ready(Vec<(usize, Start)>),
    /// Nothing is left.
    Done,
}

impl Board {
    pub(super) fn new(starts: Vec<Vec<Start>>) -> Self {
        let stages = vec![Stage::Open(0); starts.len()];
        Self { starts, stages }
    }

    /// Cases whose start is solved, in the list's order; with a shard its own share of the list first.
    pub(super) fn next(&mut self, shard: Option<(usize, usize)>) -> Next {
        if self.is_done() {
            return Next::Done;
        }
        let mut ready: Vec<(usize, Start)> =
            (0..self.stages.len()).filter_map(|case| Some((case, self.start(case)?))).collect();
        if let Some((own, count)) = shard {
            ready.sort_by_key(|(case, _)| case % count != own);
        }
        Next::Ready(ready)
    }

    /// The start of an open case: the first, from the one to try on, that did not fail itself. `None` while that is not
    /// known.
    fn start(&mut self, case: usize) -> Option<Start> {
        let Stage::Open(tried) = self.stages[case] else { return None };
        for (k, start) in self.starts[case].iter().enumerate().skip(tried) {
            match start {
                Start::Rest => {}
                Start::Case(before) => match self.stages[*before] {
                    Stage::Solved(_) => {}
                    Stage::Failed => continue,
                    Stage::Open(_) | Stage::Running(_) => return None,
                },
            }
            self.stages[case] = Stage::Open(k);
            return Some(*start);
        }
        // Every start has failed: gravity alone is left.
        Some(Start::Rest)
    }

    pub(super) fn begin(&mut self, case: usize) {
        if let Stage::Open(tried) = self.stages[case] {
            self.stages[case] = Stage::Running(tried);
        }
    }

    pub(super) fn solved(&mut self, case: usize, solved: Arc<Solved>) {
        self.stages[case] = Stage::Solved(solved);
    }

    pub(super) fn failed(&mut self, case: usize) {
        self.stages[case] = Stage::Failed;
    }

    /// Puts a case back that failed from its start; whether there is another start to try.
    pub(super) fn try_next(&mut self, case: usize) -> bool {
        let Stage::Running(tried) = self.stages[case] else { return false };
        let left = self.starts[case].iter().skip(tried + 1);
        let again = left.clone().any(|start| match start {
            Start::Rest => true,
            Start::Case(before) => !matches!(self.stages[*before], Stage::Failed),
        });
        if again {
            self.stages[case] = Stage::Open(tried + 1);
        }
        again
    }

    /// The state of a solved case.
    pub(super) fn state(&self, case: usize) -> Option<Arc<Solved>> {
        if let Stage::Solved(solved) = &self.stages[case] { Some(Arc::clone(solved)) } else { None }
    }

    /// Cases nobody here works on yet.
    pub(super) fn open(&self) -> Vec<usize> {
        (0..self.stages.len()).filter(|case| matches!(self.stages[*case], Stage::Open(_))).collect()
    }

    pub(super) fn is_done(&self) -> bool {
        self.stages.iter().all(|stage| matches!(stage, Stage::Solved(_) | Stage::Failed))
    }
}
