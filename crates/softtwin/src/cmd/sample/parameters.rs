//! Parameters of an actuator and their ranges.

use crate::failure::{configuration, usage};
use crate::files;
use fem::actuator::{Setting, moved_nodes};
use std::path::Path;

/// More parameters make more corners of their ranges than can be checked, and more inputs than a model has.
const MOST: usize = 8;

/// A quantity of `actuator.toml` that varies.
#[derive(Clone, Debug)]
pub struct Parameter {
    /// Dotted key.
    pub name: String,
    /// Lower and upper value.
    pub range: [f64; 2],
}

/// `NAME=LOW:HIGH`.
pub fn range(text: &str) -> Result<Parameter, String> {
    let expected = "expected NAME=LOW:HIGH with LOW < HIGH, such as elastomer.law.mu_mpa=0.6:1.0";
    let (name, range) = text.split_once('=').ok_or(expected)?;
    let (low, high) = range.split_once(':').ok_or(expected)?;
    match (low.trim().parse::<f64>(), high.trim().parse::<f64>()) {
        (Ok(low), Ok(high)) if low < high && low.is_finite() && high.is_finite() => {
            Ok(Parameter { name: name.trim().into(), range: [low, high] })
        }
        _ => Err(expected.into()),
    }
}

/// Checks every corner of the ranges on the actuator's mesh: where no corner collides, nothing between them does, because
/// planes move linearly with each parameter.
pub fn check(actuator: &Path, parameters: &[Parameter]) -> anyhow::Result<()> {
    if parameters.len() > MOST {
        return Err(usage(format!("--parameter: expected at most {MOST}, found {}", parameters.len())));
    }
    let family = files::family(actuator)?;
    for corner in 0..1_usize << parameters.len() {
        let value = |(k, p): (usize, &Parameter)| (p.name.clone(), p.range[(corner >> k) & 1]);
        let settings: Vec<Setting> = parameters.iter().enumerate().map(value).collect();
        let changed = family.variant(&settings).and_then(|variant| family.actuator_of(&variant));
        let changed = changed.map_err(configuration)?;
        moved_nodes(family.problem.mesh(), &family.actuator, &changed)
            .map_err(|wrong| configuration(fem::VariantError::Values(wrong)))?;
    }
    Ok(())
}
