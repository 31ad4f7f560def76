//! The same in the plainest way: the oracle of the tests and the definition of what the kernel computes.

use rom::kernel::{Affine, Field, FieldSource, Role, Spec};

/// All published fields, field-major, in f64, straight from the equations; with each value the sum of the magnitudes
/// of its terms, from which the bound of any order of summation in f32 follows.
///
/// # Panics
/// If the spec's slices do not fit each other (`Basis::build` says which) or `coefficients`
/// is too short.
pub fn reconstruct(spec: &Spec<'_>, coefficients: &[f64]) -> Vec<Reference> {
    let mut out = Vec::new();
    for (index, field) in spec.fields.iter().enumerate().filter(|(_, field)| field.published) {
        for i in 0..spec.output_nodes() {
            let node = spec.source_node(i);
            let value = match &field.source {
                FieldSource::Affine(affine) => {
                    let sum = combine(affine, coefficients, node);
                    Reference { terms: sum.terms + 2.0 * rest_of(spec, index, node), ..sum }
                }
                FieldSource::Magnitude { coordinates, rest, shifts } => {
                    let mut squares = Reference { value: 0.0, terms: 0.0 };
                    for (axis, (&coordinate, rest)) in coordinates.iter().zip(rest).enumerate() {
                        let FieldSource::Affine(affine) = &spec.fields[coordinate].source else { continue };
                        let x = combine(affine, coefficients, node);
                        let moves = shifts.iter().filter_map(|shift| {
                            shift.axes[axis].map(|by| f64::from(by[node]) * coefficients[shift.coefficient])
                        });
                        let (moved, terms) = moves.fold((0.0, 0.0), |(m, t), by| (m + by, t + by.abs()));
                        let rest = f64::from(rest[node]);
                        squares.value += (x.value - rest - moved).powi(2);
                        squares.terms += (x.terms + rest.abs() + terms).powi(2);
                    }
                    Reference { value: squares.value.sqrt(), terms: squares.terms.sqrt() }
                }
            };
            let value = match field.role {
                Role::Plain => value,
                Role::Displacement | Role::Stress => Reference { value: value.value.max(0.0), ..value },
            };
            out.push(value);
        }
    }
    out
}

/// A value and the sum of the magnitudes it was added up from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    /// The value in the unit of its field.
    pub value: f64,
    /// `|mean| + sum_j |phi_j a_j|` (for a magnitude: the length of that vector, rest shape included; for a coordinate
    /// whose displacement is published: with the rest shape twice, which is taken off and added again).
    pub terms: f64,
}

/// Magnitude of the undeformed coordinate that a published magnitude measures field `index` against, or 0.
fn rest_of(spec: &Spec<'_>, index: usize, node: usize) -> f64 {
    let of_magnitude = |field: &Field<'_>| match &field.source {
        FieldSource::Magnitude { coordinates, rest, .. } if field.published => {
            let axis = coordinates.iter().position(|&coordinate| coordinate == index)?;
            Some(f64::from(rest[axis][node]).abs())
        }
        _ => None,
    };
    spec.fields.iter().find_map(of_magnitude).unwrap_or(0.0)
}

fn combine(affine: &Affine<'_>, coefficients: &[f64], node: usize) -> Reference {
    let mean = affine.mean.map_or(0.0, |mean| f64::from(mean[node]));
    let mut sum = Reference { value: mean, terms: mean.abs() };
    for (j, &a) in coefficients[affine.coefficients.clone()].iter().enumerate() {
        let term = affine.modes.value(j, node) * a;
        sum.value += term;
        sum.terms += term.abs();
    }
    sum
}
