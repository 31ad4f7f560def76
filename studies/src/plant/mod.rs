//! A simulated actuator to try controllers on: delay, valve, line and chambers, contact force and tip, gauge and load cell with
//! noise.
//!
//! `dv/dt = (u(t - delay) + offset - v) / tau_valve`, `dp/dt = (v - p) / tau_line` (the tube's resistance times the compliance of
//! line and chambers), `(F, tip) = truth(p, true gap)`; the gauge shows `p + noise`, the load cell `F + noise`.

pub mod modbus;
pub mod on_wire;
pub mod report;
mod rig;
pub mod table;

use rom::rng::Rng;
use runtime::query::Solver;
use std::collections::VecDeque;
use table::PlantTable;

/// Parameters of the plant.
#[derive(Debug, Clone, Copy)]
pub struct PlantSpec {
    /// Time constant of the valve, s.
    pub valve_s: f64,
    /// Time constant of line and chambers, s; 0: none.
    pub line_s: f64,
    /// Time from command to valve, s.
    pub delay_s: f64,
    /// Highest pressure of the supply, MPa.
    pub supply_mpa: f64,
    /// Offset of the valve, MPa.
    pub valve_offset_mpa: f64,
    /// The gap that really is there, mm.
    pub true_gap_mm: f64,
    /// Stiffness of the body, by that of the table; a model's plant takes 1 only.
    pub stiffness: f64,
    /// Standard deviation of the gauge's noise, MPa.
    pub gauge_noise_mpa: f64,
    /// Standard deviation of the load cell's noise, N.
    pub cell_noise_n: f64,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for PlantSpec {
    /// A proportional valve of 20 ms behind 10 ms of delay, a line of 60 ms, a gauge of 50 Pa and a load cell of 2 mN.
    fn default() -> Self {
        Self {
            valve_s: 0.02,
            line_s: 0.06,
            delay_s: 0.01,
            supply_mpa: 0.09,
            valve_offset_mpa: 0.0,
            true_gap_mm: 30.0,
            stiffness: 1.0,
            gauge_noise_mpa: 5e-5,
            cell_noise_n: 2e-3,
            seed: 1,
        }
    }
}

/// Source of true force and tip.
#[derive(Debug)]
pub enum Truth {
    /// A second finite-element mesh.
    Table(PlantTable),
    /// A trained model; its tip is not followed.
    Model(Box<Solver>),
}

/// Instrument values and true values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Gauge, MPa.
    pub pressure_mpa: f64,
    /// Load cell, N.
    pub force_n: f64,
    /// The true force, N.
    pub true_force_n: f64,
    /// The tip's true height, mm; NaN of a model.
    pub true_tip_mm: f64,
}

/// The plant in motion.
#[derive(Debug)]
pub struct Plant {
    /// Parameters; gap and offset may be changed while it moves.
    pub spec: PlantSpec,
    truth: Truth,
    valve_mpa: f64,
    pressure_mpa: f64,
    /// Commands on their way to the valve: when they arrive, s, and what they want.
    under_way: VecDeque<(f64, f64)>,
    wanted_mpa: f64,
    time_s: f64,
    noise: Rng,
}

/// Longest step of the equations, s.
const STEP_S: f64 = 1e-3;

impl Plant {
    /// A plant at rest.
    pub fn new(spec: PlantSpec, truth: Truth) -> Self {
        Self {
            spec,
            truth,
            valve_mpa: 0.0,
            pressure_mpa: 0.0,
            under_way: VecDeque::new(),
            wanted_mpa: 0.0,
            time_s: 0.0,
            noise: Rng::new(spec.seed),
        }
    }

    /// Takes a command; the supply cannot do more than it can.
    pub fn command(&mut self, pressure_mpa: f64) {
        if pressure_mpa.is_finite() {
            let arrives_s = self.time_s + self.spec.delay_s;
            self.under_way.push_back((arrives_s, pressure_mpa.clamp(0.0, self.spec.supply_mpa)));
        }
    }

    /// Moves on by `dt_s` and reads the instruments.
    pub fn step(&mut self, dt_s: f64) -> Reading {
        let steps = (dt_s / STEP_S).ceil().max(1.0) as usize;
        for _ in 0..steps {
            self.advance(dt_s / steps as f64);
        }
        let PlantSpec { true_gap_mm, stiffness, gauge_noise_mpa, cell_noise_n, .. } = self.spec;
        let (true_force_n, true_tip_mm) = match &mut self.truth {
            Truth::Table(table) => table.at(self.pressure_mpa, true_gap_mm, stiffness),
            Truth::Model(solver) => {
                (solver.evaluate(self.pressure_mpa, true_gap_mm).contact_force_n, f64::NAN)
            }
        };
        let (gauge, cell) = (self.noise.normal() * gauge_noise_mpa, self.noise.normal() * cell_noise_n);
        Reading {
            pressure_mpa: self.pressure_mpa + gauge,
            force_n: true_force_n + cell,
            true_force_n,
            true_tip_mm,
        }
    }

    /// One step of the equations: each lag exact for an input that stays over it.
    fn advance(&mut self, dt_s: f64) {
        self.time_s += dt_s;
        while self.under_way.front().is_some_and(|(arrives_s, _)| *arrives_s <= self.time_s) {
            self.wanted_mpa = self.under_way.pop_front().map_or(self.wanted_mpa, |(_, wanted)| wanted);
        }
        let share = |tau_s: f64| if tau_s > 0.0 { 1.0 - (-dt_s / tau_s).exp() } else { 1.0 };
        let setpoint = (self.wanted_mpa + self.spec.valve_offset_mpa).clamp(0.0, self.spec.supply_mpa);
        self.valve_mpa += (setpoint - self.valve_mpa) * share(self.spec.valve_s);
        self.pressure_mpa += (self.valve_mpa - self.pressure_mpa) * share(self.spec.line_s);
    }
}
