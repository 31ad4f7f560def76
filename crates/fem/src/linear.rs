//! Linear solver: faer's sparse Cholesky, analysed once per problem and factorised once per iteration.

use std::sync::Arc;

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
use thiserror::Error;

use crate::sparse::SymmetricBlocks;

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

    /// Entries of the factor.
    pub(crate) fn factor_entries(&self) -> usize {
        self.symbolic.len_val()
    }
}

/// Right-hand sides solved at once.
const SIDES: usize = 8;

/// Kind of the present factor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Definite,
    Indefinite,
}

/// Factor and workspace of one thread.
pub(crate) struct Factor {
    analysis: Arc<Analysis>,
    values: Vec<f64>,
    memory: MemBuffer,
    kind: Kind,
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
        Ok(Self { analysis, values, memory, kind: Kind::Definite })
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
            self.kind = Kind::Definite;
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
        self.kind = Kind::Indefinite;
        indefinite.map(|_| ()).map_err(|_| LinearError::Singular)
    }

    /// True if the last matrix was positive definite.
    pub(crate) fn positive_definite(&self) -> bool {
        self.kind == Kind::Definite
    }

    /// Number of negative pivots of the last matrix, equal to that of its negative eigenvalues.
    pub(crate) fn negative_pivots(&self) -> usize {
        if self.kind == Kind::Definite {
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
            Kind::Definite => {
                LltRef::new(symbolic, &self.values).solve_in_place_with_conj(Conj::No, rhs, Par::Seq, stack);
            }
            Kind::Indefinite => {
                LdltRef::new(symbolic, &self.values).solve_in_place_with_conj(Conj::No, rhs, Par::Seq, stack);
            }
        }
    }
}
