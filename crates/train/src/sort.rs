//! Assignment of training cases to regimes.

use crate::config::TrainConfig;
use crate::error::TrainError;
use rom::inputs::{GAP, Inputs, PARAMETERS, PRESSURE};
use rom::snapshots::{Database, RegimeKind, Split};
use rom::statistics::range;

/// Training cases by regime, as indices into the database.
pub(crate) struct TrainingCases {
    pub free: Vec<usize>,
    pub contact: Vec<usize>,
    /// Largest training pressure of all.
    pub max_pressure_mpa: f64,
    pub remarks: Vec<String>,
    /// Cases whose derivatives contradict those of a case at the same inputs: their derivatives are not used.
    pub doubtful: Vec<usize>,
}

impl TrainingCases {
    /// The training cases of a regime.
    pub fn of(&self, kind: RegimeKind) -> &[usize] {
        match kind {
            RegimeKind::Free => &self.free,
            RegimeKind::Contact => &self.contact,
        }
    }
}

/// Inputs that a regime may be interpolated over: pressure, gap where it counts, parameters.
pub(crate) fn varying(database: &Database, kind: RegimeKind) -> Vec<usize> {
    let operating = if kind == RegimeKind::Contact { &[PRESSURE, GAP][..] } else { &[PRESSURE] };
    operating.iter().copied().chain((0..database.parameters.len()).map(|i| PARAMETERS + i)).collect()
}

pub(crate) fn sort(database: &Database, config: &TrainConfig) -> Result<TrainingCases, TrainError> {
    let train: Vec<usize> = database.of_split(Split::Train).collect();
    let touches = |i: usize| {
        let case = &database.cases[i];
        // A contact sample without force touches nothing: physically it is one more free state.
        case.regime == RegimeKind::Contact && (!config.split_at_onset || case.contact_force_n > 0.0)
    };
    let (contact, free): (Vec<usize>, Vec<usize>) = train.iter().partition(|&&i| touches(i));
    let max_pressure_mpa = train.iter().map(|&i| database.cases[i].pressure_mpa).fold(0.0, f64::max);
    let (remarks, doubtful) = (Vec::new(), Vec::new());
    let mut sorted = TrainingCases { free, contact, max_pressure_mpa, remarks, doubtful };
    let untouched = sorted.free.iter().filter(|&&i| database.cases[i].regime == RegimeKind::Contact).count();
    if untouched > 0 {
        sorted
            .remarks
            .push(format!("{untouched} contact samples touch nothing and were trained as free states"));
    }
    let free = std::mem::take(&mut sorted.free);
    sorted.free = merge(database, config, free, |i| database.cases[i].inputs_at_gap(0.0), &mut sorted)?;
    let contact = std::mem::take(&mut sorted.contact);
    let input = |i: usize| database.cases[i].inputs_at_gap(database.cases[i].gap_mm.unwrap_or(0.0));
    sorted.contact = merge(database, config, contact, input, &mut sorted)?;
    Ok(sorted)
}

/// Keeps one of several cases at the same inputs; refuses when their snapshots contradict each other.
fn merge(
    database: &Database,
    config: &TrainConfig,
    cases: Vec<usize>,
    input: impl Fn(usize) -> Inputs,
    sorted: &mut TrainingCases,
) -> Result<Vec<usize>, TrainError> {
    let width = |axis: usize| {
        let range = range(cases.iter().map(|&i| input(i).values()[axis]));
        if range > 0.0 { range } else { 1.0 }
    };
    let inputs = PARAMETERS + database.parameters.len();
    let widths: Vec<f64> = (0..inputs).map(width).collect();
    let distance = |a: usize, b: usize| {
        let (a, b) = (input(a), input(b));
        let off = |i: usize| (a.values()[i] - b.values()[i]) / widths[i];
        (0..inputs).map(|i| off(i) * off(i)).sum::<f64>().sqrt()
    };
    let (mut kept, mut contradictions): (Vec<usize>, Vec<String>) = (Vec::new(), Vec::new());
    for &i in &cases {
        let Some(&twin) = kept.iter().find(|&&k| distance(i, k) <= config.duplicate_distance) else {
            kept.push(i);
            continue;
        };
        let (a, b) = (&database.cases[twin], &database.cases[i]);
        let difference = relative_difference(database.snapshot(twin), database.snapshot(i));
        if difference <= MERGE_TOLERANCE + 10.0 * distance(twin, i) {
            if derivatives_differ(database, twin, i) {
                sorted.remarks.push(format!(
                    "cases {} and {} have the same inputs and other derivatives: those of neither are used",
                    a.name, b.name
                ));
                sorted.doubtful.push(twin);
            }
            sorted.remarks.push(format!(
                "case {} is as good as case {} (inputs {:.0e} of the range apart, fields {difference:.0e}); merged",
                b.name,
                a.name,
                distance(twin, i)
            ));
        } else {
            let gap = a.gap_mm.map_or_else(String::new, |gap| format!(", gap {gap} mm"));
            contradictions.push(format!(
                "cases {} and {} have the same inputs ({} MPa{gap}) but their fields differ by {difference:.1e} of their \
                 size; remove one",
                a.name, b.name, a.pressure_mpa
            ));
        }
    }
    if contradictions.is_empty() { Ok(kept) } else { Err(TrainError::Database(contradictions)) }
}

/// Largest relative difference of two derivatives of one state on the same side of the contact.
const DERIVATIVE_TOLERANCE: f64 = 0.05;

/// True if two cases have contradictory derivatives with respect to the same input.
fn derivatives_differ(database: &Database, a: usize, b: usize) -> bool {
    let Some(known) = &database.sensitivities else { return false };
    let entries = database.node_count * known.fields.len();
    let row = |index: usize| &known.values[index * entries..(index + 1) * entries];
    let derivatives_of = |case: usize| known.rows.iter().enumerate().filter(move |(_, row)| row.case == case);
    derivatives_of(a).any(|(i, first)| {
        let twin = derivatives_of(b).find(|(_, second)| second.input == first.input);
        twin.is_some_and(|(j, _)| relative_difference(row(i), row(j)) > DERIVATIVE_TOLERANCE)
    })
}

/// Cases at the same inputs whose fields agree to this are one case: solver tolerance, not contradiction.
const MERGE_TOLERANCE: f64 = 1e-3;

/// `|a - b| / |a|` in the maximum norm.
fn relative_difference(a: &[f32], b: &[f32]) -> f64 {
    let size = a.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
    let difference = a.iter().zip(b).fold(0.0_f32, |m, (a, b)| m.max((a - b).abs()));
    if size > 0.0 { f64::from(difference) / f64::from(size) } else { f64::from(difference) }
}
