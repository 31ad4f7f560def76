//! A basis ready to be swept.

use std::mem::MaybeUninit;

use thiserror::Error;

use super::budget::Budget;
use super::isa::Isa;
use super::local::{Gathered, Local};
use super::local_rows::LocalRows;
use super::pages::{LINE, Line};
use super::plan::Plan;
use super::rows::{F32, I16, Uniform};
use super::spec::{BasisError, Spec};
use super::sweep::{self, Job, RawPeaks};
use super::tiles::{Precision, Tiles};
use super::{MAX_ROWS, Role};

/// Cache lines that [`Basis::read_ahead`] reads at once: 512 KiB, from a cache some five microseconds, from memory some fifteen.
const AHEAD_LINES: usize = 8192;

/// Modes, means and rest shape of the published fields over a node set, stored in the order of use.
///
/// Building costs one pass over the modes; [`Basis::reconstruct`] neither allocates nor locks and can be called from
/// any thread.
#[derive(Debug, Clone)]
pub struct Basis {
    plan: Plan,
    store: Store,
    isa: Isa,
    nodes: Option<Box<[u32]>>,
}

/// How the rows are stored.
#[derive(Debug, Clone)]
enum Store {
    Uniform(Tiles),
    Local(Local),
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
        let plan = Self::plan(spec, isa)?;
        let tiles = Tiles::build(spec, &plan, precision)?;
        Ok(Self::of(spec, plan, Store::Uniform(tiles), isa))
    }

    /// Lays the basis out in as few bytes as keep the error that is accepted. Cost `O(nodes modes^2)` a field.
    ///
    /// # Errors
    /// As [`Basis::build`], and [`BasisError::Budget`] when f32 adds more than is accepted.
    pub fn build_within(spec: &Spec<'_>, budget: &Budget<'_>) -> Result<Self, BasisError> {
        Self::build_within_for(spec, budget, Isa::detect())
    }

    /// The same for a chosen instruction set: for tests and comparisons.
    ///
    /// # Errors
    /// As [`Basis::build_within`], and [`BasisError::IsaMissing`].
    pub fn build_within_for(spec: &Spec<'_>, budget: &Budget<'_>, isa: Isa) -> Result<Self, BasisError> {
        let plan = Self::plan(spec, isa)?;
        let gathered = Gathered::new(spec, &plan)?;
        Self::within(spec, &plan, &gathered, budget, isa)
    }

    /// One for each of several budgets, such as those of the parts of a domain: what depends on the modes alone is worked out once.
    ///
    /// # Errors
    /// As [`Basis::build_within`]; of each whether its budget can be kept.
    pub fn build_within_each(
        spec: &Spec<'_>,
        budgets: &[Budget<'_>],
    ) -> Result<Vec<Result<Self, BasisError>>, BasisError> {
        let isa = Isa::detect();
        let plan = Self::plan(spec, isa)?;
        let gathered = Gathered::new(spec, &plan)?;
        Ok(budgets.iter().map(|budget| Self::within(spec, &plan, &gathered, budget, isa)).collect())
    }

    fn within(
        spec: &Spec<'_>,
        plan: &Plan,
        gathered: &Gathered,
        budget: &Budget<'_>,
        isa: Isa,
    ) -> Result<Self, BasisError> {
        let local = Local::build(plan, gathered, budget)?;
        Ok(Self::of(spec, plan.clone(), Store::Local(local), isa))
    }

    fn plan(spec: &Spec<'_>, isa: Isa) -> Result<Plan, BasisError> {
        if !isa.is_available() {
            return Err(BasisError::IsaMissing { isa, detected: Isa::detect() });
        }
        Plan::new(spec)
    }

    fn of(spec: &Spec<'_>, plan: Plan, store: Store, isa: Isa) -> Self {
        Self { plan, store, isa, nodes: spec.nodes.map(Into::into) }
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
        // SAFETY: `isa` was found available when the basis was built, and the length is checked above.
        let raw = unsafe { self.sweep(coefficients, out) };
        Ok(self.peaks(raw))
    }

    /// # Safety
    /// `isa` is available, `out` is valid for writes of `plan.entries()` values, and there are enough coefficients.
    unsafe fn sweep(&self, coefficients: &[f64], out: *mut f32) -> RawPeaks {
        let (plan, isa) = (&self.plan, self.isa);
        // SAFETY: the caller's promises are passed on; rows and plan were built together.
        unsafe {
            match &self.store {
                Store::Uniform(tiles) => {
                    let mut factors = [0.0; MAX_ROWS];
                    self.each_factor(coefficients, |row, by| factors[row] = (by * tiles.factor(row)) as f32);
                    match tiles.precision() {
                        Precision::F32 => {
                            sweep::run(isa, Job { plan, rows: Uniform::<F32>::new(tiles, &factors), out })
                        }
                        Precision::I16 => {
                            sweep::run(isa, Job { plan, rows: Uniform::<I16>::new(tiles, &factors), out })
                        }
                    }
                }
                Store::Local(local) => {
                    let mut factors = [0.0; MAX_ROWS];
                    self.each_factor(coefficients, |row, by| factors[row] = by as f32);
                    sweep::run(isa, Job { plan, rows: LocalRows::new(local, &factors), out })
                }
            }
        }
    }

    /// Each row with its coefficient, 1 for means and rest shape.
    fn each_factor(&self, coefficients: &[f64], mut each: impl FnMut(usize, f64)) {
        let mut row = 0;
        let mut push = |factor: f64| {
            each(row, factor);
            row += 1;
        };
        for op in &self.plan.ops {
            (0..usize::from(op.has_mean)).for_each(|_| push(1.0));
            coefficients[op.first_coefficient..][..op.modes].iter().for_each(|&a| push(a));
            op.shifts.iter().for_each(|&at| push(-coefficients[at]));
            (0..usize::from(op.has_rest)).for_each(|_| push(1.0));
        }
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
    /// unit of the field: what it changes of each row at most, times `|a_j|` for a mode. 0 for F32, whose
    /// rounding is that of the output itself. For a magnitude it is the bound of the longest component vector.
    ///
    /// # Panics
    /// When there are fewer coefficients than [`Basis::reconstruct`] needs.
    pub fn error_bound(&self, slot: usize, coefficients: &[f64]) -> f64 {
        let mut row = 0;
        let mut next = |factor: f64| {
            row += 1;
            factor.abs() * self.largest_error(row - 1)
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

    fn largest_error(&self, row: usize) -> f64 {
        match &self.store {
            Store::Uniform(tiles) => tiles.half_step(row),
            Store::Local(local) => local.largest_error(row),
        }
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
        self.lines().iter().map(|lines| lines.len() * LINE).sum()
    }

    /// How all rows are stored; none where a [`Budget`] decided for each.
    pub fn precision(&self) -> Option<Precision> {
        match &self.store {
            Store::Uniform(tiles) => Some(tiles.precision()),
            Store::Local(_) => None,
        }
    }

    /// Of the rows of all tiles the shares in f32, i16, i8, and of those left out.
    pub fn widths(&self) -> [f64; 4] {
        let rows = self.plan.rows * self.plan.tiles();
        let stored = match &self.store {
            Store::Uniform(tiles) if tiles.precision() == Precision::F32 => [rows, 0, 0],
            Store::Uniform(_) => [0, rows, 0],
            Store::Local(local) => local.stored(&self.plan),
        };
        let [wide, half, quarter] = stored;
        [wide, half, quarter, rows - wide - half - quarter].map(|count| count as f64 / rows.max(1) as f64)
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Reads every byte of the basis once, in order, with the instruction set in use, and returns a checksum: what a
    /// reconstruction would cost if it did nothing but read. The measure that `softtwin bench` holds the kernel to.
    pub fn read_once(&self) -> u32 {
        self.lines().into_iter().fold(0, |sum, lines| {
            // SAFETY: `isa` was found available when the basis was built.
            sum.wrapping_add(unsafe { sweep::read(self.isa, lines) })
        })
    }

    /// Reads some of the basis, so that the next reconstruction finds it in the caches: step 0, 1 and so on, of 512 KiB
    /// each. Returns the bytes read; 0 after the last step.
    pub fn read_ahead(&self, step: usize) -> usize {
        let mut wanted = step.saturating_mul(AHEAD_LINES)..step.saturating_add(1).saturating_mul(AHEAD_LINES);
        let mut bytes = 0;
        for lines in self.lines() {
            let part = &lines[wanted.start.min(lines.len())..wanted.end.min(lines.len())];
            // SAFETY: `isa` was found available when the basis was built.
            std::hint::black_box(unsafe { sweep::read(self.isa, part) });
            bytes += part.len() * LINE;
            wanted = wanted.start.saturating_sub(lines.len())..wanted.end.saturating_sub(lines.len());
        }
        bytes
    }

    /// What a reconstruction reads, but for a few counts: rows, and what makes their coefficients.
    fn lines(&self) -> [&[Line]; 2] {
        match &self.store {
            Store::Uniform(tiles) => [tiles.lines(), &[]],
            Store::Local(local) => [local.tiles(), local.groups().0],
        }
    }
}
