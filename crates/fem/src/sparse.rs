//! The symmetric stiffness matrix: a fixed pattern of 3 x 3 node blocks over the lower triangle, stored by columns.

use crate::algebra::Mat3;

/// Index of a node without unknowns (held).
pub(crate) const CONSTRAINED: u32 = u32::MAX;

/// Place of a node pair's block: the rank of the row node among the column node's off-diagonal neighbours.
pub(crate) type Rank = u32;

/// A pair outside the pattern (its coupling is dropped by [`SymmetricBlocks::add`]).
pub(crate) const OUTSIDE: Rank = u32::MAX;

/// Lower triangle of a symmetric matrix of 3 x 3 blocks, compressed by scalar columns.
#[derive(Clone, Debug)]
pub(crate) struct SymmetricBlocks {
    neighbours: Vec<Vec<u32>>,
    col_ptr: Vec<usize>,
    row_idx: Vec<usize>,
}

impl SymmetricBlocks {
    /// Pattern over `free` nodes that couples all members of each group; groups list free-node indices or [`CONSTRAINED`].
    pub(crate) fn new<'a>(free: usize, groups: impl Iterator<Item = &'a [u32]>) -> Self {
        let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); free];
        for group in groups {
            for (k, &a) in group.iter().enumerate() {
                for &b in &group[..k] {
                    if a != CONSTRAINED && b != CONSTRAINED && a != b {
                        neighbours[a.min(b) as usize].push(a.max(b));
                    }
                }
            }
        }
        for column in &mut neighbours {
            column.sort_unstable();
            column.dedup();
            column.shrink_to_fit();
        }
        let mut col_ptr = vec![0];
        let mut row_idx = Vec::new();
        for (j, column) in neighbours.iter().enumerate() {
            for c in 0..3 {
                row_idx.extend((3 * j + c)..(3 * j + 3));
                row_idx.extend(column.iter().flat_map(|&i| (0..3).map(move |a| 3 * i as usize + a)));
                col_ptr.push(row_idx.len());
            }
        }
        Self { neighbours, col_ptr, row_idx }
    }

    /// The node graph, each edge in both directions.
    pub(crate) fn graph(&self) -> Vec<Vec<u32>> {
        let mut graph = self.neighbours.clone();
        for (j, column) in self.neighbours.iter().enumerate() {
            for i in column {
                graph[*i as usize].extend(u32::try_from(j));
            }
        }
        graph
    }

    /// Number of scalar unknowns.
    pub(crate) fn unknowns(&self) -> usize {
        3 * self.neighbours.len()
    }

    /// Stored entries of the lower triangle.
    pub(crate) fn stored(&self) -> usize {
        self.row_idx.len()
    }

    /// Column pointers and row indices of the lower triangle.
    pub(crate) fn columns(&self) -> (&[usize], &[usize]) {
        (&self.col_ptr, &self.row_idx)
    }

    /// Rank of the pair's block, or [`OUTSIDE`].
    pub(crate) fn rank(&self, a: u32, b: u32) -> Rank {
        if a == CONSTRAINED || b == CONSTRAINED {
            return OUTSIDE;
        }
        if a == b {
            return 0;
        }
        let found = self.neighbours[a.min(b) as usize].binary_search(&a.max(b));
        found.map_or(OUTSIDE, |k| u32::try_from(k).unwrap_or(OUTSIDE))
    }

    /// Adds the block that couples row node `a` to column node `b` (and by symmetry its transpose).
    ///
    /// For `a == b` the block must be symmetric; a pair is added once, in either order.
    #[inline]
    pub(crate) fn add(&self, values: &mut [f64], a: u32, b: u32, rank: Rank, block: &Mat3) {
        if rank == OUTSIDE || a == CONSTRAINED || b == CONSTRAINED {
            return;
        }
        let (column, offset) = (3 * a.min(b) as usize, 3 + 3 * rank as usize);
        for c in 0..3 {
            let base = self.col_ptr[column + c];
            if a == b {
                for r in c..3 {
                    values[base + r - c] += block[r][c];
                }
            } else {
                let out = &mut values[base + offset - c..base + offset - c + 3];
                for (r, out) in out.iter_mut().enumerate() {
                    *out += if a > b { block[r][c] } else { block[c][r] };
                }
            }
        }
    }

    /// Matrix times vector, both over scalar unknowns.
    pub(crate) fn multiply(&self, values: &[f64], v: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; v.len()];
        for (c, range) in self.col_ptr.windows(2).enumerate() {
            let column = range[0]..range[1];
            for (&r, value) in self.row_idx[column.clone()].iter().zip(&values[column]) {
                out[r] += value * v[c];
                if r != c {
                    out[c] += value * v[r];
                }
            }
        }
        out
    }
}
