//! Laws in homogeneous deformations: elements against closed forms, and the limits of stability.

use crate::algebra::Vec3;
use crate::element::tet10::{self, Invalid, TetGeometry};
use crate::material::{Deformation, Elastomer, Hyperelastic, VolumeChange};

const CORNERS: [Vec3; 4] = [[0.1, 0.0, 0.2], [2.1, 0.1, 0.0], [0.3, 1.8, 0.1], [0.2, 0.3, 1.6]];

/// Nominal stress (MPa) of an element under these stretches, the last direction free of stress.
fn element_stress(law: Hyperelastic, stretches: Vec3) -> Result<f64, Invalid> {
    let mut x = [[0.0; 3]; 10];
    x[..4].copy_from_slice(&CORNERS);
    for (m, [a, b]) in formats::mesh_file::TET_EDGES.into_iter().enumerate() {
        x[4 + m] = std::array::from_fn(|k| 0.5 * (x[a][k] + x[b][k]));
    }
    let u = x.map(|x| std::array::from_fn(|k| (stretches[k] - 1.0) * x[k]));
    let stress = tet10::deviatoric_stress(&TetGeometry::new(&x).unwrap(), &u, &law)?[0];
    Ok((stress[0] - stress[2]) / stretches[0])
}

fn ogden() -> Hyperelastic {
    Hyperelastic::Ogden {
        mu1_mpa: 0.02,
        alpha1: 2.0,
        mu2_mpa: 0.003,
        alpha2: 3.2,
        mu3_mpa: -0.001,
        alpha3: -1.5,
    }
}

#[test]
fn elements_in_tension_have_the_stress_of_the_closed_form() {
    let laws = [
        Hyperelastic::Gent { mu_mpa: 0.3, jm: 40.0 },
        Hyperelastic::MooneyRivlin { c10_mpa: 0.2, c01_mpa: 0.05 },
        Hyperelastic::NeoHookean { mu_mpa: 0.5 },
        ogden(),
        Hyperelastic::Yeoh { c10_mpa: 0.3, c20_mpa: -0.02, c30_mpa: 0.005 },
    ];
    for law in laws {
        for l in [0.6_f64, 1.0, 1.2, 2.0, 3.5] {
            let shapes = [[l, l.powf(-0.5), l.powf(-0.5)], [l, 1.0, 1.0 / l], [l, l, l.powi(-2)]];
            for (deformation, stretches) in Deformation::ALL.into_iter().zip(shapes) {
                let closed = law.nominal_stress_mpa(deformation, l).unwrap();
                let found = element_stress(law, stretches).unwrap();
                assert!(
                    (found - closed).abs() < 1.0e-10 * (1.0 + closed.abs()),
                    "{law:?} {deformation:?} {l}: {found} {closed}"
                );
            }
        }
    }
    // Known closed forms: neo-Hookean bar and strip, Mooney-Rivlin balloon.
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1.0e-12, "{a} {b}");
    let l = 1.7_f64;
    let stress = |law: Hyperelastic, deformation| law.nominal_stress_mpa(deformation, l).unwrap();
    near(stress(laws[2], Deformation::Uniaxial), 0.5 * (l - l.powi(-2)));
    near(stress(laws[2], Deformation::Planar), 0.5 * (l - l.powi(-3)));
    near(stress(laws[1], Deformation::Biaxial), 2.0 * (l - l.powi(-5)) * (0.2 + 0.05 * l * l));
    // An Ogden law with exponents 2 and -2 is the Mooney-Rivlin law.
    let same = Hyperelastic::Ogden {
        mu1_mpa: 0.4,
        alpha1: 2.0,
        mu2_mpa: -0.1,
        alpha2: -2.0,
        mu3_mpa: 0.0,
        alpha3: 0.0,
    };
    near(stress(same, Deformation::Uniaxial), stress(laws[1], Deformation::Uniaxial));
}

#[test]
fn a_law_is_refused_where_it_is_unstable() {
    let law = Hyperelastic::Yeoh { c10_mpa: 2.43e-2, c20_mpa: 2.25e-3, c30_mpa: -5.4e-5 };
    let limit = law.stable_to().unwrap();
    assert!((4.5..5.2).contains(&limit), "{limit}");
    let elastomer = |stretch_range| Elastomer {
        law,
        bulk_mpa: 2000.0,
        density_t_per_mm3: 1.0e-9,
        volume_change: VolumeChange::Mean,
        stretch_range,
        shear_interval_mpa: None,
    };
    assert!(elastomer(Some([1.0, 4.0])).check().is_ok());
    for range in [None, Some([1.0, 6.0]), Some([0.05, 4.0]), Some([1.0, f64::INFINITY]), Some([2.0, 4.0])] {
        assert_eq!(elastomer(range).check().unwrap_err().name, "stretch_range", "{range:?}");
    }
    let bar = |l: f64| [l, l.powf(-0.5), l.powf(-0.5)];
    assert!(element_stress(law, bar(0.98 * limit)).is_ok());
    assert!(matches!(element_stress(law, bar(1.2 * limit)), Err(Invalid::Unstable(_))));
    // Terms of both signs: unstable from where the second outweighs the first, and never with products above 0.
    let mixed = |mu2_mpa| Hyperelastic::Ogden {
        mu1_mpa: 0.05,
        alpha1: 2.0,
        mu2_mpa,
        alpha2: 3.0,
        mu3_mpa: 0.0,
        alpha3: 0.0,
    };
    let limit = mixed(-0.01).stable_to().unwrap();
    assert!(matches!(element_stress(mixed(-0.01), bar(1.1 * limit)), Err(Invalid::Unstable(_))));
    assert!(element_stress(mixed(-0.01), bar(0.9 * limit)).is_ok());
    assert_eq!(mixed(0.01).stable_to(), None);
}
