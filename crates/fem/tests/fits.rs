//! Constants recovered from synthetic tests, the choice of a law, material files.

use crate::actuators::{reference, with};
use fem::actuator::Actuator;
use fem::material::fit::{Family, Fitted, Test, fit, fit_all, stretch_range};
use fem::material::{Deformation, Hyperelastic, MaterialFile};

/// Pseudo-random number in -1 to 1.
fn noise(k: usize) -> f64 {
    let h = (k as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let h = (h ^ (h >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    ((h ^ (h >> 29)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// Test of a law with noise as a fraction of the largest stress.
fn test(law: &Hyperelastic, deformation: Deformation, to: f64, scatter: f64) -> Test {
    let stress = |l| law.nominal_stress_mpa(deformation, l).unwrap();
    let largest = stress(to).abs();
    let point = |k: usize| {
        let l = 1.0 + (to - 1.0) * k as f64 / 120.0;
        [l, stress(l) + scatter * largest * noise(k + 1000 * deformation as usize)]
    };
    Test {
        deformation,
        points: (1..=120).map(point).collect(),
        weight: 1.0,
        shape_only: false,
        working_weight: 0.2,
    }
}

fn near(found: &Hyperelastic, wanted: &Hyperelastic, tolerance: f64) {
    for ((name, found), (_, wanted)) in found.constants().into_iter().zip(wanted.constants()) {
        assert!((found / wanted - 1.0).abs() < tolerance, "{name}: {found} for {wanted}");
    }
}

#[test]
fn constants_of_every_law_are_recovered() {
    let laws = [
        (Family::NeoHookean, Hyperelastic::NeoHookean { mu_mpa: 0.05 }, 1e-9),
        (Family::MooneyRivlin, Hyperelastic::MooneyRivlin { c10_mpa: 0.03, c01_mpa: 0.008 }, 1e-8),
        (Family::Gent, Hyperelastic::Gent { mu_mpa: 0.07, jm: 33.0 }, 1e-4),
        (Family::Yeoh3, Hyperelastic::Yeoh { c10_mpa: 2.4e-2, c20_mpa: 2.2e-3, c30_mpa: -5.4e-5 }, 1e-6),
        (
            Family::Ogden2,
            Hyperelastic::Ogden {
                mu1_mpa: -0.02,
                alpha1: -1.8,
                mu2_mpa: 0.01,
                alpha2: 3.1,
                mu3_mpa: 0.0,
                alpha3: 0.0,
            },
            1e-2,
        ),
    ];
    for (family, law, tolerance) in laws {
        let tests = [(Deformation::Uniaxial, 4.0), (Deformation::Planar, 2.5), (Deformation::Biaxial, 2.0)]
            .map(|(deformation, to)| test(&law, deformation, to, 0.0));
        let found = fit(family, &tests).unwrap();
        near(&found.law, &law, tolerance);
        assert!(found.error < 1e-4 && found.beyond_error < 1e-3, "{family:?}: {found:?}");
        assert_eq!(found.stable_to.is_some(), family == Family::Yeoh3, "{family:?}");
    }
}

#[test]
fn intervals_contain_the_constants() {
    let law = Hyperelastic::Yeoh { c10_mpa: 0.01, c20_mpa: 2.0e-4, c30_mpa: 1.0e-6 };
    // The noise is that of the largest stress, so small strains would tell little.
    let bar = Test { working_weight: 0.0, ..test(&law, Deformation::Uniaxial, 4.0, 0.01) };
    let found = fit(Family::Yeoh3, &[bar]).unwrap();
    let pairs = found.law.constants().into_iter().zip(law.constants()).zip(&found.half_widths);
    for (((name, value), (_, truth)), half_width) in pairs {
        let half_width = half_width.unwrap();
        assert!((value - truth).abs() < 1.5 * half_width, "{name}: {value} +- {half_width} for {truth}");
        assert!(half_width < truth, "{name}: {half_width}");
    }
}

#[test]
fn choice_finds_the_law_that_made_the_tests() {
    let choose = |law: &Hyperelastic| {
        let tests =
            [test(law, Deformation::Uniaxial, 4.0, 0.002), test(law, Deformation::Planar, 3.0, 0.002)];
        let families = [Family::NeoHookean, Family::Gent, Family::Yeoh3, Family::Ogden2];
        Fitted::best(families.into_iter().filter_map(|family| fit(family, &tests)).collect()).unwrap()
    };
    assert_eq!(choose(&Hyperelastic::NeoHookean { mu_mpa: 0.1 }).family, Family::NeoHookean);
    let gent = choose(&Hyperelastic::Gent { mu_mpa: 0.1, jm: 20.0 });
    assert_eq!((gent.family, gent.stable_to), (Family::Gent, None));
    assert!(Fitted::best(Vec::new()).is_none());
}

/// A Gent bar cannot be followed by an Ogden law everywhere: the weight decides where it is followed.
#[test]
fn working_strains_are_followed_where_they_have_weight() {
    let bar = test(&Hyperelastic::Gent { mu_mpa: 0.05, jm: 40.0 }, Deformation::Uniaxial, 4.0, 0.0);
    let working_percent = |working_weight: f64| {
        let weighted = Test { working_weight, ..bar.clone() };
        let fitted = fit(Family::Ogden1, std::slice::from_ref(&weighted)).unwrap();
        assert_eq!(
            weighted.working_error_percent(&fitted.law),
            fitted.working_error.map(|error| 100.0 * error)
        );
        fitted.working_error.unwrap()
    };
    let [without, with] = [0.0, 0.5].map(working_percent);
    assert!(with < 0.6 * without, "{with} {without}");
    // Rows at working strains are too few.
    let coarse = Test { points: bar.points.iter().copied().step_by(30).collect(), ..bar };
    assert_eq!(coarse.working_error_percent(&Hyperelastic::NeoHookean { mu_mpa: 0.05 }), None);
}

#[test]
fn terms_without_evidence_are_dropped() {
    let law = Hyperelastic::Ogden {
        mu1_mpa: 0.03,
        alpha1: 2.6,
        mu2_mpa: 0.0,
        alpha2: 0.0,
        mu3_mpa: 0.0,
        alpha3: 0.0,
    };
    let tests = [test(&law, Deformation::Uniaxial, 4.0, 0.005)];
    let best = Fitted::best(fit_all(&[Family::Ogden1, Family::Ogden2, Family::Ogden3], &tests)).unwrap();
    assert_eq!((best.family, best.constants(), best.undetermined()), (Family::Ogden1, 2, None));
    // The best second constant of this law is negative, which is not allowed: neo-Hookean, once.
    let all = fit_all(&[Family::NeoHookean, Family::MooneyRivlin], &tests);
    assert_eq!(all.iter().map(|fitted| fitted.law.name()).collect::<Vec<_>>(), ["neo-Hookean"]);
}

/// A Yeoh law follows a stiffening bar within the data; what it predicts of larger strains decides against it.
#[test]
fn choice_is_by_what_lies_beyond() {
    let law = Hyperelastic::Ogden {
        mu1_mpa: 0.03,
        alpha1: 2.8,
        mu2_mpa: 0.0,
        alpha2: 0.0,
        mu3_mpa: 0.0,
        alpha3: 0.0,
    };
    let all = fit_all(&Family::ALL, &[test(&law, Deformation::Uniaxial, 4.0, 0.002)]);
    let yeoh = all.iter().find(|fitted| fitted.family == Family::Yeoh3).unwrap();
    assert!(yeoh.error < 0.01 && yeoh.beyond_error > 0.02 && yeoh.stable_to.is_some(), "{yeoh:?}");
    assert_eq!(Fitted::best(all.clone()).unwrap().family, Family::Ogden1);
}

#[test]
fn unstable_constants_are_not_returned() {
    // A curve that softens so much that the free cubic has a negative modulus within the range.
    let points =
        (1..=60).map(|k| 1.0 + 0.05 * f64::from(k)).map(|l| [l, 0.1 * (3.0 * (l - 1.0)).tanh()]).collect();
    let tests = [Test {
        deformation: Deformation::Uniaxial,
        points,
        weight: 1.0,
        shape_only: false,
        working_weight: 0.2,
    }];
    assert_eq!(stretch_range(&tests)[0], 1.0);
    assert!((stretch_range(&tests)[1] - 4.0).abs() < 1e-9);
    for family in [Family::MooneyRivlin, Family::Yeoh3, Family::Ogden2] {
        let found = fit(family, &tests).unwrap();
        assert!(found.stable_to.is_none_or(|stretch| stretch > 3.99), "{family:?}: {found:?}");
    }
}

const MATERIAL: &str = "layout = 1\n[elastomer]\nbulk_mpa = 2000.0\ndensity_t_per_mm3 = 1.07e-9\nstretch_range = [1.0, 4.0]\n\
    [elastomer.law]\nlaw = \"ogden\"\nmu1_mpa = 0.01\nalpha1 = 2.0\nmu2_mpa = 0.001\nalpha2 = 4.0\n\
    [fit]\nrms_percent = 0.4\n[[fit.tests]]\nfile = \"strip.csv\"\ntest = \"uniaxial\"\nrms_percent = 0.4\n";

/// The reference actuator with `elastomer` as its section.
fn actuator(elastomer: &str) -> String {
    let text = reference();
    let (begin, end) = (text.find("[elastomer]").unwrap(), text.find("[sheet]").unwrap());
    format!("{}{elastomer}\n{}", &text[..begin], &text[end..])
}

#[test]
fn an_actuator_takes_a_material_file_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("actuator.toml");
    let read = |elastomer: &str, material: &str| {
        std::fs::write(&path, actuator(elastomer)).unwrap();
        std::fs::write(folder.path().join("silicone.toml"), material).unwrap();
        Actuator::read(&path)
    };
    let found = read("[elastomer]\nfile = \"silicone.toml\"", MATERIAL).unwrap();
    assert_eq!(found.elastomer.stretch_range, Some([1.0, 4.0]));
    assert!((found.elastomer.law.shear_modulus_mpa() - 0.012).abs() < 1e-12);
    let (_, material) = Actuator::material(&path).unwrap().unwrap();
    assert!(material.summary().contains("strip.csv (uniaxial)"));
    // Unknown keys, constants beside the file, a missing file, constants that are unstable over the stated range.
    for (elastomer, material) in [
        ("[elastomer]\nfile = \"silicone.toml\"\nbulk_mpa = 10.0", MATERIAL.to_owned()),
        ("[elastomer]\nfile = 7", MATERIAL.to_owned()),
        ("[elastomer]\nfile = \"other.toml\"", MATERIAL.to_owned()),
        ("[elastomer]\nfile = \"silicone.toml\"", MATERIAL.replace("rms_percent", "rms")),
        ("[elastomer]\nfile = \"silicone.toml\"", MATERIAL.replace("layout = 1", "layout = 2")),
        ("[elastomer]\nfile = \"silicone.toml\"", MATERIAL.replace("mu2_mpa = 0.001", "mu2_mpa = -0.001")),
    ] {
        assert!(read(elastomer, &material).is_err(), "{elastomer} {material}");
    }
    std::fs::write(&path, with(&reference(), "elastomer", "bulk_mpa", "2000.0")).unwrap();
    assert!(Actuator::material(&path).unwrap().is_none());
    assert!(MaterialFile::read(&folder.path().join("none.toml")).is_err());
}

#[test]
fn sag_by_beam_theory_is_near_the_solved_one() {
    let actuator = Actuator::parse(&reference()).unwrap();
    // The finite elements sag by 27.45 mm (docs/fem.md).
    let sag = actuator.sag_estimate_mm(1.0).unwrap();
    assert!((sag / 27.45 - 1.0).abs() < 0.3, "{sag} mm");
    // Small displacements are proportional to the weight over the stiffness.
    // Softer is lower, down to hanging from the base.
    let sags = [1.0, 0.3, 0.1, 0.03, 0.01].map(|factor| actuator.sag_estimate_mm(factor).unwrap());
    assert!(sags.is_sorted() && sags[4] > 0.7 * 115.0 && sags[4] < 115.0, "{sags:?}");
    let ratio = actuator.sag_estimate_mm(100.0).unwrap() / actuator.sag_estimate_mm(200.0).unwrap();
    assert!((ratio - 2.0).abs() < 0.01, "{ratio}");
    let hanging =
        Actuator::parse(&with(&reference(), "loads", "gravity_mm_s2", "[9810.0, 0.0, 0.0]")).unwrap();
    assert_eq!(hanging.sag_estimate_mm(1.0).unwrap(), 0.0);
}

/// A strip that is 1.5 times as stiff as the part tells the part's limit, and a planar test up to a small stretch its modulus.
#[test]
fn test_of_the_shape_only_leaves_the_modulus_to_the_others() {
    let part = Hyperelastic::Gent { mu_mpa: 0.02, jm: 40.0 };
    let planar = test(&part, Deformation::Planar, 2.0, 0.0);
    let stiffer = Hyperelastic::Gent { mu_mpa: 0.03, jm: 40.0 };
    let strip = Test { shape_only: true, ..test(&stiffer, Deformation::Uniaxial, 4.5, 0.0) };
    let fitted = fit(Family::Gent, &[planar.clone(), strip.clone()]).unwrap();
    let Hyperelastic::Gent { mu_mpa, jm } = fitted.law else { panic!("{:?}", fitted.law) };
    assert!((mu_mpa / 0.02 - 1.0).abs() < 1e-3 && (jm / 40.0 - 1.0).abs() < 1e-3, "{mu_mpa} {jm}");
    assert_eq!(fitted.moduli[0], 1.0);
    assert!((fitted.moduli[1] / 1.5 - 1.0).abs() < 1e-3 && fitted.error < 1e-4, "{:?}", fitted.moduli);
    // With both moduli taken as one, no law explains both.
    let both = fit(Family::Gent, &[planar, Test { shape_only: false, ..strip }]).unwrap();
    assert!(both.error > 0.05, "{}", both.error);
}
