//! How good a new twin is, in figures that say what they mean.

use crate::datasheet::{CaseError, DataSheet};
use crate::evaluate::{self, EvaluateError, EvaluationReport};
use rom::halfwidths::Errors;
use rom::model::Model;
use rom::snapshots::{Case, Database, FieldKind, RegimeKind, Split};
use rom::statistics::{ends, mean};
use serde::Serialize;
use std::path::PathBuf;

/// Percent above which an error of a state that was never trained on is said at the end.
const TOO_LARGE_PERCENT: f64 = 5.0;

/// Errors of a quantity at the worst node of a state: mean over the states and worst of them.
#[derive(Debug, Serialize)]
pub struct Share {
    /// Percent of the largest value of the state; of a force, of the largest of all.
    pub percent: [f64; 2],
    /// Percent of what such largest values range over in the database.
    pub percent_of_range: [f64; 2],
    /// The worst state.
    pub worst_case: String,
}

/// Errors of the states of one regime; `None` of a quantity that the model does not have.
#[derive(Debug, Serialize)]
pub struct Shares {
    /// The regime.
    pub regime: RegimeKind,
    /// Number of states.
    pub states: usize,
    /// Of the displacement.
    pub displacement: Option<Share>,
    /// Of the von Mises stress.
    pub stress: Option<Share>,
    /// Of the contact force.
    pub force: Option<Share>,
}

impl Shares {
    fn named(&self) -> [(&'static str, Option<&Share>); 3] {
        let shares = [&self.displacement, &self.stress, &self.force].map(Option::as_ref);
        let [displacement, stress, force] = shares;
        [("displacement", displacement), ("stress", stress), ("contact force", force)]
    }
}

/// Errors on held-out states, and by leaving out each training state in turn.
#[derive(Debug, Serialize)]
pub struct Quality {
    /// Of states that were never trained on.
    pub held_back: Vec<Shares>,
    /// Of training states, each left out in turn.
    pub leave_one_out: Vec<Shares>,
    /// What is wrong with the model as far as its own figures tell.
    pub warnings: Vec<String>,
    /// Picture of the errors, if one was drawn.
    pub picture: Option<PathBuf>,
}

impl Quality {
    /// Measures a model on the held-out states of its database; also the report on these states, if there are any.
    ///
    /// # Errors
    /// A model that was trained on another mesh.
    pub fn new(
        model: &Model,
        sheet: Option<&DataSheet>,
        data: &Database,
    ) -> Result<(Self, Option<EvaluationReport>), EvaluateError> {
        let largest = largest_values(data);
        let sheets = || sheet.iter().flat_map(|sheet| &sheet.regimes);
        let left_out = sheets().filter_map(|regime| {
            // Leaving out a state at the edge measures extrapolation.
            let inner = regime.leave_one_out.iter().filter(|error| !error.on_hull);
            let errors = inner.filter_map(|error| {
                let index = data.cases.iter().position(|case| case.name == error.case)?;
                let CaseError { displacement_mm, stress_mpa, force_n, .. } = *error;
                Some((index, Errors { displacement_mm, stress_mpa, force_n }))
            });
            shares(regime.kind, &data.cases, &largest, &errors.collect::<Vec<_>>())
        });
        let leave_one_out = left_out.collect();
        let violations = sheets().filter_map(|regime| Some(regime.force_violation.as_ref()?.to_string()));
        let mut this =
            Self { held_back: Vec::new(), leave_one_out, warnings: violations.collect(), picture: None };
        let held_back = |case: &usize| data.cases[*case].split != Split::Train;
        let cases: Vec<usize> = (0..data.cases.len()).filter(held_back).collect();
        if cases.is_empty() {
            return Ok((this, None));
        }
        let report = evaluate::evaluate(model, data, &cases)?;
        for summary in &report.regimes {
            let own = cases
                .iter()
                .zip(&report.cases)
                .filter(|(_, case)| case.is_of(summary.regime) && !summary.outside.contains(&case.case));
            let errors: Vec<(usize, Errors)> = own.map(|(index, case)| (*index, case.errors)).collect();
            this.held_back.extend(shares(summary.regime, &data.cases, &largest, &errors));
        }
        this.warnings.extend(this.held_back.iter().flat_map(too_large));
        Ok((this, Some(report)))
    }
}

/// Errors of one regime as a row of a table: percent of the largest value, at the worst node of a state.
#[derive(Debug, Serialize)]
pub struct QualityRow {
    regime: &'static str,
    states: usize,
    tested: &'static str,
    displacement_percent: Option<f64>,
    displacement_worst_percent: Option<f64>,
    stress_percent: Option<f64>,
    stress_worst_percent: Option<f64>,
    force_percent: Option<f64>,
    force_worst_percent: Option<f64>,
}

impl Quality {
    /// The errors as a table.
    pub fn rows(&self) -> Vec<QualityRow> {
        let row = |tested, shares: &Shares| {
            let [displacement, stress, force] = [&shares.displacement, &shares.stress, &shares.force]
                .map(|share| share.as_ref().map_or([None; 2], |share| share.percent.map(Some)));
            QualityRow {
                regime: shares.regime.name(),
                states: shares.states,
                tested,
                displacement_percent: displacement[0],
                displacement_worst_percent: displacement[1],
                stress_percent: stress[0],
                stress_worst_percent: stress[1],
                force_percent: force[0],
                force_worst_percent: force[1],
            }
        };
        let held_back = self.held_back.iter().map(|shares| row("never trained on", shares));
        held_back.chain(self.leave_one_out.iter().map(|shares| row("left out in turn", shares))).collect()
    }
}

/// A sentence for each quantity whose error on a state that was never trained on is too large.
fn too_large(shares: &Shares) -> impl Iterator<Item = String> {
    let large = shares.named().into_iter().filter_map(|(name, share)| Some((name, share?)));
    large.filter(|(_, share)| share.percent[1] > TOO_LARGE_PERCENT).map(|(name, share)| {
        let (regime, case, percent) = (shares.regime.name(), &share.worst_case, share.percent[1]);
        format!(
            "{name} of the {regime} state {case}, which was never trained on, is off by {percent:.1} % of the largest value"
        )
    })
}

/// The largest displacement (mm), stress (MPa) and force (N) of each state; NaN of what the database does not have.
pub fn largest_values(data: &Database) -> Vec<Errors> {
    let fields = |case: usize, wanted: FieldKind| {
        let found = data.fields.iter().position(|field| field.kind == wanted)?;
        Some(data.field(case, found).map(|value| f64::from(value.abs())).fold(0.0, f64::max))
    };
    let value = |case: usize| Errors {
        displacement_mm: fields(case, FieldKind::Magnitude)
            .or_else(|| largest_displacement_mm(data, case))
            .unwrap_or(f64::NAN),
        stress_mpa: fields(case, FieldKind::Stress).unwrap_or(f64::NAN),
        force_n: data.cases[case].contact_force_n,
    };
    (0..data.cases.len()).map(value).collect()
}

/// Largest displacement of a state from the undeformed mesh, mm.
fn largest_displacement_mm(data: &Database, case: usize) -> Option<f64> {
    let mesh = data.undeformed_mm.as_ref()?;
    let mut squares = vec![0.0; data.node_count];
    for axis in 0..3 {
        let field = data.coordinate(axis)?;
        let pairs = data.field(case, field).zip(mesh);
        squares
            .iter_mut()
            .zip(pairs)
            .for_each(|(sum, (x, at))| *sum += (f64::from(x) - at[usize::from(axis)]).powi(2));
    }
    Some(squares.into_iter().fold(0.0, f64::max).sqrt())
}

/// Errors of some states of a regime as shares of the largest values of all; `None` without a state.
fn shares(
    regime: RegimeKind,
    cases: &[Case],
    largest: &[Errors],
    errors: &[(usize, Errors)],
) -> Option<Shares> {
    if errors.is_empty() {
        return None;
    }
    let of_regime = |value: fn(&Errors) -> f64| -> Vec<f64> {
        let own = cases.iter().zip(largest).filter(|(case, _)| case.regime == regime);
        own.map(|(_, largest)| value(largest)).collect()
    };
    let share = |value: fn(&Errors) -> f64, of_all: bool| {
        let [low, high] = ends(of_regime(value));
        let mean_and_worst = |by: &dyn Fn(usize) -> f64| {
            let percent: Vec<f64> =
                errors.iter().map(|(case, error)| 100.0 * value(error) / by(*case)).collect();
            [mean(percent.iter().copied()), percent.iter().copied().fold(0.0, f64::max)]
        };
        let of_case = |case: usize| if of_all { high } else { value(&largest[case]) };
        let percent = mean_and_worst(&of_case);
        let percent_of_range = mean_and_worst(&|_| high - low);
        let worse = |a: &&(usize, Errors), b: &&(usize, Errors)| {
            (value(&a.1) / of_case(a.0)).total_cmp(&(value(&b.1) / of_case(b.0)))
        };
        let worst_case = cases[errors.iter().max_by(worse)?.0].name.clone();
        (percent[0].is_finite() && high > 0.0).then_some(Share { percent, percent_of_range, worst_case })
    };
    let has_force = regime == RegimeKind::Contact;
    Some(Shares {
        regime,
        states: errors.len(),
        displacement: share(|v| v.displacement_mm, false),
        stress: share(|v| v.stress_mpa, false),
        force: has_force.then(|| share(|v| v.force_n, true)).flatten(),
    })
}

#[cfg(test)]
#[path = "../tests/unit/quality.rs"]
mod tests;
