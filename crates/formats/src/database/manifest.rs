//! `database.toml`: description of the folder.

use crate::error::{Diagnostic, FormatError};
use crate::file;
use rom::inputs::{MAX_INPUTS, PARAMETERS, Parameter};
use rom::snapshots::{FieldKind, FieldSpec, Footprint, NodeSet};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file in its folder.
pub const FILE: &str = "database.toml";
/// Layout that is read and written.
const LAYOUT: u32 = 1;
/// Inputs of every model, with their units; a database may omit them.
const OPERATING: [(&str, &str); PARAMETERS] = [("pressure_mpa", "MPa"), ("gap_mm", "mm")];

/// Checked content of `database.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Layout version, 1.
    pub layout: u32,
    /// Actuator (`pneunet`).
    pub actuator: String,
    pub nodes: usize,
    /// File of the cases, in the same folder.
    pub cases: String,
    /// File of the snapshots, in the same folder.
    pub snapshots: String,
    /// File of the undeformed mesh, in the same folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<String>,
    /// File of the derivative of the undeformed mesh with respect to each parameter (`parameters x nodes x 3`, mm per unit), in the
    /// same folder, if parameters move it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub undeformed_by: Option<String>,
    /// Origin of the mesh; any string.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh_origin: Option<String>,
    /// Solver of the cases; any string.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solver: Option<String>,
    /// File of the derivatives with respect to inputs, in the same folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensitivities: Option<String>,
    /// Fields in the order of that file; default: all fields.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensitivity_fields: Option<Vec<String>>,
    /// Obstacle; default: the paper's plate, for the gripper its block.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub obstacle: Option<Footprint>,
    /// Fields in the order of the snapshots.
    pub field: Vec<Field>,
    /// Inputs: `pressure_mpa`, `gap_mm` (each optional), then parameters, by their key in the actuator's description if it has one.
    pub input: Vec<Input>,
    /// Further columns of the case table, for other tools.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub extra: Vec<Extra>,
    /// Named node sets, in addition to `bottom` and `surface`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub node_set: Vec<NodeSet>,
}

/// Field of the snapshots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Field {
    /// Name; coordinates are `x`, `y`, `z`.
    pub name: String,
    pub unit: String,
    pub kind: StoredKind,
}

/// Meaning of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StoredKind {
    /// Deformed coordinate; its axis is its name.
    Coordinate,
    /// Displacement magnitude.
    Magnitude,
    /// Equivalent stress, never negative.
    Stress,
    /// Other quantity.
    Other,
}

/// Input of the cases.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// Column name; for a parameter its dotted key in the actuator's description.
    pub name: String,
    pub unit: String,
    /// A parameter's value in the actuator's description.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nominal: Option<f64>,
}

/// Column of the case table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Extra {
    pub name: String,
    pub unit: String,
}

impl Manifest {
    /// Reads and checks the file.
    ///
    /// # Errors
    /// An unreadable file, other keys, or inconsistent values; all errors.
    pub fn read(path: &Path) -> Result<Self, FormatError> {
        let manifest: Self = file::read_toml(path, "the keys of layout 1")?;
        let diagnostics = manifest.diagnostics();
        FormatError::check(manifest, path, diagnostics)
    }

    /// Writes the file, with a comment that describes it.
    pub fn write(&self, path: &Path) -> Result<(), FormatError> {
        let body = toml::to_string(self).map_err(|e| FormatError::write(path, std::io::Error::other(e)))?;
        let text = format!(
            "# Finite-element database, layout {LAYOUT}: snapshots are f32, cases x nodes x fields\n{body}"
        );
        file::replace(path, text.as_bytes())
    }

    /// Description of a database with the usual file names, without a mesh.
    pub fn new(actuator: &str, nodes: usize, fields: &[FieldSpec]) -> Self {
        Self {
            layout: LAYOUT,
            actuator: actuator.into(),
            nodes,
            cases: "cases.csv".into(),
            snapshots: "snapshots.npy".into(),
            mesh: None,
            undeformed_by: None,
            mesh_origin: None,
            solver: None,
            obstacle: None,
            field: fields.iter().map(Field::of).collect(),
            input: OPERATING
                .map(|(name, unit)| Input { name: name.into(), unit: unit.into(), nominal: None })
                .into(),
            sensitivities: None,
            sensitivity_fields: None,
            extra: vec![],
            node_set: vec![],
        }
    }

    /// Declares that the pressure of the table is a result, in whose place another quantity was given.
    pub fn pressure_as_result(&mut self, given: Input) {
        self.input.retain(|input| input.name != OPERATING[0].0);
        self.input.push(given);
        self.extra.push(Extra { name: OPERATING[0].0.into(), unit: OPERATING[0].1.into() });
    }

    /// True if a column is neither input nor force.
    pub(super) fn is_extra(&self, name: &str) -> bool {
        self.extra.iter().any(|extra| extra.name == name)
    }

    /// Copies this description from its file to another, with other names of files; comments are kept.
    pub fn copy_with_names(&self, from: &Path, to: &Path, names: &[(&str, &str)]) -> Result<(), FormatError> {
        let text = file::read_text(from, file::MAX_TEXT_BYTES)?;
        let renamed = |text: String, (old, new): &(&str, &str)| {
            text.replace(&format!("\"{old}\""), &format!("\"{new}\""))
        };
        file::replace(to, names.iter().fold(text, renamed).as_bytes())
    }

    /// Fields for the model.
    pub fn field_specs(&self) -> Vec<FieldSpec> {
        self.field.iter().map(Field::spec).collect()
    }

    /// Inputs other than pressure and gap, in the order of the file.
    pub fn parameters(&self) -> Vec<Parameter> {
        let further = self.input.iter().filter(|input| operating(&input.name).is_none());
        further
            .map(|i| Parameter {
                name: i.name.clone(),
                unit: i.unit.clone(),
                nominal: i.nominal.unwrap_or(f64::NAN), // refused by `diagnostics`
            })
            .collect()
    }

    /// Each input's name with its position in the inputs of a model.
    pub(super) fn positions(&self) -> Vec<(&str, usize)> {
        let mut next = PARAMETERS..;
        let position = |input: &'_ Input| operating(&input.name).or_else(|| next.next()).unwrap_or_default();
        let positions: Vec<usize> = self.input.iter().map(position).collect();
        self.input.iter().map(|input| input.name.as_str()).zip(positions).collect()
    }

    fn diagnostics(&self) -> Vec<Diagnostic> {
        let mut diagnostics = Vec::new();
        let mut check = |ok: bool, place: String, expected: &str, found: String| {
            if !ok {
                diagnostics.push(Diagnostic::new(place, expected, found));
            }
        };
        check(self.layout == LAYOUT, "layout".into(), "1", self.layout.to_string());
        check(self.nodes > 0, "nodes".into(), "at least 1", "0".into());
        check(!self.field.is_empty(), "[[field]]".into(), "at least one field", "none".into());
        for (key, name) in [
            ("cases", Some(&self.cases)),
            ("snapshots", Some(&self.snapshots)),
            ("mesh", self.mesh.as_ref()),
            ("undeformed_by", self.undeformed_by.as_ref()),
            ("sensitivities", self.sensitivities.as_ref()),
        ] {
            if let Some(name) = name {
                check(
                    file::is_plain_name(name),
                    key.into(),
                    "the name of a file in the same folder",
                    name.clone(),
                );
            }
        }
        for (i, set) in self.node_set.iter().enumerate() {
            let place = format!("[[node_set]] {}", i + 1);
            let others = self.node_set[..i].iter().map(|other| other.name.as_str());
            let is_new = others.chain(["bottom", "surface"]).all(|other| other != set.name);
            check(is_new, place.clone(), "a name used once, other than bottom and surface", set.name.clone());
            let beyond = set.nodes.iter().find(|node| **node as usize >= self.nodes);
            check(
                beyond.is_none(),
                place,
                "nodes of the mesh",
                beyond.map_or_else(String::new, u32::to_string),
            );
        }
        for (i, field) in self.field.iter().enumerate() {
            let twice = self.field[..i].iter().any(|other| other.name == field.name);
            check(!twice, format!("[[field]] {}", i + 1), "a name used once", field.name.clone());
            let axis = field.kind != StoredKind::Coordinate || axis_of(&field.name).is_some();
            check(axis, format!("[[field]] {}", i + 1), "x, y or z for a coordinate", field.name.clone());
        }
        self.check_inputs(&mut check);
        for name in self.sensitivity_fields.iter().flatten() {
            let known = self.field.iter().any(|field| field.name == *name);
            check(known, "sensitivity_fields".into(), "names of [[field]]", name.clone());
        }
        diagnostics
    }

    fn check_inputs(&self, check: &mut dyn FnMut(bool, String, &str, String)) {
        let count = PARAMETERS + self.parameters().len();
        check(
            count <= MAX_INPUTS,
            "[[input]]".into(),
            "at most 6 other than pressure and gap",
            count.to_string(),
        );
        for (i, input) in self.input.iter().enumerate() {
            let place = || format!("[[input]] {} ({})", i + 1, input.name);
            let twice = self.input[..i].iter().any(|other| other.name == input.name);
            check(!twice, place(), "a name used once", input.name.clone());
            if let Some(position) = operating(&input.name) {
                let first = self.input[..i].iter().all(|other| operating(&other.name).is_some());
                check(first, place(), "pressure_mpa and gap_mm before all others", "behind another".into());
                check(
                    input.unit == OPERATING[position].1,
                    place(),
                    OPERATING[position].1,
                    input.unit.clone(),
                );
                continue;
            }
            let nominal = input.nominal.is_some_and(f64::is_finite);
            check(
                nominal,
                place(),
                "nominal = a number, the value of the actuator as described",
                format!("{:?}", input.nominal),
            );
        }
    }
}

/// Position of pressure and gap in the inputs of every model.
fn operating(name: &str) -> Option<usize> {
    OPERATING.iter().position(|(wanted, _)| *wanted == name)
}

fn axis_of(name: &str) -> Option<u8> {
    ["x", "y", "z"].iter().position(|axis| *axis == name).map(|i| i as u8)
}

impl Field {
    fn of(spec: &FieldSpec) -> Self {
        let kind = match spec.kind {
            FieldKind::Coordinate(_) => StoredKind::Coordinate,
            FieldKind::Magnitude => StoredKind::Magnitude,
            FieldKind::Stress => StoredKind::Stress,
            FieldKind::Other => StoredKind::Other,
        };
        Self { name: spec.name.clone(), unit: spec.unit.clone(), kind }
    }

    fn spec(&self) -> FieldSpec {
        let kind = match self.kind {
            // `diagnostics` refuses a coordinate without an axis in its name.
            StoredKind::Coordinate => axis_of(&self.name).map_or(FieldKind::Other, FieldKind::Coordinate),
            StoredKind::Magnitude => FieldKind::Magnitude,
            StoredKind::Stress => FieldKind::Stress,
            StoredKind::Other => FieldKind::Other,
        };
        FieldSpec { name: self.name.clone(), unit: self.unit.clone(), kind }
    }
}
