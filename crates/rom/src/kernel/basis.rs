//! A basis ready to be swept.

use std::mem::MaybeUninit;

use thiserror::Error;

use super::isa::Isa;
use super::plan::Plan;
use super::spec::{BasisError, Spec};
use super::sweep::{self, Job, RawPeaks};
use super::tiles::{Precision, Tiles};
use super::{MAX_ROWS, Role};

/// Modes, means and rest shape of the published fields over a node set, stored in the order of use.
///
/// Building costs one pass over the modes; [`Basis::reconstruct`] neither allocates nor locks and can be called from
/// any thread.
#[derive(Debug, Clone)]
pub struct Basis {
    plan: Plan,
    tiles: Tiles,
    precision: Precision,
    isa: Isa,
    nodes: Option<Box<[u32]>>,
}

/// A largest value and where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// The value, in the unit of its field.
    pub value: f32,
    /// Index of the node in the model, not in the node set; the lowest of equals.
    pub node: u32,
}

/// What is found on the way through the fields.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Peaks {
    /// Largest displacement magnitude, mm, when the basis publishes one.
    pub displacement_mm: Option<Peak>,
    /// Largest von Mises stress, MPa, when the basis publishes it.
    pub stress_mpa: Option<Peak>,
}

/// Slices that do not fit the basis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ReconstructError {
    /// Fewer coefficients than the modes refer to.
    #[error("found {found} coefficients; this basis needs at least {expected}")]
    Coefficients {
        /// Length given.
        found: usize,
        /// Least length.
        expected: usize,
    },
    /// An output of another length.
    #[error("the output holds {found} values; this basis writes {expected}")]
    Output {
        /// Length given.
        found: usize,
        /// Length needed.
        expected: usize,
    },
}

impl Basis {
    /// Lays the basis out for this processor.
    ///
    /// # Errors
    /// [`BasisError`] when slices do not fit each other, a node is not in the model, or a value is not finite.
    pub fn build(spec: &Spec<'_>, precision: Precision) -> Result<Self, BasisError> {
        Self::build_for(spec, precision, Isa::detect())
    }

    /// The same for a chosen instruction set: for tests and comparisons.
    ///
    /// # Errors
    /// As [`Basis::build`], and [`BasisError::IsaMissing`].
    pub fn build_for(spec: &Spec<'_>, precision: Precision, isa: Isa) -> Result<Self, BasisError> {
        if !isa.is_available() {
            return Err(BasisError::IsaMissing { isa, detected: Isa::detect() });
        }
        let plan = Plan::new(spec)?;
        let tiles = Tiles::build(spec, &plan, precision)?;
        Ok(Self { plan, tiles, precision, isa, nodes: spec.nodes.map(Into::into) })
    }

    /// Writes all published fields, field-major (all nodes of the first field, then of the second ...), and returns
    /// the peaks.
    ///
    /// `coefficients` are the model's modal coefficients; each is rounded to f32 once. NaN in a coefficient comes out
    /// as NaN in the fields and never wins a peak; when every value of a field is NaN its peak is minus infinity.
    ///
    /// # Errors
    /// [`ReconstructError`] when a slice has the wrong length; nothing is written then.
    pub fn reconstruct(&self, coefficients: &[f64], out: &mut [f32]) -> Result<Peaks, ReconstructError> {
        // SAFETY: the slice is valid for writes of its length.
        unsafe { self.reconstruct_into(coefficients, out.as_mut_ptr(), out.len()) }
    }

    /// The same into memory that was never written, such as a slice loaned from shared memory. On `Ok` every element
    /// of `out` is initialised; unsafe code may rely on it.
    ///
    /// # Errors
    /// [`ReconstructError`] when a slice has the wrong length; nothing is written then.
    pub fn reconstruct_uninit(
        &self,
        coefficients: &[f64],
        out: &mut [MaybeUninit<f32>],
    ) -> Result<Peaks, ReconstructError> {
        // SAFETY: the slice is valid for writes of its length, and the sweep never reads from it.
        unsafe { self.reconstruct_into(coefficients, out.as_mut_ptr().cast(), out.len()) }
    }

    /// # Safety
    /// `out` is valid for writes of `len` values.
    unsafe fn reconstruct_into(
        &self,
        coefficients: &[f64],
        out: *mut f32,
        len: usize,
    ) -> Result<Peaks, ReconstructError> {
        if coefficients.len() < self.plan.coefficients {
            let expected = self.plan.coefficients;
            return Err(ReconstructError::Coefficients { found: coefficients.len(), expected });
        }
        if len != self.plan.entries() {
            return Err(ReconstructError::Output { found: len, expected: self.plan.entries() });
        }
        let factors = self.factors(coefficients);
        let job = Job { plan: &self.plan, tiles: &self.tiles, factors: &factors, out };
        // SAFETY: `isa` was found available when the basis was built, and the length is checked above.
        let raw = unsafe { sweep::run(self.isa, self.precision, job) };
        Ok(self.peaks(raw))
    }

    /// Coefficients in the order of the rows, 1 for means and rest shape, times the scale of their storage.
    fn factors(&self, coefficients: &[f64]) -> [f32; MAX_ROWS] {
        let mut factors = [0.0; MAX_ROWS];
        let mut row = 0;
        let mut push = |factor: f64| {
            factors[row] = (factor * self.tiles.factor(row)) as f32;
            row += 1;
        };
        for op in &self.plan.ops {
            (0..usize::from(op.has_mean)).for_each(|_| push(1.0));
            coefficients[op.first_coefficient..][..op.modes].iter().for_each(|&a| push(a));
            op.shifts.iter().for_each(|&at| push(-coefficients[at]));
            (0..usize::from(op.has_rest)).for_each(|_| push(1.0));
        }
        factors
    }

    fn peaks(&self, raw: RawPeaks) -> Peaks {
        let peak = |(value, node): (f32, usize)| Peak {
            value,
            node: self.nodes.as_ref().map_or(node as u32, |nodes| nodes[node]),
        };
        let has = |role| self.plan.ops.iter().any(|op| op.role == role);
        let displacement = self.plan.magnitude_slot.is_some() || has(Role::Displacement);
        Peaks {
            displacement_mm: displacement.then(|| peak(raw.displacement)),
            stress_mpa: has(Role::Stress).then(|| peak(raw.stress)),
        }
    }

    /// Largest error of a value of published field `slot` that the storage causes, for these coefficients, in the
    /// unit of the field: half a step of each row, times `|a_j|` for a mode. 0 for F32, whose
    /// rounding is that of the output itself. For a magnitude it is the bound of the longest component vector.
    ///
    /// # Panics
    /// When there are fewer coefficients than [`Basis::reconstruct`] needs.
    pub fn error_bound(&self, slot: usize, coefficients: &[f64]) -> f64 {
        let mut row = 0;
        let mut next = |factor: f64| {
            row += 1;
            factor.abs() * self.tiles.half_step(row - 1)
        };
        let mut squares = 0.0;
        for op in &self.plan.ops {
            let mut bound = if op.has_mean { next(1.0) } else { 0.0 };
            bound += coefficients[op.first_coefficient..][..op.modes].iter().map(|&a| next(a)).sum::<f64>();
            let shifted = bound + op.shifts.iter().map(|&at| next(coefficients[at])).sum::<f64>();
            squares += if op.in_magnitude { shifted * shifted } else { 0.0 };
            bound += if op.has_rest { next(1.0) } else { 0.0 };
            if op.slot == Some(slot) {
                return bound;
            }
        }
        squares.sqrt()
    }

    /// Values written by a reconstruction: published fields times nodes.
    pub fn output_len(&self) -> usize {
        self.plan.entries()
    }

    /// Published fields.
    pub fn fields(&self) -> usize {
        self.plan.published
    }

    /// Nodes of the node set.
    pub fn nodes(&self) -> usize {
        self.plan.nodes
    }

    /// Bytes read by a reconstruction.
    pub fn bytes(&self) -> usize {
        self.tiles.tile_bytes * self.plan.tiles()
    }

    /// How the basis is stored.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Reads every byte of the basis once, in order, with the instruction set in use, and returns a checksum: what a
    /// reconstruction would cost if it did nothing but read. The measure that `softtwin bench` holds the kernel to.
    pub fn read_once(&self) -> u32 {
        // SAFETY: `isa` was found available when the basis was built.
        unsafe { sweep::read(self.isa, &self.tiles) }
    }
}
