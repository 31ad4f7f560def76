//! The sweep: every tile once, in order, all fields of a tile at once.

use super::TILE_NODES;
use super::isa::Isa;
use super::lanes::{Lanes, portable::Portable};
use super::pages::{LINE, Line};
use super::plan::Plan;
use super::rows::Rows;
use super::spec::Role;

/// Largest value and the output node that has it, per peak.
#[derive(Debug, Clone, Copy)]
pub(super) struct RawPeaks {
    pub displacement: (f32, usize),
    pub stress: (f32, usize),
}

/// What a sweep works on.
pub(super) struct Job<'a, R> {
    pub plan: &'a Plan,
    /// The first row of the first tile.
    pub rows: R,
    /// Valid for writes of `plan.entries()` values.
    pub out: *mut f32,
}

/// Runs the sweep with an instruction set that the caller has found to be available.
///
/// # Safety
/// `isa` is available, `job.rows` are those of `job.plan`, and `job.out` is valid for writes of `plan.entries()` f32, all of
/// which are written.
pub(super) unsafe fn run<R: Rows>(isa: Isa, job: Job<'_, R>) -> RawPeaks {
    // SAFETY: the caller's promises are passed on.
    unsafe {
        match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => x86::avx512(job),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => x86::avx2(job),
            #[cfg(target_arch = "aarch64")]
            Isa::Neon => sweep::<super::lanes::neon::Neon, R>(job),
            _ => sweep::<Portable, R>(job),
        }
    }
}

/// Reads every cache line once and returns a checksum.
///
/// # Safety
/// `isa` is available.
pub(super) unsafe fn read(isa: Isa, lines: &[Line]) -> u32 {
    // SAFETY: the caller's promise is passed on.
    unsafe {
        match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => x86::avx512_read(lines),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => x86::avx2_read(lines),
            #[cfg(target_arch = "aarch64")]
            Isa::Neon => read_lines::<super::lanes::neon::Neon>(lines),
            _ => read_lines::<Portable>(lines),
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
        ($($features:literal, $lanes:ty: $run:ident, $read:ident;)*) => {$(
            #[target_feature(enable = $features)]
            pub(super) unsafe fn $run<R: Rows>(job: Job<'_, R>) -> RawPeaks {
                // SAFETY: the caller's promises are passed on.
                unsafe { sweep::<$lanes, R>(job) }
            }

            #[target_feature(enable = $features)]
            pub(super) unsafe fn $read(lines: &[Line]) -> u32 {
                // SAFETY: the caller's promises are passed on.
                unsafe { read_lines::<$lanes>(lines) }
            }
        )*};
    }
    compiled! {
        "avx512f,avx512vnni", Avx512: avx512, avx512_read;
        "avx2,fma", Avx2: avx2, avx2_read;
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
    plan: &'a Plan,
    out: *mut f32,
    displacement: LanePeak<V>,
    stress: LanePeak<V>,
}

/// # Safety
/// As for [`run`], with the instruction set of `V`.
#[inline(always)]
unsafe fn sweep<V: Lanes, R: Rows>(job: Job<'_, R>) -> RawPeaks {
    let Job { plan, mut rows, out } = job;
    // SAFETY: whole tiles write one row a field inside `out`; the last, partial one goes through a buffer. The
    // storage holds `plan.tiles()` tiles.
    unsafe {
        let (displacement, stress) = (LanePeak::<V>::new(), LanePeak::new());
        let mut sweep = Sweep { plan, out, displacement, stress };
        let whole = plan.nodes / TILE_NODES;
        for index in 0..whole {
            sweep.tile::<R, WholeTile>(&mut rows, index);
        }
        if whole < plan.tiles() {
            sweep.tile::<R, PartialTile>(&mut rows, whole);
        }
        RawPeaks {
            displacement: sweep.displacement.reduce(plan.nodes),
            stress: sweep.stress.reduce(plan.nodes),
        }
    }
}

impl<V: Lanes> Sweep<'_, V> {
    #[inline(always)]
    unsafe fn tile<R: Rows, W: Write>(&mut self, rows: &mut R, index: usize) {
        let (plan, out) = (self.plan, self.out);
        // SAFETY: the rows follow the plan that laid out the tile, and each slot is below `published`.
        unsafe {
            let number = V::splat(f32::from_bits(index as u32));
            let mut squares = V::splat(0.0);
            rows.begin_tile::<V>();
            for op in &plan.ops {
                let mut value = rows.combine::<V>(op);
                if op.in_magnitude {
                    let moved = rows.shift(op, value);
                    squares = moved.mul_add(moved, squares);
                }
                if op.has_rest {
                    value = rows.add_rest(value);
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
            let existing = W::existing(value, self.plan, tile);
            if role == Role::Stress {
                self.stress.update(existing, number);
            } else {
                self.displacement.update(existing, number);
            }
            value
        }
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
unsafe fn read_lines<V: Lanes>(lines: &[Line]) -> u32 {
    const SUMS: usize = 4;
    const ROW_LINES: usize = TILE_NODES * size_of::<f32>() / LINE;
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
