//! A simulated actuator to try controllers on: delay, valve, line, play, swing, contact force and observable, gauge and sensor with noise.
//!
//! ```text
//! w' = (u(t - delay) + offset - w) / tau_valve,   c' = (w - c) / tau of filling or emptying,   v = H(c)
//! q'' = w_s^2 (v - q) - 2 z w_s q',               (F, y) = body(q, true gap)
//! ```
//!
//! The gauge shows `c` (or `w`) plus bias and noise.

use crate::inverse::{Model, Quantity};
use crate::settings::GaugeAt;
use crate::shape::{Plays, lag};
use rom::memory::{Line, Play};
use rom::rng::Rng;
use std::collections::VecDeque;

/// Parameters of the plant.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantSpec {
    /// Time constant of the valve, s; 0: none.
    pub valve_s: f64,
    /// Time constants of line and chambers, s.
    pub line: Line,
    /// Play operators, MPa.
    pub play: Vec<Play>,
    /// Frequency of the swing, Hz; 0: none.
    pub swing_hz: f64,
    pub swing_damping: f64,
    /// Time from command to valve, s.
    pub delay_s: f64,
    /// Highest pressure of the supply, MPa.
    pub supply_mpa: f64,
    pub valve_offset_mpa: f64,
    pub gauge_bias_mpa: f64,
    /// Place of the gauge.
    pub gauge_at: GaugeAt,
    pub true_gap_mm: f64,
    /// Stiffness of the body relative to that of [`RestingBody`].
    pub stiffness: f64,
    /// Standard deviation of the gauge's noise, MPa.
    pub gauge_noise_mpa: f64,
    /// Standard deviations of the noise of the load cell, N, and of the sensor of the observable.
    pub noise: [f64; 2],
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for PlantSpec {
    /// A proportional valve of 20 ms behind 10 ms of delay, a line of 60 ms, a gauge of 50 Pa and a load cell of 2 mN.
    fn default() -> Self {
        Self {
            valve_s: 0.02,
            line: Line { fill_s: 0.06, empty_s: 0.06 },
            play: Vec::new(),
            swing_hz: 0.0,
            swing_damping: 0.02,
            delay_s: 0.01,
            supply_mpa: 0.09,
            valve_offset_mpa: 0.0,
            gauge_bias_mpa: 0.0,
            gauge_at: GaugeAt::Cavity,
            true_gap_mm: 30.0,
            stiffness: 1.0,
            gauge_noise_mpa: 5e-5,
            noise: [2e-3, 0.02],
            seed: 1,
        }
    }
}

/// Force and observable of a body at rest, by pressure in MPa, gap in mm and relative stiffness. A model whose silicone and sheet are `k`
/// times as stiff has the shape of `p / k` and `k` times its force, its weight and the plate's give aside.
pub trait RestingBody {
    /// Contact force, N, and observable.
    fn answer(&mut self, pressure_mpa: f64, gap_mm: f64, stiffness: f64) -> [f64; 2];
}

impl<M: Model> RestingBody for M {
    fn answer(&mut self, pressure_mpa: f64, gap_mm: f64, stiffness: f64) -> [f64; 2] {
        let point = Model::at(self, pressure_mpa / stiffness, gap_mm);
        [stiffness * point.force_n, point.observable]
    }
}

/// Instrument values and true values.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PlantReading {
    /// Gauge, MPa.
    pub pressure_mpa: f64,
    /// Load cell, N.
    pub force_n: f64,
    /// Sensor of the observable.
    pub observable: f64,
    pub true_force_n: f64,
    pub true_observable: f64,
    /// The true pressure in the cavity, MPa.
    pub true_pressure_mpa: f64,
}

impl PlantReading {
    /// Measured and true value of a quantity.
    pub fn of(&self, quantity: Quantity) -> [f64; 2] {
        match quantity {
            Quantity::Force => [self.force_n, self.true_force_n],
            Quantity::Observable => [self.observable, self.true_observable],
            Quantity::Pressure => [self.pressure_mpa, self.true_pressure_mpa],
        }
    }
}

/// The plant in motion.
#[derive(Debug)]
pub struct Plant<B> {
    /// Parameters; gap, offset, supply and bias may be changed while it moves.
    pub spec: PlantSpec,
    body: B,
    valve_mpa: f64,
    cavity_mpa: f64,
    plays: Plays,
    /// Pressure behind play and swing, MPa, and its change, MPa/s.
    swing: [f64; 2],
    /// Commands on their way to the valve: when they arrive, s, and their pressure.
    under_way: VecDeque<(f64, f64)>,
    wanted_mpa: f64,
    time_s: f64,
    noise: Rng,
}

/// Longest step of the equations, s.
const STEP_S: f64 = 1e-3;

impl<B: RestingBody> Plant<B> {
    /// A plant at rest without pressure.
    pub fn new(spec: PlantSpec, body: B) -> Self {
        Self {
            body,
            valve_mpa: 0.0,
            cavity_mpa: 0.0,
            plays: Plays::at(0.0),
            swing: [0.0; 2],
            under_way: VecDeque::new(),
            wanted_mpa: 0.0,
            time_s: 0.0,
            noise: Rng::new(spec.seed),
            spec,
        }
    }

    /// Takes a command, within what the supply has.
    pub fn command(&mut self, pressure_mpa: f64) {
        if pressure_mpa.is_finite() {
            self.under_way.push_back((self.time_s + self.spec.delay_s, pressure_mpa));
        }
    }

    /// Advances by `dt_s` and reads the instruments.
    pub fn step(&mut self, dt_s: f64) -> PlantReading {
        let steps = (dt_s / STEP_S).ceil().max(1.0) as usize;
        for _ in 0..steps {
            self.advance(dt_s / steps as f64);
        }
        let PlantSpec { true_gap_mm, stiffness, gauge_noise_mpa, gauge_bias_mpa, gauge_at, noise, .. } =
            self.spec;
        let [true_force_n, true_observable] = self.body.answer(self.swing[0], true_gap_mm, stiffness);
        let at_gauge_mpa = if gauge_at == GaugeAt::Cavity { self.cavity_mpa } else { self.valve_mpa };
        let [gauge, force, observable] =
            [gauge_noise_mpa, noise[0], noise[1]].map(|sigma| sigma * self.noise.normal());
        PlantReading {
            pressure_mpa: at_gauge_mpa + gauge_bias_mpa + gauge,
            force_n: true_force_n + force,
            observable: true_observable + observable,
            true_force_n,
            true_observable,
            true_pressure_mpa: self.cavity_mpa,
        }
    }

    /// One step of the equations: lags exact for an input that is held over it, the swing symplectic.
    fn advance(&mut self, dt_s: f64) {
        let spec = &self.spec;
        self.time_s += dt_s;
        while self.under_way.front().is_some_and(|(arrives_s, _)| *arrives_s <= self.time_s) {
            self.wanted_mpa = self.under_way.pop_front().map_or(self.wanted_mpa, |(_, wanted)| wanted);
        }
        let setpoint_mpa = (self.wanted_mpa + spec.valve_offset_mpa).clamp(0.0, spec.supply_mpa);
        let valve = Line { fill_s: spec.valve_s, empty_s: spec.valve_s };
        self.valve_mpa =
            if spec.valve_s > 0.0 { lag(self.valve_mpa, setpoint_mpa, valve, dt_s) } else { setpoint_mpa };
        self.cavity_mpa = lag(self.cavity_mpa, self.valve_mpa, spec.line, dt_s);
        let behind_mpa = self.plays.follow(&spec.play, self.cavity_mpa);
        if spec.swing_hz <= 0.0 {
            self.swing = [behind_mpa, 0.0];
            return;
        }
        let w = std::f64::consts::TAU * spec.swing_hz;
        let [at, speed] = self.swing;
        let faster = speed + dt_s * (w * w * (behind_mpa - at) - 2.0 * spec.swing_damping * w * speed);
        self.swing = [at + dt_s * faster, faster];
    }
}
