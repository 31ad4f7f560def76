//! Solved state, the start of a continuation and the source of the output; and the stretches that it reaches, against the range over which
//! the law of its elastomer was fitted.

use crate::algebra::{Vec3, det_inv_transpose, dot, norm};
use crate::config::Load;
use crate::element::membrane::Plane;
use crate::material::{bar_invariant, bar_stretch};
use crate::problem::Problem;

/// Displacements with the stress unknowns of the mixed formulation; valid for one problem.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// Nodal displacements (mm).
    pub displacement_mm: Vec<Vec3>,
    /// Pressure unknown of each tetrahedron (MPa, tension positive).
    pub element_pressure_mpa: Vec<f64>,
    /// Membrane resultants of each sheet triangle's three Gauss points (11, 22, 12; N/mm).
    pub sheet_resultants_n_per_mm: Vec<[Plane; 3]>,
    /// The loads this state is in equilibrium with.
    pub load: Load,
}

impl State {
    /// Largest displacement of a node (mm).
    pub fn largest_displacement_mm(&self) -> f64 {
        self.displacement_mm.iter().map(|u| norm(*u)).fold(0.0, f64::max)
    }
}

/// Stretches of a state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretches {
    /// Stretch of a bar with the largest first invariant of the elastomer.
    pub largest: f64,
    /// Fraction of the elastomer's volume beyond the range of its law; 0 without a range.
    pub beyond: f64,
}

/// Fraction of the elastomer's volume that may be beyond the range of its law: re-entrant corners are.
const MAX_BEYOND: f64 = 0.01;

impl Stretches {
    /// True if more of the elastomer than re-entrant corners is stretched beyond the range of its law.
    pub fn is_beyond(&self) -> bool {
        self.beyond > MAX_BEYOND
    }
}

impl Problem {
    /// A line about a state that reaches beyond the range of its law; `None` within it.
    pub fn stretch_warning(&self, stretches: Stretches) -> Option<String> {
        let ranges = self.config().elastomers.iter().filter_map(|elastomer| elastomer.stretch_range);
        let ranges: Vec<String> = ranges.map(|[low, high]| format!("{low} to {high}")).collect();
        stretches.is_beyond().then(|| {
            format!(
                "{:.0} % of the elastomer is stretched beyond the range of its law ({}), up to {:.2}: its stress there is extrapolated",
                100.0 * stretches.beyond,
                ranges.join("; "),
                stretches.largest
            )
        })
    }

    /// Stretches of a state at the Gauss points.
    pub fn stretches(&self, state: &State) -> Stretches {
        let (mut largest, mut beyond, mut volume) = (3.0_f64, 0.0, 0.0);
        for (e, (tet, geometry)) in self.mesh().tets.iter().zip(&self.tets).enumerate() {
            let u = tet.map(|n| state.displacement_mm[n as usize]);
            let range = self.elastomer(e).stretch_range;
            let limit =
                range.map_or(f64::INFINITY, |[low, high]| bar_invariant(low).max(bar_invariant(high)));
            for (q, weight) in geometry.weights.iter().enumerate() {
                let f = geometry.deformation_gradient(q, &u);
                let det = det_inv_transpose(&f).0;
                let i1 = f.iter().map(|row| dot(*row, *row)).sum::<f64>() / det.cbrt().powi(2);
                largest = largest.max(i1);
                volume += weight;
                beyond += if i1 > limit { *weight } else { 0.0 };
            }
        }
        Stretches { largest: bar_stretch(largest), beyond: beyond / volume }
    }
}
