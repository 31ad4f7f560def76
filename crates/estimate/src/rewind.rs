//! Estimates from before a contact that was detected late.
//!
//! A contact begins with small forces and shifts. [`crate::Filter`] requires much evidence for it while the gap is unknown; until
//! then the unknowns absorb it as a stiffer actuator or a biased gauge. Estimates are therefore stored while the lowest point
//! approaches a possible obstacle. When a contact shows its gap, those from before it are restored.

use crate::matrix::{Symmetric, Vector};

/// Largest number of stored estimates.
const KEPT: usize = 64;
/// Descent of the lowest point between two stored estimates, mm.
const SPACING_MM: f64 = 0.5;
/// Distance of the lowest point from the obstacle, mm, from which on an estimate is from before a contact.
const CLEARANCE_MM: f64 = 1.5;

/// One stored estimate.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Before {
    pub(crate) t_s: f64,
    pub(crate) mean: Vector,
    pub(crate) covariance: Symmetric,
    /// Largest gap that readings without contact had excluded (mm).
    pub(crate) gap_floor_mm: f64,
}

/// Last estimates, the newest last. The capacity is allocated once.
#[derive(Debug)]
pub(crate) struct Rewind(Vec<Before>);

/// Clones with full capacity.
impl Clone for Rewind {
    fn clone(&self) -> Self {
        let mut out = Self::new();
        out.0.extend_from_slice(&self.0);
        out
    }
}

impl Rewind {
    pub(crate) fn new() -> Self {
        Self(Vec::with_capacity(KEPT))
    }

    /// Stores an estimate if the lowest point is lower than at the last one.
    pub(crate) fn keep(&mut self, t_s: f64, mean: &Vector, covariance: &Symmetric, gap_floor_mm: f64) {
        // The bound falls if the gap drifts, and restarts after a contact: lower estimates are outdated.
        while self.0.last().is_some_and(|last| last.gap_floor_mm > gap_floor_mm + SPACING_MM) {
            self.0.pop();
        }
        if self.0.last().is_some_and(|last| gap_floor_mm < last.gap_floor_mm + SPACING_MM) {
            return;
        }
        if self.0.len() == KEPT {
            self.0.remove(0);
        }
        self.0.push(Before { t_s, mean: *mean, covariance: *covariance, gap_floor_mm });
    }

    /// Last estimate from before a contact with an obstacle at `gap_mm`.
    pub(crate) fn before_contact(&self, gap_mm: f64) -> Option<Before> {
        self.0.iter().rev().find(|kept| kept.gap_floor_mm <= gap_mm - CLEARANCE_MM).copied()
    }

    /// Removes all estimates, when a contact has begun.
    pub(crate) fn forget(&mut self) {
        self.0.clear();
    }
}

#[cfg(test)]
#[path = "../tests/unit/rewind.rs"]
mod tests;
