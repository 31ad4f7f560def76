//! Values at mid-side nodes where a program gives them at corners only, as Ansys does for stress and strain: its listings have no
//! line for a mid-side node then, its arrays (`*VGET`) have a zero.

use super::run::{Quantity, Run};
use crate::cells::{self, Block};

/// Gives mid-side nodes the mean of their edge's ends, in quantities that have a value at every corner and none, or zero, at all
/// mid-sides.
pub(super) fn fill(run: &mut Run) {
    let edges: Vec<[u32; 3]> = run.blocks.iter().flat_map(of_block).collect();
    for quantity in run.steps.iter_mut().flat_map(|step| &mut step.quantities) {
        fill_quantity(quantity, &edges);
    }
}

/// Each mid-side with the ends of its edge.
fn of_block(block: &Block) -> Vec<[u32; 3]> {
    let edges = cells::edges(block.kind);
    let corners = block.nodes_per_cell - edges.len();
    let of_cell = |cell: &[u32]| -> Vec<[u32; 3]> {
        edges.iter().enumerate().map(|(k, [a, b])| [cell[corners + k], cell[*a], cell[*b]]).collect()
    };
    block.nodes.chunks_exact(block.nodes_per_cell).flat_map(of_cell).collect()
}

fn fill_quantity(quantity: &mut Quantity, edges: &[[u32; 3]]) {
    let count = quantity.components.len();
    let at = |node: u32| node as usize * count..(node as usize + 1) * count;
    let is_none = |node: u32| quantity.values[at(node)].iter().all(|value| value.is_nan() || *value == 0.0);
    let is_known = |node: u32| quantity.values[at(node)].iter().all(|value| value.is_finite());
    if !edges.iter().all(|[middle, a, b]| is_none(*middle) && is_known(*a) && is_known(*b)) {
        return;
    }
    for [middle, a, b] in edges {
        for k in 0..count {
            let mean = 0.5 * (quantity.values[at(*a)][k] + quantity.values[at(*b)][k]);
            quantity.values[at(*middle)][k] = mean;
        }
    }
}
