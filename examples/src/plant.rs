//! A simulated actuator to try controllers on: valve and tubes as a first-order lag behind a delay, the contact force of
//! the trained model at the true gap, a gauge and a load cell with noise.
//!
//! `dp/dt = (u(t - delay) - p) / tau`, `F = F_model(p, true gap)`; the gauge shows `p + noise`, the load cell `F + noise`.

use runtime::query::Solver;
use std::collections::VecDeque;

/// What the plant is like.
#[derive(Debug, Clone, Copy)]
pub struct PlantSpec {
    /// Time constant of the pneumatics, s.
    pub tau_s: f64,
    /// Time from command to valve, s.
    pub delay_s: f64,
    /// Highest pressure of the supply, MPa.
    pub supply_mpa: f64,
    /// The gap that really is there, mm.
    pub true_gap_mm: f64,
    /// Standard deviation of the gauge's noise, MPa.
    pub gauge_noise_mpa: f64,
    /// Standard deviation of the load cell's noise, N.
    pub cell_noise_n: f64,
    /// Of the noise.
    pub seed: u64,
}

/// What the instruments show, and the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Gauge, MPa.
    pub pressure_mpa: f64,
    /// Load cell, N.
    pub force_n: f64,
    /// The true force, N.
    pub true_force_n: f64,
}

/// The plant in motion.
#[derive(Debug)]
pub struct Plant {
    spec: PlantSpec,
    solver: Solver,
    pressure_mpa: f64,
    /// Commands on their way to the valve: when they arrive, s, and what they want.
    under_way: VecDeque<(f64, f64)>,
    wanted_mpa: f64,
    time_s: f64,
    noise: u64,
}

impl Plant {
    /// A plant at rest.
    pub fn new(spec: PlantSpec, solver: Solver) -> Self {
        let noise = spec.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        Self {
            spec,
            solver,
            pressure_mpa: 0.0,
            under_way: VecDeque::new(),
            wanted_mpa: 0.0,
            time_s: 0.0,
            noise,
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
        self.time_s += dt_s;
        while let Some((arrives_s, wanted)) =
            self.under_way.front().copied().filter(|(at, _)| *at <= self.time_s)
        {
            self.wanted_mpa = wanted;
            self.under_way.retain(|(at, _)| *at > arrives_s);
        }
        // The lag's exact step for a command that stays over it.
        self.pressure_mpa += (self.wanted_mpa - self.pressure_mpa) * (1.0 - (-dt_s / self.spec.tau_s).exp());
        let true_force_n = self.solver.evaluate(self.pressure_mpa, self.spec.true_gap_mm).contact_force_n;
        let (gauge, cell) = (self.gauss() * self.spec.gauge_noise_mpa, self.gauss() * self.spec.cell_noise_n);
        Reading { pressure_mpa: self.pressure_mpa + gauge, force_n: true_force_n + cell, true_force_n }
    }

    /// A normal number, by the sum of twelve uniform ones (xorshift).
    fn gauss(&mut self) -> f64 {
        let mut uniform = || {
            self.noise ^= self.noise << 13;
            self.noise ^= self.noise >> 7;
            self.noise ^= self.noise << 17;
            (self.noise >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}
