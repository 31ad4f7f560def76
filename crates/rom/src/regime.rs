//! Which regime a reading belongs to: the onset pressure over the gap, and a label that does not chatter.
//!
//! Guard: contact when `P >= P_c(gap)`. A gap below the sag touches at once (`P_c = 0`), a gap beyond reach never.
//! The *physics* always follows the guard, so fields and force stay continuous; only the *label* has hysteresis.

use crate::snapshots::RegimeKind;
use serde::{Deserialize, Serialize};

/// Onset pressure over gap, derived from the free model: where its lowest surface node reaches the obstacle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OnsetTable {
    /// Gaps in mm, strictly increasing: from the sag to the reach.
    pub gap_mm: Vec<f64>,
    /// Onset pressures in MPa, strictly increasing, the first one 0.
    pub pressure_mpa: Vec<f64>,
}

/// When a gap is touched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Onset {
    /// Gravity alone does it: the gap is at or below the sag.
    Always,
    /// At this pressure in MPa.
    At(f64),
    /// Not within the free model's pressures.
    Never,
}

impl Onset {
    /// Onset pressure in MPa: 0 when always touched, none when never.
    pub fn pressure_mpa(self) -> Option<f64> {
        match self {
            Self::Always => Some(0.0),
            Self::At(pressure) => Some(pressure),
            Self::Never => None,
        }
    }

    /// The regime the physics is in.
    pub fn regime(self, pressure_mpa: f64) -> RegimeKind {
        match self {
            Self::Always => RegimeKind::Contact,
            Self::At(onset) if pressure_mpa >= onset => RegimeKind::Contact,
            Self::At(_) | Self::Never => RegimeKind::Free,
        }
    }
}

impl OnsetTable {
    /// Gap at which gravity alone touches, in mm.
    pub fn sag_mm(&self) -> f64 {
        self.gap_mm[0]
    }

    /// Largest gap the free model's pressures can close, in mm.
    pub fn reach_mm(&self) -> f64 {
        self.gap_mm[self.gap_mm.len() - 1]
    }

    /// Onset of a gap by linear interpolation in the table. `O(log entries)`.
    pub fn onset(&self, gap_mm: f64) -> Onset {
        if gap_mm <= self.sag_mm() {
            return Onset::Always;
        }
        if gap_mm > self.reach_mm() {
            return Onset::Never;
        }
        let hi = self.gap_mm.partition_point(|g| *g < gap_mm).max(1);
        let (g0, g1) = (self.gap_mm[hi - 1], self.gap_mm[hi]);
        let t = (gap_mm - g0) / (g1 - g0);
        Onset::At(self.pressure_mpa[hi - 1] + t * (self.pressure_mpa[hi] - self.pressure_mpa[hi - 1]))
    }
}

/// Memory of the last label: sensor noise around the onset must not flip it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegimeSwitch {
    label: Option<RegimeKind>,
}

impl RegimeSwitch {
    /// The label for a reading: contact as soon as the onset is reached, free only when it is undercut by
    /// `hysteresis_mpa`. Without memory (a fresh switch) it is the physics' own regime.
    pub fn label(&mut self, onset: Onset, pressure_mpa: f64, hysteresis_mpa: f64) -> RegimeKind {
        let physics = onset.regime(pressure_mpa);
        let held = self.label == Some(RegimeKind::Contact)
            && physics == RegimeKind::Free
            && matches!(onset, Onset::At(p) if pressure_mpa > p - hysteresis_mpa);
        let label = if held { RegimeKind::Contact } else { physics };
        self.label = Some(label);
        label
    }
}
