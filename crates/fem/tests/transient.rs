//! Motion against closed forms: fall, spin, cantilever, creep, relaxation, impact; energies; checkpoints; refusals.
//! `--nocapture` prints the figures.

use crate::builder::{Builder, close};
use crate::closed_forms::neo_hookean;
use fem::actuator::Actuator;
use fem::material::VolumeChange;
use fem::transient::{StepSettings, Trace, Transient, TransientError};
use fem::{
    BodyMass, ContactSettings, Dynamics, Load, Mesh, NewtonSettings, Obstacle, Problem, ProblemConfig,
    PronyTerm, Solver, State,
};
use std::sync::Arc;

fn problem(mesh: Mesh, density_t_per_mm3: f64, contact: ContactSettings) -> Arc<Problem> {
    let elastomers = neo_hookean(1.0, 2000.0, density_t_per_mm3, VolumeChange::Mean);
    // Far below the errors of the time integration that are measured.
    let newton = NewtonSettings { correction_tolerance_mm: 1.0e-9, ..NewtonSettings::default() };
    let config = ProblemConfig { elastomers, contact, newton, ..ProblemConfig::default() };
    Arc::new(Problem::new(mesh, config).unwrap())
}

fn undeformed(problem: &Arc<Problem>) -> State {
    Solver::new(Arc::clone(problem)).unwrap().undeformed()
}

/// Steps of one length.
fn every(step_s: f64) -> StepSettings {
    StepSettings { largest_s: step_s, smallest_s: step_s, tolerance_mm: 1.0e9 }
}

fn elastic() -> Dynamics {
    Dynamics { beta_s: 0.0, prony: Vec::new() }
}

/// A block that nothing holds, and a far one that is held.
fn loose(low: [f64; 3], high: [f64; 3], cells: [usize; 3]) -> Mesh {
    let mut b = Builder::default();
    b.solid(low, high, cells);
    let bottom = low[1] + 1.0e-9;
    b.mesh.bottom = b.faces(|p| p[1] < bottom);
    b.solid([60.0, 60.0, 60.0], [61.0, 61.0, 61.0], [1; 3]);
    b.mesh.fixed_nodes = b.nodes_where(|p| p[0] > 59.0);
    b.mesh
}

#[test]
fn loose_block_falls_as_a_rigid_body() {
    let problem = problem(loose([0.0; 3], [4.0, 2.0, 3.0], [2, 1, 1]), 1.0e-9, ContactSettings::default());
    let state = undeformed(&problem);
    let still = vec![[0.0; 3]; state.displacement_mm.len()];
    let load = Load { gravity_mm_s2: [0.0, -9810.0, 500.0], ..Load::default() };
    let start = State { load, ..state };
    let mut motion =
        Transient::released(problem, &Dynamics::default(), StepSettings::default(), start, &still).unwrap();
    motion.advance(&|_| load, 0.05).unwrap();
    let (t, free) = (0.05_f64, motion.state().displacement_mm[0]);
    assert!(close(free[1], -0.5 * 9810.0 * t * t, 1.0e-9) && close(free[2], 0.5 * 500.0 * t * t, 1.0e-9));
    let energy = motion.figures().unwrap().energy;
    assert!(
        close(energy.kinetic_mj, energy.external_mj, 1.0e-6) && energy.damping_mj.abs() < 1.0e-9,
        "{energy:?}"
    );
}

#[test]
fn spin_is_damped_by_the_turn_of_its_centrifugal_stress_alone() {
    let problem = problem(loose([-2.0; 3], [2.0, 2.0, 2.0], [1; 3]), 1.0e-9, ContactSettings::default());
    let start = undeformed(&problem);
    let spin = 100.0;
    let velocity = |p: &[f64; 3]| if p[0] < 50.0 { [-spin * p[1], spin * p[0], 0.0] } else { [0.0; 3] };
    let velocity: Vec<_> = problem.mesh().nodes_mm.iter().map(velocity).collect();
    let (beta_s, until_s) = (1.0e-4, 0.06);
    let dynamics = Dynamics { beta_s, prony: Vec::new() };
    let mut motion = Transient::released(problem, &dynamics, every(5.0e-4), start, &velocity).unwrap();
    motion.advance(&|_| Load::default(), until_s).unwrap();
    let energy = motion.figures().unwrap().energy;
    let kinetic_mj = 0.5 * 64.0e-9 * spin * spin * 16.0 / 6.0;
    // The stress balances M omega^2 x, so that the force is beta omega^2 M v: E' = -2 beta omega^2 E.
    let exact = 1.0 / (1.0 + 2.0 * beta_s * spin * spin * until_s) - 1.0;
    let found = energy.kinetic_mj / kinetic_mj;
    println!(
        "a full rotation: kinetic energy changes by {:+.3} %, closed form {:+.3} %",
        100.0 * found,
        100.0 * exact
    );
    assert!((found - exact).abs() < 0.005, "{energy:?} of {kinetic_mj}");
}

#[test]
fn cantilever_swings_at_its_frequency_and_converges_with_second_order() {
    let mut b = Builder::default();
    b.solid([0.0; 3], [24.0, 2.0, 3.0], [6, 1, 1]);
    b.mesh.fixed_nodes = b.nodes_where(|p| p[0] < 1.0e-9);
    let problem = problem(b.mesh, 1.0e-9, ContactSettings::default());
    let rest = undeformed(&problem);
    let mode = Solver::new(Arc::clone(&problem)).unwrap().vibrations(&rest, 1).unwrap().swap_remove(0);
    let frequency_hz = mode.rate_rad_s / std::f64::consts::TAU;
    // A small vibration of one degree of freedom: the tip moves as `amplitude_mm * sin(omega t)`. `closed_forms` compares the
    // eigenvalue with beam theory.
    let amplitude_mm = 0.01;
    let largest_mm = mode.shape_mm.iter().map(|shape| shape[1].abs()).fold(0.0, f64::max);
    let scale = amplitude_mm / largest_mm * mode.rate_rad_s;
    let velocity: Vec<_> = mode.shape_mm.iter().map(|shape| shape.map(|s| scale * s)).collect();
    let series = |steps: u32| {
        let step_s = 1.0 / (frequency_hz * f64::from(steps));
        let mut motion =
            Transient::released(Arc::clone(&problem), &elastic(), every(step_s), rest.clone(), &velocity)
                .unwrap();
        let start_mm = motion.figures().unwrap().tip_y_mm;
        let sign = velocity.iter().map(|v| v[1]).sum::<f64>().signum();
        let tip_mm = |k: u32| {
            motion.advance(&|_| Load::default(), f64::from(k) * step_s).unwrap();
            sign * (motion.figures().unwrap().tip_y_mm - start_mm)
        };
        (1..=steps).map(tip_mm).collect::<Vec<f64>>()
    };
    let [coarse, fine] = [32, 64].map(series);
    let error = |tips: &[f64]| {
        let exact =
            |k: usize| amplitude_mm * (std::f64::consts::TAU * (k + 1) as f64 / tips.len() as f64).sin();
        tips.iter().enumerate().map(|(k, tip)| (tip - exact(k)).abs()).fold(0.0, f64::max) / amplitude_mm
    };
    let (errors, order) = ([error(&coarse), error(&fine)], (error(&coarse) / error(&fine)).log2());
    let turn = fine.iter().rposition(|tip| *tip > 0.0).unwrap();
    let half = (turn + 1) as f64 + fine[turn] / (fine[turn] - fine[turn + 1]);
    let measured_hz = 0.5 * fine.len() as f64 * frequency_hz / half;
    println!(
        "cantilever: {measured_hz:.4} Hz in time, {frequency_hz:.4} Hz as eigenvalue; largest errors {errors:.5?} of the amplitude with 32 and 64 steps in a period, order {order:.2}"
    );
    assert!(close(measured_hz, frequency_hz, 0.005));
    assert!((1.85..2.15).contains(&order) && errors[1] < 0.01, "{errors:?}");
}

const WEIGHT: f64 = 0.3;
const TIME_S: f64 = 0.05;

fn viscous() -> Dynamics {
    Dynamics { beta_s: 0.0, prony: vec![PronyTerm { weight: WEIGHT, time_s: TIME_S }] }
}

/// A bar of 4 x 6 x 4 that hangs from its upper end, almost without inertia; it buckles at a strain of 9 %.
fn bar(bottom_mm: f64) -> Arc<Problem> {
    let mut b = Builder::default();
    b.solid([4.0, bottom_mm, 4.0], [8.0, bottom_mm + 6.0, 8.0], [1, 2, 1]);
    b.mesh.fixed_nodes = b.nodes_where(|p| p[1] > bottom_mm + 6.0 - 1.0e-9);
    b.mesh.bottom = b.faces(|p| p[1] < bottom_mm + 1.0e-9);
    let contact = ContactSettings { obstacle_penalty_mpa_per_mm: 1.0e5, ..ContactSettings::default() };
    problem(b.mesh, 1.0e-14, contact)
}

#[test]
fn hanging_bar_creeps_as_its_series() {
    let problem = bar(0.0);
    let start = undeformed(&problem);
    let h = TIME_S / 20.0;
    let mut motion = Transient::from_equilibrium(problem, &viscous(), every(h), 0.0, start).unwrap();
    let gravity = 1.0e10;
    let load_at = |t: f64| Load { gravity_mm_s2: [0.0, -gravity * (t / h).min(1.0), 0.0], ..Load::default() };
    let sag = |motion: &Transient| -motion.figures().unwrap().lowest_y_mm;
    let mut sags = Vec::new();
    for k in 1..=100 {
        motion.advance(&load_at, f64::from(k) * h).unwrap();
        sags.push(sag(&motion));
    }
    // 1 - w exp(-t / tau_c), tau_c = tau / (1 - w), averaged over the ramp.
    let (end, retardation) = (sags[99], TIME_S / (1.0 - WEIGHT));
    let ramp = retardation / h * (h / retardation).exp_m1();
    let mut worst = 0.0_f64;
    for (k, sag) in sags.iter().enumerate() {
        let exact = |k: usize| 1.0 - WEIGHT * ramp * (-(k as f64) * h / retardation).exp();
        worst = worst.max((sag / end - exact(k + 1) / exact(100)).abs());
    }
    println!("creep: largest error {worst:.2e} of the sag {end:.4} mm");
    assert!(end > 0.0005 && worst < 1.0e-3, "{worst}");
}

#[test]
fn pressed_bar_relaxes_as_its_series() {
    let problem = bar(-1.0);
    let load = |gap_mm| Load { obstacle: Obstacle::Plate { gap_mm }, ..Load::default() };
    let mut solver = Solver::new(Arc::clone(&problem)).unwrap();
    let (start, _) = solver.solve_to(&undeformed(&problem), &load(0.99)).unwrap();
    let h = TIME_S / 20.0;
    let mut motion = Transient::from_equilibrium(problem, &viscous(), every(h), 0.0, start).unwrap();
    let load_at = |t: f64| load(0.99 - 0.05 * (t / h).min(1.0));
    let (before, mut forces) = (motion.figures().unwrap().contact_force_n, Vec::new());
    for k in 1..=100 {
        motion.advance(&load_at, f64::from(k) * h).unwrap();
        forces.push(motion.figures().unwrap().contact_force_n);
    }
    // The force rises by its long-term part and an overstress that decays.
    let (end, ramp) = (forces[99] - before, TIME_S / h * (h / TIME_S).exp_m1());
    let mut worst = 0.0_f64;
    for (k, force) in forces.iter().enumerate() {
        let exact = |k: usize| 1.0 + WEIGHT / (1.0 - WEIGHT) * ramp * (-(k as f64) * h / TIME_S).exp();
        worst = worst.max(((force - before) / end - exact(k + 1) / exact(100)).abs());
    }
    println!("relaxation: largest error {worst:.2e} of the rise of the force by {end:.4} N");
    assert!(end > 0.3 && worst < 2.0e-3, "{worst} {forces:?}");
    let energy = motion.figures().unwrap().energy;
    assert!(energy.viscous_mj > 0.0 && energy.numerical_mj().abs() < 0.03 * energy.external_mj, "{energy:?}");
}

#[test]
fn impact_conserves_momentum_and_gains_no_energy() {
    let mesh = loose([4.0, 0.0, 4.0], [8.0, 2.0, 8.0], [2, 1, 2]);
    let problem = problem(mesh, 1.0e-9, ContactSettings::default());
    let load = Load { obstacle: Obstacle::Plate { gap_mm: 0.05 }, ..Load::default() };
    let start = State { load, ..undeformed(&problem) };
    let nodes = &problem.mesh().nodes_mm;
    let speed = 250.0;
    let velocity: Vec<_> =
        nodes.iter().map(|p| if p[0] < 50.0 { [0.0, -speed, 0.0] } else { [0.0; 3] }).collect();
    let h = 2.0e-5;
    let mut motion =
        Transient::released(Arc::clone(&problem), &elastic(), every(h), start, &velocity).unwrap();
    let (mut impulse, mut kinetic, mut peak) = (0.0, Vec::new(), 0.0_f64);
    let mass = 32.0e-9;
    let before = 0.5 * mass * speed * speed;
    for k in 1..=250 {
        motion.advance(&|_| load, f64::from(k) * h).unwrap();
        let figures = motion.figures().unwrap();
        impulse += h * figures.contact_force_n;
        peak = peak.max(figures.contact_force_n);
        kinetic.push(figures.energy.kinetic_mj + figures.energy.strain_mj);
        assert!(figures.contact_force_n >= 0.0);
    }
    let after: f64 = BodyMass::new(problem).times(&motion.velocity_mm_s()).iter().map(|m| m[1]).sum();
    println!(
        "impact: impulse {impulse:.4e} N s, momentum changes by {:.4e}, peak {peak:.2} N, energy {:+.3} % at most",
        after + mass * speed,
        100.0 * kinetic.iter().copied().fold(f64::MIN, f64::max) / before
    );
    assert!(impulse > mass * speed && close(impulse, after + mass * speed, 1.0e-4));
    assert!(kinetic.iter().all(|change| *change < 0.01 * before) && kinetic[249] > -0.5 * before);
    assert!(motion.figures().unwrap().contact_force_n == 0.0, "the block has left the plate");
}

/// The tiny finger over a plate, undeformed and without loads at first.
fn finger(settings: StepSettings, dynamics: &Dynamics) -> (Transient, impl Fn(f64) -> Load + use<>) {
    let actuator = Actuator::parse(&crate::actuators::tiny()).unwrap();
    let mesh = actuator.grid_mesh(9.0, 1).unwrap();
    let problem = Arc::new(Problem::new(mesh, actuator.problem_config()).unwrap());
    let trace = "t_s,pressure_mpa,gap_mm,loads.gravity_mm_s2.1\n\
                 0,0,0.3,0\n0.003,0.06,0.3,-9810\n0.006,0.06,0.2,-9810\n1,0.06,0.2,-9810\n";
    let trace = Trace::parse(trace, &actuator).unwrap();
    let load_at = move |t_s| trace.load(&actuator, t_s);
    let state = State { load: load_at(0.0), ..undeformed(&problem) };
    (Transient::from_equilibrium(problem, dynamics, settings, 0.0, state).unwrap(), load_at)
}

#[test]
fn energies_of_a_finger_balance() {
    let dynamics = Dynamics { beta_s: 5.0e-5, prony: vec![PronyTerm { weight: 0.2, time_s: 0.002 }] };
    let settings = StepSettings { largest_s: 5.0e-4, smallest_s: 3.0e-5, tolerance_mm: 4.0e-3 };
    let (mut motion, load_at) = finger(settings, &dynamics);
    let (mut external, mut worst) = (0.0_f64, 0.0_f64);
    for k in 1..=13 {
        motion.advance(&load_at, f64::from(k) * 5.0e-4).unwrap();
        let energy = motion.figures().unwrap().energy;
        external = external.max(energy.external_mj.abs());
        worst = worst.max(energy.numerical_mj().abs());
    }
    let (figures, work) = (motion.figures().unwrap(), motion.work());
    let energy = figures.energy;
    println!(
        "finger: numerical dissipation {:.3} % of {external:.4} mJ, {energy:?}, {work:?}",
        100.0 * worst / external
    );
    assert!(worst < 0.01 * external && figures.contact_force_n > 0.0, "{worst} of {external}, {figures:?}");
}

#[test]
fn pressures_of_further_cavities_change_in_a_trace() {
    let actuator = Actuator::parse(&crate::actuators::two_sided()).unwrap();
    let trace = "t_s,pressure_mpa,pressure_mpa.lower\n0,0,0.01\n0.003,0.04,0.01\n0.006,0.04,0.05\n";
    let trace = Trace::parse(trace, &actuator).unwrap();
    assert_eq!(trace.settings, [("pressure_mpa.lower".to_owned(), 0.01)]);
    assert!(close(trace.at(0.0045).cavities_change_mpa[0], 0.02, 1.0e-12));
    let load = trace.load(&actuator, 0.006);
    assert!(close(load.cavities_change_mpa[0], 0.04, 1.0e-12) && close(load.pressure_mpa, 0.04, 1.0e-12));
    let bad = Trace::parse("t_s,pressure_mpa,pressure_mpa.lower\n0,0,0\n1,0,-0.1\n", &actuator).unwrap_err();
    assert!(bad[0].to_string().contains("0 to 10 MPa"), "{bad:?}");
}

/// The second chamber of a bar is inflated from a pressure at rest: its work is in the balance.
#[test]
fn work_of_a_further_cavity_is_in_the_balance_of_energy() {
    let problem = crate::parts::bar_of_two(0.002);
    let load_at = |t_s: f64| {
        let mut load = Load { pressure_mpa: 0.5 * t_s, ..Load::default() };
        load.cavities_change_mpa[0] = 2.0 * t_s;
        load
    };
    let mut solver = Solver::new(Arc::clone(&problem)).unwrap();
    let start = solver.undeformed();
    let state = solver.solve_to(&start, &load_at(0.0)).unwrap().0;
    let dynamics = Dynamics { beta_s: 5.0e-5, prony: Vec::new() };
    let settings = StepSettings { largest_s: 2.5e-4, smallest_s: 3.0e-5, tolerance_mm: 4.0e-3 };
    let mut motion = Transient::from_equilibrium(problem, &dynamics, settings, 0.0, state).unwrap();
    motion.advance(&load_at, 0.004).unwrap();
    let energy = motion.figures().unwrap().energy;
    println!("two chambers: {energy:?}, left {} mJ", energy.numerical_mj());
    assert!(
        energy.external_mj > 0.0 && energy.numerical_mj().abs() < 0.02 * energy.external_mj,
        "{energy:?}"
    );
}

#[test]
fn motion_continues_from_a_checkpoint_with_the_same_bits() {
    let problem = bar(-1.0);
    let load_at = |t: f64| Load {
        obstacle: Obstacle::Plate { gap_mm: 1.05 - 30.0 * t },
        gravity_mm_s2: [1.0e9, 0.0, 0.0],
        ..Load::default()
    };
    let begin = || {
        let start = State { load: load_at(0.0), ..undeformed(&problem) };
        Transient::from_equilibrium(Arc::clone(&problem), &viscous(), StepSettings::default(), 0.0, start)
            .unwrap()
    };
    let (mut whole, mut again) = (begin(), begin());
    whole.advance(&load_at, 0.002).unwrap();
    let values = whole.checkpoint();
    assert!(again.restore(&values, &load_at) && again.t_s().total_cmp(&0.002).is_eq());
    for motion in [&mut whole, &mut again] {
        motion.advance(&load_at, 0.005).unwrap();
    }
    assert!(whole.state() == again.state() && whole.figures() == again.figures());
    assert!(whole.figures().unwrap().contact_force_n > 0.0);
    assert!(!again.restore(&values[1..], &load_at));
}

#[test]
fn motions_without_mass_or_resolution_are_refused() {
    let (problem, still) = (bar(0.0), elastic());
    let start = |problem: &Arc<Problem>, settings| {
        Transient::from_equilibrium(Arc::clone(problem), &still, settings, 0.0, undeformed(problem))
    };
    let weightless = self::problem(problem.mesh().clone(), 0.0, ContactSettings::default());
    assert!(matches!(start(&weightless, every(1.0e-3)), Err(TransientError::Density(_))));
    assert!(matches!(start(&problem, every(1.0e-9)), Err(TransientError::Setting { .. })));
    let fast = start(&problem, every(1.0e-3)).unwrap();
    let Err(TransientError::Unresolved { frequency_hz, longest_s, .. }) = fast.check_resolution() else {
        panic!("a bar without inertia is faster than any step");
    };
    assert!(close(frequency_hz * longest_s, 0.1, 1.0e-9) && longest_s < 1.0e-3);
}

#[test]
fn traces_are_checked_and_interpolated() {
    let actuator = Actuator::parse(&crate::actuators::tiny()).unwrap();
    let bad = |text: &str, part: &str| {
        let found = Trace::parse(text, &actuator).unwrap_err();
        assert!(found.iter().any(|d| d.to_string().contains(part)), "{text}: {found:?}");
    };
    bad("t_s,pressure_mpa\n0,0.01\n", "at least two");
    bad("t_s,pressure_mpa\n0,0.01\n0.1,0.02\n0.05,0.03\n", "after the row before");
    bad("t_s,pressure_mpa\n0,0.01\n0,0.02\n", "after the row before");
    bad("t_s,pressure_mpa\n0,0.01\n0.1,-0.02\n", "0 to 10 MPa");
    bad("t_s,pressure_mpa\n0,0.01\n0.1,60\n", "0 to 10 MPa");
    bad("t_s,pressure_mpa\n0,0.01\n0.1,nan\n", "a finite number");
    bad("t_s,pressure_mpa,gap_mm\n0,0.01,40\n0.1,0.02,\n", "in every row or in none");
    bad("t_s,pressure_mpa,gap_mm\n0,0.01,-1\n0.1,0.02,-1\n", "outside the body");
    bad("t_s,pressure_mpa,weather\n0,0.01,1\n0.1,0.02,1\n", "weather");
    bad("t_s,pressure_mpa,elastomer.law.mu_mpa\n0,0.01,0.8\n0.1,0.02,0.7\n", "of the first row");
    bad("t_s,gap_mm\n0,40\n1,40\n", "pressure_mpa");
    let text = "t_s,pressure_mpa,gap_mm,loads.gravity_mm_s2.0,elastomer.law.mu_mpa,tip_x_mm\n\
                1,0.02,50,0,0.7,9\n1.01,0.04,40,100,0.7,9\n4,0.04,40,100,0.7,9\n";
    let trace = Trace::parse(text, &actuator).unwrap();
    let middle = trace.at(1.005);
    assert!(close(middle.pressure_mpa, 0.03, 1.0e-9) && close(middle.gap_mm.unwrap(), 45.0, 1.0e-9));
    assert!(close(middle.gravity_mm_s2[0], 50.0, 1.0e-9) && close(middle.gravity_mm_s2[1], -9810.0, 1.0e-12));
    assert_eq!(trace.settings, [("elastomer.law.mu_mpa".to_owned(), 0.7)]);
    assert!((trace.at(0.0).pressure_mpa, trace.at(9.0).pressure_mpa) == (0.02, 0.04));
    let instants = trace.instants(&[1.001], 0.002);
    assert!(
        instants.len() == 1502 && instants.windows(2).all(|w| w[1] - w[0] < 0.002 + 1.0e-9),
        "{}",
        instants.len()
    );
    let [(begin_s, length_s)] = trace.long_intervals()[..] else { panic!("one interval is longer than 1 s") };
    assert!(close(begin_s, 1.01, 1.0e-12) && close(length_s, 2.99, 1.0e-9));
}

#[test]
fn constants_of_motion_are_checked() {
    let with = |key: &str, value: &str| {
        Actuator::parse(&crate::actuators::with(&crate::actuators::tiny(), "dynamics", key, value))
    };
    let bad = |key: &str, value: &str, part: &str| {
        let found = with(key, value).unwrap_err();
        assert!(found.iter().any(|d| d.to_string().contains(part)), "{value}: {found:?}");
    };
    bad("beta_s", "-0.001", "0 to 1 s");
    bad("prony", "[{ weight = 0.6, time_s = 0.1 }, { weight = 0.4, time_s = 1.0 }]", "below 1");
    bad("prony", "[{ weight = 0.6, time_s = -0.1 }]", "above 0 s");
    bad("prony", "[{ weight = -0.6, time_s = 0.1 }]", "above 0");
    let plain = Actuator::parse(&crate::actuators::tiny()).unwrap();
    assert!(
        plain.dynamics == Dynamics::default()
            && close(plain.quantity("dynamics.beta_s").unwrap(), 0.002, 1e-12)
    );
    let given = with("prony", "[{ weight = 0.2, time_s = 0.05 }]").unwrap();
    assert_eq!(given.dynamics.prony, [PronyTerm { weight: 0.2, time_s: 0.05 }]);
    let changed = given.with(&[("dynamics.prony.0.weight".into(), 0.3)]).unwrap();
    assert!(close(changed.dynamics.prony[0].weight, 0.3, 1.0e-12));
}
