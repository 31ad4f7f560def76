//! The snapshot database: what the finite elements computed, before any reduction.
//!
//! A [`Database`] is plain data. `formats` fills it from files, `fem` from simulations, tests from formulas; training
//! reads it and nothing else. [`Database::problems`] returns all errors of a database.

use crate::inputs::{Inputs, MAX_INPUTS, PARAMETERS, Parameter};
use crate::statistics::ends;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Largest plausible pressure and gap: an actuator of this size bursts far below.
const MAX_PRESSURE_MPA: f64 = 100.0;
const MAX_GAP_MM: f64 = 1e5;

/// Meaning of a field: decides which fields are derived from it and which values are impossible.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FieldKind {
    /// Deformed coordinate along an axis (0 = x, 1 = y, 2 = z).
    Coordinate(u8),
    /// Displacement magnitude `|x - x0|`: derived from the coordinates when the undeformed mesh is known.
    Magnitude,
    /// An equivalent stress: never negative.
    Stress,
    /// Anything else: interpolated without constraints.
    Other,
}

/// Names of the axes 0, 1, 2.
pub const AXES: [&str; 3] = ["x", "y", "z"];

/// Marker and axis of a measured coordinate: `tip` and 0 of `tip_x_mm`; `None` for another name.
#[must_use]
pub fn marker_axis(output: &str) -> Option<(&str, usize)> {
    let (marker, axis) = output.strip_suffix("_mm")?.rsplit_once('_')?;
    Some((marker, AXES.iter().position(|known| *known == axis)?))
}

/// One field of the database: name, unit and meaning.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FieldSpec {
    /// Name as the user writes it (`x`, `von_mises`).
    pub name: String,
    /// Unit as printed (`mm`, `MPa`).
    pub unit: String,
    /// What training and publishing must know of it.
    pub kind: FieldKind,
}

impl FieldSpec {
    /// The five fields of the paper: deformed coordinates and displacement magnitude in mm, von Mises stress in MPa.
    pub fn of_the_paper() -> Vec<Self> {
        let field = |name: &str, unit: &str, kind| Self { name: name.into(), unit: unit.into(), kind };
        vec![
            field("x", "mm", FieldKind::Coordinate(0)),
            field("y", "mm", FieldKind::Coordinate(1)),
            field("z", "mm", FieldKind::Coordinate(2)),
            field("displacement", "mm", FieldKind::Magnitude),
            field("von_mises", "MPa", FieldKind::Stress),
        ]
    }
}

/// Purpose of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Split {
    /// The model is fitted to it.
    Train,
    /// The paper's test cases: evaluation only, never selection.
    Test,
    /// Further states (outside the training range, spot checks): evaluation only.
    Check,
}

/// Whether the body touches the obstacle. A model has interpolants of its own for each regime.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum RegimeKind {
    /// Nothing is touched: the pressure alone decides (the paper's Regime I).
    Free,
    /// The actuator presses on the obstacle: pressure and gap decide (the paper's Regime II).
    Contact,
}

impl RegimeKind {
    /// Name used in files and on the screen.
    pub fn name(self) -> &'static str {
        match self {
            Self::Free => "free",
            Self::Contact => "contact",
        }
    }

    /// This regime, then the other one.
    pub fn with_other(self) -> [Self; 2] {
        match self {
            Self::Free => [Self::Free, Self::Contact],
            Self::Contact => [Self::Contact, Self::Free],
        }
    }

    /// Number in states, fields, answers and FMUs.
    pub fn number(self) -> u32 {
        match self {
            Self::Free => 1,
            Self::Contact => 2,
        }
    }
}

/// One simulated state and what it was simulated for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// Name in the database (`"67"`), used in every report.
    pub name: String,
    /// The regime it was sampled for. A contact case with zero force touches nothing and is trained as free.
    pub regime: RegimeKind,
    /// Whether it trains or tests the model.
    pub split: Split,
    /// Cavity pressure in MPa.
    pub pressure_mpa: f64,
    /// Distance from the underside of the undeformed base to the obstacle in mm; `None` without an obstacle.
    pub gap_mm: Option<f64>,
    /// Total contact force in N.
    pub contact_force_n: f64,
    /// One value for each of [`Database::parameters`].
    pub parameters: Vec<f64>,
}

impl Case {
    /// The state's inputs; a gap of infinity where there is no obstacle.
    pub fn inputs(&self) -> Inputs {
        self.inputs_at_gap(self.gap_mm.unwrap_or(f64::INFINITY))
    }

    /// The state's inputs with another gap, in mm.
    pub fn inputs_at_gap(&self, gap_mm: f64) -> Inputs {
        let values = self.parameters.iter().take(MAX_INPUTS - PARAMETERS).enumerate();
        values.fold(Inputs::new(self.pressure_mpa, gap_mm), |inputs, (i, value)| {
            inputs.with(PARAMETERS + i, *value)
        })
    }
}

/// Derivatives of snapshots and forces with respect to inputs, for some of the cases.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensitivities {
    /// Case and input of each row.
    pub rows: Vec<Sensitivity>,
    /// Database fields in the order of the array.
    pub fields: Vec<usize>,
    /// `rows x nodes x fields`, in the field's unit per unit of the input.
    pub values: Vec<f32>,
}

/// Derivative of one case with respect to one input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensitivity {
    /// Index of the case.
    pub case: usize,
    /// Position of the input: pressure, gap, then the parameters.
    pub input: usize,
    /// Derivative of the contact force, N per unit of the input.
    pub contact_force_n_per_unit: f64,
}

/// Small vibration about a state of a regime: a linear mode of a model that moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Vibration {
    /// Regime of the state that it vibrates about.
    pub regime: RegimeKind,
    /// Circular frequency, rad/s.
    pub rate_rad_s: f64,
    /// Shape of modal mass 1 t in mm: all x, then all y, then all z.
    pub shape_mm: Vec<f64>,
    /// Contact force per amplitude, N.
    pub reaction_n: f64,
}

/// A named set of nodes (`surface`, `bottom`).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NodeSet {
    /// Name as the user writes it.
    pub name: String,
    /// Node indices, each below the node count.
    pub nodes: Vec<u32>,
}

/// The rigid thing the actuator can touch: the plane `y = -gap_mm` over a rectangle of x and z.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Footprint {
    /// Extent along the actuator in mm.
    pub x_mm: [f64; 2],
    /// Extent across the actuator in mm.
    pub z_mm: [f64; 2],
}

impl Default for Footprint {
    fn default() -> Self {
        Self::PLATE
    }
}

impl Footprint {
    /// The paper's plate.
    pub const PLATE: Self = Self { x_mm: [0.0, 120.0], z_mm: [-9.0, 41.0] };
    /// The block that stands for the gripped object.
    pub const BLOCK: Self = Self { x_mm: [85.0, 115.0], z_mm: [1.0, 31.0] };
    /// Extent of the paper's plate beyond the actuator's tip and beyond each of its sides, mm.
    pub const PLATE_BEYOND_MM: [f64; 2] = [5.0, 9.0];

    /// A plate below these undeformed nodes (mm), as far beyond them as the paper's plate; none without nodes. `O(nodes)`.
    pub fn plate_below(nodes_mm: &[[f32; 3]]) -> Option<Self> {
        let extent = |axis: usize| ends(nodes_mm.iter().map(|node| f64::from(node[axis])));
        let [beyond_tip, beyond_side] = Self::PLATE_BEYOND_MM;
        let ([left, tip], [front, back]) = (extent(0), extent(2));
        let plate =
            Self { x_mm: [left.min(0.0), tip + beyond_tip], z_mm: [front - beyond_side, back + beyond_side] };
        (!nodes_mm.is_empty()).then_some(plate)
    }
}

/// Snapshots with their inputs: `Y_snap` of Eq. (2) and everything needed to read it.
#[derive(Clone, Debug, Default)]
pub struct Database {
    /// Actuator (`pneunet`).
    pub actuator: String,
    /// Fields in file order.
    pub fields: Vec<FieldSpec>,
    /// Nodes per field.
    pub node_count: usize,
    /// Cases in file order.
    pub cases: Vec<Case>,
    /// `cases x nodes x fields`, case-major and node-interleaved as in `snapshots.npy`.
    pub snapshots: Vec<f32>,
    /// Undeformed node positions in mm, where known.
    pub undeformed_mm: Option<Vec<[f64; 3]>>,
    /// Change of those positions per unit of each parameter, where parameters move them: parameter by parameter, mm per unit.
    pub undeformed_by: Vec<Vec<[f32; 3]>>,
    /// Outer surface as triangles over node indices (for viewers); empty when unknown.
    pub surface_triangles: Vec<[u32; 3]>,
    /// Named node sets.
    pub node_sets: Vec<NodeSet>,
    /// What the actuator touches at a gap.
    pub obstacle: Footprint,
    /// Inputs in addition to pressure and gap, at most six; every case has a value for each.
    pub parameters: Vec<Parameter>,
    /// Derivatives, where they were computed.
    pub sensitivities: Option<Sensitivities>,
    /// Vibrations that the modes of their regimes shall contain.
    pub vibrations: Vec<Vibration>,
    /// blake3 of the database's content.
    pub hash: [u8; 32],
}

impl Database {
    /// Training states without an obstacle: `snapshots` holds one row a pressure, `nodes x fields` with all fields of a node
    /// together. For contact, and for meshes and node sets, fill in the fields of the struct.
    ///
    /// # Panics
    /// Without a pressure or a field. Everything else is checked by training.
    pub fn free(actuator: &str, fields: Vec<FieldSpec>, pressures_mpa: &[f64], snapshots: Vec<f32>) -> Self {
        let case = |(i, pressure_mpa): (usize, &f64)| Case {
            name: i.to_string(),
            regime: RegimeKind::Free,
            split: Split::Train,
            pressure_mpa: *pressure_mpa,
            gap_mm: None,
            contact_force_n: 0.0,
            parameters: Vec::new(),
        };
        let mut database = Self {
            actuator: actuator.into(),
            node_count: snapshots.len() / (pressures_mpa.len() * fields.len()),
            fields,
            cases: pressures_mpa.iter().enumerate().map(case).collect(),
            snapshots,
            ..Self::default()
        };
        database.hash = database.content_hash();
        database
    }

    /// Entries of one snapshot: nodes x fields.
    pub fn entries(&self) -> usize {
        self.node_count * self.fields.len()
    }

    /// One case as stored: `nodes x fields`, node-interleaved.
    pub fn snapshot(&self, case: usize) -> &[f32] {
        let n = self.entries();
        &self.snapshots[case * n..(case + 1) * n]
    }

    /// One field of one case, node by node.
    pub fn field(&self, case: usize, field: usize) -> impl Iterator<Item = f32> + '_ {
        self.snapshot(case).iter().skip(field).step_by(self.fields.len()).copied()
    }

    /// Displacement of the undeformed nodes from the nominal mesh by a case's parameters, per axis (mm). `None` if no parameter moves them.
    pub fn moved_mm(&self, case: usize) -> Option<[Vec<f32>; 3]> {
        let steps = self.cases[case].parameters.iter().zip(&self.parameters);
        let steps: Vec<f64> = steps.map(|(value, parameter)| value - parameter.nominal).collect();
        let moved = |node: usize, axis: usize| -> f64 {
            steps.iter().zip(&self.undeformed_by).map(|(step, by)| step * f64::from(by[node][axis])).sum()
        };
        let along = |axis| (0..self.node_count).map(|node| moved(node, axis) as f32).collect();
        (!self.undeformed_by.is_empty()).then(|| [0, 1, 2].map(along))
    }

    /// Undeformed position of a node in a case (mm), along an axis; NaN without a mesh.
    pub fn undeformed_at(&self, case: usize, node: usize, axis: usize) -> f64 {
        let nominal = self.undeformed_mm.as_ref().map_or(f64::NAN, |mesh| mesh[node][axis]);
        let values = self.cases[case].parameters.iter().zip(&self.parameters);
        let moved = values.zip(&self.undeformed_by);
        moved.fold(nominal, |x, ((value, parameter), by)| {
            x + (value - parameter.nominal) * f64::from(by[node][axis])
        })
    }

    /// Indices of the cases of a split, in file order.
    pub fn of_split(&self, split: Split) -> impl Iterator<Item = usize> + '_ {
        (0..self.cases.len()).filter(move |&i| self.cases[i].split == split)
    }

    /// The field deformed along `axis`, if there is one.
    pub fn coordinate(&self, axis: u8) -> Option<usize> {
        self.fields.iter().position(|f| f.kind == FieldKind::Coordinate(axis))
    }

    /// blake3 over cases, fields, snapshots, parameters and sensitivities: what a model remembers of its database.
    /// `O(bytes)`.
    pub fn content_hash(&self) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        for field in &self.fields {
            hasher.update(field.name.as_bytes()).update(&[0]).update(field.unit.as_bytes()).update(&[0]);
        }
        for case in &self.cases {
            let regime = case.regime.number() as u8 - 1;
            hasher.update(case.name.as_bytes()).update(&[0, regime, case.split as u8]);
            let fixed = [case.pressure_mpa, case.gap_mm.unwrap_or(f64::NAN), case.contact_force_n];
            for value in fixed.iter().chain(&case.parameters) {
                hasher.update(&value.to_le_bytes());
            }
        }
        hash_values(&mut hasher, &self.snapshots);
        for parameter in &self.parameters {
            hasher.update(parameter.name.as_bytes()).update(&[0]).update(parameter.unit.as_bytes());
            hasher.update(&parameter.nominal.to_le_bytes());
        }
        for moved in &self.undeformed_by {
            hash_values(&mut hasher, moved.as_flattened());
        }
        if let Some(sensitivities) = &self.sensitivities {
            for row in &sensitivities.rows {
                hasher.update(&(row.case as u64).to_le_bytes()).update(&(row.input as u64).to_le_bytes());
                hasher.update(&row.contact_force_n_per_unit.to_le_bytes());
            }
            hash_values(&mut hasher, &sensitivities.values);
        }
        *hasher.finalize().as_bytes()
    }
}

fn hash_values(hasher: &mut blake3::Hasher, values: &[f32]) {
    let mut bytes = Vec::with_capacity(1 << 16);
    for chunk in values.chunks(1 << 14) {
        bytes.clear();
        bytes.extend(chunk.iter().flat_map(|v| v.to_le_bytes()));
        hasher.update(&bytes);
    }
}

impl Database {
    /// Messages of all errors that prevent training.
    pub fn problems(&self) -> Vec<String> {
        let mut problems = self.shape_problems();
        if problems.is_empty() {
            problems.extend(self.case_problems());
            problems.extend(self.parameter_problems());
            problems.extend(self.value_problems());
        }
        problems
    }

    fn shape_problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        let expected = self.cases.len() * self.entries();
        if self.fields.is_empty() || self.node_count == 0 {
            problems.push(format!(
                "expected fields and nodes, found {} and {}",
                self.fields.len(),
                self.node_count
            ));
        }
        if self.snapshots.len() != expected {
            problems.push(format!(
                "snapshots: expected {expected} values ({} cases x {} nodes x {} fields), found {}",
                self.cases.len(),
                self.node_count,
                self.fields.len(),
                self.snapshots.len()
            ));
        }
        if let Some(mesh) = self.undeformed_mm.as_ref().filter(|m| m.len() != self.node_count) {
            problems.push(format!("mesh: expected {} nodes, found {}", self.node_count, mesh.len()));
        }
        let moved = &self.undeformed_by;
        if !moved.is_empty() && moved.len() != self.parameters.len() {
            problems.push(format!(
                "undeformed_by: expected {} parameters, found {}",
                self.parameters.len(),
                moved.len()
            ));
        }
        if let Some(by) = moved.iter().find(|by| by.len() != self.node_count) {
            problems.push(format!("undeformed_by: expected {} nodes, found {}", self.node_count, by.len()));
        }
        let beyond = |nodes: &[u32]| nodes.iter().any(|n| *n as usize >= self.node_count);
        if beyond(self.surface_triangles.as_flattened()) {
            problems.push(format!("surface: a triangle names a node beyond {}", self.node_count));
        }
        for set in self.node_sets.iter().filter(|s| beyond(&s.nodes)) {
            problems.push(format!("node set {}: names a node beyond {}", set.name, self.node_count));
        }
        let names: BTreeSet<&str> = self.fields.iter().map(|f| f.name.as_str()).collect();
        if names.len() != self.fields.len() {
            problems.push("fields: two have the same name".into());
        }
        problems
    }

    fn case_problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        if self.of_split(Split::Train).next().is_none() {
            problems.push(format!(
                "expected training cases (split = train), found none among {}",
                self.cases.len()
            ));
        }
        for case in &self.cases {
            let name = &case.name;
            if !(0.0..=MAX_PRESSURE_MPA).contains(&case.pressure_mpa) {
                problems.push(format!(
                    "case {name}: pressure_mpa {} is not within 0..{MAX_PRESSURE_MPA}",
                    case.pressure_mpa
                ));
            }
            if let Some(gap) = case.gap_mm.filter(|gap| !(-MAX_GAP_MM..=MAX_GAP_MM).contains(gap)) {
                problems.push(format!("case {name}: gap_mm {gap} is not a length in mm"));
            }
            if case.regime == RegimeKind::Contact && case.gap_mm.is_none() {
                problems.push(format!("case {name}: a contact case needs gap_mm"));
            }
            if !(case.contact_force_n.is_finite() && case.contact_force_n >= 0.0) {
                problems.push(format!(
                    "case {name}: contact_force_n {} is not a force >= 0",
                    case.contact_force_n
                ));
            }
        }
        problems
    }

    /// Parameters and derivatives that do not fit the cases.
    fn parameter_problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        let (count, most) = (self.parameters.len(), MAX_INPUTS - PARAMETERS);
        if count > most {
            problems.push(format!(
                "parameters: expected at most {most} in addition to pressure and gap, found {count}"
            ));
        }
        let names: BTreeSet<&str> = self.parameters.iter().map(|p| p.name.as_str()).collect();
        if names.len() != count {
            problems.push("parameters: two have the same name".into());
        }
        for parameter in self.parameters.iter().filter(|p| !p.nominal.is_finite()) {
            problems.push(format!("parameter {}: the nominal value is not finite", parameter.name));
        }
        for case in &self.cases {
            if case.parameters.len() != count || case.parameters.iter().any(|v| !v.is_finite()) {
                problems.push(format!(
                    "case {}: expected {count} numbers for the parameters, found {:?}",
                    case.name, case.parameters
                ));
            }
        }
        if let Some(derivatives) = &self.sensitivities {
            let entries = derivatives.rows.len() * derivatives.fields.len() * self.node_count;
            let (inputs, found) = (PARAMETERS + count, derivatives.values.len());
            if derivatives.rows.iter().any(|row| row.case >= self.cases.len() || row.input >= inputs) {
                problems.push("sensitivities: a row names a missing case or input".into());
            }
            if found != entries || derivatives.fields.iter().any(|f| *f >= self.fields.len()) {
                problems
                    .push(format!("sensitivities: expected {entries} values of known fields, found {found}"));
            }
        }
        problems
    }

    /// One message per case with non-finite entries: the first entry and the number of them.
    fn value_problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        for (i, case) in self.cases.iter().enumerate() {
            let snapshot = self.snapshot(i);
            let Some(first) = snapshot.iter().position(|v| !v.is_finite()) else { continue };
            let count = snapshot.iter().filter(|v| !v.is_finite()).count();
            let (node, field) = (first / self.fields.len(), &self.fields[first % self.fields.len()].name);
            problems.push(format!(
                "case {}: {count} non-finite values, the first ({}) at node {node}, field {field}",
                case.name, snapshot[first]
            ));
        }
        problems
    }
}
