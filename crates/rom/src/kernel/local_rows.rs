//! How the sweep reads rows of local modes: their coefficients first, group by group.

use super::lanes::{FourFactors, Lanes, PairFactors};
use super::local::{AT_ONCE, Counts, GROUP_TILES, Local};
use super::plan::Op;
use super::rows::Rows;
use super::{MAX_ROWS, TILE_NODES};

/// What the whole numbers of a list are multiplied by, and the sums of its fours' parts.
#[derive(Clone, Copy, Default)]
struct Units {
    pair: f32,
    four: f32,
    sums: [i32; 2],
}

/// Bytes of two rows of i16 and of four of i8.
const PAIR_BYTES: usize = 2 * 2 * TILE_NODES;
const FOUR_BYTES: usize = 4 * TILE_NODES;

/// Pairs and fours of all lists at most, and what is written behind the last.
const PAIRS: usize = MAX_ROWS + AT_ONCE / 2;
const FOURS: usize = MAX_ROWS + AT_ONCE / 4;

/// Factors of rows in i16, two at a time. A list begins with a pair of its own, and is written sixteen rows at a time.
struct Pairs {
    high: [[i16; 2]; PAIRS],
    low: [[i16; 2]; PAIRS],
}

/// Factors of rows in i8, four at a time, whole and in parts, likewise.
struct Fours {
    values: [[i16; 4]; FOURS],
    high: [[i8; 4]; FOURS],
    low: [[i8; 4]; FOURS],
}

/// Rows of local modes, whose coefficients are made anew for every group. No copy of it is made: it holds them all.
pub(super) struct LocalRows<'a> {
    cursor: *const u8,
    transform: *const f32,
    /// Of the next list of this group.
    counts: *const Counts,
    /// Of the group's first list.
    group: *const Counts,
    /// Rows of the plan by list.
    lists: &'a [usize],
    /// By row of the plan.
    coefficients: &'a [f32; MAX_ROWS],
    /// By row of the group.
    factors: [f32; MAX_ROWS + AT_ONCE],
    pairs: Pairs,
    fours: Fours,
    /// By list.
    units: [Units; MAX_ROWS],
    next: usize,
    next_pair: usize,
    next_four: usize,
    list: usize,
    tile: usize,
}

impl<'a> LocalRows<'a> {
    /// From the first tile on.
    pub fn new(local: &'a Local, coefficients: &'a [f32; MAX_ROWS]) -> Self {
        let (transforms, counts) = local.groups();
        Self {
            cursor: local.tiles().as_ptr().cast(),
            transform: transforms.as_ptr().cast(),
            counts: counts.as_ptr(),
            group: counts.as_ptr(),
            lists: local.lists(),
            coefficients,
            factors: [0.0; MAX_ROWS + AT_ONCE],
            pairs: Pairs { high: [[0; 2]; PAIRS], low: [[0; 2]; PAIRS] },
            fours: Fours { values: [[0; 4]; FOURS], high: [[0; 4]; FOURS], low: [[0; 4]; FOURS] },
            units: [Units::default(); MAX_ROWS],
            next: 0,
            next_pair: 0,
            next_four: 0,
            list: 0,
            tile: 0,
        }
    }

    /// The coefficients of a group's rows.
    #[inline(always)]
    unsafe fn make_factors<V: Lanes>(&mut self) {
        let (mut first, mut to, mut to_pair, mut to_four) = (0, 0, 0, 0);
        for (list, &rows) in self.lists.iter().enumerate() {
            // SAFETY: matrices and counts were made for these lists, with no more rows than the plan has; what lies beyond a list's
            // own rows is written over by the next list.
            unsafe {
                let [wide, half, bytes] = (*self.group.add(list)).map(usize::from);
                let coefficients = self.coefficients.as_ptr().add(first);
                for at in (0..wide + half + bytes).step_by(AT_ONCE) {
                    V::sixteen_sums(
                        self.transform,
                        coefficients,
                        rows,
                        self.factors.as_mut_ptr().add(to + at),
                    );
                    self.transform = self.transform.add(rows * AT_ONCE);
                }
                let [of_pairs, of_fours] =
                    [to + wide..to + wide + half, to + wide + half..to + wide + half + bytes];
                let pair = V::whole_pairs(
                    self.factors.get_unchecked(of_pairs),
                    room(&mut self.pairs.high, to_pair, half),
                    room(&mut self.pairs.low, to_pair, half),
                );
                let (sums, four) = V::whole_fours(
                    self.factors.get_unchecked(of_fours),
                    room(&mut self.fours.values, to_four, bytes),
                    room(&mut self.fours.high, to_four, bytes),
                    room(&mut self.fours.low, to_four, bytes),
                );
                *self.units.get_unchecked_mut(list) = Units { pair, four, sums };
                to += wide + half + bytes;
                to_pair += half.div_ceil(2);
                to_four += bytes.div_ceil(4);
            }
            first += rows;
        }
    }

    /// `sum` plus the rows of the next list, each width in turn.
    #[inline(always)]
    unsafe fn add_list<V: Lanes>(&mut self, mut sum: V) -> V {
        // SAFETY: the tiles were made with the counts, for the plan that drives the sweep.
        unsafe {
            let [wide, half, bytes] = *self.counts;
            self.counts = self.counts.add(1);
            for _ in 0..wide {
                let factor = *self.factors.get_unchecked(self.next);
                sum = V::load(self.cursor.cast()).mul_add(V::splat(factor), sum);
                self.cursor = self.cursor.add(TILE_NODES * size_of::<f32>());
                self.next += 1;
            }
            let units = *self.units.get_unchecked(self.list);
            if half > 0 {
                let count = usize::from(half).div_ceil(2);
                let of_list = self.next_pair..self.next_pair + count;
                let high = self.pairs.high.get_unchecked(of_list.clone());
                let low = self.pairs.low.get_unchecked(of_list);
                sum = sum.add_pairs(self.cursor, &PairFactors { high, low, unit: units.pair });
                self.cursor = self.cursor.add(count * PAIR_BYTES);
                self.next_pair += count;
            }
            if bytes > 0 {
                let count = usize::from(bytes).div_ceil(4);
                let of_list = self.next_four..self.next_four + count;
                let values = self.fours.values.get_unchecked(of_list.clone());
                let high = self.fours.high.get_unchecked(of_list.clone());
                let low = self.fours.low.get_unchecked(of_list);
                let factors = FourFactors { values, high, low, sums: units.sums, unit: units.four };
                sum = sum.add_fours(self.cursor, &factors);
                self.cursor = self.cursor.add(count * FOUR_BYTES);
                self.next_four += count;
            }
            self.next += usize::from(half + bytes);
            self.list += 1;
            sum
        }
    }
}

/// Where the factors of `count` rows are written, from word `at` on.
///
/// # Safety
/// There is room for so many, rounded up to sixteen.
#[inline(always)]
unsafe fn room<T, const N: usize>(words: &mut [[T; N]], at: usize, count: usize) -> &mut [T] {
    let first = at * N;
    // SAFETY: the caller's promise.
    unsafe { words.as_flattened_mut().get_unchecked_mut(first..first + count.next_multiple_of(AT_ONCE)) }
}

// SAFETY (all methods): the trait's contract.
impl Rows for LocalRows<'_> {
    #[inline(always)]
    unsafe fn begin_tile<V: Lanes>(&mut self) {
        if self.tile.is_multiple_of(GROUP_TILES) {
            // SAFETY: see the impl.
            unsafe {
                self.group = if self.tile == 0 { self.group } else { self.group.add(self.lists.len()) };
                self.make_factors::<V>();
            }
        }
        self.tile += 1;
        self.counts = self.group;
        (self.next, self.next_pair, self.next_four, self.list) = (0, 0, 0, 0);
    }

    #[inline(always)]
    unsafe fn combine<V: Lanes>(&mut self, _: &Op) -> V {
        // SAFETY: see the impl.
        unsafe { self.add_list(V::splat(0.0)) }
    }

    #[inline(always)]
    unsafe fn shift<V: Lanes>(&mut self, _: &Op, sum: V) -> V {
        // SAFETY: see the impl.
        unsafe { self.add_list(sum) }
    }

    #[inline(always)]
    unsafe fn add_rest<V: Lanes>(&mut self, sum: V) -> V {
        // SAFETY: see the impl.
        unsafe { self.add_list(sum) }
    }
}
