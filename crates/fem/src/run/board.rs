//! Stages of the cases of a run: a case is ready when its start is known.

use super::schedule::Start;
use super::store::Solved;
use std::sync::Arc;

/// Stage of a case.
#[derive(Clone, Debug)]
enum Stage {
    /// Not begun; the index of the start to try.
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

/// Next action of a thread.
pub(super) enum Next {
    /// Solve this case, now in work, from this start.
    Solve(usize, Start),
    /// Wait for a case in work: it decides which one is next.
    Wait,
    /// End: no case is left.
    Done,
}

impl Board {
    pub(super) fn new(starts: Vec<Vec<Start>>) -> Self {
        let stages = vec![Stage::Open(0); starts.len()];
        Self { starts, stages }
    }

    /// Takes the first case of the list whose start is solved.
    pub(super) fn next(&mut self) -> Next {
        if self.is_done() {
            return Next::Done;
        }
        let ready = (0..self.stages.len()).find_map(|case| Some((case, self.start(case)?)));
        let Some((case, start)) = ready else { return Next::Wait };
        if let Stage::Open(tried) = self.stages[case] {
            self.stages[case] = Stage::Running(tried);
        }
        Next::Solve(case, start)
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

    pub(super) fn is_done(&self) -> bool {
        self.stages.iter().all(|stage| matches!(stage, Stage::Solved(_) | Stage::Failed))
    }
}
