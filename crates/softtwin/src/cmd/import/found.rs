//! What an import of results found, and what can hardly be meant.

use fem::{BodyReport, four_digits};
use formats::results::{ImportedStates, input_ranges};
use rom::snapshots::{Database, Split};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// A database that was made.
#[derive(Serialize)]
pub struct ResultsReport<'a> {
    out: &'a Path,
    nodes: usize,
    states: usize,
    training: usize,
    testing: usize,
    fields: Vec<String>,
    inputs: Vec<String>,
    /// True if `mesh.vtu` is that of the first simulation only.
    shape_varies: bool,
    left_out: Vec<String>,
    largest_displacement_mm: f64,
    largest_stress_mpa: Option<f64>,
    ranges: BTreeMap<String, [f64; 2]>,
    body: BodyReport,
}

impl<'a> ResultsReport<'a> {
    pub fn new(out: &'a Path, states: ImportedStates) -> Self {
        let ImportedStates { database, blocks, nodes, shape_varies, left_out } = states;
        let largest = Largest::of(&database);
        let mut body = BodyReport::of(database.undeformed_mm.as_deref().unwrap_or_default(), &blocks);
        largest.doubt(&mut body);
        let training = database.of_split(Split::Train).count();
        Self {
            out,
            nodes,
            states: database.cases.len(),
            training,
            testing: database.cases.len() - training,
            ranges: input_ranges(&database).into_iter().collect(),
            fields: database.fields.into_iter().map(|field| field.name).collect(),
            inputs: database.parameters.into_iter().map(|parameter| parameter.name).collect(),
            shape_varies,
            left_out,
            largest_displacement_mm: largest.displacement_mm,
            largest_stress_mpa: largest.stress_mpa,
            body,
        }
    }
}

/// Largest values of all states.
struct Largest {
    displacement_mm: f64,
    /// `None` without a stress.
    stress_mpa: Option<f64>,
}

/// Stress from which a body that moves far is not of rubber (MPa): it tears.
const TORN_MPA: f64 = 10.0;

impl Largest {
    fn of(database: &Database) -> Self {
        let largest = |name: &str| {
            let field = database.fields.iter().position(|field| field.name == name)?;
            let states = 0..database.cases.len();
            Some(
                states
                    .flat_map(|case| database.field(case, field))
                    .map(|v| f64::from(v.abs()))
                    .fold(0.0, f64::max),
            )
        };
        Self { displacement_mm: largest("displacement").unwrap_or(0.0), stress_mpa: largest("von_mises") }
    }

    /// Remarks on values that can hardly be meant.
    fn doubt(&self, body: &mut BodyReport) {
        let share = self.displacement_mm / body.largest_mm();
        if share > 10.0 {
            body.remark(format!(
                "the body moves by {} times its length: do lengths and displacements have one unit?",
                four_digits(share)
            ));
        }
        if let Some(mpa) = self.stress_mpa.filter(|mpa| *mpa > TORN_MPA && share > 0.1) {
            body.remark(format!(
                "the body bends by {:.0} % of its length at {} MPa, and rubber tears at some {TORN_MPA} MPa: is --stress-unit that of \
                 the files?",
                100.0 * share,
                four_digits(mpa)
            ));
        }
    }
}
