use super::*;
use control::inverse::{Model, Point};
use control::plant::{Plant, PlantSpec};
use rom::memory::{Line, Play};

/// F = 10 N/MPa times the pressure; the observable falls by 800 mm/MPa, and stiffens.
#[derive(Clone, Copy)]
struct Bent;

impl Model for Bent {
    fn at(&mut self, pressure_mpa: f64, _: f64) -> Point {
        Point {
            force_n: 10.0 * pressure_mpa,
            force_by_pressure: 10.0,
            observable: -800.0 * pressure_mpa * (1.0 - 3.0 * pressure_mpa),
            observable_by_pressure: -800.0 * (1.0 - 6.0 * pressure_mpa),
            onset_mpa: 0.0,
        }
    }
    fn range_mpa(&self) -> [f64; 2] {
        [0.0, 0.09]
    }
    fn observable_grows(&self) -> bool {
        false
    }
}

fn rows(spec: PlantSpec, experiment: &Experiment, is_measured: bool) -> Vec<ActuationCycle> {
    let mut plant = Plant::new(spec, Bent);
    let row = |at: usize| {
        let time_s = at as f64 / 200.0;
        let command_mpa = experiment.at(time_s);
        let shown = plant.step(1.0 / 200.0);
        plant.command(command_mpa);
        let measured = if is_measured { shown.observable } else { f64::NAN };
        ActuationCycle { time_s, command_mpa, gauge_mpa: shown.pressure_mpa, measured }
    };
    (0..(200.0 * experiment.end_s()) as usize).map(row).collect()
}

/// The constants of a plant with line, play, swing and a biased gauge come back from its experiment.
#[test]
fn constants_of_a_plant_are_identified() {
    let spec = PlantSpec {
        valve_s: 0.0,
        line: Line { fill_s: 0.15, empty_s: 0.5 },
        play: vec![Play { threshold: 2e-3, weight: 1.0 }],
        swing_hz: 3.0,
        swing_damping: 0.03,
        delay_s: 0.02,
        gauge_bias_mpa: 1e-3,
        ..PlantSpec::default()
    };
    let experiment = Experiment::new([0.0, 0.06], 0.1, 2.0);
    let rows = rows(spec, &experiment, true);
    let found = identify_actuation(&rows, &experiment.holds_s, true, true);
    let of = settings(&Settings::default(), &found);
    let near =
        |found: f64, truth: f64, error: f64| assert!((found / truth - 1.0).abs() < error, "{found} {truth}");
    near(of.line.fill_s, 0.15, 0.15);
    near(of.line.empty_s, 0.5, 0.1);
    near(of.swing_hz, 3.0, 0.03);
    assert!((0.01..0.08).contains(&of.swing_damping), "{}", of.swing_damping);
    assert!((of.delay_s - 0.02).abs() < 0.005, "{}", of.delay_s);
    let half_mpa: f64 = of.play.iter().map(|play| play.weight * play.threshold).sum();
    near(half_mpa, 2e-3, 0.2);
    near(found.noise.unwrap(), 0.02, 0.2);
    assert_eq!(found.remarks, Vec::<String>::new());
}

/// Without play and swing none is found; without a sensor none is looked for, and both are named.
#[test]
fn effects_that_are_not_there_or_not_measured_are_named() {
    let spec = PlantSpec { line: Line { fill_s: 0.1, empty_s: 0.1 }, ..PlantSpec::default() };
    let experiment = Experiment::new([0.0, 0.06], 0.1, 2.0);
    for (is_measured, remarks) in [(true, 2), (false, 1)] {
        let rows = rows(spec.clone(), &experiment, is_measured);
        let found = identify_actuation(&rows, &experiment.holds_s, true, is_measured);
        let settings = settings(&Settings::default(), &found);
        assert_eq!((settings.swing_hz, settings.play.len()), (0.0, 0));
        assert_eq!(found.remarks.len(), remarks, "{:?}", found.remarks);
    }
}

/// Only the keys change; comments, other tables and the other actuator stay.
#[test]
fn settings_are_written_with_comments_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    let text = "# rig\nname = \"s\"\n[[actuator]]\nname = \"a\"\n[[actuator]]\nname = \"b\" # second\n\
                [actuator.control]\nhold = \"tip\"\ndelay_s = 0.5 # s\nvalve_mpa_per_s = 0.1\n";
    std::fs::write(&path, text).unwrap();
    let settings = Settings {
        line: Line { fill_s: 0.25, empty_s: 1.0 },
        play: vec![Play { threshold: 1e-3, weight: 1.0 }],
        ..Settings::default()
    };
    scene::write(&path, 1, "tip", &settings).unwrap();
    let new = std::fs::read_to_string(&path).unwrap();
    for kept in ["# rig\n", "name = \"b\" # second\n", "hold = \"tip\"\n", "delay_s = 0.01 # s\n"] {
        assert!(new.contains(kept), "{kept}: {new}");
    }
    let table: toml::Table = new.parse().unwrap();
    let control = table["actuator"][1]["control"].clone();
    let all: Settings = control.try_into().unwrap();
    assert!(all.play.is_empty() && all.of("force").unwrap().play.is_empty());
    let read = all.of("tip").unwrap();
    assert_eq!((read.line, read.play, read.hold.as_str()), (settings.line, settings.play, "tip"));
    assert_eq!(read.valve_mpa_per_s, None);
    assert!(table["actuator"][0].get("control").is_none());
}
