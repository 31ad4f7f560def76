//! Inflation at constant flow: what a pressure gauge reads while a pump fills the cavity.
//!
//! The pump delivers the volume flow Q of air at atmospheric pressure p_a into the cavity of volume V(P) and the dead
//! volume V_d of the tube. The gas stays at room temperature (isothermal, ideal), P is gauge pressure:
//!
//! ```text
//! (p_a + P) (V(P) + V_d) = p_a (V(0) + V_d) + p_a Q t
//! ```
//!
//! so the time at which a pressure is reached is explicit, and P(t) follows by inverting it (it must rise).

use anyhow::{anyhow, ensure};
use rom::rng::Rng;
use softtwin::range::{self, MAX_PRESSURE_MPA};

/// Atmospheric pressure, MPa.
pub const ATMOSPHERE_MPA: f64 = 0.101_325;

/// A pump, a gauge and how they are sampled. The defaults are the paper's flow and a digital gauge.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct Inflation {
    /// Flow of air at atmospheric pressure in mL/min.
    #[arg(long, value_name = "FLOW", default_value_t = 125.0, value_parser = range::number(1e-6, 1e9))]
    pub flow_ml_per_min: f64,
    /// Volume of tube and fittings in mm3.
    #[arg(long, value_name = "MM3", default_value_t = 0.0, value_parser = range::number(0.0, 1e12))]
    pub dead_volume_mm3: f64,
    /// Gauge pressure at which the pump stops in MPa.
    #[arg(long, value_name = "MPA", default_value_t = 0.07, value_parser = range::number(1e-9, MAX_PRESSURE_MPA))]
    pub end_pressure_mpa: f64,
    /// Readings a second.
    #[arg(long, value_name = "HZ", default_value_t = 200.0, value_parser = range::number(1e-3, 1e6))]
    pub rate_hz: f64,
    /// Step of the gauge's display in MPa; 0 for none.
    #[arg(long, value_name = "MPA", default_value_t = 1.0e-4, value_parser = range::number(0.0, 1.0))]
    pub resolution_mpa: f64,
    /// Standard deviation of the gauge's noise before rounding in MPa.
    #[arg(long, value_name = "MPA", default_value_t = 5.0e-5, value_parser = range::number(0.0, 1.0))]
    pub noise_mpa: f64,
    /// Seed of the noise.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}

/// One reading of the gauge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Time since the pump started, s.
    pub t_s: f64,
    /// Gauge pressure as shown, MPa.
    pub pressure_mpa: f64,
}

impl Inflation {
    /// Gauge readings from no pressure to `end_pressure_mpa` for the cavity volumes `(pressure_mpa, volume_mm3)`, sorted by
    /// pressure, linear between them. Cost: the number of readings.
    ///
    /// # Errors
    /// An unusable parameter or table.
    pub fn readings(&self, volumes: &[(f64, f64)]) -> anyhow::Result<Vec<Reading>> {
        self.check()?;
        let table = self.times(volumes)?;
        let end_s = time_of(&table, self.end_pressure_mpa);
        let mut rng = Rng::new(self.seed);
        let count = (end_s * self.rate_hz).floor() as usize + 1;
        Ok((0..count)
            .map(|k| {
                let t_s = k as f64 / self.rate_hz;
                Reading { t_s, pressure_mpa: self.gauge(pressure_at(&table, t_s), &mut rng) }
            })
            .collect())
    }

    /// Checks that the parameters are those of a pump and a gauge.
    ///
    /// # Errors
    /// The first unusable parameter.
    pub fn check(&self) -> anyhow::Result<()> {
        let positive = [
            ("flow_ml_per_min", self.flow_ml_per_min),
            ("end_pressure_mpa", self.end_pressure_mpa),
            ("rate_hz", self.rate_hz),
        ];
        for (name, found) in positive {
            ensure!(
                found.is_finite() && found > 0.0,
                "{name}: expected a finite number above 0, found {found}"
            );
        }
        let not_negative = [
            ("dead_volume_mm3", self.dead_volume_mm3),
            ("resolution_mpa", self.resolution_mpa),
            ("noise_mpa", self.noise_mpa),
        ];
        for (name, found) in not_negative {
            ensure!(
                found.is_finite() && found >= 0.0,
                "{name}: expected a finite number, 0 or more, found {found}"
            );
        }
        Ok(())
    }

    /// `(time, pressure)` at the table's pressures: the gas law solved for t.
    fn times(&self, volumes: &[(f64, f64)]) -> anyhow::Result<Vec<(f64, f64)>> {
        let refuse = |found: String| {
            anyhow!(
                "volume table: expected rising pressures from 0 to at least {} MPa, found {found}; simulate the missing states",
                self.end_pressure_mpa
            )
        };
        let (Some(first), Some(last)) = (volumes.first(), volumes.last()) else {
            return Err(refuse("no states".into()));
        };
        if first.0 != 0.0 || last.0 < self.end_pressure_mpa {
            return Err(refuse(format!("{} to {} MPa", first.0, last.0)));
        }
        if let Some(bad) = volumes.iter().find(|v| !(v.0.is_finite() && v.1.is_finite() && v.1 > 0.0)) {
            return Err(refuse(format!("volume {} mm^3 at {} MPa", bad.1, bad.0)));
        }
        let flow_mm3_per_s = self.flow_ml_per_min * 1000.0 / 60.0;
        let gas = |&(p, v): &(f64, f64)| (ATMOSPHERE_MPA + p) * (v + self.dead_volume_mm3) / ATMOSPHERE_MPA;
        let initial = gas(first);
        for pair in volumes.windows(2) {
            let [low, high] = [pair[0].0, pair[1].0];
            if high <= low {
                return Err(refuse(format!("{high} MPa after {low} MPa")));
            }
            ensure!(
                gas(&pair[1]) > gas(&pair[0]),
                "volume table: the gas the cavity holds falls between {low} and {high} MPa, so constant flow has no single \
                 P(t); check those two states"
            );
        }
        Ok(volumes.iter().map(|v| ((gas(v) - initial) / flow_mm3_per_s, v.0)).collect())
    }

    /// Value of the gauge. It has no vacuum range, like common digital gauges.
    fn gauge(&self, pressure_mpa: f64, rng: &mut Rng) -> f64 {
        let noisy = (pressure_mpa + self.noise_mpa * rng.normal()).max(0.0);
        if self.resolution_mpa > 0.0 {
            (noisy / self.resolution_mpa).round() * self.resolution_mpa
        } else {
            noisy
        }
    }
}

/// The readings as the CSV a replaying bridge takes: `made_by` as comment lines, then `t_s,pressure_mpa,gap_mm`.
#[must_use]
pub fn to_csv(readings: &[Reading], gap_mm: f64, made_by: &str) -> String {
    let mut text = String::new();
    for line in made_by.lines() {
        text += &format!("# {line}\n");
    }
    text += "t_s,pressure_mpa,gap_mm\n";
    for r in readings {
        text += &format!("{:.4},{:.6},{gap_mm}\n", r.t_s, r.pressure_mpa);
    }
    text
}

fn interpolate(x: f64, (x0, y0): (f64, f64), (x1, y1): (f64, f64)) -> f64 {
    y0 + (y1 - y0) * (x - x0) / (x1 - x0)
}

fn pressure_at(table: &[(f64, f64)], t_s: f64) -> f64 {
    let upper = table.partition_point(|row| row.0 < t_s).clamp(1, table.len() - 1);
    interpolate(t_s, table[upper - 1], table[upper])
}

fn time_of(table: &[(f64, f64)], pressure_mpa: f64) -> f64 {
    let upper = table.partition_point(|row| row.1 < pressure_mpa).clamp(1, table.len() - 1);
    let swap = |(t, p): (f64, f64)| (p, t);
    interpolate(pressure_mpa, swap(table[upper - 1]), swap(table[upper]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The default gauge.
    fn digital() -> Inflation {
        Inflation {
            flow_ml_per_min: 125.0,
            dead_volume_mm3: 0.0,
            end_pressure_mpa: 0.07,
            rate_hz: 200.0,
            resolution_mpa: 1.0e-4,
            noise_mpa: 5.0e-5,
            seed: 1,
        }
    }

    fn silent() -> Inflation {
        Inflation { resolution_mpa: 0.0, noise_mpa: 0.0, ..digital() }
    }

    #[test]
    fn rigid_vessel_fills_by_boyles_law() {
        let volume = 6000.0;
        let readings = silent().readings(&[(0.0, volume), (0.1, volume)]).unwrap();
        let flow = 125_000.0 / 60.0;
        for r in &readings {
            let expected = ATMOSPHERE_MPA * flow * r.t_s / volume;
            assert!((r.pressure_mpa - expected).abs() < 1e-12, "{r:?}");
        }
        let last = readings.last().unwrap().pressure_mpa;
        assert!(last <= 0.07 + 1e-12 && last > 0.07 - 2e-4, "ends at {last}");
    }

    #[test]
    fn gas_law_holds_at_every_reading_of_a_soft_vessel() {
        let table: Vec<_> = (0..=100).map(|k| f64::from(k) * 1e-3).map(|p| (p, 6000.0 + 5e4 * p)).collect();
        let tube = Inflation { dead_volume_mm3: 2000.0, ..silent() };
        for r in tube.readings(&table).unwrap() {
            let p = r.pressure_mpa;
            let held = (ATMOSPHERE_MPA + p) * (8000.0 + 5e4 * p);
            let pumped = ATMOSPHERE_MPA * (8000.0 + 125_000.0 / 60.0 * r.t_s);
            assert!((held / pumped - 1.0).abs() < 5e-5, "{r:?}: {held} against {pumped}");
        }
    }

    #[test]
    fn gauge_rounds_and_is_seeded_without_vacuum_readings() {
        let table = [(0.0, 6000.0), (0.07, 9000.0)];
        let make = |seed| Inflation { seed, ..digital() }.readings(&table).unwrap();
        let readings = make(1);
        for r in &readings {
            let steps = r.pressure_mpa / 1e-4;
            assert!((steps - steps.round()).abs() < 1e-9 && r.pressure_mpa >= 0.0, "{r:?}");
        }
        assert_eq!(readings, make(1));
        assert_ne!(readings, make(2));
    }

    #[test]
    fn unreachable_pressures_are_refused() {
        let refused = |volumes: &[(f64, f64)], part: &str| {
            let error = silent().readings(volumes).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        };
        refused(&[(0.0, 6000.0), (0.05, 7000.0)], "found 0 to 0.05 MPa");
        refused(&[(0.0, 6000.0), (0.05, 900.0), (0.07, 9000.0)], "falls between 0 and 0.05 MPa");
        refused(&[(0.0, 6000.0), (0.07, f64::NAN)], "volume NaN mm^3");
        let still = Inflation { flow_ml_per_min: 0.0, ..silent() }.readings(&[(0.0, 1.0), (1.0, 1.0)]);
        assert!(still.unwrap_err().to_string().contains("flow_ml_per_min"));
        assert!(silent().readings(&[]).is_err());
    }
}
