//! Settings of a controller: `[actuator.control]` of a scene.

use crate::twin_model::TwinModelError;
use rom::memory::{Line, MemorySpec, Play};
use rom::model::Model;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

/// Where the gauge is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GaugeAt {
    /// In the cavity, or on a short tube: behind the line.
    #[default]
    Cavity,
    /// At the valve: before the line.
    Valve,
}

/// How the command follows from the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LawKind {
    /// Inverse of line and play behind a shaped path.
    #[default]
    Inverse,
    /// Optimum over a horizon, under the limits of pressure, rate and force.
    Predictive,
}

/// What a supply that gives less than the target needs leads to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LowSupply {
    /// What it gives is held, so that a gripped part does not fall.
    #[default]
    Hold,
    /// The fault `no-response`: the valve takes its safe value.
    Release,
}

/// Dynamics of the actuator and times of the loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Quantity that is held without another target: `force`, `tip`, `pressure`, or an observable of the model.
    pub hold: String,
    pub law: LawKind,
    /// Horizon of the predictive law, s.
    pub horizon_s: f64,
    /// Marker whose height is the tip's; needed where the scene has several.
    pub marker: Option<String>,
    /// Further cavity whose valve is driven, `left` of `pressure_mpa.left`; default: the valve of `pressure_mpa`.
    pub cavity: Option<String>,
    /// Whether the sensor of the quantity corrects the model.
    pub is_measured: bool,
    /// Time constants of valve, line and cavity together, s.
    pub line: Line,
    /// Play operators of pressure, MPa.
    pub play: Vec<Play>,
    /// Time from command to valve, s.
    pub delay_s: f64,
    /// Fastest change that the valve itself gives, MPa/s, where that is slower than its `rate_mpa_per_s`; default: it is not.
    pub valve_mpa_per_s: Option<f64>,
    /// Lowest frequency of the swing, Hz; 0: none.
    pub swing_hz: f64,
    pub swing_damping: f64,
    /// Place of the gauge.
    pub gauge_at: GaugeAt,
    /// Time constant of the reference's approach to its target, s.
    pub approach_s: f64,
    /// Largest rise and fall of the reference, MPa/s.
    pub slew_mpa_per_s: [f64; 2],
    /// Time constant of each of the two lags of the correction, s.
    pub correction_s: f64,
    /// Largest correction of the model, MPa.
    pub correction_max_mpa: f64,
    /// Fraction of the valve's error that is corrected in a second, 1/s.
    pub bias_per_s: f64,
    /// Largest correction of the valve, MPa.
    pub bias_max_mpa: f64,
    pub low_supply: LowSupply,
    /// Largest force, N; a target is cut at [`TARGET_FRACTION`] of it.
    pub force_max_n: f64,
    /// Settings that count instead while the force, the tip, a pressure or an observable is held.
    #[serde(skip_serializing_if = "Table::is_empty")]
    pub force: Table,
    #[serde(skip_serializing_if = "Table::is_empty")]
    pub tip: Table,
    #[serde(skip_serializing_if = "Table::is_empty")]
    pub pressure: Table,
    #[serde(skip_serializing_if = "Table::is_empty")]
    pub observable: Table,
}

/// Tables of single quantities, by their names in a scene.
pub const QUANTITIES: [&str; 4] = ["force", "tip", "pressure", "observable"];

/// The table of a held quantity, of which `column` is that of its targets.
pub fn table_of(column: &str) -> &'static str {
    match column {
        "force_n" => "force",
        "tip_y_mm" => "tip",
        "pressure_mpa" => "pressure",
        _ => "observable",
    }
}

/// Fraction of the force limit at which a target is cut: the rest is for overshoot.
pub const TARGET_FRACTION: f64 = 0.95;

impl Default for Settings {
    /// For the reference actuator on a valve with a lag of 80 ms.
    fn default() -> Self {
        Self {
            hold: "force".into(),
            law: LawKind::Inverse,
            horizon_s: 1.0,
            marker: None,
            cavity: None,
            is_measured: true,
            line: Line { fill_s: 0.08, empty_s: 0.08 },
            play: Vec::new(),
            delay_s: 0.01,
            valve_mpa_per_s: None,
            swing_hz: 0.0,
            swing_damping: 0.02,
            gauge_at: GaugeAt::Cavity,
            approach_s: 0.12,
            slew_mpa_per_s: [0.3, 0.3],
            correction_s: 0.08,
            correction_max_mpa: 0.04,
            bias_per_s: 2.0,
            bias_max_mpa: 0.01,
            low_supply: LowSupply::Hold,
            force_max_n: 0.6,
            force: Table::new(),
            tip: Table::new(),
            pressure: Table::new(),
            observable: Table::new(),
        }
    }
}

impl Settings {
    fn table(&self, name: &str) -> &Table {
        match name {
            "force" => &self.force,
            "tip" => &self.tip,
            "pressure" => &self.pressure,
            _ => &self.observable,
        }
    }

    /// The settings for a quantity, by the name of its table.
    ///
    /// # Errors
    /// What of the table is no setting.
    pub fn of(&self, name: &str) -> Result<Self, String> {
        let own = self.table(name);
        let mut all = Table::try_from(self).map_err(|error| error.to_string())?;
        QUANTITIES.iter().for_each(|name| drop(all.remove(*name)));
        // What is held and by which valve is no setting of a quantity.
        let of_all = |key: &&String| ["hold", "cavity", "marker"].contains(&key.as_str());
        let is_table = |key: &&String| QUANTITIES.contains(&key.as_str());
        if let Some(key) = own.keys().find(|key| of_all(key) || is_table(key)) {
            return Err(format!("{key}: expected in [actuator.control] only"));
        }
        all.extend(own.clone());
        Value::Table(all).try_into().map_err(|error: toml::de::Error| error.message().to_owned())
    }

    /// Times of the loop for the frequency of the swing: 0.9 of its period for the approach, 0.4 for each lag of the correction.
    #[must_use]
    pub fn with_swing(self, swing_hz: f64, swing_damping: f64) -> Self {
        let (approach_s, correction_s) = (0.9 / swing_hz, 0.4 / swing_hz);
        Self { swing_hz, swing_damping, approach_s, correction_s, ..self }
    }

    /// Line and play of a model with memory of the driven pressure replace those of the settings; true if it has any.
    ///
    /// # Errors
    /// A description that contradicts itself, or an orifice, which no law inverts.
    pub(crate) fn take_memory(&mut self, model: &Model, driven: usize) -> Result<bool, TwinModelError> {
        let of_pressure =
            MemorySpec::of(model)?.and_then(|memory| memory.inputs.into_iter().find(|of| of.input == driven));
        let Some(of_pressure) = of_pressure else { return Ok(false) };
        if of_pressure.orifice.is_some() {
            return Err(TwinModelError::Orifice);
        }
        self.play = of_pressure.play;
        if let Some(line) = of_pressure.line {
            (self.line, self.gauge_at) = (line, GaugeAt::Valve);
        }
        Ok(true)
    }

    /// All errors; `key` is the table's place in the scene.
    pub fn problems(&self, key: &str) -> Vec<String> {
        let mut problems = Vec::new();
        for name in QUANTITIES.into_iter().filter(|name| !self.table(name).is_empty()) {
            let key = format!("{key}.{name}");
            match self.of(name) {
                Ok(own) => problems.extend(own.problems(&key)),
                Err(error) => problems.push(format!("{key}: {error}")),
            }
        }
        let mut expect = |fits: bool, name: &str, expected: &str, found: f64| {
            if !fits {
                problems.push(format!("{key}.{name}: expected {expected}, found {found}"));
            }
        };
        for (name, value, most) in [
            ("line.fill_s", self.line.fill_s, 60.0),
            ("valve_mpa_per_s", self.valve_mpa_per_s.unwrap_or(1.0), f64::INFINITY),
            ("line.empty_s", self.line.empty_s, 60.0),
            ("approach_s", self.approach_s, 60.0),
            ("horizon_s", self.horizon_s, 60.0),
            ("slew_mpa_per_s[0]", self.slew_mpa_per_s[0], f64::INFINITY),
            ("slew_mpa_per_s[1]", self.slew_mpa_per_s[1], f64::INFINITY),
            ("correction_s", self.correction_s, 60.0),
            ("force_max_n", self.force_max_n, f64::INFINITY),
        ] {
            expect(value > 0.0 && value <= most, name, &format!("more than 0, at most {most}"), value);
        }
        for (name, value, most) in [
            ("delay_s", self.delay_s, 1.0),
            ("swing_hz", self.swing_hz, 100.0),
            ("swing_damping", self.swing_damping, 0.99),
            ("correction_max_mpa", self.correction_max_mpa, 10.0),
            ("bias_per_s", self.bias_per_s, 100.0),
            ("bias_max_mpa", self.bias_max_mpa, 10.0),
        ] {
            expect((0.0..=most).contains(&value), name, &format!("0 to {most}"), value);
        }
        for Play { threshold, weight } in &self.play {
            expect(
                *threshold > 0.0 && threshold.is_finite(),
                "play.threshold",
                "more than 0 MPa",
                *threshold,
            );
            expect((0.0..=1.0).contains(weight), "play.weight", "0 to 1", *weight);
        }
        let weights: f64 = self.play.iter().map(|play| play.weight).sum();
        expect(weights <= 1.0, "play.weight", "a sum of at most 1", weights);
        let most = rom::memory::MAX_PLAYS;
        expect(self.play.len() <= most, "play", &format!("at most {most} operators"), self.play.len() as f64);
        problems
    }

    /// Half of the play's width in the output, MPa.
    pub(crate) fn half_play_mpa(&self) -> f64 {
        self.play.iter().map(|play| play.weight * play.threshold).sum()
    }

    /// Time by which the shaped reference is late, s.
    pub(crate) fn lead_s(&self) -> f64 {
        self.delay_s + if self.swing_hz > 0.0 { 0.5 / self.swing_hz } else { 0.0 }
    }
}

/// Limits of the pressure source: `[actuator.valve]` of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Lowest and highest command, MPa.
    pub range_mpa: [f64; 2],
    /// Greatest change of the command, MPa/s.
    pub rate_mpa_per_s: f64,
    /// A measured force below this is no contact yet, N: three standard deviations of the load cell's noise.
    pub contact_n: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { range_mpa: [0.0, 0.09], rate_mpa_per_s: f64::INFINITY, contact_n: 0.008 }
    }
}

#[cfg(test)]
#[path = "../tests/unit/settings.rs"]
mod tests;
