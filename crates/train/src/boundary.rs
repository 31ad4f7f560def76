//! The onset pressure while a model is trained.

use rom::clearance::OnsetSolver;
use rom::inputs::Inputs;
use rom::model::Clearance;
use rom::regime::{OnsetAt, OnsetTable};

/// The onset as training needs it.
pub(crate) struct OnsetBoundary {
    /// Over the gap; with parameters at their nominal values.
    pub table: OnsetTable,
    /// What it is solved from where it depends on parameters.
    pub solver: Option<OnsetSolver>,
    /// Sampled states in which a node beside the obstacle is the lowest.
    pub crossings: usize,
}

impl OnsetBoundary {
    /// Whether the onset depends on parameters.
    pub fn has_parameters(&self) -> bool {
        self.solver.is_some()
    }

    /// The onset at a state.
    pub fn at(&self, inputs: &Inputs) -> OnsetAt {
        match &self.solver {
            Some(solver) => solver.onset(inputs, None, &mut solver.scratch()),
            None => self.table.at(inputs.gap_mm()),
        }
    }

    /// Depth of the lowest node at pressure and parameters, mm; none without parameters.
    pub fn depth_mm(&self, inputs: &Inputs) -> Option<f64> {
        let solver = self.solver.as_ref()?;
        Some(solver.depth_mm(inputs, &mut solver.scratch()))
    }

    /// What the data sheet says about it.
    pub fn remarks(&self) -> Option<String> {
        (self.crossings > 0).then(|| {
            format!(
                "in {} sampled states a node beside the obstacle lies lower than those above it: the onset looks at the \
                 nodes that were lowest above it in some state",
                self.crossings
            )
        })
    }

    /// What the model keeps.
    pub fn into_clearance(self) -> Option<Clearance> {
        self.solver.map(OnsetSolver::into_clearance)
    }
}
