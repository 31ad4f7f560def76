//! What was estimated before a contact that was noticed late.
//!
//! A contact begins with small forces and shifts. Until the readings say so ([`crate::Filter`] asks for much evidence while the gap is not
//! known), the unknowns take them for a stiffer actuator or a gauge that is off. So estimates are kept as the lowest point comes nearer to what may
//! be there; when a contact shows at which gap it began, those from before it are taken up again.

use crate::matrix::{Symmetric, Vector};

/// Estimates kept.
const KEPT: usize = 64;
/// By so much the lowest point comes down from one to the next, mm.
const SPACING_MM: f64 = 0.5;
/// An estimate was made before a contact when the lowest point was that far above the obstacle, mm: readings are not exact.
const CLEARANCE_MM: f64 = 1.5;

/// One of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Before {
    pub(crate) t_s: f64,
    pub(crate) mean: Vector,
    pub(crate) covariance: Symmetric,
    /// Largest gap that readings without contact had excluded (mm).
    pub(crate) gap_floor_mm: f64,
}

/// The last of them, the newest last. Memory is taken once.
#[derive(Clone, Debug)]
pub(crate) struct Rewind(Vec<Before>);

impl Rewind {
    pub(crate) fn new() -> Self {
        Self(Vec::with_capacity(KEPT))
    }

    /// Keeps an estimate where the lowest point has come down since the last one.
    pub(crate) fn keep(&mut self, now: Before) {
        if self.0.last().is_some_and(|last| now.gap_floor_mm < last.gap_floor_mm + SPACING_MM) {
            return;
        }
        if self.0.len() == KEPT {
            self.0.remove(0);
        }
        self.0.push(now);
    }

    /// The last one from before a contact with an obstacle at a gap; none is left afterwards.
    pub(crate) fn before_contact(&mut self, gap_mm: f64) -> Option<Before> {
        let found = self.0.iter().rev().find(|kept| kept.gap_floor_mm <= gap_mm - CLEARANCE_MM).copied();
        self.0.clear();
        found
    }
}
