//! What can be wrong with a database: everything is reported at once.

use crate::inputs::{MAX_INPUTS, PARAMETERS};
use crate::snapshots::{Database, RegimeKind, Split};
use std::collections::BTreeSet;

/// Absurd readings: an actuator of millimetres bursts long before.
const MAX_PRESSURE_MPA: f64 = 100.0;
const MAX_GAP_MM: f64 = 1e5;

impl Database {
    /// Every problem that forbids training, in words; empty when there is none.
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
            problems
                .push(format!("parameters: expected at most {most} beside pressure and gap, found {count}"));
        }
        let names: BTreeSet<&str> = self.parameters.iter().map(|p| p.name.as_str()).collect();
        if names.len() != count {
            problems.push("parameters: two have the same name".into());
        }
        for parameter in self.parameters.iter().filter(|p| !p.nominal.is_finite()) {
            problems.push(format!("parameter {}: the nominal value is no number", parameter.name));
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

    /// One line a case with non-finite entries: the first of them and how many.
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
