//! Acceptance limits, each with the figure of the paper's method and ours.

use super::sealed::{ERRORS, OUTSIDE, Sealed};
use super::study::{REGIMES, Study, percent, test_mse};
use super::switch::GAPS;
use crate::jumps;
use crate::sweep::extent::MAX_STRESS_JUMP;
use rom::model::Model;
use rom::snapshots::{FieldKind, RegimeKind, Split};
use std::fmt::Write as _;
use train::evaluate::{EvaluationReport, spread};

/// Limits of the mean squared error on the test cases, free and contact.
const MSE: [f64; 2] = [2e-6, 1e-5];
/// Limits for the test cases: normalised displacement and stress, relative force; free and contact.
const TEST: [[f64; 3]; 2] = [[1e-4, 1e-3, 0.0], [6e-4, 1e-2, 2e-3]];
/// Limits for the validation states in contact, mean and 95th percentile: displacement, stress, force.
const VALIDATION: [[f64; 2]; 3] = [[2e-4, 5e-4], [4e-3, 1e-2], [1.5e-4, 5e-4]];
/// Limits of the jumps of fields and force at the onset, mm and N.
const JUMP: [f64; 2] = [0.05, 1e-3];

/// Returns the table and the rows that exceed their limit.
pub fn section(study: &Study, sealed: Option<&Sealed>) -> anyhow::Result<(String, Vec<String>)> {
    let mut table = Table { text: String::from(HEAD), missed: Vec::new() };
    for (index, regime) in REGIMES.into_iter().enumerate() {
        let mse = |model| test_mse(model, &study.database, regime);
        let values = [mse(&study.paper)?, mse(&study.ours)?].map(|v| (v, format!("{v:.2e}")));
        table.row(
            &format!("mean squared error (Eq. 15), {} test cases", regime.name()),
            values,
            MSE[index],
            "",
        );
    }
    let reports = [&study.paper, &study.ours].map(|model| tests(study, model));
    let [theirs, mine] = reports;
    let (theirs, mine) = (theirs?, mine?);
    for (index, regime) in REGIMES.into_iter().enumerate() {
        for (k, name) in ["normalised displacement", "normalised stress", "relative force"].iter().enumerate()
        {
            if regime == RegimeKind::Free && k == 2 {
                continue;
            }
            let worst = |report: &EvaluationReport| largest(study, report, regime, k);
            let values = [worst(&theirs), worst(&mine)].map(|v| (v, format!("{} %", percent(v))));
            table.row(&format!("{} test cases: {name}, largest", regime.name()), values, TEST[index][k], "%");
        }
    }
    jumps(study, &mut table)?;
    validation(study, &mut table)?;
    if let Some(sealed) = sealed {
        of_sealed(sealed, &mut table);
    }
    Ok((table.text, table.missed))
}

const HEAD: &str = "\n## Acceptance limits\n\nTest cases: largest over the two of a regime. Validation states: random check cases of the database, in sight during \
    development. Test states: drawn with unused seeds, evaluated once (`sealed.csv`).\n\n\
    | quantity | paper's method | ours | limit | met |\n| --- | --- | --- | --- | --- |\n";

struct Table {
    text: String,
    missed: Vec<String>,
}

impl Table {
    /// Adds a row of `[theirs, ours]`, each as number and text; `unit` "%" shows the limit as a percentage.
    fn row(&mut self, name: &str, [theirs, mine]: [(f64, String); 2], bound: f64, unit: &str) {
        let most = if unit == "%" { format!("{} %", percent(bound)) } else { format!("{bound:.0e}{unit}") };
        let holds = if mine.0 <= bound {
            "yes"
        } else {
            self.missed.push(format!("{name}: expected at most {most}, found {}", mine.1));
            "**no**"
        };
        let _ = writeln!(self.text, "| {name} | {} | {} | {most} | {holds} |", theirs.1, mine.1);
    }
}

fn tests(study: &Study, model: &Model) -> anyhow::Result<EvaluationReport> {
    study.evaluate(model, &study.cases(|c| c.split == Split::Test))
}

/// Displacement (0), stress (1) or force (2): the largest over a regime's cases.
fn largest(study: &Study, report: &EvaluationReport, regime: RegimeKind, quantity: usize) -> f64 {
    let cases = report.cases.iter().filter(|c| c.gap_mm.is_some() == (regime == RegimeKind::Contact));
    let of = |c: &train::evaluate::CaseReport| match quantity {
        2 => c.force_relative.unwrap_or(0.0),
        k => field(study, k).map_or(0.0, |f| c.fields[f].normalised),
    };
    cases.map(of).fold(0.0, f64::max)
}

fn field(study: &Study, quantity: usize) -> Option<usize> {
    let kind = [FieldKind::Magnitude, FieldKind::Stress][quantity];
    study.database.fields.iter().position(|f| f.kind == kind)
}

fn jumps(study: &Study, table: &mut Table) -> anyhow::Result<()> {
    let Some(onset) = &study.ours.header.onset else { return Ok(()) };
    let range = [onset.sag_mm(), onset.reach_mm()];
    let both = [jumps::jumps(&study.paper, range, GAPS)?, jumps::jumps(&study.ours, range, GAPS)?];
    let name = format!("jump at the onset, gaps {:.1} to {:.1} mm", range[0], range[1]);
    let lengths = both.map(|j| (j.length_mm, format!("{:.3} mm", j.length_mm)));
    table.row(&format!("{name}: mm"), lengths, JUMP[0], " mm");
    table.row(
        &format!("{name}: N"),
        both.map(|j| (j.force_n, format!("{:.1e} N", j.force_n))),
        JUMP[1],
        " N",
    );
    let stresses = both.map(|j| (j.stress_share, format!("{} %", percent(j.stress_share))));
    table.row(&format!("{name}: stress, per largest of the state"), stresses, MAX_STRESS_JUMP, "%");
    Ok(())
}

fn validation(study: &Study, table: &mut Table) -> anyhow::Result<()> {
    let random = study.cases(|c| c.split == Split::Check && c.name.starts_with("random"));
    if random.is_empty() {
        table.text += "\nThis database has no random check cases.\n";
        return Ok(());
    }
    let reports = [study.evaluate(&study.paper, &random)?, study.evaluate(&study.ours, &random)?];
    for (k, name) in
        ["normalised displacement", "normalised stress", "force per largest force"].iter().enumerate()
    {
        let both = reports.each_ref().map(|report| match (k, report.regimes.first()) {
            (2, Some(summary)) => summary.force_normalised,
            _ => spread(
                &mut report
                    .cases
                    .iter()
                    .filter_map(|c| Some(c.fields[field(study, k)?].normalised))
                    .collect::<Vec<_>>(),
            ),
        });
        for (index, which) in ["mean", "95th percentile"].iter().enumerate() {
            let values = both.map(|s| (s[index], format!("{} %", percent(s[index]))));
            let name = format!("{} validation states in contact: {name}, {which}", random.len());
            table.row(&name, values, VALIDATION[k][index], "%");
        }
    }
    Ok(())
}

fn of_sealed(sealed: &Sealed, table: &mut Table) {
    let name = |what: &str| format!("{} test states in contact: {what}", sealed.states);
    let quantities = ["normalised position error", "normalised stress", "force per largest force"];
    let none = || (0.0, "-".to_owned());
    for (k, quantity) in quantities.iter().enumerate() {
        for (index, which) in ["mean", "95th percentile", "worst"].iter().enumerate() {
            let value = sealed.errors[k][index];
            let values = [none(), (value, format!("{} %", percent(value)))];
            table.row(&name(&format!("{quantity}, {which}")), values, ERRORS[k][index], "%");
        }
    }
    for (share, quantity) in sealed.outside.iter().zip(["displacement", "stress", "force"]) {
        let values = [none(), (*share, format!("{} %", percent(*share)))];
        table.row(&name(&format!("{quantity} outside its half-width, nominal 10 %")), values, OUTSIDE, "%");
    }
}
