use super::*;
use crate::inverse::Point;

/// F = slope (p - onset) with the onset moving by the gap; the tip falls with the pressure.
struct Line {
    slope: f64,
    onset_mpa: f64,
}

impl Model for Line {
    fn at(&mut self, pressure_mpa: f64, gap_mm: f64) -> Point {
        let onset_mpa = self.onset_mpa + 0.001 * (gap_mm - 30.0);
        let excess = pressure_mpa - onset_mpa;
        Point {
            force_n: (self.slope * excess).max(0.0),
            force_by_pressure: if excess > 0.0 { self.slope } else { 0.0 },
            tip_mm: -800.0 * pressure_mpa,
            tip_by_pressure: -800.0,
            onset_mpa,
        }
    }
    fn range_mpa(&self) -> [f64; 2] {
        [0.0, 0.09]
    }
    fn tip_grows(&self) -> bool {
        false
    }
}

const MODEL: Line = Line { slope: 8.0, onset_mpa: 0.01 };
const DT_S: f64 = 1e-3;

fn reading(pressure_mpa: f64, measured: f64) -> Reading {
    Reading { pressure_mpa, gap_mm: 30.0, measured }
}

/// A plant of another line behind a lag of 80 ms; returns force and commands of every cycle.
fn run(plant: &mut Line, target: f64, turns: usize, has_cell: bool) -> (Vec<f64>, Vec<f64>) {
    let mut controller = Controller::new(MODEL, Quantity::Force, Settings::default());
    let (mut pressure_mpa, mut forces, mut commands) = (0.0, Vec::new(), Vec::new());
    for _ in 0..turns {
        let force_n = plant.at(pressure_mpa, 30.0).force_n;
        let measured = if has_cell { force_n } else { f64::NAN };
        let turn = controller.update(target, reading(pressure_mpa, measured), DT_S);
        pressure_mpa += (turn.pressure_mpa - pressure_mpa) * DT_S / 0.08;
        forces.push(force_n);
        commands.push(turn.pressure_mpa);
    }
    (forces, commands)
}

#[test]
fn model_error_is_corrected_by_the_load_cell() {
    for (slope, onset_mpa) in
        [(8.0, 0.01), (6.4, 0.01), (9.6, 0.01), (8.0, 0.015), (8.0, 0.004), (6.4, 0.015), (9.6, 0.004)]
    {
        let (forces, _) = run(&mut Line { slope, onset_mpa }, 0.3, 3000, true);
        let last = forces[2999];
        assert!((last - 0.3).abs() < 1e-3, "{slope} {onset_mpa}: {last}");
        let most = forces.iter().copied().fold(0.0, f64::max);
        assert!(most < 0.3 * 1.05, "{slope} {onset_mpa}: {most}");
        assert!((forces[1000] - 0.3).abs() < 0.05 * 0.3, "{slope} {onset_mpa}: {}", forces[1000]);
    }
}

#[test]
fn model_force_is_held_without_load_cell() {
    let (forces, _) = run(&mut Line { slope: 9.6, ..MODEL }, 0.3, 3000, false);
    assert!((forces[2999] - 0.36).abs() < 1e-3, "{}", forces[2999]);
}

#[test]
fn commands_are_within_range_and_rate_and_targets_below_the_force_limit() {
    let settings = Settings::default();
    let (forces, commands) = run(&mut Line { slope: 8.0, onset_mpa: 0.01 }, 5.0, 3000, true);
    assert!(forces.iter().all(|force_n| *force_n <= settings.force_max_n));
    assert!((forces[2999] - TARGET_SHARE * settings.force_max_n).abs() < 1e-3);
    let step = settings.rate_mpa_per_s * DT_S + 1e-12;
    assert!(commands.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= step));
    assert!(commands.iter().all(|command| (0.0..=0.09).contains(command)));
}

#[test]
fn start_continues_from_the_present_pressure() {
    let mut controller = Controller::new(MODEL, Quantity::Force, Settings::default());
    let first = controller.update(0.24, reading(0.04, 0.24), DT_S);
    assert!((first.pressure_mpa - 0.04).abs() < 1e-6, "{first:?}");
    // Another owner has moved the valve.
    controller.start(reading(0.02, 0.08));
    let next = controller.update(0.08, reading(0.02, 0.08), DT_S);
    assert!((next.pressure_mpa - 0.02).abs() < 1e-6, "{next:?}");
}

#[test]
fn integrals_do_not_wind_up_at_a_limit() {
    let mut controller =
        Controller::new(MODEL, Quantity::Force, Settings { range_mpa: [0.0, 0.03], ..Settings::default() });
    for _ in 0..10_000 {
        assert!(controller.update(0.5, reading(0.03, 0.16), DT_S).is_limited);
    }
    // The target becomes one that is reached: the command leaves the limit within the time of reference and lead, not later.
    let commands: Vec<f64> =
        (0..300).map(|_| controller.update(0.08, reading(0.03, 0.16), DT_S).pressure_mpa).collect();
    assert!(commands[50] < 0.03 && commands[299] < 0.021, "{} {}", commands[50], commands[299]);
}

#[test]
fn non_finite_reading_is_ignored() {
    let mut controller = Controller::new(MODEL, Quantity::Force, Settings::default());
    for _ in 0..500 {
        controller.update(0.2, reading(0.03, 0.16), DT_S);
    }
    let before = controller.update(0.2, reading(0.03, 0.16), DT_S);
    for bad in [reading(f64::NAN, 0.16), Reading { gap_mm: f64::INFINITY, ..reading(0.03, 0.16) }] {
        assert_eq!(controller.update(0.2, bad, DT_S).pressure_mpa, before.pressure_mpa);
    }
    assert_eq!(controller.update(f64::NAN, reading(0.03, 0.16), DT_S).pressure_mpa, before.pressure_mpa);
}

#[test]
fn value_at_the_end_of_the_range_is_found_there() {
    let mut model = Line { slope: 1.0, onset_mpa: 0.02 };
    for pressure_mpa in [0.0, 0.09] {
        let value = Quantity::Tip.of(&model.at(pressure_mpa, 25.0)).0;
        for start_mpa in [0.16, 0.05, 0.0] {
            let found = inverse(&mut model, Quantity::Tip, 25.0, value, start_mpa);
            assert!(found.is_reached && (found.pressure_mpa - pressure_mpa).abs() < 1e-12, "{found:?}");
        }
    }
}

proptest::proptest! {
    #[test]
    fn inverse_returns_the_value_or_a_failure(
        pressure_mpa in 0.0..0.12_f64, gap_mm in 25.0..40.0_f64, start_mpa in -0.1..0.2_f64, slope in 1.0..30.0_f64
    ) {
        let mut model = Line { slope, onset_mpa: 0.02 };
        for quantity in [Quantity::Force, Quantity::Tip] {
            let value = quantity.of(&model.at(pressure_mpa, gap_mm)).0;
            let found = inverse(&mut model, quantity, gap_mm, value, start_mpa);
            let back = quantity.of(&model.at(found.pressure_mpa, gap_mm)).0;
            proptest::prop_assert_eq!(found.is_reached, pressure_mpa <= 0.09, "{:?} {}", found, value);
            proptest::prop_assert!(!found.is_reached || (back - value).abs() < 1e-4, "{} {}", back, value);
        }
    }
}
