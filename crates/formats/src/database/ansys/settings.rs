//! `settings.json`: what a folder's numbers are.

use crate::error::{Diagnostic, FormatError};
use crate::file;
use serde::Deserialize;
use std::path::Path;

/// The keys that matter here; the file has more, which belong to the program that wrote it.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Written {
    name: String,
    unit: String,
    dimensionality: Vec<usize>,
    #[serde(default)]
    symmetrical_dim: bool,
    #[serde(default)]
    deformation: bool,
    #[serde(default)]
    unit_factor: Option<f64>,
}

/// What a folder's numbers are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Quantity {
    /// A displacement vector.
    Deformation,
    /// Von Mises stress.
    Scalar,
    /// XX, YY, ZZ, XY, YZ, XZ.
    Symmetric,
}

/// The checked settings of a folder.
pub(crate) struct Settings {
    /// Name of the quantity.
    pub(crate) name: String,
    /// What it is.
    pub(crate) quantity: Quantity,
    /// To mm or MPa.
    pub(crate) factor: f64,
}

impl Settings {
    /// Reads and checks the file; all diagnostics at once.
    pub(crate) fn read(path: &Path) -> Result<Self, FormatError> {
        let text = file::read_text(path, file::MAX_TEXT_BYTES)?;
        let written: Written = serde_json::from_str(&text).map_err(|error| {
            let expected = "an object with name, unit and dimensionality";
            FormatError::one(path, Diagnostic::new("content", expected, error))
        })?;
        let mut diagnostics = Vec::new();
        let quantity = written.quantity();
        if quantity.is_none() {
            let expected = "a deformation ([3]), a stress ([1]) or a symmetric stress ([3, 3])";
            let found = format!("`{}` of {:?}", written.name, written.dimensionality);
            diagnostics.push(Diagnostic::new("dimensionality", expected, found));
        }
        let factor = factor(quantity.unwrap_or(Quantity::Deformation), &written.unit);
        if let (Some(_), None) = (quantity, factor) {
            let expected = "m, cm, mm or in for a deformation; Pa, kPa, MPa, GPa or psi for a stress";
            diagnostics.push(Diagnostic::new("unit", expected, format!("`{}`", written.unit)));
        }
        if let Some(other) = written.unit_factor.filter(|factor| *factor != 1.0) {
            diagnostics.push(Diagnostic::new("unitFactor", "1 (numbers in the unit that is named)", other));
        }
        let (quantity, factor) = (quantity.unwrap_or(Quantity::Deformation), factor.unwrap_or(1.0));
        FormatError::check(Self { name: written.name, quantity, factor }, path, diagnostics)
    }
}

impl Written {
    fn quantity(&self) -> Option<Quantity> {
        match (self.dimensionality.as_slice(), self.deformation, self.symmetrical_dim) {
            ([3], true, _) => Some(Quantity::Deformation),
            ([1], false, _) => Some(Quantity::Scalar),
            ([3, 3], false, true) => Some(Quantity::Symmetric),
            _ => None,
        }
    }
}

impl Quantity {
    /// Numbers a node.
    pub(crate) fn components(self) -> usize {
        match self {
            Self::Deformation => 3,
            Self::Scalar => 1,
            Self::Symmetric => 6,
        }
    }

    /// Von Mises stress at a node: `sqrt(((xx-yy)^2 + (yy-zz)^2 + (zz-xx)^2) / 2 + 3 (xy^2 + yz^2 + xz^2))`.
    pub(crate) fn von_mises(self, values: &[f64], node: usize) -> f64 {
        let s = &values[node * self.components()..(node + 1) * self.components()];
        match s {
            [xx, yy, zz, xy, yz, xz] => {
                let differences = (xx - yy).powi(2) + (yy - zz).powi(2) + (zz - xx).powi(2);
                (0.5 * differences + 3.0 * (xy * xy + yz * yz + xz * xz)).sqrt()
            }
            _ => s[0],
        }
    }
}

fn factor(quantity: Quantity, unit: &str) -> Option<f64> {
    if quantity == Quantity::Deformation { length_factor(unit) } else { pressure_factor(unit) }
}

/// From a unit of length to mm.
pub(crate) fn length_factor(unit: &str) -> Option<f64> {
    find(&[("m", 1e3), ("cm", 10.0), ("mm", 1.0), ("in", 25.4)], unit)
}

/// From a unit of pressure to MPa.
pub(crate) fn pressure_factor(unit: &str) -> Option<f64> {
    let psi = ("psi", 6.894_757_293_168e-3);
    find(&[("Pa", 1e-6), ("kPa", 1e-3), ("bar", 0.1), ("MPa", 1.0), ("GPa", 1e3), psi], unit)
}

fn find(units: &[(&str, f64)], unit: &str) -> Option<f64> {
    units.iter().find(|(name, _)| *name == unit).map(|(_, factor)| *factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn von_mises_of_tension_shear_and_pressure() {
        let of = |s: [f64; 6]| Quantity::Symmetric.von_mises(&s, 0);
        assert_eq!(of([2.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 2.0);
        assert_eq!(of([5.0, 5.0, 5.0, 0.0, 0.0, 0.0]), 0.0);
        assert!((of([0.0, 0.0, 0.0, 0.0, 1.0, 0.0]) - 3.0_f64.sqrt()).abs() < 1e-15);
    }
}
