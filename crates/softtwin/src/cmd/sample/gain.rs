//! Gain of a refinement: errors before and after, on held-out states.

use crate::output;
use rom::hull::DomainStatus;
use rom::model::Model;
use rom::snapshots::{Database, FieldKind, RegimeKind, Split};
use serde::Serialize;
use serde_json::json;
use std::path::Path;
use train::datasheet::DataSheet;
use train::evaluate::{CaseReport, evaluate};

pub type Trained = (Model, DataSheet);

/// Mean over cases of the worst node's displacement error (mm) and stress error (MPa), and of the force error (N).
type Errors = [f64; 3];

/// How good a model is.
#[derive(Debug, Serialize)]
pub struct Quality {
    /// Leave-one-out over training cases inside the hull.
    leave_one_out: Option<Errors>,
    /// Errors on the added states, held out for the unrefined model only.
    added: Option<Errors>,
    /// On test and check cases inside the training range: blind for both.
    held_out: Option<Errors>,
    held_out_cases: usize,
}

impl Quality {
    /// Measures a model on the refined database.
    pub fn of(
        (model, sheet): &Trained,
        database: &Database,
        kind: RegimeKind,
        added: &[&str],
    ) -> anyhow::Result<Self> {
        let is_added = |i: &usize| added.contains(&database.cases[*i].name.as_str());
        let all = || (0..database.cases.len()).filter(|i| database.cases[*i].regime == kind);
        let new: Vec<usize> = all().filter(is_added).collect();
        let kept: Vec<usize> = all().filter(|i| database.cases[*i].split != Split::Train).collect();
        let report = |cases: &[usize]| evaluate(model, database, cases);
        let mut held_out = report(&kept)?.cases;
        held_out.retain(|case| case.domain == DomainStatus::Inside);
        let left_out = sheet.regimes.iter().find(|r| r.kind == kind).and_then(|regime| {
            let inner = regime.leave_one_out.iter().filter(|e| !e.on_hull);
            mean(inner.map(|e| [e.displacement_mm, e.stress_mpa, e.force_n]))
        });
        let errors = |cases: &[CaseReport]| mean(cases.iter().map(|case| errors(database, case)));
        Ok(Self {
            leave_one_out: left_out,
            added: errors(&report(&new)?.cases),
            held_out: errors(&held_out),
            held_out_cases: held_out.len(),
        })
    }
}

fn errors(database: &Database, case: &CaseReport) -> Errors {
    let worst = |kind: FieldKind| {
        let fields = database.fields.iter().zip(&case.fields).filter(|(spec, _)| spec.kind == kind);
        fields.map(|(_, e)| e.max).fold(0.0, f64::max)
    };
    [worst(FieldKind::Magnitude), worst(FieldKind::Stress), (case.force_n - case.force_true_n).abs()]
}

fn mean(errors: impl Iterator<Item = Errors>) -> Option<Errors> {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for e in errors {
        sum.iter_mut().zip(e).for_each(|(s, e)| *s += e);
        count += 1.0;
    }
    (count > 0.0).then(|| sum.map(|s| s / count))
}

/// Before and after.
pub struct Gain<'a> {
    /// The model of the unrefined database.
    pub before: Quality,
    /// The model of the refined database.
    pub after: Quality,
    /// States added.
    pub added: usize,
    /// Where the refined model is.
    pub model: &'a Path,
}

impl Gain<'_> {
    /// Prints both.
    pub fn print(&self, as_json: bool) -> anyhow::Result<()> {
        if as_json {
            return output::json(&json!({
                "added": self.added, "model": self.model, "before": self.before, "after": self.after,
            }));
        }
        output!("{} states added; {}", self.added, self.model.display())?;
        output!(
            "{:<38} {:>18} {:>22} {:>20}",
            "mean error, before -> after",
            "displacement (mm)",
            "stress (MPa)",
            "force (N)"
        )?;
        let held_out = format!("{} states never trained on", self.after.held_out_cases);
        for (name, before, after) in [
            ("leave-one-out", self.before.leave_one_out, self.after.leave_one_out),
            ("added states (tested before)", self.before.added, self.after.added),
            (held_out.as_str(), self.before.held_out, self.after.held_out),
        ] {
            let (Some(b), Some(a)) = (before, after) else { continue };
            let pair = |k: usize| format!("{:.3e} -> {:.3e}", b[k], a[k]);
            output!("{name:<32} {:>24} {:>24} {:>24}", pair(0), pair(1), pair(2))?;
        }
        Ok(())
    }
}
