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
    assert!(named("ecoflex").is_err_and(|text| text.contains("ecoflex-00-30 (shear modulus 0.034 MPa)")));
}
