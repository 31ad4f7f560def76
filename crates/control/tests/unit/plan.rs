use super::*;
use rom::memory::{Line, Play};

fn settings() -> Settings {
    let play = vec![Play { threshold: 1e-3, weight: 0.5 }, Play { threshold: 3e-3, weight: 0.3 }];
    Settings { line: Line { fill_s: 0.3, empty_s: 1.2 }, play, ..Settings::default() }.with_swing(4.0, 0.02)
}

/// Pressures behind the swing along moves.
fn along(settings: &Settings, moves_mpa: &[f64; MOVES]) -> Vec<Dual> {
    let start = PlanStart { cavity_mpa: 0.02, plays: Plays::at(0.02), swing: [0.019, 0.01] };
    let mut along = Prediction::new(settings, &start, 0.02);
    let mut all = Vec::new();
    for (at, stages) in BLOCKS.iter().enumerate() {
        let mut command = Dual::constant(moves_mpa[at]);
        command.by[at] = 1.0;
        for _ in 0..*stages {
            along.step(&command, 1e-3);
            all.push(along.swing[0]);
        }
    }
    all
}

#[test]
fn derivatives_of_a_prediction_are_those_of_differences_where_the_play_is_driven() {
    let settings = settings();
    let moves_mpa = std::array::from_fn(|at| 0.06 + 0.002 * at as f64);
    let found = along(&settings, &moves_mpa);
    for at in 0..MOVES {
        let moved = [1e-6, -1e-6].map(|by| {
            let mut moves_mpa = moves_mpa;
            moves_mpa[at] += by;
            along(&settings, &moves_mpa)
        });
        // In its first stages the cavity is within the larger play.
        for stage in 10..STAGES {
            let difference = (moved[0][stage].value - moved[1][stage].value) / 2e-6;
            let error = (difference - found[stage].by[at]).abs();
            assert!(
                error < 1e-6 || at < 6 && error < 0.3,
                "move {at}, stage {stage}: {difference} {:?}",
                found[stage]
            );
        }
    }
}

/// A step of the swing against the closed form, and two halves against a whole.
#[test]
fn swing_is_that_of_the_closed_form() {
    let (hz, damping) = (4.0, 0.1);
    let w = std::f64::consts::TAU * hz;
    let damped = w * f64::sqrt(1.0 - damping * damping);
    let settings = Settings { swing_hz: hz, swing_damping: damping, ..Settings::default() };
    let mut state = [1.0, 0.0];
    for step in 1..=40 {
        state = swung(&settings, state, 0.0, 0.013);
        let t_s = 0.013 * f64::from(step);
        let exact =
            (-damping * w * t_s).exp() * ((damped * t_s).cos() + damping * w / damped * (damped * t_s).sin());
        assert!((state[0] - exact).abs() < 1e-12, "{t_s}: {} {exact}", state[0]);
    }
}

/// Without rows the gradient vanishes at the optimum; at a row that binds it points out of the range.
#[test]
fn optimum_of_a_program_is_that_of_its_conditions() {
    let mut program = Program::new(3);
    program.add_square(&[1.0, 0.5, 0.0], -1.0);
    program.add_square(&[0.0, 2.0, 1.0], 0.5);
    program.add_square(&[0.3, 0.0, 1.0], 0.2);
    let free = program.solve(40).unwrap();
    let gradient = |z: &[f64], row: usize| {
        program.gradient[row]
            + (0..3).map(|column| program.hessian[column * 3 + row] * z[column]).sum::<f64>()
    };
    assert!((0..3).all(|row| gradient(&free, row).abs() < 1e-7), "{free:?}");
    let mut bounded = program;
    bounded.add_row(0.1, |column| f64::from(u8::from(column == 0)));
    bounded.add_row(f64::INFINITY, |_| 1.0);
    let z = bounded.solve(40).unwrap();
    // At the bound its multiplier is positive; the other unknowns stay free.
    let gradient = |row: usize| {
        bounded.gradient[row]
            + (0..3).map(|column| bounded.hessian[column * 3 + row] * z[column]).sum::<f64>()
    };
    assert!((z[0] - 0.1).abs() < 1e-6 && free[0] > 0.1 && gradient(0) < -1e-3, "{z:?} {free:?}");
    assert!((1..3).all(|row| gradient(row).abs() < 1e-6), "{z:?}");
}

#[test]
fn contradicting_rows_have_no_optimum() {
    let mut program = Program::new(1);
    program.add_square(&[1.0], 0.0);
    program.add_row(-1.0, |_| 1.0);
    program.add_row(-1.0, |_| -1.0);
    assert!(program.solve(40).is_none());
}

/// From a command beyond the range there is no plan within the rate: the inverse answers.
#[test]
fn command_beyond_the_range_has_no_plan_within_the_rate() {
    let limits = Limits { rate_mpa_per_s: 0.1, ..Limits::default() };
    let mut planner = Planner::new(&settings(), &limits);
    planner.start(0.02, 0.02, 0.0);
    let now = |command_mpa: f64| PlanInput {
        cavity_mpa: 0.02,
        plays: Plays::at(0.02),
        bias_mpa: 0.0,
        command_mpa,
        shift_mpa: 0.0,
        missing_mpa: None,
        most_mpa: f64::INFINITY,
    };
    assert!(planner.command(&settings(), &now(0.2), 5e-3).is_none());
    assert!(planner.command(&settings(), &now(0.02), 5e-3).is_some());
}
