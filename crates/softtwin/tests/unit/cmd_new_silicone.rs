//! Tests of `src/cmd/new/silicone.rs`.

use super::*;

#[test]
fn listed_stiffness_matches_the_constants() {
    for silicone in &SILICONES {
        let value = |key: &str| {
            let found = silicone.law.iter().find(|(name, _)| *name == key);
            found.map(|(_, text)| text.parse::<f64>().unwrap())
        };
        let shear = value("mu_mpa").or_else(|| value("c10_mpa").map(|c10| 2.0 * c10)).unwrap();
        assert!((shear / silicone.shear_mpa - 1.0).abs() < 0.02, "{}: {shear}", silicone.name);
    }
    assert!(named("ecoflex").is_err_and(|text| text.contains("ecoflex-00-30 (shear modulus 0.0159 MPa)")));
}

#[test]
fn silicones_follow_their_tension_tests() {
    // Nominal stress of the cited tests (MPa) at strain 1 and 3.
    let tests = [
        ("ecoflex-00-30", 0.0297, 0.0801),
        ("ecoflex-00-50", 0.0410, 0.1258),
        ("dragon-skin-10-medium", 0.113, 0.445),
        ("dragon-skin-30", 0.437, 1.53),
    ];
    for (name, at_1, at_3) in tests {
        let law = named(name).unwrap().law;
        let value = |key: &str| law.iter().find(|(k, _)| *k == key).unwrap().1.parse::<f64>().unwrap();
        let (c10, c20, c30) = (value("c10_mpa"), value("c20_mpa"), value("c30_mpa"));
        assert!(c10 > 0.0 && c20 >= 0.0 && c30 >= 0.0, "{name}: stable at every stretch");
        for (stretch, measured) in [(2.0_f64, at_1), (4.0, at_3)] {
            let e = stretch.powi(2) + 2.0 / stretch - 3.0;
            let stress = 2.0 * (stretch - stretch.powi(-2)) * (c10 + e * (2.0 * c20 + 3.0 * e * c30));
            assert!((stress - measured).abs() < 0.05 * at_3, "{name} at stretch {stretch}: {stress} MPa");
        }
    }
}
