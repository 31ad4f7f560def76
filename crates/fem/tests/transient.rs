//! Motion against closed forms: fall, spin, cantilever, creep, relaxation, impact; energies; checkpoints; refusals.
//! `--nocapture` prints the figures.

use crate::builder::{Builder, close};
use fem::actuator::Actuator;
use fem::material::{Elastomer, Hyperelastic, VolumeChange};
use fem::transient::{StepSettings, Trace, Transient, TransientError};
use fem::{
    ContactSettings, Dynamics, Load, Mesh, NewtonSettings, Obstacle, Problem, ProblemConfig, PronyTerm,
    Solver, State,
};
use std::sync::Arc;

fn problem(mesh: Mesh, density_t_per_mm3: f64, contact: ContactSettings) -> Arc<Problem> {
    let law = Hyperelastic::NeoHookean { mu_mpa: 1.0 };
    let volume_change = VolumeChange::Mean;
    let elastomers = vec![Elastomer { law, bulk_mpa: 2000.0, density_t_per_mm3, volume_change }];
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
    let (length, height, width) = (24.0, 2.0, 3.0);
    let beam = |cells| {
        let mut b = Builder::default();
        b.solid([0.0; 3], [length, height, width], cells);
        b.mesh.fixed_nodes = b.nodes_where(|p| p[0] < 1.0e-9);
        problem(b.mesh, 1.0e-9, ContactSettings::default())
    };
    let load = Load { gravity_mm_s2: [0.0, -2000.0, 0.0], ..Load::default() };
    let begin = |problem: &Arc<Problem>, step_s| {
        let state = State { load, ..undeformed(problem) };
        let still = vec![[0.0; 3]; state.displacement_mm.len()];
        Transient::released(Arc::clone(problem), &elastic(), every(step_s), state, &still).unwrap()
    };
    let eigenvalue_hz = |problem| begin(problem, 1.0e-3).lowest_frequency_hz().unwrap().unwrap();
    let (problem, fine) = (beam([6, 1, 1]), beam([16, 2, 2]));
    let fine_hz = eigenvalue_hz(&fine);
    let frequency_hz = eigenvalue_hz(&problem);
    let start = |step_s| begin(&problem, step_s);
    // Euler and Bernoulli's, with Timoshenko's first-order correction for shear and rotary inertia.
    let (youngs, inertia) = (3.0, height * height / 12.0);
    let slender = 1.875_104_f64.powi(2) / length.powi(2) * (youngs * inertia / 1.0e-9).sqrt();
    let correction = 1.0 + 0.5 * inertia / length.powi(2) * (4.65 + 3.0 * 1.2 * 3.52);
    let theory_hz = slender / correction / std::f64::consts::TAU;
    let tip = |motion: &Transient| motion.figures().unwrap().tip_y_mm;
    // A load that rises smoothly: a sudden one moves modes that no step resolves.
    let rising = |t: f64| {
        let part = 0.5 - 0.5 * (std::f64::consts::TAU * frequency_hz * t).cos();
        Load { gravity_mm_s2: [0.0, -2000.0 * part, 0.0], ..Load::default() }
    };
    let at = |steps: f64| {
        let (until_s, state) = (0.8 / frequency_hz, undeformed(&problem));
        let settings = every(until_s / steps);
        let mut motion =
            Transient::from_equilibrium(Arc::clone(&problem), &elastic(), settings, 0.0, state).unwrap();
        motion.advance(&rising, until_s).unwrap();
        tip(&motion)
    };
    let [coarse, middle, fine] = [32.0, 64.0, 128.0].map(at);
    let order = ((coarse - middle) / (middle - fine)).abs().log2();
    let mut motion = start(0.02 / frequency_hz);
    let mut lowest = [(0.0, tip(&motion)); 3];
    let turn_s = loop {
        motion.advance(&|_| load, motion.t_s() + 0.02 / frequency_hz).unwrap();
        lowest = [lowest[1], lowest[2], (motion.t_s(), tip(&motion))];
        let [before, here, after] = lowest.map(|(_, y)| y);
        if here < before && here < after {
            let shift = 0.5 * (before - after) / (before - 2.0 * here + after);
            break lowest[1].0 + shift * (lowest[2].0 - lowest[1].0);
        }
    };
    let measured_hz = 0.5 / turn_s;
    println!(
        "cantilever: {measured_hz:.4} Hz in time, {frequency_hz:.4} Hz as eigenvalue; on a finer mesh {fine_hz:.4} Hz, beam theory {theory_hz:.4} Hz; order {order:.2}"
    );
    assert!(close(fine_hz, theory_hz, 0.01) && close(measured_hz, frequency_hz, 0.01));
    assert!((1.7..2.3).contains(&order), "{coarse} {middle} {fine}");
}

const WEIGHT: f64 = 0.3;
const TIME_S: f64 = 0.05;

fn viscous() -> Dynamics {
    Dynamics { beta_s: 0.0, prony: vec![PronyTerm { weight: WEIGHT, time_s: TIME_S }] }
}

/// A bar of 2 x 10 x 2 that hangs from its upper end, almost without inertia.
fn bar(bottom_mm: f64) -> Arc<Problem> {
    let mut b = Builder::default();
    b.solid([4.0, bottom_mm, 4.0], [6.0, bottom_mm + 10.0, 6.0], [1, 5, 1]);
    b.mesh.fixed_nodes = b.nodes_where(|p| p[1] > bottom_mm + 10.0 - 1.0e-9);
    b.mesh.bottom = b.faces(|p| p[1] < bottom_mm + 1.0e-9);
    let contact = ContactSettings { obstacle_penalty_mpa_per_mm: Some(1000.0), ..ContactSettings::default() };
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
    assert!(end > 0.001 && worst < 2.0e-3, "{worst}");
}

#[test]
fn pressed_bar_relaxes_as_its_series() {
    let problem = bar(-1.0);
    let load = |gap_mm| Load { obstacle: Obstacle::Plate { gap_mm }, ..Load::default() };
    let start = State { load: load(1.02), ..undeformed(&problem) };
    let h = TIME_S / 20.0;
    let mut motion = Transient::from_equilibrium(problem, &viscous(), every(h), 0.0, start).unwrap();
    let load_at = |t: f64| load(1.02 - 0.8 * (t / h).min(1.0));
    let mut forces = Vec::new();
    for k in 1..=100 {
        motion.advance(&load_at, f64::from(k) * h).unwrap();
        forces.push(motion.figures().unwrap().contact_force_n);
    }
    let (end, ramp) = (forces[99], TIME_S / h * (h / TIME_S).exp_m1());
    let mut worst = 0.0_f64;
    for (k, force) in forces.iter().enumerate() {
        let exact = |k: usize| 1.0 + WEIGHT / (1.0 - WEIGHT) * ramp * (-(k as f64) * h / TIME_S).exp();
        worst = worst.max((force / end - exact(k + 1) / exact(100)).abs());
    }
    println!("relaxation: largest error {worst:.2e} of the force {end:.4} N");
    assert!(end > 0.5 && worst < 5.0e-3, "{worst} {forces:?}");
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
    // The mean velocity of a body is that of its mass: weights of the faces' own mass matrix, here from the energy of translation.
    let after = momentum(&motion, &problem);
    println!(
        "impact: impulse {impulse:.4e} N s, momentum changes by {:.4e}, peak {peak:.2} N, energy {:+.3} % at most",
        after + mass * speed,
        100.0 * kinetic.iter().copied().fold(f64::MIN, f64::max) / before
    );
    assert!(impulse > mass * speed && close(impulse, after + mass * speed, 1.0e-4));
    assert!(kinetic.iter().all(|change| *change < 0.01 * before) && kinetic[249] > -0.5 * before);
    assert!(motion.figures().unwrap().contact_force_n == 0.0, "the block has left the plate");
}

/// y momentum of the loose block (t mm/s): shape functions' integrals are -1/20 of an element's mass at corners, 1/5 at edges.
fn momentum(motion: &Transient, problem: &Problem) -> f64 {
    let (velocity, mesh) = (motion.velocity_mm_s(), problem.mesh());
    let volume = |t: &[u32; 10]| {
        let [o, a, b, c] = [0, 1, 2, 3].map(|k| mesh.nodes_mm[t[k] as usize]);
        let e = |p: [f64; 3]| [p[0] - o[0], p[1] - o[1], p[2] - o[2]];
        let [a, b, c] = [a, b, c].map(e);
        (a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
            + a[2] * (b[0] * c[1] - b[1] * c[0]))
            / 6.0
    };
    let of = |t: &[u32; 10]| {
        let sum = |nodes: &[u32]| nodes.iter().map(|n| velocity[*n as usize][1]).sum::<f64>();
        1.0e-9 * volume(t) * (0.2 * sum(&t[4..]) - 0.05 * sum(&t[..4]))
    };
    mesh.tets.iter().map(of).sum()
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
    for dynamics in
        [elastic(), Dynamics { beta_s: 5.0e-5, prony: vec![PronyTerm { weight: 0.2, time_s: 0.002 }] }]
    {
        let settings = StepSettings { largest_s: 5.0e-4, smallest_s: 3.0e-5, tolerance_mm: 1.0e-3 };
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
        println!("{dynamics:?}: {:.3} % of {external:.4} mJ, {energy:?}, {work:?}", 100.0 * worst / external);
        assert!(
            worst < 0.01 * external && figures.contact_force_n > 0.0,
            "{worst} of {external}, {figures:?}"
        );
    }
}

#[test]
fn motion_continues_from_a_checkpoint_with_the_same_bits() {
    let (mut whole, load_at) = finger(StepSettings::default(), &viscous());
    whole.advance(&load_at, 0.002).unwrap();
    let values = whole.checkpoint();
    let (mut again, _) = finger(StepSettings::default(), &viscous());
    assert!(again.restore(&values, &load_at) && again.t_s().total_cmp(&0.002).is_eq());
    for motion in [&mut whole, &mut again] {
        motion.advance(&load_at, 0.005).unwrap();
    }
    assert!(whole.state() == again.state() && whole.figures() == again.figures());
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
    let mut fast = start(&problem, every(1.0e-3)).unwrap();
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
