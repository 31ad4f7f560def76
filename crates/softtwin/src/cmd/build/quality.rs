//! How good a new twin is, in figures that say what they mean.

use crate::cmd::evaluate;
use crate::files::quoted;
use crate::{files, output};
use anyhow::Result;
use rom::snapshots::{RegimeKind, Split};
use serde::Serialize;
use std::path::{Path, PathBuf};
use train::evaluate::Summary;

/// Errors of one regime in percent of the largest value of a state, mean and largest over the states.
#[derive(Debug, Serialize)]
struct Errors {
    regime: String,
    states: usize,
    displacement_percent: [f64; 2],
    /// `None` if the model has no stress.
    stress_percent: Option<[f64; 2]>,
    /// Percent of the largest force.
    force_percent: Option<[f64; 2]>,
}

/// Errors on held-out states, and by leaving out each training state in turn.
#[derive(Debug, Serialize)]
pub struct Quality {
    held_back: Vec<Errors>,
    leave_one_out: Vec<evaluate::LeftOut>,
    /// `None` without held-out states.
    picture: Option<PathBuf>,
}

impl Quality {
    /// Measures a model on the held-out states of its database and draws the errors by state.
    ///
    /// # Errors
    /// Files that cannot be read or written.
    pub fn of(model: &Path, database: &Path, picture: &Path) -> Result<Self> {
        let loaded = files::model(model)?;
        let kinds = formats::database::obstacle_kinds(database).map_err(files::refusal)?;
        let data = files::database(database, kinds[0])?;
        let held_back = |case: &usize| data.cases[*case].split != Split::Train;
        let cases: Vec<usize> = (0..data.cases.len()).filter(held_back).collect();
        let leave_one_out = evaluate::leave_one_out(&files::data_sheet(model));
        if cases.is_empty() {
            return Ok(Self { held_back: Vec::new(), leave_one_out, picture: None });
        }
        let report = train::evaluate::evaluate(&loaded, &data, &cases)?;
        evaluate::picture(&report).save(picture)?;
        let held_back = report.regimes.iter().map(errors).collect();
        Ok(Self { held_back, leave_one_out, picture: Some(picture.into()) })
    }

    /// Prints the figures.
    pub fn print(&self) -> Result<()> {
        output!("\nhow far it is from the finite elements it was trained on, at the worst node of a state:")?;
        let has_stress = self.held_back.iter().any(|e| e.stress_percent.is_some())
            || self.leave_one_out.iter().any(|left| left.stress_mpa.is_some());
        let has_force = self.held_back.iter().any(|e| e.force_percent.is_some())
            || self.leave_one_out.iter().any(|left| left.force_n.is_some());
        let stress = if has_stress { format!("{:>16}", "stress") } else { String::new() };
        let force = if has_force { format!("{:>16}", "force") } else { String::new() };
        output!("  {:<38}{:>16}{stress}{force}", "mean and largest error", "displacement")?;
        let pair = |[mean, largest]: [f64; 2]| format!("{mean:.2}, {largest:.2} %");
        for e in &self.held_back {
            let states = format!("{} {} states never trained on", e.states, e.regime);
            let cell = |is_column: bool, value: Option<[f64; 2]>| match is_column {
                true => format!("{:>16}", value.map_or("-".into(), pair)),
                false => String::new(),
            };
            let (stress, force) = (cell(has_stress, e.stress_percent), cell(has_force, e.force_percent));
            output!("  {states:<38}{:>16}{stress}{force}", pair(e.displacement_percent))?;
        }
        for left in self.leave_one_out.iter().filter(|left| left.cases > 0) {
            let states = format!("{} {} states, left out in turn", left.cases, left.regime.name());
            let pair = |[mean, _, largest]: [f64; 3], unit: &str| format!("{mean:.1e}, {largest:.1e} {unit}");
            let displacement = pair(left.displacement_mm, "mm");
            let stress =
                left.stress_mpa.map_or(String::new(), |values| format!("{:>21}", pair(values, "MPa")));
            let of_contact = left.force_n.filter(|_| left.regime == RegimeKind::Contact);
            let force = match has_force {
                true => format!("{:>19}", of_contact.map_or("-".into(), |values| pair(values, "N"))),
                false => String::new(),
            };
            output!("  {states:<34}{displacement:>20}{stress}{force}")?;
        }
        match &self.picture {
            Some(picture) => {
                output!(
                    "  percent of the largest value of a state, of a force of the largest of all; {}",
                    picture.display()
                )?;
            }
            None => output!("  no held-out state (split = test): the error is from leave-one-out only")?,
        }
        Ok(())
    }

    /// Limits of these figures for an actuator solved by this program.
    ///
    /// # Errors
    /// A closed output.
    pub fn print_limits(quick: bool, folder: &Path) -> Result<()> {
        output!(
            "  the finite elements themselves: mesh about 4 % (docs/fem.md), and whatever the silicone's constants are off"
        )?;
        if quick {
            output!("  few states, few checks: a first look. For use: softtwin build {}", quoted(folder))?;
        }
        Ok(())
    }
}

fn errors(summary: &Summary) -> Errors {
    let of = |name: &str| {
        let field = summary.fields.iter().find(|field| field.field == name)?;
        Some([100.0 * field.normalised[0], 100.0 * field.normalised[2]])
    };
    let has_force = summary.regime == RegimeKind::Contact && summary.coverage[2].is_finite();
    Errors {
        regime: summary.regime.name().to_owned(),
        states: summary.cases,
        displacement_percent: of("displacement").unwrap_or([f64::NAN; 2]),
        stress_percent: of("von_mises"),
        force_percent: has_force.then(|| [0, 2].map(|k| 100.0 * summary.force_normalised[k])),
    }
}
