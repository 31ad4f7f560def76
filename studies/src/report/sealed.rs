//! Limits for the test states (sealed): drawn with an unused seed, simulated and evaluated once. `sealed.csv` in the model's folder
//! contains their inputs and the model's errors (`softtwin evaluate --sealed N --seed S --errors sealed.csv`).

use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use rom::snapshots::RegimeKind;
use softtwin::files;
use std::path::Path;
use train::evaluate::spread;
use train::unseen_errors;

/// Limits of the errors: mean, 95th percentile, largest of normalised displacement and stress, of the force per largest force.
pub const ERRORS: [[f64; 3]; 3] = [[2e-4, 6e-4, 3e-3], [5e-3, 1.2e-2, 2e-2], [2e-4, 6e-4, 2e-3]];
/// Limit of the fraction of states outside the half-widths, whose nominal coverage is 90 %.
pub const OUTSIDE: f64 = 0.14;

/// Figures of the contact states inside the training range.
pub struct Sealed {
    pub states: usize,
    /// Displacement, stress, force: mean, 95th percentile, worst.
    pub errors: [[f64; 3]; 3],
    /// Fractions outside the half-widths.
    pub outside: [f64; 3],
}

impl Sealed {
    /// Reads the table in the folder of the database and its model; `None` without a table.
    pub fn read(database: &Path) -> anyhow::Result<Option<Self>> {
        let Some(model) = super::folder::beside(database, "twin") else { return Ok(None) };
        let table = model.with_file_name("sealed.csv");
        if !table.exists() {
            return Ok(None);
        }
        let model = files::model(&model)?;
        Self::of(&table, &model).map(Some)
    }

    /// Errors are normalised by the model's largest values.
    fn of(table: &Path, model: &Model) -> anyhow::Result<Self> {
        let mut states = unseen_errors::read(table, model)?;
        states.retain(|state| state.regime == RegimeKind::Contact);
        anyhow::ensure!(!states.is_empty(), "{}: expected contact states, found none", table.display());
        let mut predicted = ModelState::new(model, &Selection::default())?;
        let (mut errors, mut largest_n) = ([const { Vec::new() }; 3], 0.0_f64);
        let mut outside = [0.0; 3];
        for state in &states {
            let peaks = predicted.update(state.inputs)?;
            let (evaluation, widths) = (predicted.evaluation(), predicted.evaluation().halfwidths);
            let nominal = [widths.displacement_mm, widths.stress_mpa, widths.force_n];
            let peak =
                |peak: Option<rom::reconstructor::Peak>| peak.map_or(f64::NAN, |peak| f64::from(peak.value));
            let scales = [peak(peaks.displacement_mm), peak(peaks.stress_mpa), 1.0];
            largest_n = largest_n.max(evaluation.contact_force_n);
            let of_state = state.errors.values();
            for k in 0..3 {
                errors[k].push(of_state[k] / scales[k]);
                outside[k] += f64::from(u8::from(of_state[k] > nominal[k])) / states.len() as f64;
            }
        }
        errors[2].iter_mut().for_each(|error| *error /= largest_n);
        Ok(Self { states: states.len(), errors: errors.each_mut().map(|of| spread(of)), outside })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{database, training_states};
    use rom::snapshots::Split;
    use train::evaluate::evaluate;

    #[test]
    fn table_returns_the_measured_errors_and_another_models_is_refused() {
        let mut states = training_states(24, 12, 11);
        states.extend(
            (0..6).map(|i| (Split::Check, 0.03 + 0.008 * f64::from(i), Some(12.0 + 3.0 * f64::from(i)))),
        );
        let database = database(&states);
        let trained = |states: &_| train::train(states, &train::config::TrainConfig::default(), &mut |_| ());
        let (model, _) = trained(&database).expect("a model");
        let cases: Vec<usize> = database.of_split(Split::Check).collect();
        let report = evaluate(&model, &database, &cases).expect("fits");
        let folder = tempfile::tempdir().expect("a folder");
        let table = folder.path().join("sealed.csv");
        unseen_errors::write(&table, &model, &report.cases).expect("writable");
        let sealed = Sealed::of(&table, &model).expect("a table of its model");
        let inside = report.cases.iter().filter(|case| case.domain == rom::hull::DomainStatus::Inside);
        let stress =
            database.fields.iter().position(|f| f.kind == rom::snapshots::FieldKind::Stress).expect("stress");
        let mut of_stress: Vec<f64> = inside.map(|case| case.fields[stress].normalised).collect();
        assert_eq!(sealed.states, of_stress.len());
        for (found, expected) in sealed.errors[1].into_iter().zip(spread(&mut of_stress)) {
            assert!((found / expected - 1.0).abs() < 0.02, "{found} {expected}");
        }

        // Errors of a thousandfold lie outside every half-width.
        let mut larger = report.cases.clone();
        larger.iter_mut().for_each(|case| case.errors = case.errors.values().map(|error| 1e3 * error).into());
        unseen_errors::write(&table, &model, &larger).expect("writable");
        let sealed = Sealed::of(&table, &model).expect("a table of its model");
        assert!(sealed.outside.iter().all(|share| *share > OUTSIDE), "{:?}", sealed.outside);

        states.truncate(states.len() - 6);
        states.pop();
        let (other, _) = trained(&crate::synthetic::database(&states)).expect("a model");
        let refused = Sealed::of(&table, &other).err().expect("errors of another model").to_string();
        assert!(refused.contains("the predictions of this model"), "{refused}");
    }
}
