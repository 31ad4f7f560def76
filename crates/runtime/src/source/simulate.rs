//! Readings by formula: for tests, demonstrations and controllers without hardware.

use super::reading::{Reading, Scheduled, Source};
use crate::problems::Problems;
use rom::memory::ATMOSPHERE_MPA;
use rom::rng::Rng;
use serde::{Deserialize, Serialize};
use wire::SensorSample;

/// Settings of a simulated gauge.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SimulateSpec {
    /// Readings per second.
    pub rate_hz: f64,
    /// Duration, s; infinite: never ends.
    pub duration_s: f64,
    /// Measured gap, mm; NaN: none.
    pub gap_mm: f64,
    /// Standard deviation of the gauge's noise, MPa.
    pub noise_mpa: f64,
    /// Resolution of the gauge, MPa; 0: continuous.
    pub resolution_mpa: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// The true pressure over time.
    pub profile: Profile,
}

impl Default for SimulateSpec {
    fn default() -> Self {
        Self {
            rate_hz: 200.0,
            duration_s: f64::INFINITY,
            gap_mm: f64::NAN,
            noise_mpa: 0.0,
            resolution_mpa: 0.0,
            seed: 1,
            profile: Profile::Sine { mean_mpa: 0.03, amplitude_mpa: 0.03, frequency_hz: 0.25 },
        }
    }
}

/// True pressure over time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "shape", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Profile {
    /// Constant air flow into a cavity of volume `V0 + c P`, isothermal: `(P + Pa)(V0 + c P) = Pa (V0 + Q t)`, then held.
    ConstantFlow {
        /// Air flow at ambient pressure, mL/min.
        flow_ml_per_min: f64,
        /// Undeformed cavity volume, mm^3.
        volume_mm3: f64,
        /// Growth of the cavity, mm^3/MPa.
        compliance_mm3_per_mpa: f64,
        /// Pressure at which the flow stops, MPa.
        until_mpa: f64,
    },
    /// From one pressure to another, then held.
    Ramp {
        /// At the start, MPa.
        from_mpa: f64,
        /// At the end, MPa.
        to_mpa: f64,
        /// How long it takes, s.
        rise_s: f64,
    },
    /// A jump.
    Step {
        /// Before, MPa.
        low_mpa: f64,
        /// After, MPa.
        high_mpa: f64,
        /// When, s.
        at_s: f64,
    },
    /// `mean + amplitude sin(2 pi f t - pi/2)`: begins at the minimum.
    Sine { mean_mpa: f64, amplitude_mpa: f64, frequency_hz: f64 },
}

impl Profile {
    /// True pressure at `t_s`, MPa.
    pub fn pressure_mpa(&self, t_s: f64) -> f64 {
        match *self {
            Self::ConstantFlow { flow_ml_per_min, volume_mm3, compliance_mm3_per_mpa: c, until_mpa } => {
                // c P^2 + (V0 + c Pa) P - Pa Q t = 0, positive root in the form that survives c = 0.
                let inflow_mm3 = flow_ml_per_min * 1000.0 / 60.0 * t_s;
                let half = 0.5 * (volume_mm3 + c * ATMOSPHERE_MPA);
                let load = ATMOSPHERE_MPA * inflow_mm3;
                (load / (half + (half * half + c * load).sqrt())).min(until_mpa)
            }
            Self::Ramp { from_mpa, to_mpa, rise_s } => {
                from_mpa + (to_mpa - from_mpa) * (t_s / rise_s).min(1.0)
            }
            Self::Step { low_mpa, high_mpa, at_s } => {
                if t_s < at_s {
                    low_mpa
                } else {
                    high_mpa
                }
            }
            Self::Sine { mean_mpa, amplitude_mpa, frequency_hz } => {
                let phase = std::f64::consts::TAU * frequency_hz * t_s - std::f64::consts::FRAC_PI_2;
                mean_mpa + amplitude_mpa * phase.sin()
            }
        }
    }

    /// All errors in it.
    fn problems(&self, problems: &mut Problems) {
        match *self {
            Self::ConstantFlow { flow_ml_per_min, volume_mm3, compliance_mm3_per_mpa, until_mpa } => {
                problems.above_0("flow_ml_per_min", flow_ml_per_min);
                problems.above_0("volume_mm3", volume_mm3);
                problems.at_least_0("compliance_mm3_per_mpa", compliance_mm3_per_mpa);
                problems.finite("until_mpa", until_mpa);
            }
            Self::Ramp { from_mpa, to_mpa, rise_s } => {
                problems.finite("from_mpa", from_mpa);
                problems.finite("to_mpa", to_mpa);
                problems.seconds("rise_s", rise_s);
            }
            Self::Step { low_mpa, high_mpa, at_s } => {
                problems.finite("low_mpa", low_mpa);
                problems.finite("high_mpa", high_mpa);
                problems.range("at_s", at_s, [0.0, 31_536_000.0]);
            }
            Self::Sine { mean_mpa, amplitude_mpa, frequency_hz } => {
                problems.finite("mean_mpa", mean_mpa);
                problems.finite("amplitude_mpa", amplitude_mpa);
                problems.rate_hz("frequency_hz", frequency_hz);
            }
        }
    }
}

impl SimulateSpec {
    /// Checks the specification.
    ///
    /// # Errors
    /// All its problems.
    pub(super) fn open(&self) -> Result<Box<dyn Source>, Vec<String>> {
        let mut list = Vec::new();
        let mut problems = Problems::new(&mut list, "source");
        problems.rate_hz("rate_hz", self.rate_hz);
        problems.at_least_0("noise_mpa", self.noise_mpa);
        problems.at_least_0("resolution_mpa", self.resolution_mpa);
        problems.expect(self.duration_s > 0.0, "duration_s", "more than 0 (or inf)", self.duration_s);
        self.profile.problems(&mut problems.part("profile"));
        if !list.is_empty() {
            return Err(list);
        }
        let simulation = Simulation { rng: Rng::new(self.seed), spec: self.clone(), count: 0 };
        Ok(Box::new(Scheduled::new(simulation)))
    }
}

/// The readings of a formula that are still to come.
#[derive(Debug)]
struct Simulation {
    spec: SimulateSpec,
    rng: Rng,
    count: u64,
}

impl Iterator for Simulation {
    type Item = Reading;

    /// The next reading; `None` after `duration_s`.
    fn next(&mut self) -> Option<Reading> {
        let t_s = self.count as f64 / self.spec.rate_hz;
        if t_s > self.spec.duration_s {
            return None;
        }
        self.count += 1;
        let noisy = self.spec.profile.pressure_mpa(t_s) + self.spec.noise_mpa * self.rng.normal();
        let resolution = self.spec.resolution_mpa;
        let sample = SensorSample {
            t_trace_s: t_s,
            pressure_mpa: if resolution > 0.0 { (noisy / resolution).round() * resolution } else { noisy },
            gap_mm: self.spec.gap_mm,
            ..SensorSample::default()
        };
        Some(Reading { sample, due_s: t_s })
    }
}
