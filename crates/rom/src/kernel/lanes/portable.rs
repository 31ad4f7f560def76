//! A plain array, for the compiler to vectorise with what every processor of the target has.

use super::super::TILE_NODES;
use super::Lanes;

const PAIRS: usize = TILE_NODES / 2;

/// A row in an array.
#[derive(Clone, Copy)]
pub(in super::super) struct Portable([f32; TILE_NODES]);

#[inline(always)]
fn each(value: impl Fn(usize) -> f32) -> Portable {
    let mut lanes = [0.0; TILE_NODES];
    for (i, lane) in lanes.iter_mut().enumerate() {
        *lane = value(i);
    }
    Portable(lanes)
}

// SAFETY (all methods): no instruction set is needed; the trait's contract gives pointers to a row.
impl Lanes for Portable {
    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        Self([value; TILE_NODES])
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: see the impl.
        Self(unsafe { from.cast::<[f32; TILE_NODES]>().read() })
    }

    #[inline(always)]
    unsafe fn load_pairs(from: *const i32) -> Self {
        // SAFETY: see the impl.
        let pairs = unsafe { from.cast::<[i32; PAIRS]>().read() };
        let mut lanes = [0.0; TILE_NODES];
        for (i, pair) in pairs.into_iter().enumerate() {
            lanes[i] = (pair << 16) as f32;
            lanes[PAIRS + i] = pair as f32;
        }
        Self(lanes)
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: see the impl.
        unsafe { to.cast::<[f32; TILE_NODES]>().write_unaligned(self.0) }
    }

    /// Rounded twice: without the instruction, a fused `mul_add` is a library call a hundred times as slow.
    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        each(|i| self.0[i] * factor.0[i] + addend.0[i])
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        each(|i| self.0[i] + other.0[i])
    }

    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        each(|i| self.0[i].sqrt())
    }

    #[inline(always)]
    unsafe fn at_least_zero(self) -> Self {
        each(|i| if 0.0 > self.0[i] { 0.0 } else { self.0[i] })
    }

    #[inline(always)]
    unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self {
        each(|i| if self.0[i] > than.0[i] { yes.0[i] } else { no.0[i] })
    }
}
