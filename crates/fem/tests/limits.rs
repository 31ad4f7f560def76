//! Volume as the given quantity, and paths through limits of the pressure: a thick-walled balloon against its closed form.

use crate::builder::close;
use crate::closed_forms::{hollow_sphere, sphere_pressure};
use fem::material::Hyperelastic;
use fem::{LimitKind, Load, NewtonError, PathSettings, SolveError, Solver, State, limits};
use rom::memory::ATMOSPHERE_MPA;
use std::f64::consts::PI;
use std::sync::Arc;

const MU: f64 = 0.8;
const NEO_HOOKE: Hyperelastic = Hyperelastic::NeoHookean { mu_mpa: MU };

fn balloon(cells: usize, law: Hyperelastic) -> (Solver, State) {
    let solver = Solver::new(Arc::new(hollow_sphere(cells, law))).unwrap();
    let start = solver.undeformed();
    (solver, start)
}

/// Injected volume at which the inner radius of 1 mm has grown by `stretch`.
fn volume_mm3(stretch: f64) -> f64 {
    4.0 / 3.0 * PI * (stretch.powi(3) - 1.0)
}

fn injected(volume_mm3: f64) -> Load {
    Load { injected_mm3: Some(volume_mm3), ..Load::default() }
}

#[test]
fn balloon_at_given_volumes_has_the_pressures_of_the_closed_form() {
    for (cells, bound) in [(4, 0.08), (8, 0.02)] {
        let (mut solver, mut state) = balloon(cells, NEO_HOOKE);
        for stretch in [1.3, 1.8, 2.2] {
            let report;
            (state, report) = solver.solve_to(&state, &injected(volume_mm3(stretch))).unwrap();
            let exact = sphere_pressure(MU, 1.0, 2.0, stretch);
            let error = state.load.pressure_mpa / exact - 1.0;
            println!(
                "{cells} cells, stretch {stretch}: {:.4} MPa, error {:.2} %, {report:?}",
                state.load.pressure_mpa,
                100.0 * error
            );
            assert!(error.abs() < bound, "{error}");
            assert!(close(solver.injected_mm3(&state), volume_mm3(stretch), 1e-6));
        }
    }
}

#[test]
fn given_pressure_finds_the_state_of_the_given_volume_below_the_limit() {
    let (mut solver, start) = balloon(4, NEO_HOOKE);
    let (by_volume, _) = solver.solve_to(&start, &injected(volume_mm3(1.4))).unwrap();
    let load = Load { injected_mm3: None, ..by_volume.load };
    let (by_pressure, _) = solver.solve_to(&start, &load).unwrap();
    let apart = by_volume.displacement_mm.iter().flatten().zip(by_pressure.displacement_mm.iter().flatten());
    let apart = apart.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart < 1.0e-6, "{apart} mm apart");
}

#[test]
fn path_lists_the_limit_of_the_balloon_and_loses_stability_there() {
    let (mut solver, start) = balloon(4, NEO_HOOKE);
    let settings = PathSettings { end_mm3: volume_mm3(2.2), points: 12 };
    let path = solver.path(&start, settings, &mut |_| {}).unwrap();
    let found = limits(&path.points);
    println!("{found:?}, {:?}", path.report);
    assert!(
        path.ended.is_none() && found.len() == 1 && found[0].kind == LimitKind::PressureMaximum,
        "{found:?}"
    );
    assert_eq!(found[0].next_injected_mm3, None);
    let exact = (120..220).map(|k| sphere_pressure(MU, 1.0, 2.0, 0.01 * f64::from(k))).fold(0.0, f64::max);
    assert!(close(found[0].pressure_mpa, exact, 0.08), "{} against {exact}", found[0].pressure_mpa);
    for (k, point) in path.points.iter().enumerate() {
        assert_eq!(point.is_stable_at_pressure(), k <= found[0].after);
        assert!(point.is_stable_at_volume());
    }
    // The slope of the path is the derivative of the volume.
    let [a, b] = [1, 5].map(|k| &path.points[k]);
    for point in [a, b] {
        let step = 1.0e-3;
        let at = |solver: &mut Solver, d: f64| {
            solver.solve_to(&point.state, &injected(point.injected_mm3 + d)).unwrap().0.load.pressure_mpa
        };
        let slope = 2.0 * step / (at(&mut solver, step) - at(&mut solver, -step));
        assert!(close(point.compliance_mm3_per_mpa, slope, 1e-4), "{slope} {}", point.compliance_mm3_per_mpa);
    }
    // At given pressure the limit ends the way, and is named.
    let load = Load { pressure_mpa: 1.1 * found[0].pressure_mpa, ..Load::default() };
    let Err(SolveError::NotConverged(stopped)) = solver.solve_to(&start, &load) else { panic!("no limit") };
    println!("{stopped}, {:?}", stopped.report);
    let NewtonError::Limit { pressure_mpa, injected_mm3, next_injected_mm3: None, .. } = stopped.reason
    else {
        panic!("{stopped}")
    };
    assert!(
        close(pressure_mpa, found[0].pressure_mpa, 1e-6) && close(injected_mm3, found[0].injected_mm3, 1e-3)
    );
    // Who does not ask for a state behind the limit gets the same limit for less.
    solver.searches_behind_limits = false;
    let Err(SolveError::NotConverged(at_limit)) = solver.solve_to(&start, &load) else { panic!("no limit") };
    println!("{at_limit}, {:?}", at_limit.report);
    let NewtonError::Limit { pressure_mpa, next_injected_mm3: None, .. } = at_limit.reason else {
        panic!("{at_limit}")
    };
    assert!(close(pressure_mpa, found[0].pressure_mpa, 1e-3), "{pressure_mpa}");
    assert!(2 * at_limit.report.factorisations < stopped.report.factorisations, "{:?}", at_limit.report);
}

#[test]
fn stiffening_balloon_snaps_to_a_stable_state_and_back() {
    let (mut solver, start) = balloon(4, Hyperelastic::Gent { mu_mpa: MU, jm: 30.0 });
    let settings = PathSettings { end_mm3: volume_mm3(4.0), points: 24 };
    let path = solver.path(&start, settings, &mut |_| {}).unwrap();
    let found = limits(&path.points);
    println!("{found:?}, {:?}", path.report);
    let [most, least] = found[..] else { panic!("{found:?}") };
    assert_eq!((most.kind, least.kind), (LimitKind::PressureMaximum, LimitKind::PressureMinimum));
    // Beyond the maximum the next stable state has that pressure again, and the jump back goes to another volume.
    let forth = most.next_injected_mm3.unwrap();
    assert!(least.next_injected_mm3.unwrap() < most.injected_mm3 && forth > least.injected_mm3);
    let near = path.points.iter().rfind(|point| point.injected_mm3 < forth).unwrap();
    let (state, _) =
        solver.solve_to(&near.state, &Load { pressure_mpa: most.pressure_mpa, ..Load::default() }).unwrap();
    assert!(near.is_stable_at_pressure() && close(solver.injected_mm3(&state), forth, 1e-3), "{forth}");
    // Given pressures name both limits with the state that each jumps to.
    for (limit, from, factor, next) in
        [(most, &path.points[0], 1.1, forth), (least, near, 0.5, least.next_injected_mm3.unwrap())]
    {
        let load = Load { pressure_mpa: factor * limit.pressure_mpa, ..Load::default() };
        let Err(SolveError::NotConverged(stopped)) = solver.solve_to(&from.state, &load) else {
            panic!("no limit")
        };
        println!("{stopped}, {:?}", stopped.report);
        let NewtonError::Limit { pressure_mpa, next_injected_mm3: Some(found), .. } = stopped.reason else {
            panic!("{stopped}")
        };
        assert!(close(pressure_mpa, limit.pressure_mpa, 1e-3) && close(found, next, 5e-3), "{found} {next}");
    }
}

#[test]
fn gas_in_balloon_and_supply_has_the_pressure_of_both_closed_forms() {
    let (mut solver, start) = balloon(4, NEO_HOOKE);
    let undeformed_mm3 = solver.problem().undeformed_volume_mm3();
    for (dead_mm3, amount_mm3) in [(0.0, 20.0), (100.0, 500.0), (100.0, 760.0)] {
        let load = Load { dead_mm3: Some(dead_mm3), ..injected(amount_mm3) };
        let (state, report) = solver.solve_to(&start, &load).unwrap();
        // Boyle's law holds to rounding; the equilibrium is that of the volume found.
        let (pressure_mpa, volume_mm3) = (state.load.pressure_mpa, solver.injected_mm3(&state));
        let space_mm3 = undeformed_mm3 + dead_mm3;
        let product = (pressure_mpa + ATMOSPHERE_MPA) * (space_mm3 + volume_mm3);
        assert!(close(product, ATMOSPHERE_MPA * (space_mm3 + amount_mm3), 1e-7), "{report:?}");
        let (of_volume, _) = solver.solve_to(&start, &injected(volume_mm3)).unwrap();
        assert!(close(of_volume.load.pressure_mpa, pressure_mpa, 1e-6));
        // Both closed forms: the stretch at which the sphere has the pressure of its gas.
        let excess = |stretch: f64| {
            let space_mm3 = 4.0 / 3.0 * PI + dead_mm3;
            let gas_mpa = ATMOSPHERE_MPA * (space_mm3 + amount_mm3) / (space_mm3 + self::volume_mm3(stretch));
            sphere_pressure(MU, 1.0, 2.0, stretch) + ATMOSPHERE_MPA - gas_mpa
        };
        let (mut low, mut high) = (1.0, 4.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if excess(middle) < 0.0 { low = middle } else { high = middle }
        }
        let exact = sphere_pressure(MU, 1.0, 2.0, low);
        println!(
            "{dead_mm3} mm3, {amount_mm3} mm3 of gas: {pressure_mpa:.4} MPa, exact {exact:.4}, {report:?}"
        );
        assert!(close(pressure_mpa, exact, 0.08));
    }
    let load = Load { dead_mm3: Some(-1.0), ..injected(1.0) };
    assert!(matches!(solver.solve_to(&start, &load), Err(SolveError::Load { name: "dead_mm3", .. })));
}
