//! Silicones by name: law, constants and where they are published.

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
}

/// All of them; the first is the default.
pub const SILICONES: [Silicone; 5] = [
    Silicone {
        name: "reference",
        law: &[("law", "\"gent\""), ("mu_mpa", "0.8"), ("jm", "6.0")],
        density_t_per_mm3: "1.0e-9",
        shear_mpa: 0.8,
        source: "Pu, Hu, Liu, Niu, An, Int. J. Solids Struct. 2026: the elastomer of the reference actuator",
    },
    Silicone {
        name: "elastosil-m4601",
        law: &[("law", "\"yeoh\""), ("c10_mpa", "0.11"), ("c20_mpa", "0.02"), ("c30_mpa", "0.0")],
        density_t_per_mm3: "1.13e-9",
        shear_mpa: 0.22,
        source: "Soft Robotics Toolkit (softroboticstoolkit.com), PneuNets bending actuators, modeling",
    },
    Silicone {
        name: "dragon-skin-30",
        law: &[("law", "\"yeoh\""), ("c10_mpa", "0.1536"), ("c20_mpa", "0.0016"), ("c30_mpa", "0.0")],
        density_t_per_mm3: "1.08e-9",
        shear_mpa: 0.31,
        source: "SOROTOKI (github.com/BJCaasenbrood/SorotokiCode), material Dragonskin30; density of the data sheet",
    },
    Silicone {
        name: "ecoflex-00-50",
        law: &[("law", "\"yeoh\""), ("c10_mpa", "0.0145"), ("c20_mpa", "0.0001"), ("c30_mpa", "0.0")],
        density_t_per_mm3: "1.07e-9",
        shear_mpa: 0.029,
        source: "SOROTOKI (github.com/BJCaasenbrood/SorotokiCode), material Ecoflex0050",
    },
    Silicone {
        name: "ecoflex-00-30",
        law: &[("law", "\"yeoh\""), ("c10_mpa", "0.017"), ("c20_mpa", "-0.0002"), ("c30_mpa", "0.000023")],
        density_t_per_mm3: "1.07e-9",
        shear_mpa: 0.034,
        source: "SOROTOKI (github.com/BJCaasenbrood/SorotokiCode), Ecoflex0030.m, in its comment; density of the data sheet",
    },
];

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

#[cfg(test)]
#[path = "../../../tests/unit/cmd_new_silicone.rs"]
mod tests;
