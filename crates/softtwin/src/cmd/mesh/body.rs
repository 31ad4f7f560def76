//! What `mesh`, `mesh --step` and `import` say of a body before anything is solved: its measures, and what can hardly be meant.

use crate::output;
use fem::Measures;
use formats::cells::Block;
use serde_json::{Value, json};

/// Soft actuators are between these sizes (mm); one outside of them is mostly a file in another unit.
const SIZES_MM: [f64; 2] = [0.5, 5.0e3];
/// Difference between the volumes of a mesh and of its CAD file from which flat facets are too coarse.
const FACET_ERROR: f64 = 0.01;
/// Initial shear moduli of silicones and rubbers reach from some kPa to this (MPa).
const STIFFEST_RUBBER_MPA: f64 = 5.0;
/// Processor time of a state of the reference actuator (s) at its number of nodes, and how it grows with them (docs/fem.md).
const STATE: (f64, f64, f64) = (9.0, 25_022.0, 1.5);

/// A body, and remarks on it.
pub struct BodyReport {
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
                rounded(largest_mm)
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
                rounded(own),
                rounded(cad)
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
                rounded(shear_modulus_mpa)
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

    /// Prints measures and remarks.
    pub fn print(&self) -> anyhow::Result<()> {
        let Measures { low_mm, high_mm, volume_mm3, hollows, thinnest_wall } = &self.measures;
        let axis = |k: usize| format!("{} to {}", rounded(low_mm[k]), rounded(high_mm[k]));
        output!("extent     x {}, y {}, z {} mm", axis(0), axis(1), axis(2))?;
        match (volume_mm3, thinnest_wall) {
            (Some(volume), Some(wall)) => output!(
                "volume     {} mm3; thinnest wall {} mm at {}",
                rounded(*volume),
                rounded(wall.thickness_mm),
                place(wall.at_mm)
            )?,
            (Some(volume), None) => output!("volume     {} mm3", rounded(*volume))?,
            _ => output!("volume     none: the surface is not closed")?,
        }
        for (k, hollow) in hollows.iter().enumerate() {
            output!(
                "hollow {:<3} {} mm3, centre {}, {} facets",
                k + 1,
                rounded(hollow.volume_mm3),
                place(hollow.centre_mm),
                hollow.facets
            )?;
        }
        if let Some(state_s) = self.state_s {
            output!("a state takes about {} s of processor time", rounded(state_s))?;
        }
        self.remarks.iter().try_for_each(|remark| Ok(output!("note: {remark}")?))
    }

    /// The same as JSON.
    pub fn json(&self) -> Value {
        let mut value = json!(self.measures);
        value["remarks"] = json!(self.remarks);
        value["state_s"] = json!(self.state_s);
        value
    }
}

/// A number with four digits.
pub fn rounded(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let digits = 10.0_f64.powi(3 - value.abs().log10().floor() as i32);
    format!("{}", (value * digits).round() / digits)
}

/// `(12, 1.5, 4) mm`.
pub fn place(at_mm: [f64; 3]) -> String {
    // A coordinate that is 0 but for rounding is 0.
    let [x, y, z] = at_mm.map(|v| rounded((v * 1.0e6).round() / 1.0e6));
    format!("({x}, {y}, {z}) mm")
}
