//! Motion on families of equilibria with a closed form: oscillator, hinge, two masses above a plate.

use rom::inertia::data::FadingMotion;
use rom::inertia::manifold::{
    Amplitudes, Coordinates, Equilibrium, InertialLoad, LinearMode, MAX_LOADS, Manifold, PlateForce, Tangents,
};
use rom::inertia::stepper::{Motion, MotionSettings, MotionStep, ReadingError};
use rom::inputs::Inputs;
use rom::memory::PronyTerm;
use rom::snapshots::RegimeKind;
use std::f64::consts::TAU;

/// Position of the load in the inputs.
pub const LOAD: usize = 2;
/// Load at rest, mm/s2.
const REST: f64 = -9810.0;

pub fn settings(step_ns: u64, damping_s: f64) -> MotionSettings {
    MotionSettings { step_ns, damping_s, held_after_ns: 100_000_000, restart_after_ns: 2_000_000_000 }
}

pub fn reading(pressure_mpa: f64, gap_mm: f64) -> Inputs {
    Inputs::new(pressure_mpa, gap_mm).with(LOAD, REST)
}

pub fn coordinates(values: &[f64]) -> Coordinates {
    let mut all = Coordinates::default();
    all[..values.len()].copy_from_slice(values);
    all
}

/// One load along the first axis or a unit vector.
fn load(unit: &[f64], range: [f64; 2]) -> Vec<InertialLoad> {
    vec![InertialLoad { input: LOAD, unit: coordinates(unit), range }]
}

pub fn along_one(tangent: &[f64]) -> Tangents {
    let mut tangents = Tangents::default();
    tangents[0] = coordinates(tangent);
    tangents
}

/// Force of a spring on an obstacle at the position 0, N.
const PRELOAD_N: f64 = 100.0;

/// Unit mass on a spring whose rest position the pressure moves, and a part without inertia that follows the pressure; both push an
/// obstacle.
struct Spring {
    rate_rad_s: f64,
    /// Distance from an obstacle.
    clearance_mm: f64,
    loads: Vec<InertialLoad>,
}

impl Spring {
    fn new(hertz: f64) -> Self {
        let rate_rad_s = TAU * hertz;
        let range = [-1.0, 1.0].map(|side| REST + side * 20.0 * rate_rad_s.powi(2));
        Self { rate_rad_s, clearance_mm: f64::INFINITY, loads: load(&[1.0], range) }
    }
}

impl Manifold for Spring {
    fn loads(&self) -> &[InertialLoad] {
        &self.loads
    }

    fn equilibrium(&mut self, _: RegimeKind, inputs: &Inputs) -> Equilibrium {
        let compliance = self.rate_rad_s.powi(-2);
        let position = 1000.0 * inputs.pressure_mpa() + compliance * inputs.values()[LOAD];
        Equilibrium {
            position: coordinates(&[position, 500.0 * inputs.pressure_mpa()]),
            tangents: along_one(&[compliance]),
            by_pressure: coordinates(&[1000.0, 500.0]),
        }
    }

    fn clearance_mm(&mut self, _: &Inputs, _: &Amplitudes) -> f64 {
        self.clearance_mm
    }

    fn force(&mut self, inputs: &Inputs, _: &Amplitudes) -> PlateForce {
        let Equilibrium { position: [first, second, ..], tangents, .. } =
            self.equilibrium(RegimeKind::Contact, inputs);
        let mut by_load = [0.0; MAX_LOADS];
        by_load[0] = 2.0 * tangents[0][0];
        PlateForce { n: PRELOAD_N + 2.0 * first + 3.0 * second, by_load, ..PlateForce::default() }
    }
}

/// Position of the spring's mass.
fn at(spring: &mut Spring, moved: &MotionStep) -> f64 {
    spring.equilibrium(RegimeKind::Free, &moved.state.inputs).position[0]
}

/// Largest error of a spring during a second whose pressure rises by 5 kPa in 20 ms.
fn spring_error(step_ns: u64, hertz: f64) -> f64 {
    let (mut motion, mut spring) =
        (Motion::new(Spring::new(hertz), settings(step_ns, 0.0)), Spring::new(hertz));
    motion.advance(0, &reading(0.0, f64::INFINITY)).unwrap();
    let mut worst = 0.0_f64;
    let w = spring.rate_rad_s;
    for i in 1..=250_u64 {
        let t = i as f64 * 4e-3;
        let moved = motion.advance(i * 4_000_000, &reading(0.25 * t.min(0.02), f64::INFINITY)).unwrap();
        let risen = (w * t).sin() - if t > 0.02 { (w * (t - 0.02)).sin() } else { 0.0 };
        let exact = 250.0 * (t.min(0.02) - risen / w) + REST / (w * w);
        worst = worst.max((at(&mut spring, &moved) - exact).abs());
    }
    worst
}

#[test]
fn oscillator_follows_its_closed_form_with_second_order() {
    let errors = [4_000_000, 2_000_000, 1_000_000].map(|step| spring_error(step, 4.0));
    assert!(errors[2] < 0.02, "{errors:?}");
    for pair in errors.windows(2) {
        assert!((3.5..4.5).contains(&(pair[0] / pair[1])), "{errors:?}");
    }
}

#[test]
fn relaxing_spring_follows_its_closed_form() {
    // x'' = -w^2 (x + r h), h' = x' - h / tau after a jump of the rest position, by the eigenvalues of the linear system.
    let term = PronyTerm { ratio: 0.5, time_s: 0.05 };
    let mut motion = Motion::new(Spring::new(4.0), settings(500_000, 0.0)).relaxing(&[term]);
    let mut spring = Spring::new(4.0);
    let square = spring.rate_rad_s.powi(2);
    motion.advance(0, &reading(0.0, f64::INFINITY)).unwrap();
    let rhs = |[x, v, h]: [f64; 3]| [v, -square * (x + term.ratio * h), v - h / term.time_s];
    let along = |y: [f64; 3], k: [f64; 3], by: f64| std::array::from_fn(|i| y[i] + by * k[i]);
    // At the end of the first step the pressure has jumped by 5 kPa: the position is 5 mm away from rest, all of it relaxing.
    let mut y = [-5.0, 0.0, -5.0];
    let (step_s, mut worst) = (1e-4, 0.0_f64);
    motion.advance(1000, &reading(0.005, f64::INFINITY)).unwrap();
    for i in 1..=200_u64 {
        for _ in 0..40 {
            let a = rhs(y);
            let b = rhs(along(y, a, 0.5 * step_s));
            let c = rhs(along(y, b, 0.5 * step_s));
            let d = rhs(along(y, c, step_s));
            y = std::array::from_fn(|i| y[i] + step_s / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        }
        let moved = motion.advance(1000 + i * 4_000_000, &reading(0.005, f64::INFINITY)).unwrap();
        worst = worst.max((at(&mut spring, &moved) - 5.0 - REST / square - y[0]).abs());
    }
    // The jump takes one inner step, half of which the motion is late.
    assert!(worst < 0.05, "{worst}");
}

#[test]
fn stress_of_a_relaxing_elastomer_is_that_of_the_whole_load() {
    // P = P^ + r h, h' = P^' - h / tau, under a ramp of P^ that ends: h = tau P^' (1 - exp(-t / tau)).
    let term = PronyTerm { ratio: 0.5, time_s: 0.05 };
    let mut motion = Motion::new(Spring::new(4.0), settings(500_000, 0.0)).relaxing(&[term]);
    let (rate, end_s) = (0.25, 0.02);
    motion.advance(0, &reading(0.0, f64::INFINITY)).unwrap();
    for i in 1..=40_u64 {
        let t = i as f64 * 2e-3;
        let state =
            motion.advance(i * 2_000_000, &reading(rate * t.min(end_s), f64::INFINITY)).unwrap().state;
        let risen = term.time_s * rate * (1.0 - (-t.min(end_s) / term.time_s).exp());
        let borne = risen * (-(t - end_s).max(0.0) / term.time_s).exp();
        let whole_mpa = rate * t.min(end_s) + term.ratio * borne;
        assert!((state.stressed.pressure_mpa() - whole_mpa).abs() < 1e-12, "{t}: {state:?}");
    }
}

#[test]
fn unresolved_part_follows_the_pressure_with_the_time_constant_of_the_damping() {
    let (beta, h, rise_s) = (2e-3, 5e-4, 0.02);
    let spring = || Spring { clearance_mm: -1.0, ..Spring::new(4.0) };
    let (mut motion, mut place) = (Motion::new(spring(), settings(500_000, beta)), spring());
    let mut at = |inputs: &Inputs| place.equilibrium(RegimeKind::Contact, inputs).position;
    let mut last = at(&motion.advance(0, &reading(0.0, 1.0)).unwrap().state.inputs);
    for i in 1..=80_u64 {
        let t = i as f64 * h;
        let state = motion.advance(i * 500_000, &reading(t.min(rise_s), 1.0)).unwrap().state;
        let (now, shown) = (at(&state.inputs), at(&state.shown.0));
        let late = |t: f64| if t > 0.0 { t - beta * (1.0 - (-t / beta).exp()) } else { 0.0 };
        let exact = 500.0 * (late(t) - late(t - rise_s));
        let off = [shown[0] - now[0], shown[1] - exact];
        assert!(off.iter().all(|off| off.abs() < 1e-5), "{t}: {shown:?}, {exact}");
        let force_n = PRELOAD_N + 2.0 * (now[0] + beta * (now[0] - last[0]) / h) + 3.0 * now[1];
        assert!((state.contact_force_n - force_n).abs() < 1e-4, "{t}: {state:?}, expected {force_n} N");
        last = now;
    }
}

#[test]
fn steps_longer_than_a_period_stay_bounded_and_keep_energy() {
    let mut motion = Motion::new(Spring::new(400.0), settings(5_000_000, 0.0));
    let mut spring = Spring::new(400.0);
    motion.advance(0, &reading(0.0, f64::INFINITY)).unwrap();
    for i in 1..2000_u64 {
        let moved = motion.advance(i * 5_000_000, &reading(0.001, f64::INFINITY)).unwrap();
        assert!(!moved.at_rest && at(&mut spring, &moved).abs() < 3.0, "{moved:?}");
    }
}

#[test]
fn damping_decays_as_its_closed_form() {
    let (beta, hertz, t) = (2e-3, 4.0, 2.0);
    let mut motion = Motion::new(Spring::new(hertz), settings(500_000, beta));
    let mut spring = Spring::new(hertz);
    let begin = motion.advance(0, &reading(0.0, f64::INFINITY)).unwrap();
    motion.advance(1, &reading(0.005, f64::INFINITY)).unwrap();
    let mut last = motion.advance(2, &reading(0.005, f64::INFINITY)).unwrap();
    for i in 1..=40_u64 {
        last = motion.advance(i * 50_000_000, &reading(0.005, f64::INFINITY)).unwrap();
    }
    let w = TAU * hertz;
    let (decay, damped) = (0.5 * beta * w * w, w * (1.0 - (0.5 * beta * w).powi(2)).sqrt());
    let swing = 5.0 * (-decay * t).exp() * ((damped * t).cos() + decay / damped * (damped * t).sin());
    let found = at(&mut spring, &last);
    assert!((found - (5.0 - swing + REST / (w * w))).abs() < 0.02, "{found}");
    // A swing that the unknown past may have left: by 25 % of the range of 40 mm, which fades as the motion does.
    let FadingMotion { path, impact, unknown_past: past } = begin.state.fading_mm;
    assert!((path, impact) == (0.0, 0.0) && (past - 10.0).abs() < 1e-9, "{begin:?}");
    let FadingMotion { path, impact, unknown_past: past } = last.state.fading_mm;
    assert!((past / (10.0 * (-decay * t).exp()) - 1.0).abs() < 0.01, "{last:?}");
    assert!(impact == 0.0 && path > 1.0 && path < 4.0 * 5.0 * hertz * t, "{last:?}");
}

/// Unit mass at the end of a lever with a torsion spring, whose angle at rest the pressure moves: the family is curved.
struct Hinge {
    loads: Vec<InertialLoad>,
}

const LEVER_MM: f64 = 100.0;
const TORSION: f64 = 6.25e6;

impl Hinge {
    fn new() -> Self {
        Self { loads: load(&[0.0, 1.0], [-60_000.0, 40_000.0]) }
    }

    fn rest_angle(pressure_mpa: f64) -> f64 {
        -10.0 * pressure_mpa
    }

    fn angle(pressure_mpa: f64, load: f64) -> f64 {
        let mut angle = Self::rest_angle(pressure_mpa);
        for _ in 0..60 {
            let off = TORSION * (angle - Self::rest_angle(pressure_mpa)) - load * LEVER_MM * angle.cos();
            angle -= off / (TORSION + load * LEVER_MM * angle.sin());
        }
        angle
    }

    /// Elastic energy and that of the load at rest.
    fn potential(pressure_mpa: f64, angle: f64) -> f64 {
        0.5 * TORSION * (angle - Self::rest_angle(pressure_mpa)).powi(2) - REST * LEVER_MM * angle.sin()
    }
}

impl Manifold for Hinge {
    fn loads(&self) -> &[InertialLoad] {
        &self.loads
    }

    fn equilibrium(&mut self, _: RegimeKind, inputs: &Inputs) -> Equilibrium {
        let load = inputs.values()[LOAD];
        let (sin, cos) = Self::angle(inputs.pressure_mpa(), load).sin_cos();
        let stiffness = TORSION + load * LEVER_MM * sin;
        let (by_load, by_pressure) = (LEVER_MM * cos / stiffness, -10.0 * TORSION / stiffness);
        Equilibrium {
            position: coordinates(&[LEVER_MM * cos, LEVER_MM * sin]),
            tangents: along_one(&[-LEVER_MM * sin * by_load, LEVER_MM * cos * by_load]),
            by_pressure: coordinates(&[-LEVER_MM * sin * by_pressure, LEVER_MM * cos * by_pressure]),
        }
    }
}

/// Pressure of a ramp of 20 ms.
fn ramp(t_ns: u64) -> f64 {
    0.03 + 0.03 * (t_ns as f64 / 2e7).min(1.0)
}

/// Angle after each 10 ms by the equation of motion of the hinge, integrated by Runge and Kutta's method.
fn hinge_truth(beta: f64) -> Vec<f64> {
    let rhs = |t_ns: f64, [angle, rate]: [f64; 2]| {
        let rest = Hinge::rest_angle(ramp(t_ns as u64));
        let load = TORSION * (angle - rest) / (LEVER_MM * angle.cos());
        let stiffness = TORSION + load * LEVER_MM * angle.sin();
        let torque = -TORSION * (angle - rest) + REST * LEVER_MM * angle.cos() - beta * stiffness * rate;
        [rate, torque / (LEVER_MM * LEVER_MM)]
    };
    let h = 1e-5;
    let mut y = [Hinge::angle(0.03, REST), 0.0];
    let mut angles = Vec::new();
    for i in 0..100_000_u64 {
        let t_ns = i as f64 * h * 1e9;
        let along = |k: [f64; 2], by: f64| [y[0] + by * k[0], y[1] + by * k[1]];
        let a = rhs(t_ns, y);
        let b = rhs(t_ns + 0.5e9 * h, along(a, 0.5 * h));
        let c = rhs(t_ns + 0.5e9 * h, along(b, 0.5 * h));
        let d = rhs(t_ns + 1e9 * h, along(c, h));
        y = std::array::from_fn(|i| y[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        if (i + 1) % 1000 == 0 {
            angles.push(y[0]);
        }
    }
    angles
}

fn hinge(step_ns: u64, beta: f64) -> Vec<f64> {
    let mut motion = Motion::new(Hinge::new(), settings(step_ns, beta));
    motion.advance(0, &reading(0.03, f64::INFINITY)).unwrap();
    let angle = |i: u64| {
        let moved = motion.advance(i * 10_000_000, &reading(ramp(i * 10_000_000), f64::INFINITY)).unwrap();
        Hinge::angle(moved.state.inputs.pressure_mpa(), moved.state.inputs.values()[LOAD])
    };
    (1..=100).map(angle).collect()
}

#[test]
fn curved_family_under_a_ramp_follows_the_equation_of_motion_with_second_order() {
    for beta in [0.0, 2e-3] {
        let truth = hinge_truth(beta);
        let error = |step_ns| {
            let found = hinge(step_ns, beta);
            found.iter().zip(&truth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        let errors = [2_000_000, 1_000_000, 500_000].map(error);
        assert!(errors[2] < 1e-3, "{beta}: {errors:?} of {truth:?}");
        for pair in errors.windows(2) {
            assert!((3.0..5.0).contains(&(pair[0] / pair[1])), "{beta}: {errors:?}");
        }
    }
}

#[test]
fn energy_of_a_curved_family_stays_without_damping_and_falls_with_it() {
    for beta in [0.0, 2e-3] {
        let mut motion = Motion::new(Hinge::new(), settings(1_000_000, beta));
        motion.advance(0, &reading(0.0, f64::INFINITY)).unwrap();
        let mut energies = Vec::new();
        for i in 1..=25_000_u64 {
            let moved = motion.advance(i * 1_000_000, &reading(0.04, f64::INFINITY)).unwrap();
            let angle = Hinge::angle(0.04, moved.state.inputs.values()[LOAD]);
            energies.push(moved.state.kinetic_mj + Hinge::potential(0.04, angle));
        }
        let rest = Hinge::potential(0.04, Hinge::angle(0.04, REST));
        // Kinetic energy is that of the middle of a step: means over a period of about 250 steps.
        let means: Vec<f64> =
            energies.chunks(2500).map(|e| e.iter().sum::<f64>() / e.len() as f64 - rest).collect();
        if beta == 0.0 {
            assert!(means.iter().all(|e| (e / means[0] - 1.0).abs() < 2e-3), "{means:?}");
        } else {
            assert!(means.windows(2).all(|e| e[1] < e[0]), "{means:?}");
            assert!(means[9] < 1e-6 * means[0], "{means:?}");
        }
    }
}

/// Two masses on a chain of springs; the outer one, which the pressure pushes down, lands on a plate. Exact: one load and one linear
/// mode free, one load in contact.
struct Pair {
    loads: Vec<InertialLoad>,
    mode: Vec<LinearMode>,
}

/// Stiffness to the frame and between the masses, mJ/mm2, and force of the pressure on the outer mass, per MPa.
const STIFFNESS: [f64; 2] = [2000.0, 9000.0];
const PUSH: f64 = 200_000.0;

impl Pair {
    fn new() -> Self {
        let [k, l] = STIFFNESS;
        // Upper eigenvector of [[k + l, -l], [-l, l]].
        let square = 0.5 * (k + 2.0 * l + (k * k + 4.0 * l * l).sqrt());
        let ratio = l / (l - square);
        let length = (1.0 + ratio * ratio).sqrt();
        let shape = coordinates(&[1.0 / length, ratio / length]);
        let loads = load(&[1.0], [-200_000.0, 200_000.0]);
        Self { loads, mode: vec![LinearMode { rate_rad_s: square.sqrt(), shape }] }
    }
}

impl Manifold for Pair {
    fn loads(&self) -> &[InertialLoad] {
        &self.loads
    }

    fn modes(&self, regime: RegimeKind) -> &[LinearMode] {
        if regime == RegimeKind::Free { &self.mode } else { &[] }
    }

    fn equilibrium(&mut self, regime: RegimeKind, inputs: &Inputs) -> Equilibrium {
        let ([k, l], load, push) = (STIFFNESS, inputs.values()[LOAD], PUSH * inputs.pressure_mpa());
        if regime == RegimeKind::Free {
            let first = (load - push) / k;
            return Equilibrium {
                position: coordinates(&[first, first - push / l]),
                tangents: along_one(&[1.0 / k, 1.0 / k]),
                by_pressure: coordinates(&[-PUSH / k, -PUSH / k - PUSH / l]),
            };
        }
        let first = (load - l * inputs.gap_mm()) / (k + l);
        let position = coordinates(&[first, -inputs.gap_mm()]);
        Equilibrium { position, tangents: along_one(&[1.0 / (k + l)]), by_pressure: Coordinates::default() }
    }

    fn clearance_mm(&mut self, inputs: &Inputs, amplitudes: &Amplitudes) -> f64 {
        let outer =
            self.equilibrium(RegimeKind::Free, inputs).position[1] + self.mode[0].shape[1] * amplitudes[0];
        outer + inputs.gap_mm()
    }

    fn onset_load(&mut self, inputs: &Inputs) -> f64 {
        let ([k, l], push) = (STIFFNESS, PUSH * inputs.pressure_mpa());
        k * (push / l - inputs.gap_mm()) + push
    }

    fn force(&mut self, inputs: &Inputs, _: &Amplitudes) -> PlateForce {
        let [k, l] = STIFFNESS;
        let first = self.equilibrium(RegimeKind::Contact, inputs).position[0];
        let n = l * (-inputs.gap_mm() - first) + PUSH * inputs.pressure_mpa();
        let mut by_load = [0.0; MAX_LOADS];
        by_load[0] = -l / (k + l);
        PlateForce { n, by_load, ..PlateForce::default() }
    }
}

const GAP_MM: f64 = 20.0;

/// Pressure that swings about the onset of contact three times a second.
fn swing(t_ns: u64) -> f64 {
    0.1 + 0.09 * (TAU * 3.0 * t_ns as f64 * 1e-9 - 1.0).sin()
}

/// Positions, force and losses at impacts of the two masses every 5 ms, by small steps with a plastic impact.
fn pair_truth(beta: f64) -> Vec<[f64; 3]> {
    let [k, l] = STIFFNESS;
    let h = 2e-6;
    let push = |i: u64| PUSH * swing(i * 2000);
    let mut x = Pair::new().equilibrium(RegimeKind::Free, &reading(swing(0), GAP_MM)).position;
    let (mut v, mut touching, mut found) = ([0.0; 2], false, Vec::new());
    for i in 0..500_000_u64 {
        let u = [x[0] + beta * v[0], x[1] + beta * v[1]];
        let (first, second) = (REST - k * u[0] - l * (u[0] - u[1]), l * (u[0] - u[1]) - push(i));
        v[0] += h * first;
        v[1] += h * second;
        if touching && second > 0.0 {
            touching = false;
        }
        if touching || x[1] + h * v[1] < -GAP_MM {
            (touching, v[1], x[1]) = (true, 0.0, -GAP_MM);
        }
        x[0] += h * v[0];
        x[1] += h * v[1];
        if (i + 1) % 2500 == 0 {
            found.push([x[0], x[1], if touching { -second } else { 0.0 }]);
        }
    }
    found
}

#[test]
fn landing_and_leaving_follow_the_plastic_impact_without_chatter() {
    let truth = pair_truth(2e-3);
    assert!(truth.iter().any(|t| t[2] > 0.0) && truth.iter().any(|t| t[2] == 0.0));
    for step_ns in [250_000, 500_000, 1_000_000] {
        let mut motion = Motion::new(Pair::new(), settings(step_ns, 2e-3));
        motion.advance(0, &reading(swing(0), GAP_MM)).unwrap();
        let (mut changes, mut last, mut worst, mut square) = (0, RegimeKind::Free, 0.0_f64, [0.0_f64; 3]);
        for i in 1..=1000_u64 {
            let moved = motion.advance(i * 1_000_000, &reading(swing(i * 1_000_000), GAP_MM)).unwrap().state;
            changes += usize::from(moved.regime != last);
            last = moved.regime;
            assert!(moved.contact_force_n >= 0.0);
            if i % 5 == 0 {
                let manifold = motion.manifold();
                let mut x = manifold.equilibrium(moved.regime, &moved.inputs).position;
                let modes = manifold.modes(moved.regime);
                modes
                    .iter()
                    .for_each(|mode| (0..2).for_each(|j| x[j] += mode.shape[j] * moved.amplitudes[0]));
                let exact = truth[i as usize / 5 - 1];
                worst = worst.max((x[0] - exact[0]).abs());
                for (square, off) in square.iter_mut().zip([
                    x[0] - exact[0],
                    x[1] - exact[1],
                    moved.contact_force_n - exact[2],
                ]) {
                    *square += off * off / 200.0;
                }
            }
        }
        let rms = square.map(f64::sqrt);
        assert_eq!(changes, 12, "{step_ns} ns: {rms:?}");
        assert!(
            rms[0] < 0.05 && rms[1] < 0.05 && rms[2] < 600.0,
            "{step_ns} ns: {rms:?} mm, mm, of 30,000 mN"
        );
    }
}

#[test]
fn energy_never_grows_through_impacts_at_constant_pressure() {
    let [k, l] = STIFFNESS;
    let mut motion = Motion::new(Pair::new(), settings(500_000, 0.0));
    motion.advance(0, &reading(0.03, GAP_MM)).unwrap();
    motion.advance(10_000_000, &reading(0.16, GAP_MM)).unwrap();
    let (mut energies, mut landings, mut last) = (Vec::new(), 0, RegimeKind::Free);
    for i in 21..4021_u64 {
        let moved = motion.advance(i * 500_000, &reading(0.16, GAP_MM)).unwrap().state;
        landings += usize::from(moved.regime != last && moved.regime == RegimeKind::Contact);
        last = moved.regime;
        let manifold = motion.manifold();
        let mut x = manifold.equilibrium(moved.regime, &moved.inputs).position;
        let modes = manifold.modes(moved.regime);
        modes.iter().for_each(|mode| (0..2).for_each(|j| x[j] += mode.shape[j] * moved.amplitudes[0]));
        let potential =
            0.5 * (k * x[0] * x[0] + l * (x[0] - x[1]).powi(2)) - REST * x[0] + 0.16 * PUSH * x[1];
        energies.push([moved.kinetic_mj, potential]);
    }
    // Kinetic energies are those of the middles of steps.
    let energies: Vec<f64> = energies.windows(2).map(|e| 0.5 * (e[0][0] + e[1][0]) + e[0][1]).collect();
    assert!(landings > 1, "{landings}");
    let spread = energies[0] - energies[energies.len() - 1];
    let mut lowest = energies[0];
    for energy in energies {
        assert!(energy < lowest + 0.005 * spread, "{energy} {lowest} {spread}");
        lowest = lowest.min(energy);
    }
}

#[test]
fn results_do_not_depend_on_how_readings_are_cut_and_repeat_bit_identically() {
    // Straight lines between instants of 10 ms, read every 10 ms, 1 ms and at uneven times.
    let line = |t_ns: u64| {
        let (before, part) = (t_ns / 10_000_000 * 10_000_000, (t_ns % 10_000_000) as f64 * 1e-7);
        (1.0 - part) * swing(before) + part * swing(before + 10_000_000)
    };
    let run = |times: &[u64]| -> Vec<MotionStep> {
        let mut motion = Motion::new(Pair::new(), settings(500_000, 2e-3));
        motion.advance(0, &reading(line(0), GAP_MM)).unwrap();
        let all = times.iter().map(|t| (*t, motion.advance(*t, &reading(line(*t), GAP_MM)).unwrap()));
        all.filter(|(t, _)| t % 10_000_000 == 0).map(|(_, moved)| moved).collect()
    };
    let even = |step: u64| (1..=1_000_000_000 / step).map(|i| i * step).collect::<Vec<u64>>();
    let (coarse, fine) = (run(&even(10_000_000)), run(&even(1_000_000)));
    let uneven: Vec<u64> = (1..=100)
        .flat_map(|i| [i * 10_000_000 - 7_654_321 + i * 31, i * 10_000_000 - 1_234, i * 10_000_000])
        .collect();
    let uneven = run(&uneven);
    assert_eq!(coarse.len(), 100);
    for (a, (b, c)) in coarse.iter().zip(fine.iter().zip(&uneven)) {
        for other in [b, c] {
            assert_eq!(a.state.regime, other.state.regime);
            let loads = [a, other].map(|moved| moved.state.inputs.values()[LOAD]);
            assert!((loads[0] - loads[1]).abs() < 1e-5 * 4e5, "{loads:?}");
            assert!((a.state.contact_force_n - other.state.contact_force_n).abs() < 1.0);
        }
    }
    assert_eq!(format!("{coarse:?}"), format!("{:?}", run(&even(10_000_000))));
}

#[test]
fn readings_that_are_late_or_not_numbers_are_refused_and_gaps_are_reported() {
    let mut motion = Motion::new(Spring::new(4.0), settings(1_000_000, 2e-3));
    let free = |p| reading(p, f64::INFINITY);
    assert!(motion.advance(5_000_000, &free(0.0)).unwrap().at_rest);
    let before = motion.advance(10_000_000, &free(0.001)).unwrap();
    assert_eq!((before.at_rest, before.held), (false, false));
    let late = ReadingError::NotLater { found_ns: 10_000_000, last_ns: 10_000_000 };
    assert_eq!(motion.advance(10_000_000, &free(0.002)), Err(late));
    assert_eq!(
        motion.advance(11_000_000, &free(f64::NAN)),
        Err(ReadingError::NotFinite { found_ns: 11_000_000 })
    );
    let held = motion.advance(500_000_000, &free(0.001)).unwrap();
    assert_eq!((held.at_rest, held.held), (false, true));
    assert!(motion.advance(3_000_000_000, &free(0.001)).unwrap().at_rest);
    assert_eq!(motion.advance(3_001_000_000, &free(0.001)).unwrap().state.inputs.values()[LOAD], REST);
    // A jump of 100 times the range.
    let lost = motion.advance(3_002_000_000, &free(10.0)).unwrap();
    assert!(lost.load_distance > 0.0 || lost.at_rest, "{lost:?}");
}
