//! Readings by formula: for tests, demonstrations and controllers without hardware.

use super::reading::{Reading, Scheduled, Source};
use rom::rng::Rng;
use serde::{Deserialize, Serialize};
use wire::SensorSample;

/// Pressure of the surrounding air, MPa.
const AMBIENT_MPA: f64 = 0.101325;

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
    Sine {
        /// Mean, MPa.
        mean_mpa: f64,
        /// Amplitude, MPa.
        amplitude_mpa: f64,
        /// Frequency, Hz.
        frequency_hz: f64,
    },
}

impl Profile {
    /// True pressure at `t_s`, MPa.
    pub fn pressure_mpa(&self, t_s: f64) -> f64 {
        match *self {
            Self::ConstantFlow { flow_ml_per_min, volume_mm3, compliance_mm3_per_mpa: c, until_mpa } => {
                // c P^2 + (V0 + c Pa) P - Pa Q t = 0, positive root in the form that survives c = 0.
                let inflow_mm3 = flow_ml_per_min * 1000.0 / 60.0 * t_s;
                let half = 0.5 * (volume_mm3 + c * AMBIENT_MPA);
                let load = AMBIENT_MPA * inflow_mm3;
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

    /// Keys and values, each with the rule it must keep.
    fn rules(&self) -> Vec<(&'static str, f64, Rule)> {
        match *self {
            Self::ConstantFlow { flow_ml_per_min, volume_mm3, compliance_mm3_per_mpa, until_mpa } => vec![
                ("profile.flow_ml_per_min", flow_ml_per_min, Rule::Above0),
                ("profile.volume_mm3", volume_mm3, Rule::Above0),
                ("profile.until_mpa", until_mpa, Rule::Finite),
                ("profile.compliance_mm3_per_mpa", compliance_mm3_per_mpa, Rule::AtLeast0),
            ],
            Self::Ramp { from_mpa, to_mpa, rise_s } => vec![
                ("profile.from_mpa", from_mpa, Rule::Finite),
                ("profile.to_mpa", to_mpa, Rule::Finite),
                ("profile.rise_s", rise_s, Rule::Above0),
            ],
            Self::Step { low_mpa, high_mpa, at_s } => vec![
                ("profile.low_mpa", low_mpa, Rule::Finite),
                ("profile.high_mpa", high_mpa, Rule::Finite),
                ("profile.at_s", at_s, Rule::Finite),
            ],
            Self::Sine { mean_mpa, amplitude_mpa, frequency_hz } => vec![
                ("profile.mean_mpa", mean_mpa, Rule::Finite),
                ("profile.amplitude_mpa", amplitude_mpa, Rule::Finite),
                ("profile.frequency_hz", frequency_hz, Rule::Above0),
            ],
        }
    }
}

/// Rule for a value of the specification.
#[derive(Debug, Clone, Copy)]
enum Rule {
    Finite,
    AtLeast0,
    Above0,
    /// Above 0, infinity allowed.
    Duration,
}

impl Rule {
    /// The rule for the user when `value` breaks it.
    fn broken_by(self, value: f64) -> Option<&'static str> {
        let (kept, text) = match self {
            Self::Finite => (value.is_finite(), "a finite number"),
            Self::AtLeast0 => (value.is_finite() && value >= 0.0, "0 or more"),
            Self::Above0 => (value.is_finite() && value > 0.0, "a finite number above 0"),
            Self::Duration => (value > 0.0, "more than 0 (or inf)"),
        };
        (!kept).then_some(text)
    }
}

impl SimulateSpec {
    /// Checks the specification.
    ///
    /// # Errors
    /// All its problems.
    pub(super) fn open(&self) -> Result<Box<dyn Source>, Vec<String>> {
        let own = [
            ("rate_hz", self.rate_hz, Rule::Above0),
            ("noise_mpa", self.noise_mpa, Rule::AtLeast0),
            ("resolution_mpa", self.resolution_mpa, Rule::AtLeast0),
            ("duration_s", self.duration_s, Rule::Duration),
        ];
        let problems: Vec<String> = own
            .into_iter()
            .chain(self.profile.rules())
            .filter_map(|(key, value, rule)| {
                Some(format!("source.{key}: expected {}, found {value}", rule.broken_by(value)?))
            })
            .collect();
        if !problems.is_empty() {
            return Err(problems);
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
