//! Patch test of bonded materials.

use super::builder::Builder;
use crate::algebra::{Mat3, Vec3, det_inv_transpose, dot, mat_vec, norm};
use crate::material::{Elastomer, Hyperelastic, VolumeChange};
use crate::system::{Ahead, System};
use crate::{Load, Problem, ProblemConfig, State};

/// First Piola-Kirchhoff stress of a neo-Hookean solid at the gradient `f`.
fn piola(mu: f64, bulk: f64, f: &Mat3) -> Mat3 {
    let (det, inverse) = det_inv_transpose(f);
    let shear = mu * det.powf(-2.0 / 3.0);
    let trace: f64 = f.iter().flatten().map(|v| v * v).sum();
    let along = bulk * (det - 1.0) * det - shear * trace / 3.0;
    std::array::from_fn(|i| std::array::from_fn(|j| shear * f[i][j] + along * inverse[i][j]))
}

/// Two bonded materials, each homogeneously deformed, with equal displacement and traction at the interface y = 1.
#[test]
fn bonded_materials_pass_the_patch_test() {
    let solid = |mu_mpa, bulk_mpa, volume_change| Elastomer {
        law: Hyperelastic::NeoHookean { mu_mpa },
        bulk_mpa,
        density_t_per_mm3: 0.0,
        volume_change,
        stretch_range: None,
        shear_interval_mpa: None,
    };
    let soft = solid(0.05, 50.0, VolumeChange::Mean);
    for stiff in [
        solid(5.0, 500.0, VolumeChange::Mean),
        solid(1300.0, 4200.0, VolumeChange::Mean),
        solid(1300.0, 4200.0, VolumeChange::Points),
        solid(0.01, 20.0, VolumeChange::Mean),
    ] {
        let mut b = Builder::default();
        b.solid([0.0; 3], [2.0; 3], [2, 2, 2]);
        let above = |b: &Builder, tet: &[u32; 10]| {
            tet[..4].iter().map(|n| b.mesh.nodes_mm[*n as usize][1]).sum::<f64>() > 4.0
        };
        b.mesh.tet_material = b.mesh.tets.iter().map(|tet| u16::from(above(&b, tet))).collect();
        b.mesh.fixed_nodes = vec![0];
        let elastomers = vec![soft, stiff];
        let problem =
            Problem::new(b.mesh, ProblemConfig { elastomers, sheet: None, ..ProblemConfig::default() })
                .unwrap();
        let of = |e: &Elastomer, f: &Mat3| piola(e.law.shear_modulus_mpa(), e.bulk_mpa, f);
        // The jump of the gradient is `a n`; Newton's method with differences finds the `a` of equal tractions.
        let below: Mat3 = [[1.02, 0.01, -0.02], [0.03, 0.98, 0.01], [-0.01, 0.02, 1.01]];
        let upper = |a: Vec3| -> Mat3 {
            std::array::from_fn(|i| std::array::from_fn(|j| below[i][j] + if j == 1 { a[i] } else { 0.0 }))
        };
        let jump = |a: Vec3| -> Vec3 {
            let (p, q) = (of(&stiff, &upper(a)), of(&soft, &below));
            std::array::from_fn(|i| p[i][1] - q[i][1])
        };
        let mut a = [0.0; 3];
        for _ in 0..60 {
            let step = 1.0e-7;
            let columns: Mat3 = std::array::from_fn(|j| {
                let side =
                    |sign: f64| jump(std::array::from_fn(|i| a[i] + if i == j { sign * step } else { 0.0 }));
                let (up, down) = (side(1.0), side(-1.0));
                std::array::from_fn(|i| (up[i] - down[i]) / (2.0 * step))
            });
            // Rows of the inverse transpose of the columns as rows solve `J da = -r`.
            let (_, rows) = det_inv_transpose(&columns);
            let r = jump(a);
            a = std::array::from_fn(|k| a[k] - dot(rows[k], r));
        }
        let at = |x: &Vec3| -> Vec3 {
            let base = mat_vec(&below, *x);
            std::array::from_fn(|i| base[i] - x[i] + a[i] * (x[1] - 1.0).max(0.0))
        };
        let u: Vec<Vec3> = problem.mesh().nodes_mm.iter().map(at).collect();
        let state = State {
            displacement_mm: u,
            element_pressure_mpa: vec![0.0; problem.mesh().tets.len()],
            ..State::default()
        };
        let mut system = System::new(&problem);
        system.assemble(&problem, &state, &Load::default(), Ahead::default(), false).unwrap();
        // Residuals with the pressures that follow from the displacements.
        let forces = system.condensed;
        let scale_n = forces.iter().map(|f| norm(*f)).fold(0.0, f64::max);
        let inside = |x: &Vec3| x.iter().all(|v| *v > 1.0e-6 && *v < 2.0 - 1.0e-6);
        let inner = problem.mesh().nodes_mm.iter().zip(&forces).filter(|(x, _)| inside(x));
        let worst = inner.map(|(_, f)| norm(*f)).fold(0.0, f64::max) / scale_n;
        println!("soft and {stiff:?}: largest force inside {worst:.1e} of that on the boundary");
        assert!(worst < 1.0e-6, "{worst}");
    }
}
