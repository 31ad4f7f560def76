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

/// Names of the components of a symmetric tensor of which programs write the components in different orders.
pub(super) const UNORDERED: [&str; 6] = ["t1", "t2", "t3", "t4", "t5", "t6"];
