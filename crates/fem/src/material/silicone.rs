//! Silicones whose constants are published, by name; and the shear modulus of one of which only a data sheet is known.
//!
//! Shore A: `E = 0.0981 (56 + 7.62336 S) / (0.137505 (254 - 2.54 S))` MPa (Gent, Rubber Chem. Technol. 31, 896, 1958), `mu = E / 3`.
//! 100 % modulus: `mu = stress / 1.75`, the neo-Hookean bar at stretch 2. Six silicones with public tension tests have 0.23 to
//! 0.70 times these values: both relations are those of harder, filled rubber. Shore 00: exponential through the two of them that are sold
//! by that scale.

/// A silicone whose constants are published.
pub struct Silicone {
    /// As typed.
    pub name: &'static str,
    /// Law and constants as `[elastomer.law]` of `actuator.toml` has them.
    pub law: &'static [(&'static str, &'static str)],
    /// Mass density, t/mm3.
    pub density_t_per_mm3: &'static str,
    /// Initial shear modulus, MPa: how stiff it is beside the others.
    pub shear_mpa: f64,
    /// Where the constants come from.
    pub source: &'static str,
    /// The public test behind the constants.
    pub test: Option<PublicTest>,
}

/// Public tension test.
pub struct PublicTest {
    /// Largest stretch that was fitted.
    pub stretch: f64,
    /// RMS error, % of the largest stress.
    pub rms_percent: f64,
}

const STRIPS: &str = "`softtwin material fit` on a tension test of the Soft-Robotics-Materials-Database (github.com/LucMarechal), commit \
                      8ff66c3; density of the data sheet";

const MORE_STRIPS: &str = "`softtwin material fit --working-weight 0` on 30 to 54 rows of a tension test of the Soft-Robotics-Materials-Database \
                           (github.com/LucMarechal), commit 0f67d88; density of the data sheet";

const PRINTED: &str = "`softtwin material fit --law yeoh --working-weight 0` on the mean tension test (Cauchy stress against stretch) of MacCurdyLab/SoRoForge \
                       (github.com), commit 59e845b, TPU Data; a law of both invariants follows it better in tension and is far too stiff \
                       in biaxial tension; density of the data sheet";

/// All of them; the first is the default.
pub const SILICONES: [Silicone; 9] = [
    Silicone {
        name: "reference",
        law: &[("law", "\"gent\""), ("mu_mpa", "0.8"), ("jm", "6.0")],
        density_t_per_mm3: "1.0e-9",
        shear_mpa: 0.8,
        source: "Pu, Hu, Liu, Niu, An, Int. J. Solids Struct. 2026: the elastomer of the reference actuator",
        test: None,
    },
    Silicone {
        name: "elastosil-m4601",
        law: &[("law", "\"yeoh\""), ("c10_mpa", "0.11"), ("c20_mpa", "0.02"), ("c30_mpa", "0.0")],
        density_t_per_mm3: "1.13e-9",
        shear_mpa: 0.22,
        source: "Soft Robotics Toolkit (softroboticstoolkit.com), PneuNets bending actuators, modeling",
        test: None,
    },
    Silicone {
        name: "dragon-skin-30",
        law: &[("law", "\"ogden\""), ("mu1_mpa", "0.123447"), ("alpha1", "2.84437")],
        density_t_per_mm3: "1.08e-9",
        shear_mpa: 0.176,
        source: STRIPS,
        test: Some(PublicTest { stretch: 4.0, rms_percent: 1.59 }),
    },
    Silicone {
        name: "dragon-skin-20",
        law: &[("law", "\"ogden\""), ("mu1_mpa", "0.0965366"), ("alpha1", "2.82639")],
        density_t_per_mm3: "1.08e-9",
        shear_mpa: 0.136,
        source: MORE_STRIPS,
        test: Some(PublicTest { stretch: 4.0, rms_percent: 0.86 }),
    },
    Silicone {
        name: "dragon-skin-10-medium",
        law: &[("law", "\"ogden\""), ("mu1_mpa", "0.0274648"), ("alpha1", "3.04756")],
        density_t_per_mm3: "1.07e-9",
        shear_mpa: 0.0419,
        source: STRIPS,
        test: Some(PublicTest { stretch: 4.0, rms_percent: 2.29 }),
    },
    Silicone {
        name: "ecoflex-00-50",
        law: &[("law", "\"ogden\""), ("mu1_mpa", "0.0152620"), ("alpha1", "2.51952")],
        density_t_per_mm3: "1.07e-9",
        shear_mpa: 0.0192,
        source: STRIPS,
        test: Some(PublicTest { stretch: 4.0, rms_percent: 0.42 }),
    },
    Silicone {
        name: "ecoflex-00-30",
        law: &[("law", "\"ogden\""), ("mu1_mpa", "0.0119651"), ("alpha1", "2.37221")],
        density_t_per_mm3: "1.07e-9",
        shear_mpa: 0.0142,
        source: STRIPS,
        test: Some(PublicTest { stretch: 4.0, rms_percent: 0.68 }),
    },
    Silicone {
        name: "ecoflex-00-10",
        law: &[
            ("law", "\"yeoh\""),
            ("c10_mpa", "0.00359612"),
            ("c20_mpa", "0.000139825"),
            ("c30_mpa", "-2.72637e-7"),
        ],
        density_t_per_mm3: "1.04e-9",
        shear_mpa: 0.00719,
        source: MORE_STRIPS,
        test: Some(PublicTest { stretch: 4.0, rms_percent: 0.45 }),
    },
    Silicone {
        name: "ninjaflex",
        law: &[
            ("law", "\"yeoh\""),
            ("c10_mpa", "2.05472"),
            ("c20_mpa", "-0.0820714"),
            ("c30_mpa", "0.00275112"),
        ],
        density_t_per_mm3: "1.19e-9",
        shear_mpa: 4.11,
        source: PRINTED,
        test: Some(PublicTest { stretch: 3.8, rms_percent: 3.0 }),
    },
];

impl Silicone {
    /// Source, with range and error of the test behind it.
    pub fn evidence(&self) -> String {
        match &self.test {
            Some(test) => format!(
                "stretches 1 to {}, RMS {} % of the largest stress: {}",
                test.stretch, test.rms_percent, self.source
            ),
            None => format!("published constants, compared with no public test: {}", self.source),
        }
    }
}

/// The silicone of that name.
///
/// # Errors
/// The names there are, with their stiffness.
pub fn named(text: &str) -> Result<&'static Silicone, String> {
    SILICONES.iter().find(|silicone| silicone.name == text).ok_or_else(|| {
        let list: Vec<String> =
            SILICONES.iter().map(|s| format!("{} (shear modulus {} MPa)", s.name, s.shear_mpa)).collect();
        format!("expected one of {}; or give --shear-modulus-mpa", list.join(", "))
    })
}

/// A figure of a data sheet that tells how stiff a silicone is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HardnessFigure {
    /// Shore A hardness.
    ShoreA(f64),
    /// Shore 00 hardness.
    Shore00(f64),
    /// Nominal stress at 100 % elongation, MPa.
    Modulus100(f64),
}

/// Shear modulus (MPa), and the interval around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShearEstimate {
    /// Geometric middle of the interval, MPa.
    pub shear_mpa: f64,
    /// Where the shear modulus may be, MPa.
    pub interval_mpa: [f64; 2],
}

/// Interval of a relation for filled rubber, as a fraction of its value: the silicones, and room for batch and cure.
const FILLED: [f64; 2] = [0.2, 1.0];
/// Factor of the interval about the exponential of Shore 00: batches, and two silicones only.
const SHORE_00_FACTOR: f64 = 2.0;

impl HardnessFigure {
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

    /// Shear modulus that the figure tells, with its interval.
    pub fn estimate(self) -> ShearEstimate {
        let between = |[low, high]: [f64; 2]| ShearEstimate {
            shear_mpa: (low * high).sqrt(),
            interval_mpa: [low, high],
        };
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
#[path = "../../tests/unit/silicones.rs"]
mod tests;
