//! Tests of `src/cmd/new/silicone.rs`.

use super::*;
use fem::material::{Deformation, Hyperelastic};

fn law(silicone: &Silicone) -> Hyperelastic {
    let lines: String = silicone.law.iter().map(|(key, value)| format!("{key} = {value}\n")).collect();
    toml::from_str(&lines).unwrap()
}

#[test]
fn listed_stiffness_matches_the_constants() {
    for silicone in &SILICONES {
        let shear = law(silicone).shear_modulus_mpa();
        assert!((shear / silicone.shear_mpa - 1.0).abs() < 0.02, "{}: {shear}", silicone.name);
    }
    assert!(named("ecoflex").is_err_and(|text| text.contains("ecoflex-00-30 (shear modulus 0.0151 MPa)")));
}

#[test]
fn silicones_follow_their_tension_tests() {
    // Nominal stress of the cited tests (MPa) at a stretch of 2 and at the largest one.
    let tests = [
        ("ecoflex-00-30", 0.0297, 0.0801),
        ("ecoflex-00-50", 0.0410, 0.1258),
        ("dragon-skin-10-medium", 0.113, 0.445),
        ("dragon-skin-30", 0.437, 1.53),
        ("dragon-skin-20", 0.3184, 1.194),
        ("ecoflex-00-10", 0.0148, 0.0565),
        ("ninjaflex", 5.954, 9.347),
    ];
    for (name, at_2, at_end) in tests {
        let silicone = named(name).unwrap();
        let test = silicone.test.as_ref().unwrap();
        let law = law(silicone);
        assert!(
            law.stable_to().is_none_or(|stretch| stretch > test.stretch),
            "{name}: stable over its range"
        );
        for (stretch, measured) in [(2.0_f64, at_2), (test.stretch, at_end)] {
            let stress = law.nominal_stress_mpa(Deformation::Uniaxial, stretch).unwrap();
            let most = f64::max(0.02, 0.02 * test.rms_percent) * at_end;
            assert!((stress - measured).abs() < most, "{name} at stretch {stretch}: {stress} MPa");
        }
    }
    assert!(SILICONES.iter().all(|s| s.test.is_some() || s.evidence().contains("no public test")));
}
