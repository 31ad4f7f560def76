//! What `mesh`, `mesh --step` and `import` say of a body before anything is solved: its measures, and what can hardly be meant.

use super::measures::Measures;
use formats::cells::Block;
use serde::Serialize;

/// Soft actuators are between these sizes (mm); one outside of them is mostly a file in another unit.
const SIZES_MM: [f64; 2] = [0.5, 5.0e3];
/// Difference between the volumes of a mesh and of its CAD file from which flat facets are too coarse.
const FACET_ERROR: f64 = 0.01;
/// Initial shear moduli of silicones and rubbers reach from some kPa to this (MPa).
const STIFFEST_RUBBER_MPA: f64 = 5.0;
/// Processor time of a state of the reference actuator (s) at its number of nodes, and how it grows with them (docs/fem.md).
const STATE: (f64, f64, f64) = (9.0, 25_022.0, 1.5);

/// A body, and remarks on it.
#[derive(Debug, Serialize)]
pub struct BodyReport {
    #[serde(flatten)]
    measures: Measures,
    remarks: Vec<String>,
    /// Expected processor time of a state (s), of a body that this program solves.
    state_s: Option<f64>,
}

impl BodyReport {
    /// Measures a body of any cells.
    pub fn of(points_mm: &[[f64; 3]], blocks: &[Block]) -> Self {
        let measures = Measures::of(points_mm, blocks);
        let mut remarks = Vec::new();
        let largest_mm = measures.extent_mm().into_iter().fold(0.0, f64::max);
        if !(SIZES_MM[0]..=SIZES_MM[1]).contains(&largest_mm) {
            let hint =
                if largest_mm < SIZES_MM[0] { "metres" } else { "micrometres, or mm taken for metres" };
            remarks.push(format!(
                "the body is {} mm long: are its lengths in mm? They look like {hint}",
                four_digits(largest_mm)
            ));
        }
        Self { measures, remarks, state_s: None }
    }

    /// The same of 10-node tetrahedra, which this program solves.
    pub fn of_tets(points_mm: &[[f64; 3]], tets: &[[u32; 10]]) -> Self {
        let block = Block { kind: 24, nodes_per_cell: 10, nodes: tets.as_flattened().to_vec() };
        let (seconds, nodes, power) = STATE;
        let state_s = seconds * (points_mm.len() as f64 / nodes).powf(power);
        Self { state_s: Some(state_s), ..Self::of(points_mm, &[block]) }
    }

    /// Compares with the volume of the CAD file (mm3).
    pub fn compare(&mut self, cad_mm3: Option<f64>) {
        let (Some(cad), Some(own)) = (cad_mm3, self.measures.volume_mm3) else { return };
        let off = own / cad - 1.0;
        if off.abs() > FACET_ERROR {
            self.remarks.push(format!(
                "flat facets change the volume by {:.1} % ({} instead of {} mm3): give a smaller --size-mm",
                100.0 * off,
                four_digits(own),
                four_digits(cad)
            ));
        }
    }

    /// Says that a body without a closed hollow takes no pressure.
    pub fn want_hollow(&mut self) {
        if self.measures.hollows.is_empty() {
            self.remarks.push(
                "no hollow is closed: one that opens to the outside takes no pressure; close its mouth with a thin plug or skin"
                    .into(),
            );
        }
    }

    /// Says that an elastomer is stiffer than any.
    pub fn check_rubber(&mut self, shear_modulus_mpa: f64) {
        if shear_modulus_mpa > STIFFEST_RUBBER_MPA {
            self.remarks.push(format!(
                "the elastomer's shear modulus is {} MPa; rubber has up to {STIFFEST_RUBBER_MPA} MPa, silicone 0.01 to 1 MPa: are its \
                 constants in MPa?",
                four_digits(shear_modulus_mpa)
            ));
        }
    }

    /// Adds a remark.
    pub fn remark(&mut self, text: String) {
        self.remarks.push(text);
    }

    /// Largest extent (mm).
    pub fn largest_mm(&self) -> f64 {
        self.measures.extent_mm().into_iter().fold(0.0, f64::max)
    }
}

/// Three significant digits, for numbers that people read.
pub(crate) fn three_digits(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

/// A number with four digits.
pub fn four_digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let digits = 10.0_f64.powi(3 - value.abs().log10().floor() as i32);
    format!("{}", (value * digits).round() / digits)
}
