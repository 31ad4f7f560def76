//! How the sweep reads rows of local modes: their coefficients first, group by group.

use super::lanes::{Four, FourFactors, Lanes, Pair};
use super::local::{AT_ONCE, Counts, GROUP_TILES, Local};
use super::plan::Op;
use super::rows::Rows;
use super::{MAX_ROWS, TILE_NODES, whole};

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
    pairs: [Pair; MAX_ROWS],
    fours: [Four; MAX_ROWS],
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
            pairs: [Pair::default(); MAX_ROWS],
            fours: [Four::default(); MAX_ROWS],
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
                to = of_fours.end;
                let [next_pair, next_four] = [to_pair + half.div_ceil(2), to_four + bytes.div_ceil(4)];
                let pairs = self.pairs.get_unchecked_mut(to_pair..next_pair);
                let pair_unit = whole::pairs(self.factors.get_unchecked(of_pairs), pairs);
                let fours = self.fours.get_unchecked_mut(to_four..next_four);
                let (sums, four_unit) = whole::fours(self.factors.get_unchecked(of_fours), fours);
                *self.units.get_unchecked_mut(list) = Units { pair: pair_unit, four: four_unit, sums };
                [to_pair, to_four] = [next_pair, next_four];
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
                let pairs = self.pairs.get_unchecked(self.next_pair..self.next_pair + count);
                sum = sum.add_pairs(self.cursor, pairs, units.pair);
                self.cursor = self.cursor.add(count * PAIR_BYTES);
                self.next_pair += count;
            }
            if bytes > 0 {
                let count = usize::from(bytes).div_ceil(4);
                let fours = self.fours.get_unchecked(self.next_four..self.next_four + count);
                sum = sum.add_fours(self.cursor, &FourFactors { fours, sums: units.sums, unit: units.four });
                self.cursor = self.cursor.add(count * FOUR_BYTES);
                self.next_four += count;
            }
            self.next += usize::from(half + bytes);
            self.list += 1;
            sum
        }
    }
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
