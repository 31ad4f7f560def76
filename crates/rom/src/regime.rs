//! Regime of a state: the onset pressure over the gap.
//!
//! Contact when `P >= P_c(gap)`. A gap below the sag is touched at any pressure (`P_c = 0`), a gap beyond reach at none.

use crate::inputs::{GAP, Inputs, MAX_INPUTS};
use crate::snapshots::RegimeKind;
use serde::{Deserialize, Serialize};

/// Onset pressure over gap, derived from the free model: where its lowest surface node reaches the obstacle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OnsetTable {
    /// Gaps in mm, strictly increasing: from the sag to the reach.
    pub gap_mm: Vec<f64>,
    /// Onset pressures in MPa, strictly increasing, the first one 0.
    pub pressure_mpa: Vec<f64>,
    /// dP_c/dgap in MPa/mm at the entries.
    pub slope: Vec<f64>,
    /// Relative growth of the slope at the sag, per mm: it continues the table below the sag.
    pub bend_per_mm: f64,
}

/// Fraction of the table's gaps from which the bend at the sag is fitted.
const BEND_FRACTION: f64 = 0.2;

/// Onset of contact for one gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Onset {
    /// At any pressure, by gravity: the gap is at or below the sag.
    Always,
    /// At this pressure in MPa.
    At(f64),
    /// Not within the free model's pressures.
    Never,
}

impl Onset {
    /// Onset pressure in MPa: 0 for [`Self::Always`], `None` for [`Self::Never`].
    pub fn pressure_mpa(self) -> Option<f64> {
        match self {
            Self::Always => Some(0.0),
            Self::At(pressure) => Some(pressure),
            Self::Never => None,
        }
    }

    /// The regime at a pressure.
    pub fn regime(self, pressure_mpa: f64) -> RegimeKind {
        match self {
            Self::Always => RegimeKind::Contact,
            Self::At(onset) if pressure_mpa >= onset => RegimeKind::Contact,
            Self::At(_) | Self::Never => RegimeKind::Free,
        }
    }
}

/// The onset at one state, with the pressure continued beyond sag and reach: the force is a multiple of its distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnsetAt {
    /// Pressure, or that there is none.
    pub onset: Onset,
    /// `P_c` in MPa: negative below the sag, above the largest training pressure beyond the reach.
    pub pressure_mpa: f64,
    /// Its derivative with respect to each input, MPa per unit of the input.
    pub gradient: [f64; MAX_INPUTS],
}

impl OnsetAt {
    /// No onset was found: the regime is free, and the distance to its training range is infinite.
    pub(crate) const UNKNOWN: Self =
        Self { onset: Onset::Never, pressure_mpa: f64::NAN, gradient: [0.0; MAX_INPUTS] };
    /// Nothing is there to touch.
    pub(crate) const NEVER: Self =
        Self { onset: Onset::Never, pressure_mpa: f64::INFINITY, gradient: [0.0; MAX_INPUTS] };
}

/// The onset found last, where a search at a state near it begins ([`crate::evaluator::Query::near`]).
#[derive(Clone, Debug, Default)]
pub struct LastOnset(pub(crate) Option<(Inputs, OnsetAt)>);

impl LastOnset {
    /// Onset pressure at another state along the tangent, MPa; `None` without a last onset.
    pub(crate) fn continued_mpa(&self, inputs: &Inputs) -> Option<f64> {
        let (from, found) = self.0.as_ref().filter(|(_, found)| matches!(found.onset, Onset::At(_)))?;
        let ways = inputs.values().iter().zip(from.values()).zip(found.gradient);
        // Inputs that the model does not have are NaN; their derivative is 0.
        let along = ways.filter(|(_, by)| *by != 0.0).map(|((to, from), by)| (to - from) * by);
        Some(found.pressure_mpa + along.sum::<f64>())
    }

    /// Gap that a state's pressure closes minus its gap (mm), along the onset's tangent; `None` without a last onset. The error is the
    /// onset's curvature over that distance.
    pub fn inside_mm(&self, inputs: &Inputs) -> Option<f64> {
        let (_, found) = self.0.as_ref()?;
        Some((inputs.pressure_mpa() - self.continued_mpa(inputs)?) / found.gradient[GAP])
    }
}

impl OnsetTable {
    /// Onset, continued pressure and slope at a gap.
    pub fn at(&self, gap_mm: f64) -> OnsetAt {
        let (pressure_mpa, slope) = self.pressure_and_slope(gap_mm);
        let mut gradient = [0.0; MAX_INPUTS];
        gradient[GAP] = slope;
        OnsetAt { onset: self.onset(gap_mm), pressure_mpa, gradient }
    }

    /// Gap at which gravity alone touches, in mm.
    pub fn sag_mm(&self) -> f64 {
        self.gap_mm[0]
    }

    /// Largest gap the free model's pressures can close, in mm.
    pub fn reach_mm(&self) -> f64 {
        self.gap_mm[self.gap_mm.len() - 1]
    }

    /// Builds the table from increasing gaps and pressures; slopes by the monotone (Fritsch-Carlson) rule.
    pub fn new(gap_mm: Vec<f64>, pressure_mpa: Vec<f64>) -> Self {
        let slope = monotone_slopes(&gap_mm, &pressure_mpa);
        let bend_per_mm = bend(&gap_mm, &pressure_mpa);
        Self { gap_mm, pressure_mpa, slope, bend_per_mm }
    }

    /// Onset of a gap. `O(log entries)`.
    pub fn onset(&self, gap_mm: f64) -> Onset {
        if gap_mm <= self.sag_mm() {
            return Onset::Always;
        }
        if gap_mm > self.reach_mm() || gap_mm.is_nan() {
            return Onset::Never;
        }
        Onset::At(self.pressure_and_slope(gap_mm).0)
    }

    /// The largest gap that a pressure closes, mm: the inverse of `P_c(gap)`, at least the sag and at most the reach. The
    /// onset pressure of the gap returned is at most `pressure_mpa`, that of the next larger number is above it.
    pub fn closed_gap_mm(&self, pressure_mpa: f64) -> f64 {
        let above = self.pressure_mpa.partition_point(|p| *p <= pressure_mpa);
        if above == 0 || above == self.gap_mm.len() {
            return if above == 0 { self.sag_mm() } else { self.reach_mm() };
        }
        let (mut closed, mut open) = (self.gap_mm[above - 1], self.gap_mm[above]);
        loop {
            let middle = 0.5 * (closed + open);
            if middle <= closed || middle >= open {
                return closed;
            }
            if self.pressure_and_slope(middle).0 <= pressure_mpa { closed = middle } else { open = middle }
        }
    }

    /// `P_c(gap)` in MPa and its slope in MPa/mm: monotone cubic within the table, straight beyond the reach. Below the
    /// sag it is negative: how far the pressure would have to fall for the actuator to lift off. There it continues with the
    /// table's slope and bend, `slope (e^(bend x) - 1) / bend`: a kink in P_c would be one in the factor of the force.
    pub fn pressure_and_slope(&self, gap_mm: f64) -> (f64, f64) {
        let last = self.gap_mm.len() - 1;
        if gap_mm <= self.gap_mm[0] {
            let x = self.bend_per_mm * (gap_mm - self.gap_mm[0]);
            let relative = if x == 0.0 { 1.0 } else { x.exp_m1() / x };
            let below = self.slope[0] * (gap_mm - self.gap_mm[0]) * relative;
            return (self.pressure_mpa[0] + below, self.slope[0] * x.exp());
        }
        if gap_mm >= self.gap_mm[last] {
            let slope = self.slope[last];
            return (self.pressure_mpa[last] + slope * (gap_mm - self.gap_mm[last]), slope);
        }
        let i = self.gap_mm.partition_point(|g| *g <= gap_mm).saturating_sub(1); // 0 for NaN
        let h = self.gap_mm[i + 1] - self.gap_mm[i];
        let t = (gap_mm - self.gap_mm[i]) / h;
        let (p0, p1) = (self.pressure_mpa[i], self.pressure_mpa[i + 1]);
        let (m0, m1) = (self.slope[i] * h, self.slope[i + 1] * h);
        let (a, b) = (2.0 * (p0 - p1) + m0 + m1, -3.0 * (p0 - p1) - 2.0 * m0 - m1);
        (((a * t + b) * t + m0) * t + p0, ((3.0 * a * t + 2.0 * b) * t + m0) / h)
    }
}

/// d ln(slope) / dgap at the low end, a least-squares line through the logarithms of the secants there. Never negative:
/// a slope that grew towards lower gaps would run away below the sag.
fn bend(x: &[f64], y: &[f64]) -> f64 {
    let limit = x[0] + BEND_FRACTION * (x[x.len() - 1] - x[0]);
    let secant = |i: usize| ((y[i + 1] - y[i]) / (x[i + 1] - x[i])).ln();
    let points: Vec<(f64, f64)> = (0..x.len() - 1)
        .filter(|&i| x[i + 1] <= limit)
        .map(|i| (0.5 * (x[i] + x[i + 1]), secant(i)))
        .filter(|p| p.1.is_finite())
        .collect();
    let n = points.len() as f64;
    let (mx, my) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let square: f64 = points.iter().map(|p| (p.0 - mx).powi(2)).sum();
    let product: f64 = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    if square > 0.0 { (product / square).max(0.0) } else { 0.0 }
}

/// Slopes that keep a cubic Hermite interpolant monotone: harmonic means of neighbouring secants.
fn monotone_slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let secants: Vec<f64> =
        x.windows(2).zip(y.windows(2)).map(|(x, y)| (y[1] - y[0]) / (x[1] - x[0])).collect();
    let mean = |a: f64, b: f64| if a * b > 0.0 { 2.0 * a * b / (a + b) } else { 0.0 };
    (0..x.len())
        .map(|i| match (i.checked_sub(1).and_then(|j| secants.get(j)), secants.get(i)) {
            (Some(a), Some(b)) => mean(*a, *b),
            (Some(end), None) | (None, Some(end)) => *end,
            (None, None) => 0.0,
        })
        .collect()
}
