//! The sweep: every tile once, in order, all fields of a tile at once.

use std::mem::MaybeUninit;

use super::isa::Isa;
use super::lanes::{Lanes, Portable};
use super::modes::{Modes, row_bytes, runs};
use super::pages::{LINE, Lines};
use super::plan::{Op, Plan, Role};
use super::{MAX_ROWS, TILE_NODES};

/// Largest value and the output node that has it, per peak.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RawPeaks {
    pub displacement: (f32, usize),
    pub stress: (f32, usize),
}

/// Rows of a basis: for every op of the plan its modes, and all constant rows, tile after tile.
#[derive(Debug, Clone)]
pub(crate) struct Rows {
    pub modes: Vec<Modes>,
    /// For every op its modes in use, as neighbours of as many bits: the bits and their number.
    runs: Vec<Vec<(u8, usize)>>,
    constants: Lines,
}

/// Cache lines per constant row.
const CONSTANT_LINES: usize = TILE_NODES * size_of::<f32>() / LINE;

impl Rows {
    /// Lays the constant rows out, which hold one value per node.
    pub(crate) fn new(plan: &Plan, modes: Vec<Modes>, constants: &[Vec<f32>]) -> Self {
        let mut lines = Lines::zeroed(plan.tiles() * constants.len() * CONSTANT_LINES);
        let values = (0..plan.tiles()).flat_map(|tile| constants.iter().map(move |row| (tile, row)));
        let rows = lines.bytes_mut().chunks_exact_mut(CONSTANT_LINES * LINE);
        for (to, (tile, row)) in rows.zip(values) {
            for (lane, to) in to.chunks_exact_mut(size_of::<f32>()).enumerate() {
                to.copy_from_slice(&row[(tile * TILE_NODES + lane).min(row.len() - 1)].to_le_bytes());
            }
        }
        let runs = plan.ops.iter().zip(&modes).map(|(op, modes)| runs(&modes.bits()[..op.modes]).collect());
        Self { runs: runs.collect(), modes, constants: lines }
    }

    /// Bytes of the constant rows.
    pub(crate) fn constant_bytes(&self) -> usize {
        self.constants.bytes().len()
    }

    /// True if these rows belong to a plan.
    fn fit(&self, plan: &Plan) -> bool {
        let fits = |(op, modes): (&Op, &Modes)| modes.nodes() == plan.nodes && modes.count() >= op.modes;
        self.modes.len() == plan.ops.len()
            && plan.ops.iter().zip(&self.modes).all(fits)
            && self.constants.len() == plan.tiles() * plan.constants * CONSTANT_LINES
    }
}

/// [`run`] into initialised memory.
pub(crate) fn run_into(
    isa: Isa,
    plan: &Plan,
    rows: &Rows,
    coefficients: &[f64],
    out: &mut [f32],
) -> RawPeaks {
    // SAFETY: of the same layout, and `run` writes f32 and nothing else.
    let out = unsafe { std::slice::from_raw_parts_mut(out.as_mut_ptr().cast(), out.len()) };
    run(isa, plan, rows, coefficients, out)
}

/// Data of a sweep.
struct Job<'a> {
    plan: &'a Plan,
    rows: &'a Rows,
    /// One per mode and shift, in the order of the ops.
    factors: &'a [f32; MAX_ROWS],
    out: *mut f32,
}

/// Reconstructs all published fields; every element of `out` is written.
///
/// # Panics
/// If rows, coefficients or output are not those of the plan, or the processor has no such instruction set.
pub(crate) fn run(
    isa: Isa,
    plan: &Plan,
    rows: &Rows,
    coefficients: &[f64],
    out: &mut [MaybeUninit<f32>],
) -> RawPeaks {
    assert!(isa.is_available() && rows.fit(plan) && plan.factors <= MAX_ROWS);
    assert!(coefficients.len() >= plan.coefficients && out.len() == plan.entries());
    let mut factors = [0.0; MAX_ROWS];
    let mut next = factors.iter_mut();
    for (op, modes) in plan.ops.iter().zip(&rows.modes) {
        let used = coefficients[op.first_coefficient..][..op.modes].iter().enumerate();
        used.zip(&mut next).for_each(|((mode, a), to)| *to = (a * modes.factor(mode)) as f32);
        op.shifts.iter().zip(&mut next).for_each(|(index, to)| *to = -coefficients[*index] as f32);
    }
    let job = Job { plan, rows, factors: &factors, out: out.as_mut_ptr().cast() };
    // SAFETY: the instruction set is available, the rows are those of the plan, and the output has its length.
    unsafe { dispatch(isa, job) }
}

/// # Safety
/// `isa` is available, the rows are of the plan, `out` is valid for writes of `plan.entries()` values.
unsafe fn dispatch(isa: Isa, job: Job<'_>) -> RawPeaks {
    // SAFETY: passed on to the caller.
    unsafe {
        match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => x86::avx512(job),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => x86::avx2(job),
            #[cfg(target_arch = "aarch64")]
            Isa::Neon => sweep::<super::lanes::neon::Neon>(job),
            _ => sweep::<Portable>(job),
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    //! The sweep compiled with the features of each instruction set, which is all that makes these functions unsafe
    //! beyond the sweep itself.

    use super::{Job, RawPeaks, sweep};
    use crate::kernel::lanes::{avx2::Avx2, avx512::Avx512};

    #[target_feature(enable = "avx512f")]
    pub(super) unsafe fn avx512(job: Job<'_>) -> RawPeaks {
        // SAFETY: passed on to the caller.
        unsafe { sweep::<Avx512>(job) }
    }

    #[target_feature(enable = "avx2,fma")]
    pub(super) unsafe fn avx2(job: Job<'_>) -> RawPeaks {
        // SAFETY: passed on to the caller.
        unsafe { sweep::<Avx2>(job) }
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
    /// Next constant row.
    constants: *const f32,
    displacement: LanePeak<V>,
    stress: LanePeak<V>,
}

/// # Safety
/// As for [`dispatch`], with the instruction set of `V`.
#[inline(always)]
unsafe fn sweep<V: Lanes>(job: Job<'_>) -> RawPeaks {
    let plan = job.plan;
    // SAFETY: whole tiles write one row per field inside `out`; the last, partial one goes through a buffer. The
    // storage holds `plan.tiles()` tiles.
    unsafe {
        let (displacement, stress) = (LanePeak::<V>::new(), LanePeak::new());
        let constants = job.rows.constants.as_ptr().cast();
        let mut sweep = Sweep { job, constants, displacement, stress };
        let whole = plan.nodes / TILE_NODES;
        for index in 0..whole {
            sweep.tile::<WholeTile>(index);
        }
        if whole < plan.tiles() {
            sweep.tile::<PartialTile>(whole);
        }
        RawPeaks {
            displacement: sweep.displacement.reduce(plan.nodes),
            stress: sweep.stress.reduce(plan.nodes),
        }
    }
}

/// Adds `count` modes of as many bits, times their factors.
///
/// # Safety
/// So many rows of these bits and so many factors are there, and the instruction set of `V` is available.
#[inline(always)]
unsafe fn add_rows<V: Lanes, const BITS: usize>(
    mut row: *const u8,
    mut factors: *const f32,
    count: usize,
    mut value: V,
) -> V {
    // SAFETY: passed on to the caller.
    unsafe {
        for _ in 0..count {
            let mode = if BITS == 32 { V::load(row.cast()) } else { V::load_integers::<BITS>(row) };
            value = mode.mul_add(V::splat(*factors), value);
            (row, factors) = (row.add(TILE_NODES * BITS / 8), factors.add(1));
        }
    }
    value
}

impl<V: Lanes> Sweep<'_, V> {
    #[inline(always)]
    unsafe fn constant(&mut self) -> V {
        // SAFETY: the plan that laid out the constant rows drives the sweep, so an aligned row is here.
        unsafe {
            let row = V::load(self.constants);
            self.constants = self.constants.add(TILE_NODES);
            row
        }
    }

    #[inline(always)]
    unsafe fn tile<W: Write>(&mut self, index: usize) {
        let (plan, out) = (self.job.plan, self.job.out);
        let mut factors = self.job.factors.as_ptr();
        // SAFETY: rows and factors follow the plan, and each slot is below `published`.
        unsafe {
            let number = V::splat(f32::from_bits(index as u32));
            let mut squares = V::splat(0.0);
            let rows = self.job.rows;
            for ((op, modes), runs) in plan.ops.iter().zip(&rows.modes).zip(&rows.runs) {
                let first: *const u8 = modes.lines().as_ptr().cast();
                let mut row = first.add(index * modes.tile_bytes());
                let mut value = if op.has_mean { self.constant() } else { V::splat(0.0) };
                for &(bits, count) in runs {
                    value = match bits {
                        4 => add_rows::<V, 4>(row, factors, count, value),
                        8 => add_rows::<V, 8>(row, factors, count, value),
                        16 => add_rows::<V, 16>(row, factors, count, value),
                        _ => add_rows::<V, 32>(row, factors, count, value),
                    };
                    (row, factors) = (row.add(count * row_bytes(bits)), factors.add(count));
                }
                if op.in_magnitude {
                    let mut moved = value;
                    for _ in 0..op.shifts.len() {
                        moved = self.constant().mul_add(V::splat(*factors), moved);
                        factors = factors.add(1);
                    }
                    squares = moved.mul_add(moved, squares);
                }
                if op.has_rest {
                    value = self.constant().add(value);
                }
                let value = self.finish::<W>(op.role, value, number, index);
                if let Some(slot) = op.slot {
                    W::write(value, plan, out, slot, index);
                }
            }
            if let Some(slot) = plan.magnitude_slot {
                let magnitude = squares.sqrt();
                self.displacement.update(W::existing(magnitude, plan, index), number);
                W::write(magnitude, plan, out, slot, index);
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

/// Writer of a tile's values to the output.
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
