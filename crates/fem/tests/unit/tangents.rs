//! Every tangent is the derivative of its force, and every force the derivative of its energy.

use super::noise;
use crate::algebra::{Vec3, add, axpy, det_inv_transpose, dot, mat_vec, scale, skew};
use crate::contact::penalty;
use crate::element::cavity::{CavityLoad, face_terms};
use crate::element::membrane::{self, MembraneGeometry};
use crate::element::tet10::{self, TetGeometry, TetTerms};
use crate::element::{bending, tri6};
use crate::material::{Dependence, Elastomer, Fibres, Film, Hyperelastic, Isotropic, VolumeChange};
use formats::mesh_file::{TET_EDGES, TRI_EDGES};

const STEP: f64 = 1.0e-6;

const LAWS: [Hyperelastic; 5] = [
    Hyperelastic::Gent { mu_mpa: 0.8, jm: 6.0 },
    Hyperelastic::NeoHookean { mu_mpa: 0.5 },
    Hyperelastic::Yeoh { c10_mpa: 0.3, c20_mpa: -0.02, c30_mpa: 0.005 },
    Hyperelastic::MooneyRivlin { c10_mpa: 0.2, c01_mpa: 0.05 },
    Hyperelastic::Ogden {
        mu1_mpa: 0.4,
        alpha1: 1.7,
        mu2_mpa: -0.02,
        alpha2: -3.0,
        mu3_mpa: 0.01,
        alpha3: 5.0,
    },
];

fn tet() -> [Vec3; 10] {
    let mut x = [[0.0; 3]; 10];
    x[..4].copy_from_slice(&[[0.1, 0.0, 0.2], [2.1, 0.1, 0.0], [0.3, 1.8, 0.1], [0.2, 0.3, 1.6]]);
    for (m, [a, b]) in TET_EDGES.into_iter().enumerate() {
        x[4 + m] = scale(0.5, add(x[a], x[b]));
    }
    x
}

fn triangle() -> [Vec3; 6] {
    let mut x = [[0.0; 3]; 6];
    x[..3].copy_from_slice(&[[0.1, 2.0, 0.2], [2.1, 2.0, 0.0], [0.3, 2.0, 1.9]]);
    for (m, [a, b]) in TRI_EDGES.into_iter().enumerate() {
        x[3 + m] = scale(0.5, add(x[a], x[b]));
    }
    x
}

fn shaken<const N: usize>(size: f64, seed: usize) -> [Vec3; N] {
    std::array::from_fn(|a| std::array::from_fn(|i| size * noise(seed + 3 * a + i)))
}

/// Each law with one pressure per element, and with one per Gauss point.
fn materials() -> impl Iterator<Item = Elastomer> {
    LAWS.into_iter().flat_map(|law| {
        [VolumeChange::Mean, VolumeChange::Points].map(|volume_change| Elastomer {
            law,
            bulk_mpa: 20.0,
            density_t_per_mm3: 0.0,
            volume_change,
            stretch_range: None,
            shear_interval_mpa: None,
        })
    })
}

/// `W`, `W'`, `W''` of a law of the first invariant.
fn energy(law: Hyperelastic, i1: f64) -> Option<[f64; 3]> {
    match law.at(i1) {
        Some(Dependence::Invariant(energy)) => Some([energy.w, energy.d1, energy.d2]),
        _ => None,
    }
}

#[test]
fn energies_have_the_derivatives_they_state() {
    for law in LAWS.into_iter().filter(|law| energy(*law, 3.0).is_some()) {
        for i1 in [3.0, 3.4, 5.0, 7.5] {
            let at = |i1| energy(law, i1).unwrap();
            let (up, down, here) = (at(i1 + STEP), at(i1 - STEP), at(i1));
            assert!(((up[0] - down[0]) / (2.0 * STEP) - here[1]).abs() < 1.0e-8, "{law:?} at {i1}");
            assert!(((up[1] - down[1]) / (2.0 * STEP) - here[2]).abs() < 1.0e-8, "{law:?} at {i1}");
        }
    }
    assert!(LAWS[0].at(3.0 + 5.8).is_none(), "beyond 95 % of the Gent limit no energy is given");
}

#[test]
fn solid_force_is_the_derivative_of_its_energy() {
    let geometry = TetGeometry::new(&tet()).unwrap();
    for material in materials() {
        let law = material.law;
        let u = shaken::<10>(0.12, 7);
        let mut terms = TetTerms::default();
        terms.evaluate(&geometry, &u, 0.0, &material, false).unwrap();
        for a in 0..10 {
            for i in 0..3 {
                let at = |step: f64| {
                    let mut moved = u;
                    moved[a][i] += step;
                    let (w, change) = crate::energy::isochoric(&geometry, &moved, &law).unwrap();
                    let squared = crate::energy::squared_change(&geometry, &moved, &law).unwrap();
                    (w + 0.5 * material.point_bulk_mpa() * squared, change)
                };
                let (up, down) = (at(STEP), at(-STEP));
                assert!(((up.0 - down.0) / (2.0 * STEP) - terms.force[a][i]).abs() < 1.0e-7);
                assert!(((up.1 - down.1) / (2.0 * STEP) - terms.volume_gradient[a][i]).abs() < 1.0e-7);
            }
        }
    }
}

#[test]
fn solid_tangent_is_the_derivative_of_its_force_at_constant_pressure() {
    let geometry = TetGeometry::new(&tet()).unwrap();
    let pressure = -0.37;
    // A general deformation, none, and a stretched bar: with equal principal stretches the moduli are limits.
    let stretched = tet().map(|x| [0.5 * x[0], -0.2 * x[1], -0.2 * x[2]]);
    let deformations = [shaken::<10>(0.12, 3), [[0.0; 3]; 10], stretched];
    for (material, u) in materials().flat_map(|material| deformations.map(|u| (material, u))) {
        // What the element's own pressure adds; with a pressure at each point there is none.
        let pressure = if material.point_bulk_mpa() > 0.0 { 0.0 } else { pressure };
        let force = |u: &[Vec3; 10]| {
            let mut terms = TetTerms::default();
            terms.evaluate(&geometry, u, pressure, &material, true).unwrap();
            let total: [Vec3; 10] =
                std::array::from_fn(|a| add(terms.force[a], scale(pressure, terms.volume_gradient[a])));
            (total, terms)
        };
        let (_, here) = force(&u);
        for b in 0..10 {
            for j in 0..3 {
                let at = |step: f64| {
                    let mut moved = u;
                    moved[b][j] += step;
                    force(&moved).0
                };
                let (up, down) = (at(STEP), at(-STEP));
                for a in b..10 {
                    for i in 0..3 {
                        let block = &here.tangent[a * (a + 1) / 2 + b];
                        let measured = (up[a][i] - down[a][i]) / (2.0 * STEP);
                        assert!((block[i][j] - measured).abs() < 1.0e-6, "{material:?} {a}{i} {b}{j}");
                    }
                }
            }
        }
    }
}

#[test]
fn second_piola_stress_is_that_of_the_cauchy_stress_for_every_law() {
    let geometry = TetGeometry::new(&tet()).unwrap();
    let u = shaken::<10>(0.12, 5);
    for law in [
        Hyperelastic::Gent { mu_mpa: 0.8, jm: 20.0 },
        Hyperelastic::MooneyRivlin { c10_mpa: 0.3, c01_mpa: 0.2 },
        Hyperelastic::Ogden {
            mu1_mpa: 0.4,
            alpha1: 3.1,
            mu2_mpa: -0.1,
            alpha2: -2.0,
            mu3_mpa: 0.0,
            alpha3: 0.0,
        },
    ] {
        let stress = tet10::isochoric_stress(&geometry, &u, &law).unwrap();
        let found = tet10::cauchy_of_stress(&geometry, &u, &stress);
        let expected = tet10::deviatoric_stress(&geometry, &u, &law).unwrap();
        for (found, expected) in found.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((found - expected).abs() < 1.0e-12, "{law:?}: {found} {expected}");
        }
    }
}

#[test]
fn force_and_tangent_of_a_given_stress_are_derivatives_of_its_energy() {
    let geometry = TetGeometry::new(&tet()).unwrap();
    let stress: tet10::PointTensors =
        std::array::from_fn(|q| std::array::from_fn(|k| 0.4 * noise(50 + 6 * q + k)));
    let u = shaken::<10>(0.12, 5);
    let energy = |u: &[Vec3; 10]| -> f64 {
        let at = |q: usize| {
            let f = geometry.deformation_gradient(q, u);
            let det = det_inv_transpose(&f).0;
            let [xx, yy, zz, xy, xz, yz] = stress[q];
            let h = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
            let product: f64 = f.iter().map(|row| dot(*row, mat_vec(&h, *row))).sum();
            0.5 * geometry.weights[q] * det.powf(-2.0 / 3.0) * product
        };
        (0..4).map(at).sum()
    };
    let terms = |u: &[Vec3; 10]| {
        let mut terms = TetTerms::default();
        terms.add_stress(&geometry, u, &stress, true);
        terms
    };
    let here = terms(&u);
    for b in 0..10 {
        for j in 0..3 {
            let moved = |step: f64| {
                let mut moved = u;
                moved[b][j] += step;
                moved
            };
            let (up, down) = (moved(STEP), moved(-STEP));
            let force = (energy(&up) - energy(&down)) / (2.0 * STEP);
            assert!((force - here.force[b][j]).abs() < 1.0e-7);
            let (up, down) = (terms(&up), terms(&down));
            for a in b..10 {
                for i in 0..3 {
                    let measured = (up.force[a][i] - down.force[a][i]) / (2.0 * STEP);
                    assert!((here.tangent[a * (a + 1) / 2 + b][i][j] - measured).abs() < 1.0e-6);
                }
            }
        }
    }
}

#[test]
fn membrane_force_and_tangent_are_derivatives_of_its_energy() {
    let isotropic = Isotropic { youngs_mpa: 6500.0, poisson: 0.2, thickness_mm: 0.1 };
    let family = |angle_deg| Fibres { angle_deg, spacing_mm: 0.5, stiffness_n: 100.0 };
    let fibres = vec![family(30.0), family(-55.0), family(90.0)];
    let film = |isotropic, fibres| membrane::Law::of(&Film { axis: [1.0, 0.0, 0.0], isotropic, fibres });
    // In tension, slack, and within the rounding between the two.
    for (law, size) in [
        (film(Some(isotropic), Vec::new()), 0.1),
        (film(Some(isotropic), fibres.clone()), 0.1),
        (film(None, fibres.clone()), 0.1),
        (film(None, fibres), 5.0e-4),
    ] {
        derivatives_of_a_membrane_agree(&law, size);
    }
}

fn derivatives_of_a_membrane_agree(law: &membrane::Law, size: f64) {
    let x = triangle();
    let difference = STEP.min(1.0e-4 * size);
    let geometry = MembraneGeometry::new(&x, membrane::plane_axes(&x)).unwrap();
    let deformed: [Vec3; 6] = std::array::from_fn(|a| add(x[a], shaken::<6>(size, 11)[a]));
    let resultants =
        |x: &[Vec3; 6]| std::array::from_fn(|q| law.resultant(membrane::strain(&geometry, q, x)));
    let energy = |x: &[Vec3; 6]| -> f64 {
        (0..3).map(|q| geometry.weights[q] * law.energy(membrane::strain(&geometry, q, x))).sum()
    };
    let force = |x: &[Vec3; 6]| membrane::force(&geometry, x, &resultants(x));
    let here = force(&deformed);
    let tangent = membrane::tangent(&geometry, &deformed, &resultants(&deformed), law);
    for b in 0..6 {
        for j in 0..3 {
            let at = |step: f64| {
                let mut moved = deformed;
                moved[b][j] += step;
                moved
            };
            let (up, down) = (at(difference), at(-difference));
            let slope = (energy(&up) - energy(&down)) / (2.0 * difference);
            assert!((slope - here[b][j]).abs() < 1.0e-5 * (1.0 + slope.abs()));
            let (up, down) = (force(&up), force(&down));
            for a in b..6 {
                for i in 0..3 {
                    let measured = (up[a][i] - down[a][i]) / (2.0 * difference);
                    let stated = tangent[a * (a + 1) / 2 + b][i][j];
                    assert!((measured - stated).abs() < 1.0e-5 * (1.0 + stated.abs()), "{a}{i} {b}{j}");
                }
            }
        }
    }
}

#[test]
fn membrane_strain_increment_is_linear_in_the_displacement() {
    let x = triangle();
    let geometry = MembraneGeometry::new(&x, membrane::plane_axes(&x)).unwrap();
    let du = shaken::<6>(1.0e-6, 5);
    let moved: [Vec3; 6] = std::array::from_fn(|a| add(x[a], du[a]));
    for q in 0..3 {
        let (before, after) = (membrane::strain(&geometry, q, &x), membrane::strain(&geometry, q, &moved));
        let linear = membrane::strain_increment(&geometry, q, &x, &du);
        for k in 0..3 {
            assert!((after[k] - before[k] - linear[k]).abs() < 1.0e-11);
        }
    }
}

#[test]
fn cavity_load_and_tangent_are_derivatives_of_the_volume() {
    for load in [CavityLoad::FlatFacets, CavityLoad::Consistent] {
        let x: [Vec3; 6] = std::array::from_fn(|a| add(triangle()[a], shaken::<6>(0.3, 23)[a]));
        let here = face_terms(&x, load);
        for b in 0..6 {
            for j in 0..3 {
                let at = |step: f64| {
                    let mut moved = x;
                    moved[b][j] += step;
                    face_terms(&moved, load)
                };
                let (up, down) = (at(STEP), at(-STEP));
                let slope = (up.volume_mm3 - down.volume_mm3) / (2.0 * STEP);
                assert!((slope - here.gradient[b][j]).abs() < 1.0e-7);
                for a in 0..6 {
                    let block = skew(here.hessian[a][b]);
                    for (i, row) in block.iter().enumerate() {
                        let measured = (up.gradient[a][i] - down.gradient[a][i]) / (2.0 * STEP);
                        assert!((measured + row[j]).abs() < 1.0e-7, "{load:?} {a}{i} {b}{j}");
                    }
                }
            }
        }
    }
}

#[test]
fn penalty_is_smooth_and_linear_beyond_its_rounding() {
    let w = 0.015;
    for d in [-0.02, -0.0149, -0.003, 0.0, 0.004, 0.0149, 0.2] {
        let at = |d| penalty(d, w);
        let (up, down, here) = (at(d + 1.0e-7), at(d - 1.0e-7), at(d));
        assert!(((up.energy - down.energy) / 2.0e-7 - here.force).abs() < 1.0e-8);
        assert!(((up.force - down.force) / 2.0e-7 - here.stiffness).abs() < 1.0e-5);
    }
    assert_eq!(penalty(0.2, w).force, 0.2);
    assert_eq!(penalty(-0.02, w).force, 0.0);
}

/// A rectangle of `cells x cells` cells of two triangles each: node numbers, positions in the plane, number of nodes.
/// Triangles, their corners in the plane, nodes.
type SheetGrid = (Vec<[u32; 6]>, Vec<[[f64; 2]; 6]>, usize);

fn sheet_grid(cells: usize, sides: [f64; 2]) -> SheetGrid {
    let part = |side: f64, i: usize| side * i as f64 / (2 * cells) as f64;
    let node = |i: usize, j: usize| u32::try_from(i * (2 * cells + 1) + j).unwrap();
    let mut triangles = Vec::new();
    for i in (0..2 * cells).step_by(2) {
        for j in (0..2 * cells).step_by(2) {
            for c in [[(0, 0), (2, 0), (2, 2)], [(0, 0), (2, 2), (0, 2)]] {
                let c = c.map(|(a, b)| (i + a, j + b));
                let mid = |a: usize, b: usize| ((c[a].0 + c[b].0) / 2, (c[a].1 + c[b].1) / 2);
                triangles.push([c[0], c[1], c[2], mid(0, 1), mid(1, 2), mid(2, 0)]);
            }
        }
    }
    let plane = triangles.iter().map(|t| t.map(|(i, j)| [part(sides[0], i), part(sides[1], j)])).collect();
    let nodes = triangles.iter().map(|t| t.map(|(i, j)| node(i, j))).collect();
    (nodes, plane, (2 * cells + 1) * (2 * cells + 1))
}

/// Energy is never negative, however flat the triangles are: what a grid makes of a slot between two chambers.
#[test]
fn bending_energy_is_never_negative() {
    for width in [10.0, 3.0, 1.0, 0.3] {
        let (nodes, plane, total) = sheet_grid(4, [10.0, width]);
        let entries = bending::assemble(&nodes, &plane, 1.0, 0.2, 5.0).unwrap();
        let mut matrix = faer::Mat::<f64>::zeros(total, total);
        for e in &entries {
            matrix[(e.row as usize, e.col as usize)] = e.value;
            matrix[(e.col as usize, e.row as usize)] = e.value;
        }
        let values = matrix.self_adjoint_eigenvalues(faer::Side::Lower).unwrap();
        let (least, most) = (values[0], values[total - 1]);
        println!("width {width}: eigenvalues {least:.2e} to {most:.2e}");
        assert!(least > -1.0e-10 * most, "triangles of 10 x {width} mm: {least} of {most}");
    }
}

/// Bent to a cylinder of radius R, a plate stores `D / (2 R^2)` per area whatever its mesh.
#[test]
fn bending_energy_of_a_cylinder_is_the_plate_theory_value() {
    let side = 10.0;
    let (nodes, plane, total) = sheet_grid(4, [side; 2]);
    let (stiffness, poisson, radius) = (0.56, 0.2, 400.0);
    let entries = bending::assemble(&nodes, &plane, stiffness, poisson, 5.0).unwrap();
    let mut x = vec![[0.0; 3]; total];
    for (t, p) in nodes.iter().zip(&plane) {
        for (n, p) in t.iter().zip(p) {
            let angle = p[0] / radius;
            x[*n as usize] = [radius * angle.sin(), radius * (1.0 - angle.cos()), p[1]];
        }
    }
    let mut force = vec![[0.0; 3]; total];
    bending::add_force(&entries, &x, &mut force);
    let energy: f64 = 0.5 * x.iter().zip(&force).map(|(x, f)| dot(*x, *f)).sum::<f64>();
    let expected = 0.5 * stiffness / (radius * radius) * side * side;
    assert!(super::builder::close(energy, expected, 1.0e-3), "{energy} against {expected}");
    // Flat but rotated, sheared and stretched: no bending force at all.
    for (t, p) in nodes.iter().zip(&plane) {
        for (n, p) in t.iter().zip(p) {
            x[*n as usize] = [0.66 * p[0] + 3.0, 0.8 * p[0], p[1] - 0.2 * p[0]];
        }
    }
    let mut flat = vec![[0.0; 3]; total];
    bending::add_force(&entries, &x, &mut flat);
    assert!(flat.iter().flatten().all(|f| f.abs() < 1.0e-11));
}

#[test]
fn shape_functions_sum_to_one_and_quadrature_is_exact() {
    for [r, s, _] in tri6::SIX_POINTS {
        assert!((tri6::shape(r, s).iter().sum::<f64>() - 1.0).abs() < 1.0e-14);
        let d = tri6::derivatives(r, s);
        assert!(d.iter().map(|d| d[0]).sum::<f64>().abs() < 1.0e-13);
        assert!(d.iter().map(|d| d[1]).sum::<f64>().abs() < 1.0e-13);
    }
    // integral of r^2 s^2 over the reference triangle is 1/180; the weights sum to 1 over an area of 1/2.
    let sum: f64 = tri6::SIX_POINTS.iter().map(|[r, s, w]| w * r * r * s * s).sum();
    assert!((0.5 * sum - 1.0 / 180.0).abs() < 1.0e-14);
    for q in 0..4 {
        assert!((tet10::shape(tet10::gauss_point(q)).iter().sum::<f64>() - 1.0).abs() < 1.0e-14);
    }
}

/// Extrapolation reproduces a linear field exactly.
#[test]
fn stress_extrapolation_is_exact_for_linear_fields() {
    let x = tet();
    let field = |p: Vec3| 1.0 + 2.0 * p[0] - 0.5 * p[1] + 3.0 * p[2];
    let at_gauss = std::array::from_fn(|q| {
        let mut p = [0.0; 3];
        for (n, x) in tet10::shape(tet10::gauss_point(q)).iter().zip(&x) {
            axpy(*n, *x, &mut p);
        }
        [field(p); 6]
    });
    for (value, x) in tet10::extrapolate(at_gauss).into_iter().zip(x) {
        assert!((value[4] - field(x)).abs() < 1.0e-12);
    }
}
