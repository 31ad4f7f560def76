//! Initial shear modulus from a data sheet, with the interval that such figures leave.
//!
//! Shore A: `E = 0.0981 (56 + 7.62336 S) / (0.137505 (254 - 2.54 S))` MPa (Gent, Rubber Chem. Technol. 31, 896, 1958), `mu = E / 3`.
//! 100 % modulus: `mu = stress / 1.75`, the neo-Hookean bar at stretch 2. Six silicones with public tension tests (`silicone.rs`) have 0.23 to
//! 0.71 times these values: both relations are those of harder, filled rubber. Shore 00: exponential through the two of them that are sold
//! by that scale.

use super::silicone::SILICONES;

/// Figure of a data sheet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Figure {
    /// Shore A hardness.
    ShoreA(f64),
    /// Shore 00 hardness.
    Shore00(f64),
    /// Nominal stress at 100 % elongation, MPa.
    Modulus100(f64),
}

/// Shear modulus (MPa), and the interval around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Geometric middle of the interval, MPa.
    pub shear_mpa: f64,
    pub interval_mpa: [f64; 2],
}

/// Interval of a relation for filled rubber, as a fraction of its value: the silicones, and room for batch and cure.
const FILLED: [f64; 2] = [0.2, 1.0];
/// Factor of the interval about the exponential of Shore 00: batches, and two silicones only.
const SHORE_00_FACTOR: f64 = 2.0;

impl Figure {
    /// Name and relation.
    pub fn source(self) -> String {
        match self {
            Self::ShoreA(hardness) => {
                format!("Shore {hardness}A by Gent's relation (Rubber Chem. Technol. 31, 896, 1958)")
            }
            Self::Shore00(hardness) => {
                format!("Shore 00-{hardness} by the exponential through Ecoflex 00-30 and 00-50")
            }
            Self::Modulus100(mpa) => format!("100 % modulus {mpa} MPa of a neo-Hookean bar"),
        }
    }

    pub fn estimate(self) -> Estimate {
        let between =
            |[low, high]: [f64; 2]| Estimate { shear_mpa: (low * high).sqrt(), interval_mpa: [low, high] };
        match self {
            Self::ShoreA(hardness) => between(FILLED.map(|f| f * gent_mpa(hardness))),
            Self::Modulus100(mpa) => between(FILLED.map(|f| f * mpa / 1.75)),
            Self::Shore00(hardness) => {
                let shear =
                    |name: &str| SILICONES.iter().find(|s| s.name == name).map_or(f64::NAN, |s| s.shear_mpa);
                let (soft, hard) = (shear("ecoflex-00-30"), shear("ecoflex-00-50"));
                let shear_mpa = soft * ((hardness - 30.0) / 20.0 * (hard / soft).ln()).exp();
                between([shear_mpa / SHORE_00_FACTOR, shear_mpa * SHORE_00_FACTOR])
            }
        }
    }
}

/// Gent's relation, as a shear modulus (MPa).
fn gent_mpa(shore_a: f64) -> f64 {
    0.0981 * (56.0 + 7.623_36 * shore_a) / (0.137_505 * (254.0 - 2.54 * shore_a)) / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_contain_the_silicones_with_public_tests() {
        for (figure, name) in [
            (Figure::ShoreA(10.0), "dragon-skin-10-medium"),
            (Figure::ShoreA(30.0), "dragon-skin-30"),
            (Figure::ShoreA(20.0), "dragon-skin-20"),
            (Figure::Modulus100(0.338), "dragon-skin-20"),
            (Figure::Modulus100(0.055), "ecoflex-00-10"),
            (Figure::Shore00(10.0), "ecoflex-00-10"),
            (Figure::Shore00(30.0), "ecoflex-00-30"),
            (Figure::Shore00(50.0), "ecoflex-00-50"),
            (Figure::Modulus100(0.151), "dragon-skin-10-medium"),
            (Figure::Modulus100(0.593), "dragon-skin-30"),
            (Figure::Modulus100(0.069), "ecoflex-00-30"),
            (Figure::Modulus100(0.083), "ecoflex-00-50"),
        ] {
            let shear = SILICONES.iter().find(|s| s.name == name).unwrap().shear_mpa;
            let Estimate { shear_mpa, interval_mpa: [low, high] } = figure.estimate();
            assert!((low..high).contains(&shear), "{figure:?}: {shear} in {low} to {high}");
            assert!((0.45..2.2).contains(&(shear_mpa / shear)), "{figure:?}: {shear_mpa} for {shear}");
        }
        // Gent's figure for 50 A: E = 2.5 MPa.
        assert!((3.0 * gent_mpa(50.0) - 2.456).abs() < 0.01);
    }
}
