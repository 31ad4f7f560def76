//! Whole problems against closed forms: an inflated block, a cantilever. `--nocapture` prints the figures.

use std::sync::Arc;

use crate::builder::{Builder, close};
use fem::material::{Elastomer, Hyperelastic, VolumeChange};
use fem::{BodyMass, CavityLoad, Load, NewtonSettings, Problem, ProblemConfig, Solver};

/// One elastomer for the whole mesh.
pub fn neo_hookean(
    mu_mpa: f64,
    bulk_mpa: f64,
    density_t_per_mm3: f64,
    volume_change: VolumeChange,
) -> Vec<Elastomer> {
    elastomer(Hyperelastic::NeoHookean { mu_mpa }, bulk_mpa, density_t_per_mm3, volume_change)
}

fn elastomer(
    law: Hyperelastic,
    bulk_mpa: f64,
    density_t_per_mm3: f64,
    volume_change: VolumeChange,
) -> Vec<Elastomer> {
    let (stretch_range, shear_interval_mpa) = (None, None);
    vec![Elastomer { law, bulk_mpa, density_t_per_mm3, volume_change, stretch_range, shear_interval_mpa }]
}

/// A cube of side 4 with a hole of side 2, its nodes moved so that both become spheres of radius 2 and 1; held at one
/// small triangle of its skin.
pub fn hollow_sphere(cells: usize, law: Hyperelastic) -> Problem {
    let mut b = Builder::default();
    let hole = cells / 2 - cells / 4..cells / 2 + cells / 4;
    let inside = |c: [usize; 3]| c.iter().all(|i| hole.contains(i));
    b.cells([-2.0; 3], [2.0; 3], [cells; 3], |c| !inside(c));
    b.mesh.cavity = b.faces(|p| p.iter().all(|v| v.abs() < 1.0 + 1.0e-9));
    let skin = b.faces(|p| p[0] > 2.0 - 1.0e-9);
    b.mesh.fixed_nodes = skin[skin.len() / 2][..3].to_vec();
    for p in &mut b.mesh.nodes_mm {
        let reach = p.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let norm = p.iter().map(|v| v * v).sum::<f64>().sqrt();
        *p = p.map(|v| v * reach / norm);
    }
    let elastomers = elastomer(law, 2000.0 * law.shear_modulus_mpa(), 0.0, VolumeChange::Mean);
    // The residual that is asked for below is far under that of the default tolerance.
    let newton = NewtonSettings { correction_tolerance_mm: 1.0e-5, ..NewtonSettings::default() };
    let config =
        ProblemConfig { elastomers, cavity_load: CavityLoad::Consistent, newton, ..ProblemConfig::default() };
    Problem::new(b.mesh, config).unwrap()
}

/// Pressure of a neo-Hookean incompressible sphere whose inner radius has grown by `stretch`.
pub fn sphere_pressure(mu: f64, inner: f64, outer: f64, stretch: f64) -> f64 {
    let grown = (inner * stretch).powi(3) - inner.powi(3);
    let out = (outer.powi(3) + grown).cbrt() / outer;
    let term = |l: f64| 1.0 / l + 0.25 / l.powi(4);
    2.0 * mu * (term(out) - term(stretch))
}

/// Growth of the cavity's volume when the block is inflated.
fn growth(cells: usize, mu: f64, pressure_mpa: f64) -> f64 {
    let mut solver =
        Solver::new(Arc::new(hollow_sphere(cells, Hyperelastic::NeoHookean { mu_mpa: mu }))).unwrap();
    let start = solver.undeformed();
    let before = solver.output(&start).cavity_volume_mm3;
    let (state, report) = solver.solve_to(&start, &Load { pressure_mpa, ..Load::default() }).unwrap();
    assert!(report.residual_n < 1.0e-6, "{report:?}");
    solver.output(&state).cavity_volume_mm3 / before
}

#[test]
fn inflated_sphere_converges_to_the_closed_form() {
    let (mu, stretch) = (0.8, 1.3_f64);
    let pressure_mpa = sphere_pressure(mu, 1.0, 2.0, stretch);
    let exact = stretch.powi(3) - 1.0;
    let error = |cells| (growth(cells, mu, pressure_mpa) - 1.0) / exact - 1.0;
    let (coarse, fine) = (error(4), error(8));
    println!(
        "inflated sphere, {pressure_mpa:.4} MPa: growth of the cavity off by {:+.2} % and {:+.2} % on twice as many cells",
        100.0 * coarse,
        100.0 * fine
    );
    assert!(fine.abs() < 0.02 && fine.abs() < 0.5 * coarse.abs(), "errors {coarse:.4} and {fine:.4}");
}

/// Tip of a square beam under its own weight, and what beam theory with shear says.
fn cantilever(cells: [usize; 3], bulk: f64, volume_change: VolumeChange) -> (f64, f64) {
    let (length, side, mu) = (24.0, 2.0, 1.0);
    let mut b = Builder::default();
    b.solid([0.0; 3], [length, side, side], cells);
    b.mesh.fixed_nodes = b.nodes_where(|p| p[0] < 1.0e-9);
    let density = 1.0e-9;
    let elastomers = neo_hookean(mu, bulk, density, volume_change);
    let problem = Problem::new(b.mesh, ProblemConfig { elastomers, ..ProblemConfig::default() }).unwrap();
    let mut solver = Solver::new(Arc::new(problem)).unwrap();
    let gravity = 500.0;
    let (state, report) = solver.gravity_equilibrium([0.0, -gravity, 0.0]).unwrap();
    assert!(report.residual_n < 1.0e-9 && report.steps == 3, "{report:?}");
    let youngs = 9.0 * bulk * mu / (3.0 * bulk + mu);
    let load = density * gravity * side * side;
    let bending = load * length.powi(4) / (8.0 * youngs * side.powi(4) / 12.0);
    let shear = load * length * length / (2.0 * (5.0 / 6.0) * mu * side * side);
    let tip = state.displacement_mm.iter().map(|u| -u[1]).fold(0.0, f64::max);
    (tip, bending + shear)
}

#[test]
fn cantilever_converges_to_beam_theory() {
    let with = |cells| cantilever(cells, 2000.0, VolumeChange::Mean);
    let (coarse, theory) = with([8, 1, 1]);
    let (middle, _) = with([16, 2, 2]);
    let (fine, _) = with([24, 3, 3]);
    println!(
        "cantilever: sag {coarse:.5}, {middle:.5}, {fine:.5} mm on finer and finer meshes, beam theory {theory:.5} mm"
    );
    assert!(close(fine, theory, 0.03), "{fine} against {theory}");
    assert!((fine - middle).abs() < 0.5 * (middle - coarse).abs(), "{coarse} {middle} {fine}");
}

#[test]
fn cantilever_vibrates_at_the_frequency_of_beam_theory() {
    let (length, side, mu, density_t_per_mm3) = (24.0_f64, 2.0, 1.0, 1.0e-9);
    let mut b = Builder::default();
    b.solid([0.0; 3], [length, side, side], [24, 3, 3]);
    b.mesh.fixed_nodes = b.nodes_where(|p| p[0] < 1.0e-9);
    let elastomers = neo_hookean(mu, 2000.0, density_t_per_mm3, VolumeChange::Mean);
    let problem = Problem::new(b.mesh, ProblemConfig { elastomers, ..ProblemConfig::default() }).unwrap();
    let problem = Arc::new(problem);
    let mass = BodyMass::new(Arc::clone(&problem));
    let total_t: f64 = mass.node_mass_t().iter().sum();
    assert!(close(total_t, density_t_per_mm3 * length * side * side, 1e-9), "{total_t}");
    let mut solver = Solver::new(problem).unwrap();
    let found = solver.vibrations(&solver.undeformed(), 3).unwrap();
    for vibration in &found {
        let weighted = mass.times(&vibration.shape_mm);
        let pairs = weighted.iter().flatten().zip(vibration.shape_mm.iter().flatten());
        assert!(close(pairs.map(|(m, x)| m * x).sum(), 1.0, 1e-9));
    }
    let line = 3.0 * mu * side.powi(4) / 12.0 / (density_t_per_mm3 * side * side * length.powi(4));
    let theory = 1.8751_f64.powi(2) * line.sqrt();
    let rates = [0, 1, 2].map(|k| found[k].rate_rad_s);
    println!("cantilever: {rates:?} rad/s, beam theory {theory} rad/s");
    assert!(close(rates[0], theory, 0.03) && close(rates[1], rates[0], 0.01), "{rates:?} {theory}");
    assert!(rates[2] > 4.0 * rates[0], "{rates:?}");
}

#[test]
fn compressible_cantilever_is_closer_to_beam_theory_with_point_pressures() {
    let off = |cells, volume_change| {
        let (sag, theory) = cantilever(cells, 10.0, volume_change);
        sag / theory - 1.0
    };
    let (mean, points) = (off([8, 1, 1], VolumeChange::Mean), off([8, 1, 1], VolumeChange::Points));
    let fine = off([16, 2, 2], VolumeChange::Points);
    println!(
        "K = 10 shear moduli: {mean:+.4} with one pressure an element, {points:+.4} with four, {fine:+.4} on a finer mesh"
    );
    assert!(points.abs() < 0.5 * mean.abs() && fine.abs() < 0.5 * points.abs(), "{mean} {points} {fine}");
}
