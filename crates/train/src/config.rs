//! Configuration of training. Every key has a default; the defaults work on any database.

pub use rom::kernel::Precision;
pub use rom::observable::{Definition, ObservableKind, PointSpec};
pub use rom::radial::{KernelKind, Tail};

use formats::{FormatError, file};
use rom::model::PressureLimit;
use rom::snapshots::Footprint;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Grouping of fields for the POD.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Grouping {
    /// One POD per field: units do not weight fields against each other.
    PerField,
    /// One POD of all fields stacked: the paper's Eqs. (2)-(7).
    Joint,
}

/// Number of modes of a group.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ModeChoice {
    /// This number, or the rank if it is lower.
    Fixed(usize),
    /// The fewest with truncation error (Eq. 4) at most this.
    Energy(f64),
    /// The fewest whose leave-one-out error (geometric mean over cases) is within this factor of the best (1.02 = 2 % above the best).
    /// Leave-one-out overstates the error of new states two to four times, so what is left out here is a larger share of that.
    LeaveOneOut(f64),
}

/// A kernel with its tail.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KernelSpec {
    /// The radial basis function.
    pub kernel: KernelKind,
    /// Polynomial tail.
    pub tail: Tail,
}

/// Choices for one regime.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RegimeConfig {
    /// Number of modes of each group.
    pub modes: ModeChoice,
    /// Overrides by group name (`von_mises = { fixed = 20 }`).
    pub group_modes: BTreeMap<String, ModeChoice>,
    /// Largest number of modes per group.
    pub max_modes: usize,
    /// Candidates among which leave-one-out chooses, per group and for the force. One entry: no choice.
    pub kernels: Vec<KernelSpec>,
    /// Candidate factors on the second scaled input before distances are taken (fields vary less along the gap).
    pub anisotropy: Vec<f64>,
    /// Candidate shares of the second scaled input added to the first before distances are taken (features run aslant),
    /// tried on the best few kernels.
    pub shear: Vec<f64>,
    /// Smoothing candidates, relative to the kernel matrix's scale. 0 interpolates: training states come back to the
    /// truncation error; more must halve the leave-one-out error to be taken. Noisy snapshots ask for larger candidates.
    pub smoothing: Vec<f64>,
}

impl Default for RegimeConfig {
    /// Contact's.
    fn default() -> Self {
        let kernel = KernelKind::CubicQuintic { crossover: CROSSOVER };
        let mut contact = Self::over(CONTACT_LENGTH, Tail::Quadratic);
        contact.kernels.push(KernelSpec { kernel, tail: Tail::Quadratic });
        contact
    }
}

/// Crossover of contact's cubic-quintic candidate: the spacing of a hundred states in two inputs.
const CROSSOVER: f64 = 0.1;

/// Length of the Matern 7/2 candidate over contact's inputs.
const CONTACT_LENGTH: f64 = 1.5;

/// Length of the Matern 7/2 candidate over the free regime's one input: longer ones are quintic splines at a condition
/// number a thousand times as high.
const FREE_LENGTH: f64 = 0.5;

/// Number of modes of the free regime. Contact goes on from them, and fewer of its own then do the same.
const FREE_MODES: ModeChoice = ModeChoice::LeaveOneOut(1.2);

impl RegimeConfig {
    /// Both regimes' defaults, with a Matern 7/2 candidate of this length and tail.
    fn over(length: f64, tail: Tail) -> Self {
        Self {
            modes: ModeChoice::LeaveOneOut(1.02),
            group_modes: BTreeMap::new(),
            max_modes: 64,
            kernels: KernelSpec::candidates(length, tail),
            anisotropy: vec![0.25, 0.35, 0.5, 0.7, 1.0, 1.4],
            shear: vec![-0.5, -0.45, -0.4, -0.35, -0.3, -0.25, -0.2, -0.15, -0.1, -0.05, 0.0, 0.2],
            smoothing: vec![0.0, 1e-9, 1e-8, 3e-8],
        }
    }
}

impl KernelSpec {
    /// Both regimes' candidates, Matern 7/2 with this length and tail.
    pub fn candidates(length: f64, tail: Tail) -> Vec<Self> {
        let spec = |kernel, tail| Self { kernel, tail };
        vec![
            spec(KernelKind::Linear, Tail::Constant),
            spec(KernelKind::ThinPlate, Tail::Linear),
            spec(KernelKind::Cubic, Tail::Linear),
            spec(KernelKind::Cubic, Tail::Quadratic),
            spec(KernelKind::Quintic, Tail::Quadratic),
            spec(KernelKind::Matern72 { length }, tail),
        ]
    }
}

/// Everything `softtwin train --config` may set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainConfig {
    /// One POD per field or one for all.
    pub grouping: Grouping,
    /// Number format of the modes in the model file: integers of 4, 8 or 16 bits, by the amplitude of the mode, or 32-bit floats.
    pub precision: Precision,
    /// Subtract one snapshot before the POD: in the free regime the state with all inputs at 0, which is then exact, elsewhere and
    /// without such a state the mean.
    pub centred: bool,
    /// Derive the displacement magnitude from the coordinates where the undeformed mesh is known.
    pub derive_magnitude: bool,
    /// `true`: contact is trained on touching states and states on the onset, free on all other states. `false`: each
    /// regime on its cases, as in the paper.
    pub split_at_onset: bool,
    /// Number of onset states from the free model.
    pub boundary_states: usize,
    /// Extent of these states beyond the largest sampled gap, as a fraction of the sampled range of gaps. With
    /// parameters they reach as far as the free states.
    pub boundary_overshoot: f64,
    /// Obstacle; default: that of the database.
    pub obstacle: Option<Footprint>,
    /// Choices for the free regime.
    pub free: RegimeConfig,
    /// Choices for the contact regime.
    pub contact: RegimeConfig,
    /// Nominal coverage of the half-widths (0.9 = 90 %).
    pub coverage: f64,
    /// Pressure by which the onset must be undercut before contact is left, in MPa.
    pub hysteresis_mpa: f64,
    /// Two training inputs closer than this fraction of the range are one state twice: merged or refused.
    pub duplicate_distance: f64,
    /// Observables by name, the unit at its end (`bending_angle_deg`).
    pub observables: BTreeMap<String, Definition>,
    /// Where the search for the largest pressure ended when the actuator was built, which the model keeps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limit: Option<PressureLimit>,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            grouping: Grouping::PerField,
            precision: Precision::Integers,
            centred: true,
            derive_magnitude: true,
            split_at_onset: true,
            boundary_states: 32,
            boundary_overshoot: 0.55,
            obstacle: None,
            free: RegimeConfig { modes: FREE_MODES, ..RegimeConfig::over(FREE_LENGTH, Tail::Linear) },
            contact: RegimeConfig::default(),
            coverage: 0.9,
            hysteresis_mpa: 2e-4,
            duplicate_distance: 1e-3,
            observables: BTreeMap::new(),
            limit: None,
        }
    }
}

impl TrainConfig {
    /// The paper's method: joint uncentred POD, linear splines without tail, 4 and 6 modes.
    pub fn paper() -> Self {
        let regime = |modes| RegimeConfig {
            modes: ModeChoice::Fixed(modes),
            kernels: vec![KernelSpec { kernel: KernelKind::Linear, tail: Tail::None }],
            anisotropy: vec![1.0],
            shear: vec![0.0],
            smoothing: vec![0.0],
            ..RegimeConfig::default()
        };
        Self {
            grouping: Grouping::Joint,
            centred: false,
            derive_magnitude: false,
            split_at_onset: false,
            boundary_states: 0,
            free: regime(4),
            contact: regime(6),
            duplicate_distance: 0.0,
            ..Self::default()
        }
    }
}

impl TrainConfig {
    /// Every problem of the configuration, in words; empty when there is none.
    pub fn problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        if !(self.coverage > 0.0 && self.coverage < 1.0) {
            problems.push(format!("coverage: expected a number between 0 and 1, found {}", self.coverage));
        }
        for (name, value) in [
            ("boundary_overshoot", self.boundary_overshoot),
            ("hysteresis_mpa", self.hysteresis_mpa),
            ("duplicate_distance", self.duplicate_distance),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                problems.push(format!("{name}: expected a number >= 0, found {value}"));
            }
        }
        for (name, regime) in [("free", &self.free), ("contact", &self.contact)] {
            problems.extend(regime.problems().into_iter().map(|p| format!("[{name}] {p}")));
        }
        problems
    }
}

impl RegimeConfig {
    fn problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        if self.kernels.is_empty()
            || self.anisotropy.is_empty()
            || self.smoothing.is_empty()
            || self.max_modes == 0
        {
            problems.push(
                "kernels, anisotropy, smoothing: expected at least one each; max_modes: at least 1".into(),
            );
        }
        for KernelSpec { kernel, .. } in &self.kernels {
            let parameter = match *kernel {
                KernelKind::Linear | KernelKind::ThinPlate | KernelKind::Cubic | KernelKind::Quintic => None,
                KernelKind::Gaussian { shape } => Some(("shape", shape)),
                KernelKind::Matern72 { length } => Some(("length", length)),
                KernelKind::CubicQuintic { crossover } => Some(("crossover", crossover)),
            };
            if let Some((name, value)) = parameter.filter(|(_, value)| !(value.is_finite() && *value > 0.0)) {
                problems.push(format!("{}: expected a {name} > 0, found {value}", kernel.name()));
            }
        }
        if self.shear.iter().any(|s| !s.is_finite()) {
            problems.push("shear: expected finite shares".into());
        }
        if self.anisotropy.iter().any(|a| !(a.is_finite() && *a > 0.0)) {
            problems.push("anisotropy: expected factors > 0".into());
        }
        if self.smoothing.iter().any(|s| !(s.is_finite() && *s >= 0.0)) {
            problems.push("smoothing: expected numbers >= 0".into());
        }
        for modes in std::iter::once(&self.modes).chain(self.group_modes.values()) {
            let sound = match *modes {
                ModeChoice::Fixed(modes) => modes > 0,
                ModeChoice::Energy(limit) => (0.0..1.0).contains(&limit),
                ModeChoice::LeaveOneOut(factor) => factor >= 1.0,
            };
            if !sound {
                problems.push(format!("modes: {modes:?} is out of range"));
            }
        }
        problems
    }
}

/// Name of a database's own training configuration, which `softtwin build` writes with the observables of the actuator.
pub const OWN_CONFIG: &str = "train.toml";

impl TrainConfig {
    /// Reads a configuration of which any key may be left out.
    ///
    /// # Errors
    /// I/O errors; keys or values that are unknown.
    pub fn read(path: &Path) -> Result<Self, FormatError> {
        let text = file::read_text(path, file::MAX_TEXT_BYTES)?;
        parse(&text).map_err(|error| FormatError::refused(path, error))
    }

    /// The configuration that a database is trained with unless another one is named: its own, or the defaults.
    ///
    /// # Errors
    /// Those of [`Self::read`].
    pub fn of_database(folder: &Path) -> Result<Self, FormatError> {
        let own = folder.join(OWN_CONFIG);
        if own.is_file() { Self::read(&own) } else { Ok(Self::default()) }
    }
}

fn parse(text: &str) -> Result<TrainConfig, toml::de::Error> {
    let mut config: TrainConfig = toml::from_str(text)?;
    let table: toml::Table = toml::from_str(text)?;
    // A table of a regime takes its defaults from the contact's, and these kernels and modes are not the free regime's.
    let is_named = |key| table.get("free").is_some_and(|free| free.get(key).is_some());
    if !is_named("kernels") {
        config.free.kernels = TrainConfig::default().free.kernels;
    }
    if !is_named("modes") {
        config.free.modes = FREE_MODES;
    }
    Ok(config)
}

#[cfg(test)]
#[path = "../tests/unit/config.rs"]
mod tests;
