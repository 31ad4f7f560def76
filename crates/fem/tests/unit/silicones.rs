//! Tests of `src/material/silicone.rs`.

use super::*;
use crate::material::{Deformation, Hyperelastic};

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
    assert!(named("ecoflex").is_err_and(|text| text.contains("ecoflex-00-30 (shear modulus 0.0142 MPa)")));
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
            let most = f64::max(0.02, 0.025 * test.rms_percent) * at_end;
            assert!((stress - measured).abs() < most, "{name} at stretch {stretch}: {stress} MPa");
        }
    }
    assert!(SILICONES.iter().all(|s| s.test.is_some() || s.evidence().contains("no public test")));
}

#[test]
fn intervals_contain_the_silicones_with_public_tests() {
    for (figure, name) in [
        (HardnessFigure::ShoreA(10.0), "dragon-skin-10-medium"),
        (HardnessFigure::ShoreA(30.0), "dragon-skin-30"),
        (HardnessFigure::ShoreA(20.0), "dragon-skin-20"),
        (HardnessFigure::Modulus100(0.338), "dragon-skin-20"),
        (HardnessFigure::Modulus100(0.055), "ecoflex-00-10"),
        (HardnessFigure::Shore00(10.0), "ecoflex-00-10"),
        (HardnessFigure::Shore00(30.0), "ecoflex-00-30"),
        (HardnessFigure::Shore00(50.0), "ecoflex-00-50"),
        (HardnessFigure::Modulus100(0.151), "dragon-skin-10-medium"),
        (HardnessFigure::Modulus100(0.593), "dragon-skin-30"),
        (HardnessFigure::Modulus100(0.069), "ecoflex-00-30"),
        (HardnessFigure::Modulus100(0.083), "ecoflex-00-50"),
    ] {
        let shear = SILICONES.iter().find(|s| s.name == name).unwrap().shear_mpa;
        let ShearEstimate { shear_mpa, interval_mpa: [low, high] } = figure.estimate();
        assert!((low..high).contains(&shear), "{figure:?}: {shear} in {low} to {high}");
        assert!((0.45..2.2).contains(&(shear_mpa / shear)), "{figure:?}: {shear_mpa} for {shear}");
    }
    // Gent's figure for 50 A: E = 2.5 MPa.
    assert!((3.0 * gent_mpa(50.0) - 2.456).abs() < 0.01);
}
