//! Plants with memory that the model does not know: play, lag, swing. An interval of three standard deviations contains the truth, or
//! an alarm stands.

use crate::model::{Finger, PRESSURE, Random, setup_with_middle};
use estimate::{
    Alarm, Estimate, Filter, Fit, InputRole, MAX_INPUTS, Measurement, Model, Predicted, ResidualSeries,
    Setup, Structure, Unknown, fit,
};
use std::f64::consts::TAU;

const RATE_HZ: f64 = 100.0;
const ROWS: usize = 5;

/// Between gauge and actuator.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Plant {
    Ideal,
    /// kPa.
    Play(f64),
    /// s.
    Lag(f64),
    /// Damping ratio of a swing of 4 Hz.
    Swing(f64),
}

const PLANTS: [Plant; 11] = [
    Plant::Ideal,
    Plant::Play(1.0),
    Plant::Play(2.0),
    Plant::Play(3.5),
    Plant::Play(5.0),
    Plant::Lag(0.3),
    Plant::Lag(0.6),
    Plant::Lag(0.9),
    Plant::Lag(1.2),
    Plant::Swing(0.02),
    Plant::Swing(0.2),
];

/// Pressure after an inflation of 10 s.
#[derive(Clone, Copy, Debug)]
enum Path {
    /// A sine of this frequency, Hz.
    Sine(f64),
    /// Steps of 20 kPa every two seconds, through a valve of 50 ms.
    Steps,
}

/// Gap in mm, gauge bias in MPa, stiffness in MPa.
type Truth = [f64; 3];

fn rig() -> Setup {
    let mut setup = setup_with_middle();
    for row in &mut setup.rows {
        row.model_sigma = if row.block == 0 { 0.006 } else { 0.1 };
    }
    setup.model_correlation_s = 10.0;
    setup
}

fn pressure(t_s: f64, path: Path) -> f64 {
    let since = t_s - 10.0;
    match path {
        _ if since < 0.0 => 0.01 * t_s,
        Path::Sine(hz) => 0.08 + 0.02 * (hz * TAU * since).cos(),
        Path::Steps => {
            let [to, from] = if since % 4.0 < 2.0 { [0.08, 0.1] } else { [0.1, 0.08] };
            to + (from - to) * (-(since % 2.0) / 0.05).exp()
        }
    }
}

fn readings(plant: Plant, [gap, bias, stiffness]: Truth, path: Path, seconds: f64) -> Vec<Measurement> {
    let (mut random, mut acting, mut rate) = (Random(5), 0.0_f64, 0.0_f64);
    let reading = |k: usize| {
        let t_s = k as f64 / RATE_HZ;
        let read = pressure(t_s, path);
        match plant {
            Plant::Ideal => acting = read,
            Plant::Play(kpa) => acting = acting.clamp(read - 0.5e-3 * kpa, read + 0.5e-3 * kpa),
            Plant::Lag(lag_s) => acting += (read - acting) * (1.0 - (-1.0 / (lag_s * RATE_HZ)).exp()),
            Plant::Swing(damping) => {
                let (omega, dt_s) = (4.0 * TAU, 0.1 / RATE_HZ);
                for _ in 0..10 {
                    rate += dt_s * (omega * omega * (read - acting) - 2.0 * damping * omega * rate);
                    acting += dt_s * rate;
                }
            }
        }
        let (mut inputs, mut predicted) = ([f64::NAN; MAX_INPUTS], [Predicted::default(); ROWS]);
        inputs[..3].copy_from_slice(&[acting, gap, stiffness]);
        Finger.predict(&inputs, &mut predicted);
        let mut reading = Measurement::at(t_s);
        reading.inputs[PRESSURE] = read + bias + 0.0005 * random.normal();
        for (row, sigma) in [0.005, 0.2, 0.2, 0.2, 0.2].into_iter().enumerate() {
            reading.rows[row] = predicted[row].value + sigma * random.normal();
        }
        reading
    };
    (0..(seconds * RATE_HZ) as usize).map(reading).collect()
}

/// Largest distance from the truth, in standard deviations.
fn farthest(estimates: impl Iterator<Item = Estimate>, truth: Truth) -> f64 {
    let off = |(estimate, truth): (Estimate, f64)| (estimate.value - truth).abs() / estimate.sigma;
    estimates.zip(truth).map(off).fold(0.0, f64::max)
}

/// True if the residuals of a fit have structure: the alarm of `softtwin calibrate`.
fn is_unexplained(setup: &Setup, fit: &Fit, readings: &[Measurement]) -> bool {
    let values = fit.estimates.iter().map(|estimate| estimate.value).collect::<Vec<_>>();
    let predicted = readings.iter().map(|reading| {
        let mut out = [Predicted::default(); ROWS];
        Finger.predict(&setup.inputs(reading, &values), &mut out);
        out.map(|row| row.value)
    });
    let predicted: Vec<[f64; ROWS]> = predicted.collect();
    let of = |value: &dyn Fn(usize) -> f64| (0..readings.len()).map(value).collect::<Vec<f64>>();
    (0..ROWS).any(|row| {
        let (t_s, driving) = (of(&|i| readings[i].t_s), of(&|i| readings[i].inputs[PRESSURE]));
        let (measured, predicted) = (of(&|i| readings[i].rows[row]), of(&|i| predicted[i][row]));
        let sigma = setup.rows[row].variance(1.0).sqrt();
        let series = ResidualSeries {
            t_s: &t_s,
            measured: &measured,
            predicted: &predicted,
            driving: &driving,
            sigma,
        };
        Structure::of(series).is_some_and(|found| found.is_unexplained)
    })
}

/// One plant on one path, from the first reading on.
fn check(plant: Plant, path: Path, truth: Truth) {
    let readings = readings(plant, truth, path, 22.0);
    let mut filter = Filter::new(rig()).expect("a valid setup");
    let mut alarms = 0;
    for reading in &readings {
        let alarm = filter.update(reading, &mut Finger).alarm;
        alarms += usize::from(alarm.is_some());
        let off = farthest(filter.estimates(), truth);
        assert!(
            alarm.is_some() || off <= 3.0,
            "{plant:?} {path:?} at {} s: {off} standard deviations",
            reading.t_s
        );
        assert!(
            !matches!(alarm, Some(Alarm::Sensor(_))),
            "{plant:?} {path:?} at {} s: {alarm:?}",
            reading.t_s
        );
    }
    // Little memory widens the intervals, much of it raises an alarm.
    let shows = matches!(plant, Plant::Play(3.0..) | Plant::Lag(0.6..));
    assert!(alarms > 0 || !shows, "{plant:?} {path:?}: no alarm");
    assert!(alarms == 0 || plant != Plant::Ideal, "{path:?}: {alarms} alarms without memory");
    let few: Vec<Measurement> = readings.iter().step_by(8).copied().collect();
    let fit = fit(&rig(), &few, &mut Finger).expect("a valid setup");
    let off = farthest(fit.estimates.iter().copied(), truth);
    assert!(
        off <= 3.0 || is_unexplained(&rig(), &fit, &few),
        "{plant:?} {path:?}: fit off by {off} standard deviations"
    );
    if plant == Plant::Ideal {
        let [gap, bias, stiffness] = fit.estimates[..] else { panic!("three unknowns") };
        assert!(gap.identifiable && bias.identifiable && stiffness.identifiable, "{path:?}: {fit:?}");
        assert!(filter.estimates().all(|estimate| estimate.identifiable), "{path:?}: the filter");
    }
}

#[test]
fn intervals_contain_the_truth_or_an_alarm_stands_in_slow_cycles() {
    for plant in PLANTS {
        check(plant, Path::Sine(0.1), [42.0, 0.0009, 0.84]);
    }
}

#[test]
fn intervals_contain_the_truth_or_an_alarm_stands_in_fast_cycles() {
    for plant in PLANTS {
        check(plant, Path::Sine(0.5), [36.0, -0.001, 0.72]);
    }
}

#[test]
fn intervals_contain_the_truth_or_an_alarm_stands_in_steps() {
    for plant in PLANTS {
        check(plant, Path::Steps, [48.0, 0.0, 0.78]);
    }
}

/// A play is half of its width off in one inflation, as a bias of the gauge is.
#[test]
fn bias_is_not_identifiable_from_one_inflation() {
    let truth = [42.0, 0.0009, 0.84];
    for plant in [Plant::Ideal, Plant::Play(4.5)] {
        let readings = readings(plant, truth, Path::Sine(0.1), 10.0);
        let mut filter = Filter::new(rig()).expect("a valid setup");
        readings.iter().for_each(|reading| {
            filter.update(reading, &mut Finger);
        });
        let few: Vec<Measurement> = readings.iter().step_by(4).copied().collect();
        let fit = fit(&rig(), &few, &mut Finger).expect("a valid setup");
        for estimates in [filter.estimates().collect::<Vec<_>>(), fit.estimates] {
            let is_told: Vec<bool> = estimates.iter().map(|estimate| estimate.identifiable).collect();
            assert_eq!(is_told, [true, false, true], "{plant:?}: {estimates:?}");
            assert!(farthest(estimates.iter().copied(), truth) < 3.0, "{plant:?}: {estimates:?}");
        }
    }
}

/// The same rig with a memory of the pressure whose constants are known and whose past is not.
fn remembering_rig() -> Setup {
    let mut setup = rig();
    let name = "pressure_past".into();
    setup.unknowns.push(Unknown { name, prior: 0.0, sigma: 1.0, drift_per_sqrt_s: 0.0, range: [-1.0, 1.0] });
    let InputRole::Measured { pasts, .. } = &mut setup.inputs[PRESSURE] else {
        panic!("a measured pressure")
    };
    pasts[0] = Some(3);
    setup
}

/// Readings behind a known memory: states from the first reading, and from the smallest and the largest past.
fn behind(plant: Plant, readings: &[Measurement]) -> Vec<Measurement> {
    let follow = |acting: f64, read: f64| match plant {
        Plant::Play(kpa) => acting.clamp(read - 0.5e-3 * kpa, read + 0.5e-3 * kpa),
        Plant::Lag(lag_s) => acting + (read - acting) * (1.0 - (-1.0 / (lag_s * RATE_HZ)).exp()),
        Plant::Ideal | Plant::Swing(_) => read,
    };
    let mut states = [readings[0].inputs[PRESSURE], 0.0, 0.1];
    let one = |reading: &Measurement| {
        let read = reading.inputs[PRESSURE];
        states = states.map(|acting| follow(acting, read));
        let [acting, low, high] = states;
        let mut reading = *reading;
        reading.inputs[PRESSURE] = acting;
        reading.spread[PRESSURE][0] = (high - acting).max(acting - low);
        reading
    };
    readings.iter().map(one).collect()
}

/// Recordings that begin in the middle of an inflation: the past is unknown. Noise of the gauge moves a play further than the pressure does,
/// which may raise an alarm.
#[test]
fn known_memory_with_unknown_past_is_estimated_through() {
    let plants = [
        Plant::Ideal,
        Plant::Play(2.0),
        Plant::Play(3.5),
        Plant::Play(5.0),
        Plant::Lag(0.1),
        Plant::Lag(0.5),
        Plant::Lag(1.0),
        Plant::Lag(1.5),
    ];
    let cases = [
        (Path::Sine(0.1), [42.0, 0.0009, 0.84]),
        (Path::Sine(0.5), [36.0, -0.001, 0.72]),
        (Path::Steps, [48.0, 0.0, 0.78]),
    ];
    for (plant, (path, truth)) in plants.iter().flat_map(|plant| cases.map(|case| (*plant, case))) {
        let readings = behind(plant, &readings(plant, truth, path, 26.0)[400..]);
        let mut filter = Filter::new(remembering_rig()).expect("a valid setup");
        let mut alarm = None;
        for reading in &readings {
            alarm = filter.update(reading, &mut Finger).alarm;
            let off = farthest(filter.estimates(), truth);
            assert!(alarm.is_some() || off <= 3.0, "{plant:?} {path:?} at {} s: {off}", reading.t_s);
        }
        let estimates: Vec<Estimate> = filter.estimates().collect();
        let is_play = matches!(plant, Plant::Play(_));
        assert!(alarm.is_none() || is_play, "{plant:?} {path:?}: {alarm:?}, {estimates:?}");
        let is_told = estimates[0].identifiable && estimates[2].identifiable;
        assert!(is_told || is_play, "{plant:?} {path:?}: {estimates:?}");
        let few: Vec<Measurement> = readings.iter().step_by(8).copied().collect();
        let fit = fit(&remembering_rig(), &few, &mut Finger).expect("a valid setup");
        let off = farthest(fit.estimates.iter().copied(), truth);
        let is_explained = !is_unexplained(&remembering_rig(), &fit, &few);
        assert!(off <= 3.0 || !is_explained, "{plant:?} {path:?}: fit off by {off}, {fit:?}");
        assert!(is_explained || is_play, "{plant:?} {path:?}: {fit:?}");
    }
}
