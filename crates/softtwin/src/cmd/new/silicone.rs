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
pub const SILICONES: [Silicone; 6] = [
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
        law: &[("law", "\"yeoh\""), ("c10_mpa", "0.1193"), ("c20_mpa", "0.00306"), ("c30_mpa", "0.0")],
        density_t_per_mm3: "1.08e-9",
        shear_mpa: 0.239,
        source: "fitted to a tension test at strain 0.02 to 3, RMS 1.9 % of its largest stress: Soft-Robotics-Materials-Database \
                 (github.com/LucMarechal), commit 8ff66c3; density of the data sheet",
    },
    Silicone {
        name: "dragon-skin-10-medium",
        law: &[("law", "\"yeoh\""), ("c10_mpa", "0.0311"), ("c20_mpa", "0.00104"), ("c30_mpa", "0.0")],
        density_t_per_mm3: "1.07e-9",
        shear_mpa: 0.0622,
        source: "fitted to a tension test at strain 0.02 to 3, RMS 2.4 % of its largest stress: Soft-Robotics-Materials-Database \
                 (github.com/LucMarechal), commit 8ff66c3; density of the data sheet",
    },
    Silicone {
        name: "ecoflex-00-50",
        law: &[("law", "\"yeoh\""), ("c10_mpa", "0.01108"), ("c20_mpa", "0.000188"), ("c30_mpa", "0.0")],
        density_t_per_mm3: "1.07e-9",
        shear_mpa: 0.0222,
        source: "fitted to a tension test at strain 0.02 to 3, RMS 0.6 % of its largest stress: Soft-Robotics-Materials-Database \
                 (github.com/LucMarechal), commit 8ff66c3; density of the data sheet",
    },
    Silicone {
        name: "ecoflex-00-30",
        law: &[("law", "\"yeoh\""), ("c10_mpa", "0.00793"), ("c20_mpa", "0.0000854"), ("c30_mpa", "0.0")],
        density_t_per_mm3: "1.07e-9",
        shear_mpa: 0.0159,
        source: "fitted to a tension test at strain 0.02 to 3, RMS 0.5 % of its largest stress: Soft-Robotics-Materials-Database \
                 (github.com/LucMarechal), commit 8ff66c3; density of the data sheet",
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
