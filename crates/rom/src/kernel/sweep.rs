//! The sweep: every tile once, in order, all fields of a tile at once.

use super::isa::Isa;
use super::lanes::{Lanes, portable::Portable};
use super::plan::{Op, Plan};
use super::spec::Role;
use super::tiles::{LINE, Precision, Tiles};
use super::{MAX_ROWS, TILE_NODES};

/// Largest value and the output node that has it, per peak.
#[derive(Debug, Clone, Copy)]
pub(super) struct RawPeaks {
    pub displacement: (f32, usize),
    pub stress: (f32, usize),
}

/// What a sweep works on.
#[derive(Clone, Copy)]
pub(super) struct Job<'a> {
    pub plan: &'a Plan,
    pub tiles: &'a Tiles,
    /// What each row is multiplied by, in the order of the rows: modal coefficients, scales of the storage included.
    pub factors: &'a [f32; MAX_ROWS],
    /// Valid for writes of `plan.entries()` values.
    pub out: *mut f32,
}

/// Runs the sweep with an instruction set that the caller has found to be available.
///
/// # Safety
/// `isa` is available and `job.out` is valid for writes of `plan.entries()` f32, all of which are written.
pub(super) unsafe fn run(isa: Isa, precision: Precision, job: Job<'_>) -> RawPeaks {
    // SAFETY: the caller's promises are passed on.
    unsafe {
        match (isa, precision) {
            #[cfg(target_arch = "x86_64")]
            (Isa::Avx512, Precision::F32) => avx512_f32(job),
            #[cfg(target_arch = "x86_64")]
            (Isa::Avx512, Precision::I16) => avx512_i16(job),
            #[cfg(target_arch = "x86_64")]
            (Isa::Avx2, Precision::F32) => avx2_f32(job),
            #[cfg(target_arch = "x86_64")]
            (Isa::Avx2, Precision::I16) => avx2_i16(job),
            #[cfg(target_arch = "aarch64")]
            (Isa::Neon, Precision::F32) => sweep::<super::lanes::neon::Neon, F32Rows>(job),
            #[cfg(target_arch = "aarch64")]
            (Isa::Neon, Precision::I16) => sweep::<super::lanes::neon::Neon, I16Rows>(job),
            (_, Precision::F32) => sweep::<Portable, F32Rows>(job),
            (_, Precision::I16) => sweep::<Portable, I16Rows>(job),
        }
    }
}

/// Reads every cache line of the tiles once and returns a checksum.
///
/// # Safety
/// `isa` is available.
pub(super) unsafe fn read(isa: Isa, tiles: &Tiles) -> u32 {
    // SAFETY: the caller's promise is passed on.
    unsafe {
        match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => avx512_read(tiles),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => avx2_read(tiles),
            #[cfg(target_arch = "aarch64")]
            Isa::Neon => read_lines::<super::lanes::neon::Neon>(tiles),
            _ => read_lines::<Portable>(tiles),
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    //! The sweep compiled with the features of each instruction set, which is all that makes these functions unsafe
    //! beyond the sweep itself.

    use super::*;
    use crate::kernel::lanes::{avx2::Avx2, avx512::Avx512};

    macro_rules! compiled {
        ($($name:ident, $features:literal, $body:expr, $argument:ty => $result:ty;)*) => {$(
            #[target_feature(enable = $features)]
            pub(in super::super) unsafe fn $name(argument: $argument) -> $result {
                // SAFETY: the caller's promises are passed on.
                unsafe { $body(argument) }
            }
        )*};
    }
    compiled! {
        avx512_f32, "avx512f", sweep::<Avx512, F32Rows>, Job<'_> => RawPeaks;
        avx512_i16, "avx512f", sweep::<Avx512, I16Rows>, Job<'_> => RawPeaks;
        avx512_read, "avx512f", read_lines::<Avx512>, &Tiles => u32;
        avx2_f32, "avx2,fma", sweep::<Avx2, F32Rows>, Job<'_> => RawPeaks;
        avx2_i16, "avx2,fma", sweep::<Avx2, I16Rows>, Job<'_> => RawPeaks;
        avx2_read, "avx2,fma", read_lines::<Avx2>, &Tiles => u32;
    }
}
#[cfg(target_arch = "x86_64")]
use x86::*;

/// How rows are stored.
///
/// # Safety
/// Implementations read the row at the cursor and advance the cursor by exactly that row.
trait Rows {
    /// The next row, in steps of its storage.
    unsafe fn next<V: Lanes>(cursor: &mut *const u8) -> V;
    /// The next row, which no coefficient belongs to, times the scale of its storage.
    unsafe fn constant<V: Lanes>(cursor: &mut *const u8, scale: f32) -> V;
    /// `sum` plus such a row.
    unsafe fn plus<V: Lanes>(sum: V, cursor: &mut *const u8, scale: f32) -> V;
}

struct F32Rows;

impl Rows for F32Rows {
    #[inline(always)]
    unsafe fn next<V: Lanes>(cursor: &mut *const u8) -> V {
        // SAFETY: the plan that laid out the tile drives the sweep, so a row of aligned f32 lies here.
        unsafe {
            let row = V::load(cursor.cast());
            *cursor = cursor.add(TILE_NODES * 4);
            row
        }
    }

    #[inline(always)]
    unsafe fn constant<V: Lanes>(cursor: &mut *const u8, _: f32) -> V {
        // SAFETY: as above; the scale of f32 is 1.
        unsafe { Self::next(cursor) }
    }

    #[inline(always)]
    unsafe fn plus<V: Lanes>(sum: V, cursor: &mut *const u8, _: f32) -> V {
        // SAFETY: as above; the scale of f32 is 1.
        unsafe { Self::next::<V>(cursor).add(sum) }
    }
}

struct I16Rows;

impl Rows for I16Rows {
    #[inline(always)]
    unsafe fn next<V: Lanes>(cursor: &mut *const u8) -> V {
        // SAFETY: the plan that laid out the tile drives the sweep, so a row of aligned pairs of i16 lies here.
        unsafe {
            let row = V::load_pairs(cursor.cast());
            *cursor = cursor.add(TILE_NODES * 2);
            row
        }
    }

    #[inline(always)]
    unsafe fn constant<V: Lanes>(cursor: &mut *const u8, scale: f32) -> V {
        // SAFETY: as above.
        unsafe { Self::plus(V::splat(0.0), cursor, scale) }
    }

    #[inline(always)]
    unsafe fn plus<V: Lanes>(sum: V, cursor: &mut *const u8, scale: f32) -> V {
        // SAFETY: as above.
        unsafe { Self::next::<V>(cursor).mul_add(V::splat(scale), sum) }
    }
}

/// Running maximum of each lane and the tile it was found in (as bits of an f32).
#[derive(Clone, Copy)]
struct LanePeak<V> {
    value: V,
    tile: V,
}

impl<V: Lanes> LanePeak<V> {
    #[inline(always)]
    unsafe fn new() -> Self {
        // SAFETY: the instruction set is available.
        unsafe { Self { value: V::splat(f32::NEG_INFINITY), tile: V::splat(0.0) } }
    }

    #[inline(always)]
    unsafe fn update(&mut self, value: V, tile: V) {
        // SAFETY: the instruction set is available.
        unsafe {
            self.tile = value.select_greater(self.value, tile, self.tile);
            self.value = value.select_greater(self.value, value, self.value);
        }
    }

    /// The maximum over lanes; of equal values the lowest node.
    #[inline(always)]
    unsafe fn reduce(self, nodes: usize) -> (f32, usize) {
        let (mut values, mut tiles) = ([0.0; TILE_NODES], [0.0; TILE_NODES]);
        // SAFETY: both arrays hold a row.
        unsafe {
            self.value.store(values.as_mut_ptr());
            self.tile.store(tiles.as_mut_ptr());
        }
        let mut best = (f32::NEG_INFINITY, usize::MAX);
        for (lane, (value, tile)) in values.into_iter().zip(tiles).enumerate() {
            let node = tile.to_bits() as usize * TILE_NODES + lane;
            if value > best.0 || (value == best.0 && node < best.1) {
                best = (value, node);
            }
        }
        (best.0, best.1.min(nodes - 1))
    }
}

/// State of a sweep.
struct Sweep<'a, V> {
    job: Job<'a>,
    displacement: LanePeak<V>,
    stress: LanePeak<V>,
}

/// # Safety
/// As for [`run`], with the instruction set of `V`.
#[inline(always)]
unsafe fn sweep<V: Lanes, R: Rows>(job: Job<'_>) -> RawPeaks {
    let plan = job.plan;
    // SAFETY: whole tiles write one row a field inside `out`; the last, partial one goes through a buffer. The
    // storage holds `plan.tiles()` tiles.
    unsafe {
        let mut sweep = Sweep { job, displacement: LanePeak::<V>::new(), stress: LanePeak::new() };
        let whole = plan.nodes / TILE_NODES;
        let mut tile = job.tiles.as_ptr();
        for index in 0..whole {
            sweep.tile::<R, WholeTile>(tile, index);
            tile = tile.add(job.tiles.tile_bytes);
        }
        if whole < plan.tiles() {
            sweep.tile::<R, PartialTile>(tile, whole);
        }
        RawPeaks {
            displacement: sweep.displacement.reduce(plan.nodes),
            stress: sweep.stress.reduce(plan.nodes),
        }
    }
}

impl<V: Lanes> Sweep<'_, V> {
    #[inline(always)]
    unsafe fn tile<R: Rows, W: Write>(&mut self, tile: *const u8, index: usize) {
        let job = self.job;
        // SAFETY: the cursor follows the plan that laid out the tile, factors hold one value a row, and each slot is
        // below `published`.
        unsafe {
            let number = V::splat(f32::from_bits(index as u32));
            let mut cursor = tile;
            let mut factors = job.factors.as_ptr();
            let mut squares = V::splat(0.0);
            for op in &job.plan.ops {
                let mut value = combine::<V, R>(op, &mut cursor, &mut factors);
                if op.in_magnitude {
                    let mut moved = value;
                    for j in 0..op.shifts.len() {
                        moved = R::next::<V>(&mut cursor).mul_add(V::splat(*factors.add(j)), moved);
                    }
                    factors = factors.add(op.shifts.len());
                    squares = moved.mul_add(moved, squares);
                }
                if op.has_rest {
                    value = R::plus(value, &mut cursor, *factors);
                    factors = factors.add(1);
                }
                let value = self.finish::<W>(op.role, value, number, index);
                if let Some(slot) = op.slot {
                    W::write(value, job.plan, job.out, slot, index);
                }
            }
            if let Some(slot) = job.plan.magnitude_slot {
                let magnitude = squares.sqrt();
                self.displacement.update(W::existing(magnitude, job.plan, index), number);
                W::write(magnitude, job.plan, job.out, slot, index);
            }
        }
    }

    /// Clamp and peak. One branch a peak: chosen through a pointer they would live in memory, and each tile would wait
    /// for the stores of the tile before.
    #[inline(always)]
    unsafe fn finish<W: Write>(&mut self, role: Role, value: V, number: V, tile: usize) -> V {
        if role == Role::Plain {
            return value;
        }
        // SAFETY: the instruction set is available.
        unsafe {
            let value = value.at_least_zero();
            let existing = W::existing(value, self.job.plan, tile);
            if role == Role::Stress {
                self.stress.update(existing, number);
            } else {
                self.displacement.update(existing, number);
            }
            value
        }
    }
}

/// `mean + sum_j mode_j a_j` of one field in one tile; of a component of the displacement, less the rest shape.
#[inline(always)]
unsafe fn combine<V: Lanes, R: Rows>(op: &Op, cursor: &mut *const u8, factors: &mut *const f32) -> V {
    // SAFETY: the plan promises these rows and these factors.
    unsafe {
        let mut sum = V::splat(0.0);
        if op.has_mean {
            sum = R::constant(cursor, **factors);
            *factors = factors.add(1);
        }
        for j in 0..op.modes {
            sum = R::next::<V>(cursor).mul_add(V::splat(*factors.add(j)), sum);
        }
        *factors = factors.add(op.modes);
        sum
    }
}

/// How a tile's values reach the output.
trait Write {
    /// The value with lanes beyond the last node out of the running for a peak.
    unsafe fn existing<V: Lanes>(value: V, plan: &Plan, tile: usize) -> V;
    /// The values of the nodes that exist to field `slot` of the output.
    unsafe fn write<V: Lanes>(value: V, plan: &Plan, out: *mut f32, slot: usize, tile: usize);
}

struct WholeTile;

impl Write for WholeTile {
    #[inline(always)]
    unsafe fn existing<V: Lanes>(value: V, _: &Plan, _: usize) -> V {
        value
    }

    #[inline(always)]
    unsafe fn write<V: Lanes>(value: V, plan: &Plan, out: *mut f32, slot: usize, tile: usize) {
        // SAFETY: a whole tile of a field below `published` lies inside the output.
        unsafe { value.store(out.add(slot * plan.nodes + tile * TILE_NODES)) }
    }
}

struct PartialTile;

#[repr(align(64))]
struct AlignedRow([f32; TILE_NODES]);

impl Write for PartialTile {
    #[inline(always)]
    unsafe fn existing<V: Lanes>(value: V, plan: &Plan, tile: usize) -> V {
        let mut row = AlignedRow([0.0; TILE_NODES]);
        // SAFETY: the buffer takes a row and is aligned to a cache line.
        unsafe {
            value.store(row.0.as_mut_ptr());
            row.0[plan.nodes - tile * TILE_NODES..].fill(f32::NEG_INFINITY);
            V::load(row.0.as_ptr())
        }
    }

    #[inline(always)]
    unsafe fn write<V: Lanes>(value: V, plan: &Plan, out: *mut f32, slot: usize, tile: usize) {
        let mut buffer = [0.0f32; TILE_NODES];
        let start = tile * TILE_NODES;
        // SAFETY: the buffer takes a row, and only the nodes that exist are copied on.
        unsafe {
            value.store(buffer.as_mut_ptr());
            let to = out.add(slot * plan.nodes + start);
            std::ptr::copy_nonoverlapping(buffer.as_ptr(), to, plan.nodes - start);
        }
    }
}

/// Running sums over four rows, so that the additions never wait for each other.
#[inline(always)]
unsafe fn read_lines<V: Lanes>(tiles: &Tiles) -> u32 {
    const SUMS: usize = 4;
    const ROW_LINES: usize = TILE_NODES * size_of::<f32>() / LINE;
    let lines = tiles.lines();
    let mut words = [0.0f32; TILE_NODES];
    // SAFETY: every row lies inside the slice of aligned lines.
    unsafe {
        let mut sums = [V::splat(0.0); SUMS];
        let mut groups = lines.chunks_exact(SUMS * ROW_LINES);
        for group in &mut groups {
            let first: *const f32 = group.as_ptr().cast();
            for (k, sum) in sums.iter_mut().enumerate() {
                *sum = sum.fold(first.add(k * TILE_NODES));
            }
        }
        let mut total = 0u32;
        for sum in sums {
            sum.store(words.as_mut_ptr());
            total = words.iter().fold(total, |total, word| total.wrapping_add(word.to_bits()));
        }
        let rest = groups.remainder().iter().flat_map(|line| line.0.chunks_exact(4));
        rest.fold(total, |total, word| {
            total.wrapping_add(u32::from_ne_bytes([word[0], word[1], word[2], word[3]]))
        })
    }
}
