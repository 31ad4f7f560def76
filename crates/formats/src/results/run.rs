//! Result of the readers: mesh and states.

use crate::cells::Block;

/// Finished simulation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Run {
    /// Undeformed node positions in the file's unit of length.
    pub points: Vec<[f64; 3]>,
    /// Cells; nodes below the number of points.
    pub blocks: Vec<Block>,
    /// States in the order of the file.
    pub steps: Vec<Step>,
    /// Steps that were left out, with the reason.
    pub left_out: Vec<String>,
    /// Total forces of node sets, if the program prints them.
    pub totals: Vec<Total>,
}

/// Total force of a node set at a time of the solver, in the file's unit of force.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Total {
    /// Name of the set.
    pub set: String,
    /// Time of the solver.
    pub time: f64,
    /// Along x, y and z.
    pub force: [f64; 3],
}

/// Relative difference up to which times of two files of one job are equal: they have six and seven digits.
const SAME_TIME: f64 = 1e-4;

impl Run {
    /// Magnitude of a set's total force at a step; `Err` contains the sets with a total at its time.
    ///
    /// # Errors
    /// No total of this set at this time.
    pub fn total_force(&self, set: &str, step: &Step) -> Result<f64, Vec<&str>> {
        let time = step.time.unwrap_or(f64::NAN);
        let there = || self.totals.iter().filter(|total| (total.time - time).abs() <= SAME_TIME * time.abs());
        let found = there().find(|total| total.set.eq_ignore_ascii_case(set));
        let length = |total: &Total| total.force.iter().map(|f| f * f).sum::<f64>().sqrt();
        found.map(length).ok_or_else(|| there().map(|total| total.set.as_str()).collect())
    }
}

/// State of a simulation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Step {
    /// Name in messages (`step 1 increment 4`).
    pub name: String,
    /// Time of the solver.
    pub time: Option<f64>,
    /// Quantities at the nodes.
    pub quantities: Vec<NodalQuantity>,
}

/// Quantity at the nodes; NaN: no value in the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodalQuantity {
    /// Name in the file.
    pub name: String,
    /// Names of its components, one for a scalar.
    pub components: Vec<String>,
    /// `nodes x components`.
    pub values: Vec<f64>,
}

/// True if a row is the first of its node (the known values are NaN) or repeats it to rounding.
pub(super) fn same_or_new(known: &[f64], row: &[f64]) -> bool {
    known.iter().zip(row).all(|(a, b)| a.is_nan() || (a - b).abs() <= 1e-6 * a.abs().max(b.abs()))
}

/// Numbers as names of unnamed components.
pub(super) fn counted(components: usize) -> Vec<String> {
    (1..=components).map(|k| k.to_string()).collect()
}
