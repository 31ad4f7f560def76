//! The symmetric stiffness matrix, the order of its unknowns, and its sparse Cholesky factor.

use crate::algebra::{Mat3, Vec3};
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LdltRef, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky, supernodal::SupernodalLdltRef,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};
use std::sync::Arc;
use thiserror::Error;

// ---- the symmetric stiffness matrix: a fixed pattern of 3 x 3 node blocks over the lower triangle, stored by columns ----

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

// ---- order of elimination ----

// Nested dissection of the node graph by coordinate planes.
//
// Actuators are long and their chambers are joined by thin necks: a plane through a slot separates the body with far
// fewer nodes than a minimum-degree ordering finds. Each part is cut across the axis and at the position whose
// separator is smallest for its balance; all positions along an axis are rated in one sweep over the edges.

/// Parts of this size are not cut further.
const LEAF: usize = 8;

/// Neighbour lists of a symmetric graph (both directions).
pub(crate) type Graph = Vec<Vec<u32>>;

struct Dissection<'a> {
    graph: &'a Graph,
    points: &'a [Vec3],
    /// Position of each node in the current sweep; `usize::MAX` outside the current part.
    place: Vec<usize>,
}

/// Elimination order of the nodes: `order[k]` is the node eliminated k-th.
///
/// Cost: edges x log(nodes) x 3 axes.
pub(crate) fn nested_dissection(graph: &Graph, points: &[Vec3]) -> Vec<u32> {
    let mut dissection = Dissection { graph, points, place: vec![usize::MAX; graph.len()] };
    let mut order = Vec::with_capacity(graph.len());
    let all = (0..graph.len()).filter_map(|n| u32::try_from(n).ok()).collect();
    dissection.order(all, &mut order);
    order
}

impl Dissection<'_> {
    /// Appends the part's nodes: both halves, then the nodes that separate them.
    fn order(&mut self, part: Vec<u32>, order: &mut Vec<u32>) {
        if part.len() <= LEAF {
            order.extend(part);
            return;
        }
        let Some((sorted, cut)) = self.best_cut(&part) else {
            order.extend(part);
            return;
        };
        self.number(&sorted);
        let beyond = |this: &Self, n: u32| this.graph[n as usize].iter().any(|m| this.after(*m, cut));
        let (separator, left): (Vec<u32>, Vec<u32>) = sorted[..cut].iter().partition(|n| beyond(self, **n));
        let right = sorted[cut..].to_vec();
        self.forget(&sorted);
        self.order(left, order);
        self.order(right, order);
        order.extend(separator);
    }

    fn after(&self, n: u32, cut: usize) -> bool {
        let place = self.place[n as usize];
        place != usize::MAX && place >= cut
    }

    fn number(&mut self, sorted: &[u32]) {
        for (k, n) in sorted.iter().enumerate() {
            self.place[*n as usize] = k;
        }
    }

    fn forget(&mut self, sorted: &[u32]) {
        for n in sorted {
            self.place[*n as usize] = usize::MAX;
        }
    }

    /// The part sorted along the best direction and the number of nodes before the cut.
    fn best_cut(&mut self, part: &[u32]) -> Option<(Vec<u32>, usize)> {
        let mut best: Option<(f64, Vec<u32>, usize)> = None;
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                let mut sorted = part.to_vec();
                sorted.sort_by(|a, b| {
                    let coordinate = |n: u32| sign * self.points[n as usize][axis];
                    coordinate(*a).total_cmp(&coordinate(*b)).then(a.cmp(b))
                });
                self.number(&sorted);
                let (cost, cut) = self.rate(&sorted);
                self.forget(&sorted);
                if cost.is_finite() && best.as_ref().is_none_or(|(c, _, _)| cost < *c) {
                    best = Some((cost, sorted, cut));
                }
            }
        }
        best.map(|(_, sorted, cut)| (sorted, cut))
    }

    /// Cheapest cut of a numbered part: its cost and position.
    fn rate(&self, sorted: &[u32]) -> (f64, usize) {
        let n = sorted.len();
        // A node separates every cut between itself and its farthest neighbour.
        let mut change = vec![0_i64; n + 2];
        for (k, node) in sorted.iter().enumerate() {
            let places = self.graph[*node as usize].iter().map(|m| self.place[*m as usize]);
            let farthest = places.filter(|p| *p != usize::MAX).max().unwrap_or(k);
            if farthest > k {
                change[k + 1] += 1;
                change[farthest + 1] -= 1;
            }
        }
        let mut best = (f64::INFINITY, 0);
        let mut separator = 0_i64;
        for (cut, change) in change.into_iter().enumerate().take(n).skip(1) {
            separator += change;
            let (left, right) = ((cut as i64 - separator) as f64, (n - cut) as f64);
            let smaller = left.min(right);
            if smaller < 0.2 * n as f64 {
                continue;
            }
            // The separator's dense factor against the work saved by balanced halves.
            let cost = separator as f64 * (1.0 + (left.max(right) / n as f64 - 0.5));
            if cost < best.0 {
                best = (cost, cut);
            }
        }
        best
    }
}

// ---- linear solver: faer's sparse Cholesky, analysed once per problem and factorised once per iteration ----

/// Error of the linear solver.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)] // the messages say what the values are
pub enum LinearError {
    /// The ordering or the factor did not fit in memory.
    #[error("the sparse factor of {unknowns} unknowns does not fit in memory; use a coarser mesh")]
    Memory { unknowns: usize },
    /// A pivot vanished: the tangent is singular.
    #[error(
        "the stiffness matrix is singular: a part of the mesh is not held, or the state is at a limit point"
    )]
    Singular,
}

/// Ordering and structure of the factor: shared by all solvers of a problem.
#[derive(Debug)]
pub(crate) struct Analysis {
    symbolic: SymbolicCholesky<usize>,
    unknowns: usize,
}

fn structure(pattern: &SymmetricBlocks) -> SymbolicSparseColMatRef<'_, usize> {
    let (col_ptr, row_idx) = pattern.columns();
    SymbolicSparseColMatRef::new_checked(pattern.unknowns(), pattern.unknowns(), col_ptr, None, row_idx)
}

impl Analysis {
    /// Symbolic factorisation in the elimination order of the node blocks given.
    ///
    /// # Errors
    /// [`LinearError::Memory`].
    pub(crate) fn new(pattern: &SymmetricBlocks, order: &[u32]) -> Result<Self, LinearError> {
        let unknowns = pattern.unknowns();
        let forward: Vec<usize> =
            order.iter().flat_map(|n| (0..3).map(move |c| 3 * *n as usize + c)).collect();
        let mut inverse = vec![0; unknowns];
        for (k, i) in forward.iter().enumerate() {
            inverse[*i] = k;
        }
        let params = CholeskySymbolicParams::default();
        let order = SymmetricOrdering::Custom(PermRef::new_checked(&forward, &inverse, unknowns));
        let symbolic = factorize_symbolic_cholesky(structure(pattern), Side::Lower, order, params)
            .map_err(|_| LinearError::Memory { unknowns })?;
        Ok(Self { symbolic, unknowns })
    }

    pub(crate) fn factor_entries(&self) -> usize {
        self.symbolic.len_val()
    }
}

/// Right-hand sides solved at once.
const SIDES: usize = 8;

/// Kind of the present factor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FactorKind {
    Definite,
    Indefinite,
}

/// Factor and workspace of one thread.
pub(crate) struct Factor {
    analysis: Arc<Analysis>,
    values: Vec<f64>,
    memory: MemBuffer,
    kind: FactorKind,
}

impl Factor {
    /// Allocates factor and workspace.
    ///
    /// # Errors
    /// [`LinearError::Memory`].
    pub(crate) fn new(analysis: Arc<Analysis>) -> Result<Self, LinearError> {
        let symbolic = &analysis.symbolic;
        let request = StackReq::any_of(&[
            symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default()),
            symbolic.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Default::default()),
            symbolic.solve_in_place_scratch::<f64>(SIDES, Par::Seq),
        ]);
        let unknowns = analysis.unknowns;
        let memory = MemBuffer::try_new(request).map_err(|_| LinearError::Memory { unknowns })?;
        let values = vec![0.0; symbolic.len_val()];
        Ok(Self { analysis, values, memory, kind: FactorKind::Definite })
    }

    /// Factorises the matrix: Cholesky, or `L D L^T` where the tangent is not positive definite (past a limit point of
    /// an intermediate iterate).
    ///
    /// # Errors
    /// [`LinearError::Singular`].
    pub(crate) fn factorise(&mut self, pattern: &SymmetricBlocks, matrix: &[f64]) -> Result<(), LinearError> {
        let matrix = SparseColMatRef::new(structure(pattern), matrix);
        let symbolic = &self.analysis.symbolic;
        let definite = symbolic.factorize_numeric_llt(
            &mut self.values,
            matrix,
            Side::Lower,
            LltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut self.memory),
            Default::default(),
        );
        if definite.is_ok() {
            self.kind = FactorKind::Definite;
            return Ok(());
        }
        let indefinite = symbolic.factorize_numeric_ldlt(
            &mut self.values,
            matrix,
            Side::Lower,
            LdltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut self.memory),
            Default::default(),
        );
        self.kind = FactorKind::Indefinite;
        indefinite.map(|_| ()).map_err(|_| LinearError::Singular)
    }

    /// True if the last matrix was positive definite.
    pub(crate) fn positive_definite(&self) -> bool {
        self.kind == FactorKind::Definite
    }

    /// Number of negative pivots of the last matrix, equal to that of its negative eigenvalues.
    pub(crate) fn negative_pivots(&self) -> usize {
        if self.kind == FactorKind::Definite {
            return 0;
        }
        match self.analysis.symbolic.raw() {
            SymbolicCholeskyRaw::Simplicial(symbolic) => {
                let columns = symbolic.col_ptr();
                columns[..columns.len() - 1].iter().filter(|at| self.values[**at] < 0.0).count()
            }
            SymbolicCholeskyRaw::Supernodal(symbolic) => {
                let factor = SupernodalLdltRef::new(symbolic, &self.values);
                let negative = |s: usize| {
                    let block = factor.supernode(s).val();
                    (0..block.ncols()).filter(|j| block[(*j, *j)] < 0.0).count()
                };
                (0..symbolic.n_supernodes()).map(negative).sum()
            }
        }
    }

    /// Solves in place with the last factor, for any number of right-hand sides, one behind the other.
    pub(crate) fn solve(&mut self, sides: &mut [f64]) {
        sides.chunks_mut(SIDES * self.analysis.unknowns).for_each(|sides| self.solve_few(sides));
    }

    fn solve_few(&mut self, sides: &mut [f64]) {
        let symbolic = &self.analysis.symbolic;
        let unknowns = self.analysis.unknowns;
        let rhs = MatMut::from_column_major_slice_mut(sides, unknowns, sides.len() / unknowns);
        let stack = MemStack::new(&mut self.memory);
        match self.kind {
            FactorKind::Definite => {
                LltRef::new(symbolic, &self.values).solve_in_place_with_conj(Conj::No, rhs, Par::Seq, stack);
            }
            FactorKind::Indefinite => {
                LdltRef::new(symbolic, &self.values).solve_in_place_with_conj(Conj::No, rhs, Par::Seq, stack);
            }
        }
    }
}
