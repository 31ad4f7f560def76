//! How the sweep reads the rows of a tile, for each way in which they are stored.

use std::marker::PhantomData;

use super::lanes::Lanes;
use super::plan::Op;
use super::tiles::Tiles;
use super::{MAX_ROWS, TILE_NODES};

/// The rows of a basis, read once and in order.
///
/// # Safety
/// Implementations read the rows that the plan promises and advance by exactly those. Callers ask in the order of the plan,
/// for every tile.
pub(super) trait Rows {
    /// Before the first row of a tile.
    unsafe fn begin_tile<V: Lanes>(&mut self);
    /// `mean + sum_j mode_j a_j` of one field; of a component of the displacement, less the rest shape.
    unsafe fn combine<V: Lanes>(&mut self, op: &Op) -> V;
    /// `sum` less what moves the rest shape.
    unsafe fn shift<V: Lanes>(&mut self, op: &Op, sum: V) -> V;
    /// `sum` plus the rest shape.
    unsafe fn add_rest<V: Lanes>(&mut self, sum: V) -> V;
}

/// Rows of one precision, in the order of the plan.
#[derive(Clone, Copy)]
pub(super) struct Uniform<'a, E> {
    cursor: *const u8,
    /// One a row: coefficients, scales of the storage included.
    factors: &'a [f32; MAX_ROWS],
    next: usize,
    entry: PhantomData<E>,
}

impl<'a, E: Entry> Uniform<'a, E> {
    /// From the first tile on.
    pub fn new(tiles: &'a Tiles, factors: &'a [f32; MAX_ROWS]) -> Self {
        Self { cursor: tiles.lines().as_ptr().cast(), factors, next: 0, entry: PhantomData }
    }

    #[inline(always)]
    unsafe fn row<V: Lanes>(&mut self) -> V {
        // SAFETY: the plan that laid out the tiles drives the sweep, so an aligned row lies here.
        unsafe {
            let row = E::load(self.cursor);
            self.cursor = self.cursor.add(TILE_NODES * E::BYTES);
            row
        }
    }

    #[inline(always)]
    unsafe fn factor(&mut self) -> f32 {
        let at = self.next;
        self.next += 1;
        // SAFETY: the plan has at most `MAX_ROWS` rows.
        unsafe { *self.factors.get_unchecked(at) }
    }
}

// SAFETY (all methods): the trait's contract.
impl<E: Entry> Rows for Uniform<'_, E> {
    #[inline(always)]
    unsafe fn begin_tile<V: Lanes>(&mut self) {
        self.next = 0;
    }

    #[inline(always)]
    unsafe fn combine<V: Lanes>(&mut self, op: &Op) -> V {
        // SAFETY: see the impl.
        unsafe {
            let mut sum = V::splat(0.0);
            if op.has_mean {
                sum = E::constant(self.row(), self.factor());
            }
            for _ in 0..op.modes {
                sum = self.row::<V>().mul_add(V::splat(self.factor()), sum);
            }
            sum
        }
    }

    #[inline(always)]
    unsafe fn shift<V: Lanes>(&mut self, op: &Op, mut sum: V) -> V {
        // SAFETY: see the impl.
        unsafe {
            for _ in 0..op.shifts.len() {
                sum = self.row::<V>().mul_add(V::splat(self.factor()), sum);
            }
            sum
        }
    }

    #[inline(always)]
    unsafe fn add_rest<V: Lanes>(&mut self, sum: V) -> V {
        // SAFETY: see the impl.
        unsafe { E::plus(sum, self.row(), self.factor()) }
    }
}

/// How one value of a uniform row is stored.
///
/// # Safety
/// Loads need an aligned row at the pointer; all need the instruction set of `V`.
pub(super) trait Entry: Copy {
    /// Bytes a value.
    const BYTES: usize;
    /// A row, in steps of its storage.
    unsafe fn load<V: Lanes>(from: *const u8) -> V;
    /// A row that no coefficient belongs to, times the scale of its storage.
    unsafe fn constant<V: Lanes>(row: V, scale: f32) -> V;
    /// `sum` plus such a row.
    unsafe fn plus<V: Lanes>(sum: V, row: V, scale: f32) -> V;
}

/// 32-bit floats.
#[derive(Clone, Copy)]
pub(super) struct F32;

// SAFETY (all methods): the trait's contract; the scale of f32 is 1.
impl Entry for F32 {
    const BYTES: usize = size_of::<f32>();

    #[inline(always)]
    unsafe fn load<V: Lanes>(from: *const u8) -> V {
        // SAFETY: see the impl.
        unsafe { V::load(from.cast()) }
    }

    #[inline(always)]
    unsafe fn constant<V: Lanes>(row: V, _: f32) -> V {
        row
    }

    #[inline(always)]
    unsafe fn plus<V: Lanes>(sum: V, row: V, _: f32) -> V {
        // SAFETY: see the impl.
        unsafe { row.add(sum) }
    }
}

/// Pairs of 16-bit integers.
#[derive(Clone, Copy)]
pub(super) struct I16;

// SAFETY (all methods): the trait's contract.
impl Entry for I16 {
    const BYTES: usize = size_of::<i16>();

    #[inline(always)]
    unsafe fn load<V: Lanes>(from: *const u8) -> V {
        // SAFETY: see the impl.
        unsafe { V::load_pairs(from.cast()) }
    }

    #[inline(always)]
    unsafe fn constant<V: Lanes>(row: V, scale: f32) -> V {
        // SAFETY: see the impl.
        unsafe { Self::plus(V::splat(0.0), row, scale) }
    }

    #[inline(always)]
    unsafe fn plus<V: Lanes>(sum: V, row: V, scale: f32) -> V {
        // SAFETY: see the impl.
        unsafe { row.mul_add(V::splat(scale), sum) }
    }
}
