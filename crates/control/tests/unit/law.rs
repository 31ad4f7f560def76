use super::*;
use crate::inverse::Point;
use crate::plant::{Plant, PlantSpec};
use crate::trial::{Loop, Moment, Trial, sine_figures, step_figures};
use rom::memory::{Line, Play};

/// F = slope (p - onset) with the onset moving by the gap; the observable falls with the pressure.
#[derive(Clone, Copy)]
struct Straight {
    slope: f64,
    onset_mpa: f64,
}

impl Model for Straight {
    fn at(&mut self, pressure_mpa: f64, gap_mm: f64) -> Point {
        let onset_mpa = self.onset_mpa + 0.001 * (gap_mm - 30.0);
        let excess = pressure_mpa - onset_mpa;
        Point {
            force_n: (self.slope * excess).max(0.0),
            force_by_pressure: if excess > 0.0 { self.slope } else { 0.0 },
            observable: -800.0 * pressure_mpa,
            observable_by_pressure: -800.0,
            onset_mpa,
        }
    }
    fn range_mpa(&self) -> [f64; 2] {
        [0.0, 0.09]
    }
    fn observable_grows(&self) -> bool {
        false
    }
}

const MODEL: Straight = Straight { slope: 10.0, onset_mpa: 0.01 };
const DT_S: f64 = 5e-3;

fn reading(pressure_mpa: f64, measured: f64) -> Reading {
    Reading { pressure_mpa, gap_mm: 30.0, measured, written_mpa: f64::NAN }
}

/// Line 0.3 and 1.2 s, play 4.5 kPa, swing 4 Hz, gauge bias 1 kPa, 10 % softer than the model.
fn finger() -> PlantSpec {
    PlantSpec {
        line: Line { fill_s: 0.3, empty_s: 1.2 },
        play: vec![Play { threshold: 0.00225, weight: 1.0 }],
        swing_hz: 3.8,
        gauge_bias_mpa: 1e-3,
        stiffness: 0.9,
        ..PlantSpec::default()
    }
}

fn settings() -> Settings {
    let known = finger();
    Settings { line: known.line, play: known.play, delay_s: 0.03, ..Settings::default() }
        .with_swing(4.0, 0.02)
}

fn controller(quantity: Quantity) -> Controller<Straight> {
    Controller::new(MODEL, quantity, settings(), Limits::default())
}

const LAWS: [LawKind; 2] = [LawKind::Inverse, LawKind::Predictive];

fn of_law(law: LawKind, quantity: Quantity, limits: Limits) -> Controller<Straight> {
    Controller::new(MODEL, quantity, Settings { law, ..settings() }, limits)
}

fn on(
    law: Controller<Straight>,
    quantity: Quantity,
    spec: PlantSpec,
) -> Loop<Controller<Straight>, Straight> {
    let trial = Trial { quantity, is_measured: true, gap_error_mm: 0.0, rate_hz: 1.0 / DT_S };
    Loop::new(law, Plant::new(spec, MODEL), trial)
}

fn run(quantity: Quantity, spec: PlantSpec) -> Loop<Controller<Straight>, Straight> {
    on(controller(quantity), quantity, spec)
}

fn both(quantity: Quantity, spec: &PlantSpec) -> [Loop<Controller<Straight>, Straight>; 2] {
    LAWS.map(|law| on(of_law(law, quantity, Limits::default()), quantity, spec.clone()))
}

#[test]
fn force_steps_settle_without_overshoot_on_a_plant_with_line_play_swing_and_bias() {
    for mut run in both(Quantity::Force, &finger()) {
        steps_settle(&mut run);
    }
}

fn steps_settle(run: &mut Loop<Controller<Straight>, Straight>) {
    let (mut from, mut moments) = (0.2, Vec::new());
    run.hold(from, 4.0, &mut moments);
    for target in [0.1, 0.5, 0.1, 0.3, 0.4, 0.2] {
        moments.clear();
        run.hold(target, 4.0, &mut moments);
        let found = step_figures(from, &moments, |moment| moment.truth).unwrap();
        let most_s = if target > from { 1.5 } else { 2.0 };
        assert!(found.overshoot < 0.05, "{found:?}");
        assert!(found.settling_s.is_some_and(|settling_s| settling_s < most_s), "{found:?}");
        assert!(found.final_error.abs() < 2e-3, "{found:?}");
        assert!(moments.iter().all(|moment| moment.fault.is_none()));
        from = target;
    }
}

/// The gauge shows a command a delay later, and is compared with what was wanted then.
#[test]
fn a_known_delay_makes_no_overshoot_where_nothing_swings() {
    for delay_s in [0.0, 0.01, 0.05, 0.09, 0.13, 0.25] {
        let spec = PlantSpec {
            swing_hz: 0.0,
            valve_s: 0.0,
            delay_s,
            stiffness: 1.0,
            gauge_bias_mpa: 0.0,
            ..finger()
        };
        // A reading is answered one cycle after it was taken.
        let known = Settings { swing_hz: 0.0, delay_s: delay_s + DT_S, ..settings() };
        let law = Controller::new(MODEL, Quantity::Force, known, Limits::default());
        let (mut run, mut from, mut moments) = (on(law, Quantity::Force, spec), 0.2, Vec::new());
        run.hold(from, 4.0, &mut moments);
        for target in [0.4, 0.1, 0.5, 0.3] {
            moments.clear();
            run.hold(target, 4.0, &mut moments);
            let found = step_figures(from, &moments, |moment| moment.truth).unwrap();
            assert!(found.overshoot < 0.02 && found.final_error.abs() < 2e-3, "{delay_s} s: {found:?}");
            from = target;
        }
    }
}

/// 4 kPa of play, a load cell with 2 mN of noise: noise must not lead the command through the play.
#[test]
fn at_rest_the_command_moves_by_less_than_2_kpa() {
    let stiff = PlantSpec {
        line: Line { fill_s: 0.2, empty_s: 0.8 },
        play: vec![Play { threshold: 0.002, weight: 1.0 }],
        swing_hz: 0.0,
        gauge_noise_mpa: 1e-4,
        ..PlantSpec::default()
    };
    for (law, spec) in LAWS.into_iter().flat_map(|law| [(law, finger()), (law, stiff.clone())]) {
        let known =
            Settings { law, line: spec.line, play: spec.play.clone(), delay_s: 0.035, ..Settings::default() };
        let known = if spec.swing_hz > 0.0 { known.with_swing(spec.swing_hz, 0.02) } else { known };
        let law = Controller::new(MODEL, Quantity::Force, known, Limits::default());
        let (mut run, mut moments) = (on(law, Quantity::Force, spec), Vec::new());
        run.hold(0.1, 3.0, &mut moments);
        run.hold(0.3, 12.0, &mut moments);
        // Until then the error of the valve, 1 kPa of the gauge, is found.
        let last = &moments[moments.len() - 800..];
        let [low, high] = last.iter().fold([f64::INFINITY, 0.0], |[low, high]: [f64; 2], moment| {
            [low.min(moment.command_mpa), high.max(moment.command_mpa)]
        });
        assert!(high - low < 2e-3, "{} kPa, {:?}", 1e3 * (high - low), run.law.settings.law);
        assert!(last.iter().all(|moment| (moment.truth - 0.3).abs() < 6e-3), "{:?}", last[0]);
    }
}

#[test]
fn with_a_delay_that_is_wrong_by_40_ms_both_laws_settle() {
    for (truth_s, law) in [0.01, 0.05, 0.09].into_iter().flat_map(|truth_s| LAWS.map(|law| (truth_s, law))) {
        let known = Settings { law, delay_s: 0.05, ..settings() };
        let law = Controller::new(MODEL, Quantity::Force, known, Limits::default());
        let spec = PlantSpec { delay_s: truth_s, valve_s: 0.0, ..finger() };
        let (mut run, mut moments) = (on(law, Quantity::Force, spec), Vec::new());
        let mut from = 0.2;
        run.hold(from, 4.0, &mut moments);
        for target in [0.4, 0.1, 0.3] {
            moments.clear();
            run.hold(target, 4.0, &mut moments);
            let found = step_figures(from, &moments, |moment| moment.truth).unwrap();
            assert!(found.overshoot < 0.08, "{truth_s} s: {found:?}");
            assert!(found.settling_s.is_some_and(|settling_s| settling_s < 3.0), "{truth_s} s: {found:?}");
            // Also where the plan has given way to the first law, nothing goes on to and fro.
            let last = moments[720..].iter().map(|moment| moment.command_mpa);
            let [low, high] = [last.clone().fold(f64::INFINITY, f64::min), last.fold(0.0, f64::max)];
            assert!(high - low < 6e-3, "{truth_s} s: {low} {high}");
            from = target;
        }
    }
}

/// A delay of which the settings know nothing makes the plan swing from one end of the range to the other.
#[test]
fn a_plan_that_oscillates_gives_way_to_the_first_law_and_says_so() {
    let line = Line { fill_s: 0.06, empty_s: 0.06 };
    let known =
        Settings { law: LawKind::Predictive, line, delay_s: 0.0, approach_s: 0.02, ..Settings::default() };
    let law = Controller::new(MODEL, Quantity::Force, known, Limits::default());
    let spec = PlantSpec { line, delay_s: 0.2, valve_s: 0.0, ..PlantSpec::default() };
    let (mut run, mut moments) = (on(law, Quantity::Force, spec), Vec::new());
    run.hold(0.4, 3.0, &mut moments);
    assert!(run.law.turns.is_oscillating() && run.law.is_fallback);
    moments.clear();
    run.hold(0.3, 6.0, &mut moments);
    assert!(moments[800..].iter().all(|moment| (moment.truth - 0.3).abs() < 0.02), "{:?}", moments[1199]);
    run.law.start(reading(0.03, 0.2));
    assert!(!run.law.turns.is_oscillating());
}

#[test]
fn turns_of_the_target_are_none_of_the_loops() {
    let sine = |time_s: f64| 0.04 + 0.01 * (std::f64::consts::TAU * 2.0 * time_s).sin();
    for is_asked in [true, false] {
        let mut turns = Turns::default();
        for cycle in 0..1000 {
            let pressure_mpa = sine(f64::from(cycle) * DT_S);
            turns.step(pressure_mpa, if is_asked { pressure_mpa } else { 0.04 }, 2e-3, DT_S);
        }
        assert_eq!(turns.is_oscillating(), !is_asked);
    }
}

#[test]
fn observable_follows_a_sine_of_known_rate() {
    let w = std::f64::consts::PI;
    let sine = |t_s: f64| Target { value: -40.0 + 3.0 * (w * t_s).sin(), rate: 3.0 * w * (w * t_s).cos() };
    for mut run in both(Quantity::Observable, &finger()) {
        let mut moments = Vec::new();
        run.hold(-40.0, 3.0, &mut moments);
        moments.clear();
        run.follow(sine, 8.0, &mut moments);
        let found = sine_figures(0.5, &moments[800..]);
        assert!((0.9..1.15).contains(&found.amplitude) && found.lag_deg.abs() < 20.0, "{found:?}");
    }
}

#[test]
fn loop_stays_stable_on_wrong_stiffness_lag_and_play() {
    let double = |line: Line| Line { fill_s: 2.0 * line.fill_s, empty_s: 2.0 * line.empty_s };
    let plants = [
        PlantSpec { stiffness: 0.9 * 1.2, swing_hz: 4.2, ..finger() },
        PlantSpec { stiffness: 0.9 * 0.8, swing_hz: 3.4, ..finger() },
        PlantSpec { line: double(finger().line), ..finger() },
        PlantSpec { play: vec![Play { threshold: 0.0045, weight: 1.0 }], ..finger() },
    ];
    for (spec, mut run) in plants.iter().flat_map(|spec| both(Quantity::Force, spec).map(|run| (spec, run))) {
        let mut moments = Vec::new();
        run.hold(0.4, 6.0, &mut moments);
        let off = |part: &[Moment]| part.iter().map(|moment| (moment.truth - 0.4).abs()).fold(0.0, f64::max);
        assert!(off(&moments[1000..]) < 0.02, "{spec:?}: {}", off(&moments[1000..]));
    }
}

/// A line twice as slow as known looks like an error of the valve as long as the pressure moves; nothing of that is a fault.
#[test]
fn a_line_twice_as_slow_as_known_is_no_fault() {
    let line = Line { fill_s: 0.6, empty_s: 2.4 };
    for mut run in both(Quantity::Force, &PlantSpec { line, ..finger() }) {
        for target in [0.1, 0.5, 0.1, 0.3, 0.4, 0.2, 0.5] {
            let mut moments = Vec::new();
            run.hold(target, 5.0, &mut moments);
            let last = moments[999];
            assert!(last.fault.is_none() && !last.is_limited, "{last:?}");
            assert!((last.truth - target).abs() < 0.03, "{last:?}");
        }
    }
}

#[test]
fn commands_are_within_range_and_rate_and_targets_below_the_force_limit() {
    let limits = Limits { rate_mpa_per_s: 0.5, ..Limits::default() };
    for law in LAWS {
        let mut run = on(of_law(law, Quantity::Force, limits), Quantity::Force, finger());
        let mut moments = Vec::new();
        run.hold(5.0, 4.0, &mut moments);
        let force_max_n = settings().force_max_n;
        assert!(moments.iter().all(|moment| moment.force_n <= force_max_n && moment.is_limited));
        assert!((moments[799].truth - TARGET_FRACTION * force_max_n).abs() < 1e-2);
        let step = 0.5 * DT_S + 1e-12;
        assert!(moments.windows(2).all(|pair| (pair[1].command_mpa - pair[0].command_mpa).abs() <= step));
        assert!(moments.iter().all(|moment| (0.0..=0.09).contains(&moment.command_mpa)));
    }
}

#[test]
fn without_a_plan_the_command_is_that_of_the_inverse() {
    let [mut inverse, mut planned] = LAWS.map(|law| of_law(law, Quantity::Force, Limits::default()));
    for cycle in 0..400 {
        let step = reading(0.02 + 1e-5 * f64::from(cycle), 0.1);
        planned.planner.as_mut().unwrap().max_iterations = if cycle < 200 { 1 } else { 40 };
        let [of_inverse, of_plan] =
            [&mut inverse, &mut planned].map(|law| law.update(&|_| Target::step(0.3), step, DT_S));
        assert_eq!(of_plan.is_fallback, cycle < 200);
        assert!(!of_inverse.is_fallback && (0.0..=0.09).contains(&of_plan.pressure_mpa));
        if cycle < 200 {
            assert_eq!(of_inverse, Cycle { is_fallback: false, ..of_plan });
        }
    }
}

#[test]
fn start_continues_from_the_present_pressure() {
    let mut law = controller(Quantity::Force);
    let first = law.update(&|_| Target::step(0.3), reading(0.04, 0.3), DT_S);
    assert!((first.pressure_mpa - 0.04).abs() < 1e-6, "{first:?}");
    // Another owner has moved the valve.
    law.start(reading(0.02, 0.1));
    let next = law.update(&|_| Target::step(0.1), reading(0.02, 0.1), DT_S);
    assert!((next.pressure_mpa - 0.02).abs() < 1e-6, "{next:?}");
}

#[test]
fn after_a_long_pause_the_control_starts_again_where_the_actuator_is() {
    for law in LAWS {
        let mut law = of_law(law, Quantity::Force, Limits::default());
        for _ in 0..100 {
            law.update(&|_| Target::step(0.3), reading(0.04, 0.3), DT_S);
        }
        // The valve has closed meanwhile.
        let next = law.update(&|_| Target::step(0.3), reading(0.0, 0.0), 2.0 * LONGEST_S);
        let mut fresh = controller(Quantity::Force);
        let first = fresh.update(&|_| Target::step(0.3), reading(0.0, 0.0), LONGEST_S);
        assert!((next.reference_mpa - first.reference_mpa).abs() < 1e-9, "{next:?} {first:?}");
    }
}

#[test]
fn frozen_gauge_is_flagged_while_the_pressure_swings_around_it_or_creeps_away() {
    let settings = Settings { gauge_at: GaugeAt::Valve, ..Settings::default() };
    // A swing that is near the frozen value every quarter of a second, and a ramp that the correction of the valve's error follows.
    let swing = |time_s: f64| 0.04 + 0.015 * (std::f64::consts::TAU * 2.0 * time_s).sin();
    let ramp = |time_s: f64| 0.04 + 0.0005 * time_s;
    let shapes: [(&dyn Fn(f64) -> f64, f64); 2] = [(&swing, 2.0), (&ramp, 25.0)];
    for (written_mpa, within_s) in shapes {
        for is_frozen in [true, false] {
            let mut law = Controller::new(MODEL, Quantity::Pressure, settings.clone(), Limits::default());
            let fault = (1..(within_s / DT_S) as u32).find_map(|cycle| {
                let written_mpa = written_mpa(f64::from(cycle) * DT_S);
                let shown_mpa = if is_frozen { 0.04 } else { written_mpa };
                let reading = Reading { written_mpa, ..reading(shown_mpa, f64::NAN) };
                law.update(&|_| Target::step(written_mpa), reading, DT_S).fault
            });
            assert_eq!(fault, is_frozen.then_some(Fault::NoResponse));
        }
    }
}

#[test]
fn target_beyond_the_range_is_left_at_once() {
    let limits = Limits { range_mpa: [0.0, 0.03], ..Limits::default() };
    let law = Controller::new(MODEL, Quantity::Force, settings(), limits);
    let trial =
        Trial { quantity: Quantity::Force, is_measured: true, gap_error_mm: 0.0, rate_hz: 1.0 / DT_S };
    let mut run = Loop::new(law, Plant::new(PlantSpec { supply_mpa: 0.03, ..finger() }, MODEL), trial);
    let mut moments = Vec::new();
    run.hold(0.5, 30.0, &mut moments);
    assert!(moments.iter().skip(100).all(|moment| moment.is_limited && moment.command_mpa <= 0.03));
    moments.clear();
    run.hold(0.08, 2.0, &mut moments);
    assert!(moments[20].command_mpa < 0.02, "{:?}", moments[20]);
    assert!((moments[399].truth - 0.08).abs() < 0.01, "{:?}", moments[399]);
}

#[test]
fn reading_that_is_not_finite_changes_nothing() {
    let mut law = controller(Quantity::Force);
    let before = law.update(&|_| Target::step(0.2), reading(0.03, 0.2), DT_S);
    let good = reading(0.03, 0.2);
    for bad in [reading(f64::NAN, 0.2), Reading { gap_mm: f64::INFINITY, ..good }] {
        assert_eq!(law.update(&|_| Target::step(0.2), bad, DT_S).pressure_mpa, before.pressure_mpa);
    }
    let wrong = [Target::step(f64::NAN), Target { value: 0.2, rate: f64::INFINITY }];
    assert!(
        wrong.iter().all(|target| law.update(&|_| *target, good, DT_S).pressure_mpa == before.pressure_mpa)
    );
    assert_eq!(law.update(&|_| Target::step(0.2), good, -1.0).pressure_mpa, before.pressure_mpa);
}

/// The first fault of a run, and when, s.
fn fault_of(moments: &[Moment]) -> Option<(Fault, f64)> {
    let first = moments.iter().find(|moment| moment.fault.is_some())?;
    Some((first.fault?, first.time_s - moments[0].time_s))
}

/// What a falling supply still gives is held and said; when it comes back the target is followed again. `release` lets go as a missing one.
#[test]
fn falling_supply_lowers_the_target_and_holds() {
    for (law, low_supply) in
        LAWS.into_iter().flat_map(|law| [(law, LowSupply::Hold), (law, LowSupply::Release)])
    {
        let known = Settings { law, low_supply, ..settings() };
        let law = Controller::new(MODEL, Quantity::Force, known, Limits::default());
        let (mut run, mut moments) = (on(law, Quantity::Force, finger()), Vec::new());
        run.hold(0.45, 5.0, &mut moments);
        assert!((moments[999].truth - 0.45).abs() < 5e-3 && !moments[999].is_limited);
        run.plant.spec.supply_mpa = 0.03;
        moments.clear();
        run.hold(0.45, 8.0, &mut moments);
        if low_supply == LowSupply::Release {
            assert!(fault_of(&moments).is_some_and(|(fault, _)| fault == Fault::NoResponse));
            continue;
        }
        assert_eq!(fault_of(&moments), None);
        let last = *moments.last().unwrap();
        // 30 kPa give 0.2 N without the play, and 0.04 N more after a fall through it.
        assert!(
            last.is_limited && (0.15..0.25).contains(&last.truth) && last.command_mpa < 0.037,
            "{last:?}"
        );
        assert!(moments[1000..].iter().all(|moment| (moment.truth - last.truth).abs() < 0.02));
        let cycle = run.law.update(&|_| Target::step(0.45), reading(last.pressure_mpa, last.truth), DT_S);
        assert!(cycle.limited.by_supply && (cycle.target - last.truth).abs() < 0.06, "{cycle:?}");
        run.plant.spec.supply_mpa = 0.09;
        moments.clear();
        run.hold(0.45, 12.0, &mut moments);
        let last = moments.last().unwrap();
        assert!((last.truth - 0.45).abs() < 5e-3 && !last.is_limited, "{last:?}");
    }
}

#[test]
fn missing_supply_is_flagged_within_a_second_until_it_is_released() {
    let known = Settings { low_supply: LowSupply::Release, ..settings() };
    let law = Controller::new(MODEL, Quantity::Force, known, Limits::default());
    let mut run = on(law, Quantity::Force, finger());
    let mut moments = Vec::new();
    run.hold(0.2, 3.0, &mut moments);
    assert_eq!(fault_of(&moments), None);
    run.plant.spec.supply_mpa = 0.0;
    moments.clear();
    run.hold(0.4, 2.0, &mut moments);
    let (fault, after_s) = fault_of(&moments).unwrap();
    assert!(fault == Fault::NoResponse && after_s < 1.0, "{fault:?} {after_s}");
    assert!(moments[399].command_mpa.is_nan());
    run.plant.spec.supply_mpa = 0.09;
    run.hold(0.2, 1.0, &mut moments);
    assert!(moments.last().unwrap().fault.is_some());
    run.law.release();
    moments.clear();
    run.hold(0.2, 3.0, &mut moments);
    assert!(fault_of(&moments).is_none() && (moments[599].truth - 0.2).abs() < 0.01);
}

#[test]
fn supply_that_gives_nothing_is_a_fault_though_a_low_one_is_held() {
    let mut run = run(Quantity::Force, finger());
    let mut moments = Vec::new();
    run.hold(0.2, 3.0, &mut moments);
    run.plant.spec.supply_mpa = 0.0;
    moments.clear();
    run.hold(0.4, 8.0, &mut moments);
    assert!(fault_of(&moments).is_some_and(|(fault, _)| fault == Fault::NoResponse), "{:?}", moments.last());
}

#[test]
fn quantity_against_its_model_is_a_fault() {
    struct Turned(Straight);
    impl crate::plant::RestingBody for Turned {
        fn answer(&mut self, pressure_mpa: f64, gap_mm: f64, _: f64) -> [f64; 2] {
            let point = self.0.at(pressure_mpa, gap_mm);
            [point.force_n, -50.0 - point.observable]
        }
    }
    let trial =
        Trial { quantity: Quantity::Observable, is_measured: true, gap_error_mm: 0.0, rate_hz: 1.0 / DT_S };
    let law = controller(Quantity::Observable);
    let mut run = Loop::new(law, Plant::new(finger(), Turned(MODEL)), trial);
    let mut moments = Vec::new();
    run.hold(-30.0, 3.0, &mut moments);
    let (fault, after_s) = fault_of(&moments).unwrap();
    assert!(fault == Fault::OppositeSign && after_s < 1.0, "{fault:?} {after_s}");
}

#[test]
fn measurement_may_be_missing_for_a_tenth_of_a_second() {
    for (missing_s, expected) in [(0.1, None), (3.0, Some(Fault::MeasurementLost))] {
        let mut law = controller(Quantity::Observable);
        let mut found = None;
        for at in 0..1000 {
            let is_missing = (1.0..1.0 + missing_s).contains(&(f64::from(at) * DT_S));
            let measured = if is_missing { f64::NAN } else { -24.0 };
            let cycle = law.update(&|_| Target::step(-24.0), reading(0.03, measured), DT_S);
            found = found.or(cycle.fault);
            assert_eq!(cycle.pressure_mpa.is_nan(), found.is_some());
        }
        assert_eq!(found, expected, "{missing_s} s");
    }
}

#[test]
fn saturated_load_cell_is_a_fault_within_the_range() {
    /// Its load cell shows at most 0.25 N.
    struct Saturated(Straight);
    impl crate::plant::RestingBody for Saturated {
        fn answer(&mut self, pressure_mpa: f64, gap_mm: f64, _: f64) -> [f64; 2] {
            let point = self.0.at(pressure_mpa, gap_mm);
            [point.force_n.min(0.25), point.observable]
        }
    }
    let trial =
        Trial { quantity: Quantity::Force, is_measured: true, gap_error_mm: 0.0, rate_hz: 1.0 / DT_S };
    let mut run = Loop::new(controller(Quantity::Force), Plant::new(finger(), Saturated(MODEL)), trial);
    let mut moments = Vec::new();
    run.hold(0.4, 8.0, &mut moments);
    let (fault, after_s) = fault_of(&moments).unwrap();
    assert!(fault == Fault::Unexplained && after_s < 5.0, "{fault:?} {after_s}");
    assert!(moments.iter().all(|moment| moment.command_mpa.is_nan() || moment.command_mpa <= 0.09));
}

#[test]
fn controller_that_restarts_in_motion_continues_from_there() {
    let mut run = run(Quantity::Force, finger());
    let mut moments = Vec::new();
    run.hold(0.1, 3.0, &mut moments);
    moments.clear();
    run.hold(0.5, 0.4, &mut moments);
    let before = *moments.last().unwrap();
    assert!((0.15..0.45).contains(&before.truth), "in motion: {before:?}");
    run.law = controller(Quantity::Force);
    moments.clear();
    run.hold(0.5, 4.0, &mut moments);
    let [low, high] = moments.iter().fold([f64::INFINITY, 0.0], |[low, high]: [f64; 2], moment| {
        [low.min(moment.truth), high.max(moment.truth)]
    });
    assert!(low > before.truth - 0.02 && high < 0.53, "{low} {high} after {before:?}");
    assert!(fault_of(&moments).is_none() && (moments[799].truth - 0.5).abs() < 0.01, "{:?}", moments[799]);
}

#[test]
fn target_faster_than_the_line_is_followed_at_its_rate_and_shown() {
    let without_play = Settings { play: Vec::new(), ..settings() };
    let mut law = Controller::new(MODEL, Quantity::Force, without_play, Limits::default());
    law.update(&|_| Target::step(0.2), reading(0.03, 0.2), DT_S);
    let cycle = law.update(&|_| Target { value: 0.5, rate: 50.0 }, reading(0.03, 0.2), DT_S);
    assert!(cycle.limited.by_rate && !cycle.limited.is_limited(), "{cycle:?}");
    assert!(cycle.reference_mpa - 0.03 <= settings().slew_mpa_per_s[0] * DT_S, "{cycle:?}");
}

/// As with a model that has line and play itself: the gauge is before both.
#[test]
fn force_settles_with_the_gauge_before_line_and_play() {
    let settings = Settings { gauge_at: GaugeAt::Valve, ..settings() };
    let law = Controller::new(MODEL, Quantity::Force, settings, Limits::default());
    let trial =
        Trial { quantity: Quantity::Force, is_measured: true, gap_error_mm: 0.0, rate_hz: 1.0 / DT_S };
    let spec = PlantSpec { gauge_at: GaugeAt::Valve, ..finger() };
    let mut run = Loop::new(law, Plant::new(spec, MODEL), trial);
    let (mut from, mut moments) = (0.2, Vec::new());
    run.hold(from, 4.0, &mut moments);
    for target in [0.4, 0.1] {
        moments.clear();
        run.hold(target, 4.0, &mut moments);
        let found = step_figures(from, &moments, |moment| moment.truth).unwrap();
        assert!(found.overshoot < 0.1 && found.final_error.abs() < 5e-3, "{found:?}");
        assert_eq!(fault_of(&moments), None);
        from = target;
    }
}

#[test]
fn value_at_the_end_of_the_range_is_found_there() {
    let mut model = Straight { slope: 1.0, onset_mpa: 0.02 };
    for pressure_mpa in [0.0, 0.09] {
        let value = Quantity::Observable.of(&model.at(pressure_mpa, 25.0), pressure_mpa).0;
        for start_mpa in [0.16, 0.05, 0.0] {
            let found = inverse(&mut model, Quantity::Observable, 25.0, value, start_mpa);
            assert!(found.is_reached && (found.pressure_mpa - pressure_mpa).abs() < 1e-12, "{found:?}");
        }
    }
}

proptest::proptest! {
    #[test]
    fn inverse_returns_the_value_or_a_failure(
        pressure_mpa in 0.0..0.12_f64, gap_mm in 25.0..40.0_f64, start_mpa in -0.1..0.2_f64, slope in 1.0..30.0_f64
    ) {
        let mut model = Straight { slope, onset_mpa: 0.02 };
        for quantity in [Quantity::Force, Quantity::Observable, Quantity::Pressure] {
            let value = quantity.of(&model.at(pressure_mpa, gap_mm), pressure_mpa).0;
            let found = inverse(&mut model, quantity, gap_mm, value, start_mpa);
            let back = quantity.of(&model.at(found.pressure_mpa, gap_mm), found.pressure_mpa).0;
            proptest::prop_assert_eq!(found.is_reached, pressure_mpa <= 0.09, "{:?} {}", found, value);
            proptest::prop_assert!(!found.is_reached || (back - value).abs() < 1e-4, "{} {}", back, value);
        }
    }
}
