//! Starts of the cases, from the list alone: the nearest earlier cases in the scaled inputs.
//!
//! The problem is conservative and frictionless, so the result does not depend on the path, and the shortest is the cheapest.
//! Order and number of threads change no start and therefore no byte. Rows appended within the ranges of a list do not change
//! the earlier states, and the first rows of a list need no later ones.

use crate::cases::Case;
use rom::statistics::range;

/// Distance of a case with an obstacle from one without: the approach takes about as many steps as the whole training range.
const TOUCHING: f64 = 1.0;
/// Distance of a case from one of another body (other parameters): every node moves, and the other body's state is not an
/// equilibrium of this one.
const OTHER_BODY: f64 = 1.0;
/// Starts tried for a case, one after the other.
const STARTS: usize = 3;

/// Start of a case: another case, or the nominal actuator under gravity alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Start {
    /// Index in the list.
    Case(usize),
    /// Gravity alone.
    Rest,
}

/// Starts of every case, the nearest first; never empty.
pub(super) fn starts(cases: &[Case], nominal: &[f64]) -> Vec<Vec<Start>> {
    let scale = Scale::of(cases, nominal);
    let rest = scale.scaled(0.0, None, nominal);
    let places: Vec<ScaledCase> = cases
        .iter()
        .map(|case| {
            let values: Vec<f64> = case.settings.iter().map(|(_, value)| *value).collect();
            scale.scaled(scale.driven(case), case.gap_mm, &values)
        })
        .collect();
    let starts = |i: usize| -> Vec<Start> {
        let before = places[..i].iter().enumerate().map(|(j, place)| (Start::Case(j), place));
        let all = std::iter::once((Start::Rest, &rest)).chain(before);
        let distances = all.map(|(start, place)| (scale.distance(place, &places[i]), start));
        let mut nearest: Vec<(f64, Start)> = distances.filter(|(d, _)| d.is_finite()).collect();
        // Stable sort: of equal distances, the first in the list.
        nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
        nearest.into_iter().take(STARTS).map(|(_, start)| start).collect()
    };
    (0..cases.len()).map(starts).collect()
}

/// A case in scaled inputs.
struct ScaledCase {
    /// Pressure or injected volume.
    driven: f64,
    gap: Option<f64>,
    parameters: Vec<f64>,
}

/// Units of distance: the list's own extents. The pressures of soft and stiff actuators differ by a factor of a hundred, and with a
/// fixed unit every contact state of a soft one would start from the nearest gap, whatever its pressure.
struct Scale {
    /// Extent of each parameter over the list.
    extents: Vec<f64>,
    /// The largest pressure of the list (MPa), gap (mm) and injected volume (mm3); the smallest positive number without one.
    largest_mpa: f64,
    largest_gap_mm: f64,
    largest_mm3: f64,
}

impl Scale {
    fn of(cases: &[Case], nominal: &[f64]) -> Self {
        let extent = |k: usize| {
            let extent = range(cases.iter().map(|case| case.settings[k].1).chain([nominal[k]]));
            if extent > 0.0 { extent } else { 1.0 }
        };
        let largest = |value: &dyn Fn(&Case) -> Option<f64>| {
            cases.iter().filter_map(value).map(f64::abs).fold(f64::MIN_POSITIVE, f64::max)
        };
        Self {
            extents: (0..nominal.len()).map(extent).collect(),
            largest_mpa: largest(&|case| Some(case.pressure_mpa)),
            largest_gap_mm: largest(&|case| case.gap_mm),
            largest_mm3: largest(&|case| case.volume_mm3),
        }
    }

    /// Scaled pressure or injected volume.
    fn driven(&self, case: &Case) -> f64 {
        case.volume_mm3.map_or(case.pressure_mpa / self.largest_mpa, |volume| volume / self.largest_mm3)
    }

    fn scaled(&self, driven: f64, gap_mm: Option<f64>, values: &[f64]) -> ScaledCase {
        ScaledCase {
            driven,
            gap: gap_mm.map(|gap| gap / self.largest_gap_mm),
            parameters: values.iter().zip(&self.extents).map(|(value, extent)| value / extent).collect(),
        }
    }

    /// Distance of a start from a case; infinite if the start is not to be tried.
    fn distance(&self, from: &ScaledCase, to: &ScaledCase) -> f64 {
        let (gap, touching) = match (from.gap, to.gap) {
            (None, None) => (0.0, 0.0),
            // The obstacle would have to be withdrawn; the state under gravity alone is the better start.
            (Some(_), None) => return f64::INFINITY,
            // The obstacle approaches from where it just clears the free state.
            (None, Some(gap)) => (1.0 - gap, TOUCHING),
            (Some(from), Some(to)) => (from - to, 0.0),
        };
        let parameters: f64 = from.parameters.iter().zip(&to.parameters).map(|(a, b)| (a - b).powi(2)).sum();
        let other = if parameters > 0.0 { OTHER_BODY } else { 0.0 };
        let squares = (from.driven - to.driven).powi(2) + gap.powi(2) + parameters;
        squares.sqrt() + touching + other
    }
}

#[cfg(test)]
#[path = "../../tests/unit/schedule.rs"]
mod tests;
