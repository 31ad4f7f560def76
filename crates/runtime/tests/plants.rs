//! The running estimate on plants that are not the model: how often it is right, how often an alarm stands, and that it is not
//! wrong without one.
//!
//! `cargo test -p runtime --test all -- plants --nocapture` prints a line for each run: the estimates with their standard deviations, the
//! errors in these, the alarm at the end, how often it changed.

#[path = "plants/simulated.rs"]
mod simulated;

use estimate::{Alarm, Filter};
use rom::inputs::InputSpec;
use rom::model::Model;
use rom::rng::Rng;
use runtime::config::{ActuatorSpec, Scene};
use runtime::estimation::{SensorModel, setup};
use simulated::{CELL_N, Change, Changing, MARKER_MM, Plant, Profile, RATE_HZ, SECONDS, Truth, run};
use std::path::Path;

/// Errors in standard deviations from which an estimate is wrong.
const WRONG: f64 = 3.0;
/// Share of readings with an alarm up to which a run counts as one without.
const FEW: f64 = 0.02;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    /// All estimates within three standard deviations, no alarm at the end.
    Right,
    /// An alarm stands at the end.
    Alarmed,
    /// Wrong at the end, where an earlier alarm has gone.
    Cleared,
    /// Wrong at the end, and nothing has said so.
    Silent,
}

/// A ramp up, then up and down between 15 and 70 kPa.
fn ramps(t_s: f64) -> f64 {
    let ends = [
        [0.0, 0.0],
        [2.0, 0.0],
        [10.0, 0.07],
        [12.0, 0.07],
        [18.0, 0.015],
        [20.0, 0.015],
        [26.0, 0.07],
        [28.0, 0.07],
        [34.0, 0.015],
        [40.0, 0.06],
    ];
    let part = ends.windows(2).find(|pair| t_s <= pair[1][0]).unwrap_or(&ends[8..]);
    let [[from_s, from], [to_s, to]] = [part[0], part[1]];
    from + (to - from) * ((t_s - from_s) / (to_s - from_s)).min(1.0)
}

/// A step every four seconds.
fn steps(t_s: f64) -> f64 {
    let holds = [0.0, 0.03, 0.06, 0.04, 0.07, 0.05, 0.02, 0.06, 0.03, 0.065];
    holds[((t_s / 4.0) as usize).min(9)]
}

/// A start within five seconds, then two sines with periods of 8 and 3 s.
fn sines(t_s: f64) -> f64 {
    let begin = (t_s / 5.0).min(1.0);
    begin * (0.045 - 0.02 * (0.8 * t_s).cos() - 0.008 * (2.1 * t_s).sin())
}

/// The shipped scene with these sensors, and the defaults for the model's error and the drift.
fn spec(gauge_sigma_mpa: f64) -> ActuatorSpec {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/scenes/estimate.toml");
    let mut spec = Scene::load(Path::new(path)).expect("the shipped scene").actuators.remove(0);
    spec.sigma.pressure_mpa = gauge_sigma_mpa;
    spec.sigma.pressure_rate_mpa_per_s = None;
    (spec.sigma.force_n, spec.sigma.marker_mm) = (CELL_N, MARKER_MM);
    (spec.sigma.model_force_n, spec.sigma.model_mm) = (None, None);
    spec.estimate.values_mut().for_each(|unknown| unknown.drift = None);
    spec
}

struct Bench {
    model: Model,
    keys: Vec<String>,
}

/// What a run showed.
struct Run {
    outcome: Outcome,
    /// Share of the readings in the second half with a wrong estimate and no alarm.
    silent: f64,
    /// A sensor was blamed although load cell and marker are right.
    is_blamed: bool,
}

impl Bench {
    fn new() -> Self {
        let model = Model::read(&spec(0.0001).model).expect("the shipped model").0;
        let keys = model.header.inputs.iter().map(InputSpec::key).collect();
        Self { model, keys }
    }

    /// Steps the filter through a plant's readings and prints what came out.
    fn run(&self, plant: &Plant, profile: Profile, gauge_sigma_mpa: f64, seed: u64) -> Run {
        let spec = spec(gauge_sigma_mpa);
        let setup = setup(&spec, &self.model).expect("a setup");
        let mut sensors = SensorModel::new(&spec, &self.model).expect("sensors");
        let readings = run(plant, profile, gauge_sigma_mpa, &mut sensors.clone(), &self.keys, seed);
        let order = setup.unknowns.iter().map(|unknown| match unknown.name.as_str() {
            "gap_mm" => 0,
            "elastomer.law.mu_mpa" => 1,
            "pressure_bias_mpa" => 2,
            other => panic!("no truth for {other}"),
        });
        let order: Vec<usize> = order.collect();
        let mut filter = Filter::new(setup).expect("a filter");
        let (mut alarmed, mut changes, mut last, mut silent) = (0, 0, None, 0);
        let mut is_blamed = false;
        for (at, (reading, truth)) in readings.iter().enumerate() {
            let alarm = filter.update(reading, &mut sensors).alarm;
            alarmed += usize::from(alarm.is_some());
            changes += usize::from(alarm != last);
            is_blamed |= matches!(alarm, Some(Alarm::Sensor(_))) && plant.has_right_sensors();
            last = alarm;
            let is_late = 2 * at >= readings.len();
            silent += usize::from(is_late && alarm.is_none() && farthest(&filter, &order, truth) > WRONG);
        }
        let (_, truth) = readings.last().expect("readings");
        let share = alarmed as f64 / readings.len() as f64;
        let is_wrong = farthest(&filter, &order, truth) > WRONG;
        let outcome = match (last, is_wrong) {
            (Some(_), _) => Outcome::Alarmed,
            (None, false) => Outcome::Right,
            (None, true) if share > FEW => Outcome::Cleared,
            (None, true) => Outcome::Silent,
        };
        let shown: Vec<String> = filter
            .estimates()
            .zip(&order)
            .map(|(estimate, at)| {
                let off = (estimate.value - truth[*at]) / estimate.sigma;
                format!(
                    "{:.4} +- {:.2} ({off:+.1})",
                    scaled(*at, estimate.value),
                    scaled(*at, estimate.sigma)
                )
            })
            .collect();
        let silent = silent as f64 / (0.5 * SECONDS * RATE_HZ);
        println!(
            "{:28} {:8} {} | alarm {share:.2} of the time, {changes} changes, at the end {} | wrong without: {silent:.2}",
            plant.name,
            format!("{outcome:?}"),
            shown.join("  "),
            short(last),
        );
        Run { outcome, silent, is_blamed }
    }

    /// All plants with all profiles: none is wrong without an alarm, at the end or in the second half, and most are right.
    fn all(&self, plants: &[Plant], profiles: &[(&str, Profile, f64)], seed: u64) {
        let (mut counts, mut silent, mut blamed) = ([0; 4], 0.0_f64, 0);
        for (name, profile, gauge_sigma_mpa) in profiles {
            println!("-- {name}, gauge {gauge_sigma_mpa} MPa: gap mm, mu kPa, bias Pa");
            for (at, plant) in plants.iter().enumerate() {
                let run = self.run(plant, *profile, *gauge_sigma_mpa, seed + at as u64);
                counts[run.outcome as usize] += 1;
                silent = silent.max(run.silent);
                blamed += usize::from(run.is_blamed);
            }
        }
        let runs = counts.iter().sum::<usize>();
        println!(
            "of {runs} runs: right, alarmed, cleared, silent {counts:?}; at most {silent:.3} of a run wrong without an alarm; \
             in {blamed} a right sensor was blamed"
        );
        let [right, _, cleared, never] = counts;
        assert_eq!((cleared, never), (0, 0), "wrong at the end without an alarm");
        assert!(silent <= FEW, "wrong without an alarm for {silent} of a run");
        assert!(10 * right >= 6 * runs, "{right} of {runs} are right");
        assert!(50 * blamed <= runs, "a right sensor was blamed in {blamed} of {runs}");
    }
}

/// An estimate in mm, kPa, Pa.
fn scaled(quantity: usize, value: f64) -> f64 {
    value * [1.0, 1e3, 1e6][quantity]
}

fn farthest(filter: &Filter, order: &[usize], truth: &Truth) -> f64 {
    let off = filter
        .estimates()
        .zip(order)
        .map(|(estimate, at)| (estimate.value - truth[*at]).abs() / estimate.sigma);
    off.fold(0.0, f64::max)
}

fn short(alarm: Option<Alarm>) -> String {
    alarm.map_or("none".into(), |alarm| format!("{alarm:?}"))
}

/// One kind of difference from the model each, then several.
fn known() -> Vec<Plant> {
    let new = Plant::new;
    let wide = vec![[0.0013, 0.3], [0.0026, 0.35], [0.0042, 0.35]];
    let narrow = vec![[0.0006, 0.5], [0.0014, 0.5]];
    let middle = vec![[0.0008, 0.3], [0.0016, 0.3], [0.0026, 0.3]];
    let change = |what, from_s, to_s, value| vec![Change { what, from_s, to_s, value }];
    let shape = || vec![("chambers.length_mm", 3.12), ("chambers.width_mm", 13.7), ("base.lower_mm", 2.1)];
    let fast = [0.05, 0.05];
    vec![
        new("ideal", 0.72, 33.0),
        Plant { gauge_mpa: 0.0015, ..new("gauge bias", 0.9, 28.0) },
        Plant { play: narrow, ..new("play 2 kPa", 0.8, 36.0) },
        Plant { play: wide, ..new("play 5.5 kPa", 0.72, 30.0) },
        Plant { gauge_at_valve: true, line_s: [0.05, 0.2], ..new("short line", 0.9, 33.0) },
        Plant { gauge_at_valve: true, ..new("long line", 0.8, 30.0) },
        Plant { creep: vec![[0.06, 3.0], [0.04, 20.0]], ..new("creep 10 %", 0.72, 35.0) },
        Plant { creep: vec![[0.12, 3.0], [0.08, 20.0]], ..new("creep 20 %", 0.9, 30.0) },
        Plant { swing: Some([4.0, 0.03]), ..new("swing", 0.8, 32.0) },
        Plant { gauge_at_valve: true, line_s: fast, leak_s: 1.0, ..new("leak", 0.72, 31.0) },
        Plant {
            gauge_at_valve: true,
            line_s: fast,
            leak_s: 50.0,
            changes: change(Changing::LeakS, 10.0, 30.0, 0.4),
            ..new("growing leak", 0.8, 29.0)
        },
        Plant { changes: change(Changing::CellN, 5.0, 30.0, 0.02), ..new("drifting cell", 0.72, 33.0) },
        Plant { changes: change(Changing::GaugeMpa, 5.0, 30.0, 0.004), ..new("drifting gauge", 0.9, 34.0) },
        Plant { changes: change(Changing::GapMm, 15.0, 20.0, 34.0), ..new("moved gap", 0.8, 30.0) },
        Plant { compliance: 4.0, ..new("soft plate", 0.8, 32.0) },
        Plant { play: middle.clone(), ..new("play, soft body", 0.64, 33.0) },
        Plant {
            play: middle.clone(),
            gauge_at_valve: true,
            line_s: [0.1, 0.4],
            ..new("play and line", 0.96, 28.0)
        },
        Plant { shape: shape(), ..new("another shape", 0.76, 32.0) },
        Plant {
            play: middle.clone(),
            creep: vec![[0.04, 6.0]],
            swing: Some([4.0, 0.03]),
            gauge_mpa: -0.001,
            ..new("a usual rig", 0.72, 34.0)
        },
        Plant {
            play: middle,
            creep: vec![[0.1, 5.0]],
            swing: Some([3.0, 0.02]),
            gauge_mpa: 0.002,
            cell_n: 0.006,
            ..new("everything", 0.9, 31.0)
        },
        Plant { marker_stuck_s: 15.0, ..new("stuck marker", 0.8, 33.0) },
        Plant { stiffness: 1.3, ..new("30 % stiffer", 0.7, 33.0) },
        Plant { stiffness: 0.7, ..new("30 % softer", 0.9, 33.0) },
    ]
}

const PROFILES: [(&str, Profile, f64); 3] =
    [("ramps", ramps, 0.0001), ("ramps", ramps, 0.0005), ("steps", steps, 0.0001)];

#[test]
fn known_plants_are_right_or_raise_an_alarm() {
    Bench::new().all(&known(), &PROFILES, 100);
}

/// Plants of which each has some differences from the model, of random size.
fn drawn(count: usize) -> Vec<Plant> {
    let mut random = Rng::new(20_260);
    let one = |at: usize| {
        let mut within = |low: f64, high: f64| low + (high - low) * random.uniform();
        let mut plant = Plant::new(String::new(), within(0.66, 0.94), within(26.0, 38.0));
        let mut names = Vec::new();
        for _ in 0..=at % 2 {
            let (name, kind) = KINDS[(within(0.0, 1.0) * KINDS.len() as f64) as usize];
            names.push(name);
            match kind {
                0 => plant.gauge_mpa = within(-0.003, 0.003),
                1 => {
                    let width = within(0.5, 2.0);
                    plant.play = vec![[0.0008 * width, 0.3], [0.0016 * width, 0.3], [0.0026 * width, 0.3]];
                }
                2 => {
                    let fill_s = within(0.03, 0.3);
                    plant.gauge_at_valve = true;
                    plant.line_s = [fill_s, fill_s * within(1.0, 4.0)];
                }
                3 => plant.creep = vec![[within(0.02, 0.1), within(2.0, 5.0)], [within(0.02, 0.1), 20.0]],
                4 => plant.swing = Some([within(3.0, 6.0), within(0.02, 0.1)]),
                5 => {
                    plant.gauge_at_valve = true;
                    plant.line_s = [0.05; 2];
                    plant.leak_s = within(0.5, 3.0);
                }
                6 => {
                    let value = within(0.005, 0.03);
                    plant.changes.push(Change { what: Changing::CellN, from_s: 5.0, to_s: 30.0, value });
                }
                7 => {
                    let (from_s, value) = (within(5.0, 15.0), within(-0.004, 0.004));
                    plant.changes.push(Change { what: Changing::GaugeMpa, from_s, to_s: 30.0, value });
                }
                8 => {
                    let (from_s, value) = (within(10.0, 20.0), plant.gap_mm + within(-5.0, 5.0));
                    let to_s = from_s + within(0.5, 8.0);
                    plant.changes.push(Change { what: Changing::GapMm, from_s, to_s, value });
                }
                9 => plant.compliance = within(1.0, 6.0),
                10 => {
                    plant.shape = vec![
                        ("chambers.length_mm", 3.0 * within(0.95, 1.05)),
                        ("chambers.width_mm", 14.0 * within(0.97, 1.03)),
                        ("base.lower_mm", 2.0 * within(0.93, 1.07)),
                    ];
                }
                11 => plant.marker_stuck_s = within(10.0, 30.0),
                _ => plant.stiffness = within(0.85, 1.15),
            }
        }
        plant.name = names.join(", ");
        plant
    };
    (0..count).map(one).collect()
}

const KINDS: [(&str, usize); 13] = [
    ("gauge bias", 0),
    ("play", 1),
    ("line", 2),
    ("creep", 3),
    ("swing", 4),
    ("leak", 5),
    ("drifting cell", 6),
    ("drifting gauge", 7),
    ("moved gap", 8),
    ("soft plate", 9),
    ("another shape", 10),
    ("stuck marker", 11),
    ("stiffness", 12),
];

const ASIDE: [(&str, Profile, f64); 6] = [
    ("ramps", ramps, 0.0001),
    ("ramps", ramps, 0.0005),
    ("steps", steps, 0.0001),
    ("steps", steps, 0.0005),
    ("sines", sines, 0.0001),
    ("sines", sines, 0.0005),
];

#[test]
fn drawn_plants_are_right_or_raise_an_alarm() {
    Bench::new().all(&drawn(20), &ASIDE, 900);
}
