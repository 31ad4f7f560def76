//! Plants that differ from the model: the valve's pressure passes a line with a leak, play, creep and a swing before a body of another
//! stiffness and shape turns it into a force and a tip's position, which biased, noisy sensors read.

use estimate::{MAX_INPUTS, Measurement, Model as _, Predicted};
use rom::inputs::{GAP, PRESSURE};
use rom::rng::Rng;
use runtime::estimation::SensorModel;

/// Inner step, s.
const STEP_S: f64 = 0.001;
/// Readings per second.
pub(crate) const RATE_HZ: f64 = 50.0;
/// Duration of a run, s.
pub(crate) const SECONDS: f64 = 40.0;
/// Noise of the load cell, N, and of a marker's coordinate, mm.
pub(crate) const CELL_N: f64 = 0.003;
pub(crate) const MARKER_MM: f64 = 0.1;

/// What changes linearly during a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Changing {
    GapMm,
    GaugeMpa,
    CellN,
    LeakS,
}

/// A change to a value between two times, s.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Change {
    pub(crate) what: Changing,
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
    pub(crate) value: f64,
}

#[derive(Clone, Debug)]
pub(crate) struct Plant {
    pub(crate) name: String,
    pub(crate) mu_mpa: f64,
    pub(crate) gap_mm: f64,
    /// Further inputs of the model with the body's own values.
    pub(crate) shape: Vec<(&'static str, f64)>,
    /// The whole body is stiffer by this factor.
    pub(crate) stiffness: f64,
    /// Time constants of the line, filling and emptying, s.
    pub(crate) line_s: [f64; 2],
    /// Time constant of the leak, s.
    pub(crate) leak_s: f64,
    /// The gauge reads the pressure before the line.
    pub(crate) gauge_at_valve: bool,
    /// Thresholds (MPa) and weights of play operators.
    pub(crate) play: Vec<[f64; 2]>,
    /// Weights and times (s) of the creep.
    pub(crate) creep: Vec<[f64; 2]>,
    /// Frequency (Hz) and damping ratio.
    pub(crate) swing: Option<[f64; 2]>,
    /// Compliance of the obstacle, mm/N.
    pub(crate) compliance: f64,
    pub(crate) gauge_mpa: f64,
    pub(crate) cell_n: f64,
    /// The marker shows its position of this time from then on.
    pub(crate) marker_stuck_s: f64,
    pub(crate) changes: Vec<Change>,
}

impl Plant {
    /// A plant that is the model.
    pub(crate) fn new(name: impl Into<String>, mu_mpa: f64, gap_mm: f64) -> Self {
        Self {
            name: name.into(),
            mu_mpa,
            gap_mm,
            shape: Vec::new(),
            stiffness: 1.0,
            line_s: [0.2, 0.8],
            leak_s: f64::INFINITY,
            gauge_at_valve: false,
            play: Vec::new(),
            creep: Vec::new(),
            swing: None,
            compliance: 0.0,
            gauge_mpa: 0.0,
            cell_n: 0.0,
            marker_stuck_s: f64::INFINITY,
            changes: Vec::new(),
        }
    }

    /// Whether load cell and marker show what is there.
    pub(crate) fn has_right_sensors(&self) -> bool {
        let drifts = self.changes.iter().any(|change| change.what == Changing::CellN);
        self.cell_n == 0.0 && self.marker_stuck_s.is_infinite() && !drifts
    }

    /// A changing value at a time, from its value before the change.
    fn now(&self, what: Changing, before: f64, t_s: f64) -> f64 {
        self.changes.iter().filter(|change| change.what == what).fold(before, |before, change| {
            let share = ((t_s - change.from_s) / (change.to_s - change.from_s).max(STEP_S)).clamp(0.0, 1.0);
            before + share * (change.value - before)
        })
    }
}

/// Command of the valve over time, MPa.
pub(crate) type Profile = fn(f64) -> f64;

/// Gap, stiffness and gauge bias that a reading has; NaN where no value of the model is the right one.
pub(crate) type Truth = [f64; 3];

/// Readings of a run, each with its truth.
pub(crate) fn run(
    plant: &Plant,
    profile: Profile,
    gauge_sigma_mpa: f64,
    model: &mut SensorModel,
    keys: &[String],
    seed: u64,
) -> Vec<(Measurement, Truth)> {
    let mut random = Rng::new(seed);
    let mut body = [f64::NAN; MAX_INPUTS];
    let mut set = |key: &str, value: f64| {
        let at = keys.iter().position(|other| other == key).expect("an input of the model");
        body[at] = value;
    };
    for (key, value) in [
        ("chambers.length_mm", 3.0),
        ("chambers.width_mm", 14.0),
        ("base.lower_mm", 2.0),
        ("sheet.thickness_mm", 0.1),
        ("elastomer.law.mu_mpa", plant.mu_mpa),
    ] {
        set(key, value);
    }
    plant.shape.iter().for_each(|(key, value)| set(key, *value));
    let (mut cavity, mut crept) = (0.0_f64, vec![0.0_f64; plant.creep.len()]);
    let (mut played, mut swung) = (vec![0.0_f64; plant.play.len()], [0.0_f64; 2]);
    let (mut force_n, mut shown) = (0.0_f64, None);
    let steps = (1.0 / RATE_HZ / STEP_S).round() as usize;
    let mut predicted = [Predicted::default(); 4];
    let is_other_body = !plant.shape.is_empty() || plant.stiffness != 1.0;
    let reading = |k: usize| {
        let t_s = k as f64 / RATE_HZ;
        let (mut valve, mut acting) = (0.0, 0.0);
        for inner in 0..steps {
            let now_s = t_s + inner as f64 * STEP_S;
            valve = profile(now_s);
            let leak_s = plant.now(Changing::LeakS, plant.leak_s.min(1e9), now_s);
            let line_s = plant.line_s[usize::from(valve < cavity)];
            cavity += (valve - cavity) * (1.0 - (-STEP_S / line_s).exp()) - cavity * STEP_S / leak_s;
            let mut after_play = cavity;
            for (held, [threshold, weight]) in played.iter_mut().zip(&plant.play) {
                *held = held.clamp(cavity - threshold, cavity + threshold);
                after_play += weight * (*held - cavity);
            }
            acting = after_play;
            for (past, [weight, time_s]) in crept.iter_mut().zip(&plant.creep) {
                *past += (after_play - *past) * STEP_S / time_s;
                acting += weight * (*past - after_play);
            }
            if let Some([hz, damping]) = plant.swing {
                let omega = std::f64::consts::TAU * hz;
                swung[1] += STEP_S * (omega * omega * (acting - swung[0]) - 2.0 * damping * omega * swung[1]);
                swung[0] += STEP_S * swung[1];
                acting = swung[0];
            }
        }
        let gap_mm = plant.now(Changing::GapMm, plant.gap_mm, t_s) + plant.compliance * force_n;
        (body[PRESSURE], body[GAP]) = ((acting / plant.stiffness).max(0.0), gap_mm);
        model.predict(&body, &mut predicted);
        force_n = plant.stiffness * predicted[0].value.max(0.0);
        let mut tip_mm = [1, 2, 3].map(|row: usize| predicted[row].value);
        if t_s >= plant.marker_stuck_s {
            tip_mm = *shown.get_or_insert(tip_mm);
        }
        let bias_mpa = plant.now(Changing::GaugeMpa, plant.gauge_mpa, t_s);
        let cell_n = plant.now(Changing::CellN, plant.cell_n, t_s);
        let mut measured = Measurement::at(t_s);
        let read_mpa = if plant.gauge_at_valve { valve } else { cavity };
        measured.inputs[PRESSURE] = read_mpa + bias_mpa + gauge_sigma_mpa * random.normal();
        measured.rows[0] = force_n + cell_n + CELL_N * random.normal();
        for (row, value) in tip_mm.into_iter().enumerate() {
            measured.rows[row + 1] = value + MARKER_MM * random.normal();
        }
        let mu_mpa = if is_other_body { f64::NAN } else { plant.mu_mpa };
        (measured, [gap_mm, mu_mpa, bias_mpa])
    };
    (0..(SECONDS * RATE_HZ) as usize).map(reading).collect()
}
