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
#[derive(Debug)]
pub(crate) struct Rewind(Vec<Before>);

/// With room for all of them, which the original has too.
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

    /// Keeps an estimate where the lowest point has come down since the last one.
    pub(crate) fn keep(&mut self, t_s: f64, mean: &Vector, covariance: &Symmetric, gap_floor_mm: f64) {
        // The bound falls where the gap drifts, and begins anew after a contact: what was farther down is of another time.
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

    /// The last one from before a contact with an obstacle at a gap.
    pub(crate) fn before_contact(&self, gap_mm: f64) -> Option<Before> {
        self.0.iter().rev().find(|kept| kept.gap_floor_mm <= gap_mm - CLEARANCE_MM).copied()
    }

    /// None is left: a contact has begun.
    pub(crate) fn forget(&mut self) {
        self.0.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix::MAX_STATES;

    fn keep(kept: &mut Rewind, t_s: f64, gap_floor_mm: f64) {
        kept.keep(t_s, &[t_s; MAX_STATES], &Symmetric::diagonal(&[1.0]), gap_floor_mm);
    }

    #[test]
    fn the_last_estimate_from_clear_of_the_obstacle_is_found_until_it_is_forgotten() {
        let mut kept = Rewind::new();
        (0..1000).for_each(|k| keep(&mut kept, f64::from(k), 0.1 * f64::from(k)));
        assert_eq!((kept.0.len(), kept.0.capacity()), (KEPT, KEPT));
        let found = kept.before_contact(90.0).expect("one");
        assert!((88.0..=88.5).contains(&found.gap_floor_mm), "{found:?}");
        assert!(kept.clone().0.capacity() >= KEPT);
        assert!(kept.before_contact(20.0).is_none(), "those are not kept any more");
        kept.forget();
        assert!(kept.before_contact(90.0).is_none(), "none is left");
    }

    #[test]
    fn what_was_farther_down_before_is_forgotten() {
        let mut kept = Rewind::new();
        for floor_mm in [10.0, 20.0, 30.0, 5.0, 12.0] {
            keep(&mut kept, floor_mm, floor_mm);
        }
        let found = kept.before_contact(40.0).expect("one");
        assert_eq!(found.gap_floor_mm, 12.0);
    }
}
