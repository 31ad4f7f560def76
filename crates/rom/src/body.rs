//! Whether a predicted shape can be one of the body at all.
//!
//! Far outside the training range an interpolant gives any number, also a finger of some kilometres. Some edges of the surface, spread over
//! the body, are followed through the modes: a state in which more than one in sixteen are longer than the elastomer stretches is no state of
//! the body. A body whose edges are not overstretched also keeps its reach. Chambers whose volumes are observables hold no less than nothing,
//! and no more than a sphere with the area of their stretched walls. Inside the training range nothing is checked, for all shapes there lie
//! among those of states.

use crate::affine::Affine;
use crate::evaluation::Evaluation;
use crate::observable::Form;
use crate::snapshots::RegimeKind;
use std::ops::Range;

/// Largest stretch of a body whose elastomers' limits are not in the model. Soft silicones break between 3 and 10; actuators of them work
/// below 3.
pub(crate) const MAX_STRETCH: f64 = 4.0;
/// One edge in so many may be longer: single elements at corners are.
const ONE_IN: usize = 16;

/// What is followed of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
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
    pub(crate) volumes: Vec<Form>,
}

impl Body {
    fn regime(&self, kind: RegimeKind) -> Option<&RegimeShapes> {
        self.regimes.iter().find(|of| of.kind == kind)
    }

    /// Whether the shape depends on some of these coefficients.
    pub(crate) fn depends_on(&self, kind: RegimeKind, coefficients: &Range<usize>) -> bool {
        let edge = self.regime(kind).and_then(|of| of.edges.first());
        edge.is_some_and(|rows| rows.iter().any(|row| coefficients.contains(&row.first)))
    }

    /// False if the shape of an evaluation with coefficients cannot be one of the body. Allocates nothing.
    pub(crate) fn is_possible(&self, evaluation: &Evaluation) -> bool {
        let coefficients = &evaluation.coefficients;
        let Some(of) = self.regime(evaluation.regime).filter(|_| !coefficients.is_empty()) else {
            return true;
        };
        let is_longer = |(rows, longest_mm): &(&[Affine; 3], &f64)| {
            let square: f64 = rows.iter().map(|row| row.value(coefficients).powi(2)).sum();
            square.sqrt() > **longest_mm
        };
        let longer = of.edges.iter().zip(&self.longest_mm).filter(is_longer).count();
        let holds = |form: &Form| {
            let area_mm2 = self.stretch * self.stretch * form.area_mm2;
            let sphere_mm3 = area_mm2.powf(1.5) / (6.0 * std::f64::consts::PI.sqrt());
            (0.0..=sphere_mm3).contains(&form.value(coefficients, None))
        };
        longer * ONE_IN <= of.edges.len() && of.volumes.iter().all(holds)
    }
}
