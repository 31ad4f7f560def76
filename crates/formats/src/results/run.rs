//! What the readers give: mesh and states.

use crate::cells::Block;

/// One finished simulation.
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
    /// Total forces of node sets, where the program prints them.
    pub totals: Vec<Total>,
}

/// Total force of a node set at a time of the solver, in the file's unit of force.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Total {
    /// The set.
    pub set: String,
    /// Time of the solver.
    pub time: f64,
    /// Along x, y and z.
    pub force: [f64; 3],
}

/// Times of two files of one job agree to so much, as a share: they are printed with six and with seven digits.
const SAME_TIME: f64 = 1e-4;

impl Run {
    /// Length of a set's total force at a step; `Err` has the sets that there are at its time.
    ///
    /// # Errors
    /// There is no total of that set at that time.
    pub fn total_force(&self, set: &str, step: &Step) -> Result<f64, Vec<&str>> {
        let time = step.time.unwrap_or(f64::NAN);
        let there = || self.totals.iter().filter(|total| (total.time - time).abs() <= SAME_TIME * time.abs());
        let found = there().find(|total| total.set.eq_ignore_ascii_case(set));
        let length = |total: &Total| total.force.iter().map(|f| f * f).sum::<f64>().sqrt();
        found.map(length).ok_or_else(|| there().map(|total| total.set.as_str()).collect())
    }
}

/// One state of a simulation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Step {
    /// How messages call it (`step 1 increment 4`).
    pub name: String,
    /// Time of the solver.
    pub time: Option<f64>,
    /// Quantities at the nodes.
    pub quantities: Vec<Quantity>,
}

/// A quantity at the nodes; NaN where a file gives no value.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Quantity {
    /// Name in the file.
    pub name: String,
    /// Names of its components, one for a scalar.
    pub components: Vec<String>,
    /// `nodes x components`.
    pub values: Vec<f64>,
}

/// Names of the components of a quantity that a file only counts.
pub(super) fn counted(components: usize) -> Vec<String> {
    (1..=components).map(|k| k.to_string()).collect()
}
