//! Data sheet of a model: its choices and errors. `train` writes it next to the model.

use crate::config::TrainConfig;
use formats::{FormatError, file};
use rom::halfwidths::HalfWidths;
use rom::interpolant::Metric;
use rom::snapshots::RegimeKind;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::{self, Display};
use std::path::{Path, PathBuf};

/// Data sheet of a trained model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DataSheet {
    /// Name of the actuator, as its topics have it.
    pub actuator: String,
    /// blake3 of the database, hexadecimal.
    pub database_hash: String,
    /// Nodes per field.
    pub node_count: usize,
    /// Fields in order: name, unit, source.
    pub fields: Vec<FieldSheet>,
    /// Free, then contact; only those that the database has states of.
    pub regimes: Vec<RegimeSheet>,
    /// Gap at which gravity alone touches, in mm.
    pub sag_mm: Option<f64>,
    /// Largest gap the trained pressures close, in mm.
    pub reach_mm: Option<f64>,
    /// Training cases that were merged or set aside, and why.
    pub remarks: Vec<String>,
    /// The configuration in force.
    pub config: TrainConfig,
}

impl DataSheet {
    /// Its place: beside the model, `.json` instead of `.twin`.
    fn place(model: &Path) -> PathBuf {
        model.with_extension("json")
    }

    /// The data sheet beside a model; none without one.
    pub fn read_beside(model: &Path) -> Option<Self> {
        let bytes = file::read_bytes(&Self::place(model), file::MAX_TEXT_BYTES).ok()?;
        serde_json::from_slice(&bytes).ok()
    }

    /// Writes it beside its model; returns its path.
    ///
    /// # Errors
    /// I/O errors.
    pub fn save_beside(&self, model: &Path) -> Result<PathBuf, FormatError> {
        let path = Self::place(model);
        let value = serde_json::to_value(self)
            .map_err(|error| FormatError::refused(&path, format!("the data sheet: {error}")))?;
        file::replace(&path, format!("{value:#}\n").as_bytes())?;
        Ok(path)
    }

    /// True if the model has a von Mises stress.
    pub fn has_stress(&self) -> bool {
        self.fields.iter().any(|field| field.name == "von_mises")
    }

    /// True if the model was trained on contact forces.
    pub fn has_forces(&self) -> bool {
        self.regimes.iter().any(|regime| regime.force.is_some())
    }
}

/// A field of the model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldSheet {
    /// As in the database: `x`, `y`, `z`, `magnitude`, `von_mises` or the name of another column.
    pub name: String,
    /// Unit of its values (`mm`, `MPa`); empty for a number.
    pub unit: String,
    /// `interpolated` or `derived from the coordinates`.
    pub source: String,
}

/// How a regime was fitted and what it is off by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegimeSheet {
    /// Whether this is the free regime or the one in contact.
    pub kind: RegimeKind,
    /// Number of training cases, without the states on the onset.
    pub cases: usize,
    /// States on the onset added to them.
    pub boundary_states: usize,
    /// Sampled ranges by input.
    pub inputs: Vec<InputSheet>,
    /// The fit of each group of fields with a basis in common.
    pub groups: Vec<FitSheet>,
    /// The fit of the contact force; none in the free regime and without forces in the database.
    pub force: Option<FitSheet>,
    /// Where in the training range the contact force pulls, or falls while pressure rises; none if it does so nowhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force_violation: Option<ForceViolation>,
    /// Half-widths with the nominal coverage.
    #[serde(rename = "half_widths")]
    pub halfwidths: HalfWidths,
    /// Number of held-out states from which the half-widths are set; 0: from leave-one-out.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub unseen_states: usize,
    /// Leave-one-out errors by case.
    pub leave_one_out: Vec<CaseError>,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// A place at which a contact force cannot be right: an obstacle pushes, and an actuator under more pressure pushes harder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ForceViolation {
    /// Inputs of the place by key.
    pub inputs: BTreeMap<String, f64>,
    /// Force there, N.
    pub force_n: f64,
    /// Its derivative with respect to pressure, N/MPa.
    pub force_by_pressure_n_per_mpa: f64,
}

impl Display for ForceViolation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place: Vec<String> =
            self.inputs.iter().map(|(name, value)| format!("{name} = {value:.4e}")).collect();
        write!(
            f,
            "at {} the contact force is {:.2e} N and changes by {:.2e} N/MPa with pressure, which cannot be: add a training state there",
            place.join(", "),
            self.force_n,
            self.force_by_pressure_n_per_mpa
        )
    }
}

/// Sampled range of an input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputSheet {
    /// `pressure_mpa` or `gap_mm`.
    pub name: String,
    /// Smallest training value.
    pub min: f64,
    /// Largest training value.
    pub max: f64,
}

/// Chosen fit of a group or the force, and the other candidates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitSheet {
    /// Group name or `contact_force`.
    pub name: String,
    /// Modes kept (0 for the force).
    pub modes: usize,
    /// Truncation error of Eq. (4) with them.
    pub truncation_error: f64,
    /// Condition number of the interpolation system.
    pub condition: f64,
    /// Relative residual of its solution.
    pub residual: f64,
    /// Leave-one-out error, closed form, in the field's unit: root mean square over nodes, mean over cases inside the
    /// hull (for the force: root mean square over those cases).
    pub leave_one_out: f64,
    /// Candidates, best first.
    pub candidates: Vec<Candidate>,
}

/// Candidate fit and its score.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Kernel and tail in words.
    pub kernel: String,
    /// Metric of the distances.
    pub metric: Metric,
    /// Smoothing on the diagonal.
    pub smoothing: f64,
    /// Modes the group would keep.
    pub modes: usize,
    /// Leave-one-out score of the groups chosen together, in the data's own norm; none when the fit was refused.
    pub error: Option<f64>,
    /// Why the fit was refused.
    pub refused: Option<String>,
}

/// Leave-one-out errors of one training case: the worst node's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CaseError {
    /// Name of the training case in the database.
    pub case: String,
    /// On the hull of the samples: leaving it out extrapolates, so selection does not judge by it.
    pub on_hull: bool,
    /// Displacement error in mm.
    pub displacement_mm: f64,
    /// Stress error in MPa.
    pub stress_mpa: f64,
    /// Contact-force error in N.
    pub force_n: f64,
}
