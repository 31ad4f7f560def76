//! Whether a predicted shape can be one of the body at all.
//!
//! Far outside the training range an interpolant gives any number, also a finger of some kilometres. Some edges of the surface, spread over
//! the body, are followed through the modes: a state in which more than one in sixteen are longer than the elastomer stretches is no state of
//! the body. A body whose edges are not overstretched also keeps its reach. Chambers whose volumes are observables hold no less than nothing,
//! and no more than a sphere with the area of their stretched walls. Inside the training range nothing is checked, for all shapes there lie
//! among those of states.

use crate::affine::Affine;
use crate::evaluation::Evaluation;
use crate::snapshots::RegimeKind;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Largest stretch of a body whose elastomers' limits are not in the model. Soft silicones break between 3 and 10; actuators of them work
/// below 3.
pub(crate) const MAX_STRETCH: f64 = 4.0;
/// One edge in so many may be longer: single elements at corners are.
const ONE_IN: usize = 16;

/// Bounds that a predicted shape has to keep: lengths of edges, stretch, volumes.
#[derive(Clone, Debug, PartialEq)]
pub struct ShapeLimits {
    pub(crate) regimes: Vec<RegimeShapes>,
    /// Largest possible length of each edge, mm.
    pub(crate) longest_mm: Vec<f64>,
    /// Largest possible stretch.
    pub(crate) stretch: f64,
}

/// Shapes of one regime as functions of its coefficients.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RegimeShapes {
    pub(crate) kind: RegimeKind,
    /// Vector along each edge.
    pub(crate) edges: Vec<[Affine; 3]>,
    pub(crate) volumes: Vec<VolumeForm>,
}

impl ShapeLimits {
    fn regime(&self, kind: RegimeKind) -> Option<&RegimeShapes> {
        self.regimes.iter().find(|regime| regime.kind == kind)
    }

    /// Whether the shape depends on some of these coefficients.
    pub(crate) fn depends_on(&self, kind: RegimeKind, coefficients: &Range<usize>) -> bool {
        let edge = self.regime(kind).and_then(|regime| regime.edges.first());
        edge.is_some_and(|rows| rows.iter().any(|row| coefficients.contains(&row.first)))
    }

    /// False if the shape of an evaluation with coefficients cannot be one of the body. Allocates nothing.
    pub(crate) fn is_possible(&self, evaluation: &Evaluation) -> bool {
        let coefficients = &evaluation.coefficients;
        let Some(regime) = self.regime(evaluation.regime).filter(|_| !coefficients.is_empty()) else {
            return true;
        };
        let is_longer = |(rows, longest_mm): &(&[Affine; 3], &f64)| {
            let square: f64 = rows.iter().map(|row| row.value(coefficients).powi(2)).sum();
            square.sqrt() > **longest_mm
        };
        let longer = regime.edges.iter().zip(&self.longest_mm).filter(is_longer).count();
        let holds = |form: &VolumeForm| {
            let area_mm2 = self.stretch * self.stretch * form.area_mm2;
            let sphere_mm3 = area_mm2.powf(1.5) / (6.0 * std::f64::consts::PI.sqrt());
            (0.0..=sphere_mm3).contains(&form.value(coefficients, None))
        };
        longer * ONE_IN <= regime.edges.len() && regime.volumes.iter().all(holds)
    }
}

/// The volume of a chamber in a regime as a function of the coefficients: `sum t_ijk a_i b_j c_k` (`observable/volume.rs`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct VolumeForm {
    /// First coefficient and number of coefficients of x, y, z.
    pub(crate) axes: [(usize, usize); 3],
    /// `t_ijk`, `k` running fastest. Models and the equations in Python have them by this name.
    pub(crate) numbers: Vec<f64>,
    /// Area of the undeformed walls, mm2.
    pub(crate) area_mm2: f64,
}

impl VolumeForm {
    /// True if it fits a regime of `count` coefficients.
    pub(crate) fn fits(&self, count: usize) -> bool {
        let inside = self.axes.iter().all(|(first, own)| first.saturating_add(*own) <= count);
        let expected: usize = self.axes.iter().map(|(_, own)| own.saturating_add(1)).product();
        inside && self.numbers.len() == expected && self.numbers.iter().all(|v| v.is_finite())
    }

    /// The volume; with `change`, its derivative along that change of the coefficients. Allocates nothing.
    pub(crate) fn value(&self, coefficients: &[f64], change: Option<&[f64]>) -> f64 {
        let [x, y, z] = self.axes;
        let factor = |values: &[f64], (first, _): (usize, usize), i: usize, lead: f64| {
            i.checked_sub(1).map_or(lead, |i| values[first + i])
        };
        let (mut sum, mut rest) = (0.0, self.numbers.as_slice());
        for i in 0..=x.1 {
            for j in 0..=y.1 {
                let Some((row, behind)) = rest.split_at_checked(z.1 + 1) else { return f64::NAN };
                rest = behind;
                let along = |values: &[f64], lead: f64| -> f64 {
                    row[0] * lead + row[1..].iter().zip(&values[z.0..]).map(|(t, c)| t * c).sum::<f64>()
                };
                let (a, b) = (factor(coefficients, x, i, 1.0), factor(coefficients, y, j, 1.0));
                sum += match change {
                    None => a * b * along(coefficients, 1.0),
                    Some(change) => {
                        let inner = along(coefficients, 1.0);
                        factor(change, x, i, 0.0) * b * inner
                            + a * factor(change, y, j, 0.0) * inner
                            + a * b * along(change, 0.0)
                    }
                };
            }
        }
        sum
    }
}
