//! Actuator on its mesh and all its variants: other materials, other dimensions, the same elements.

use crate::actuator::{Actuator, Setting, moved_nodes};
use crate::config::flat;
use crate::problem::{Problem, ProblemError};
use formats::Diagnostic;
use std::sync::Arc;
use thiserror::Error;

/// Error in a variant.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum VariantError {
    /// Invalid names or values, or a shape that the mesh cannot follow.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Values(Vec<Diagnostic>),
    /// Mesh and materials do not make a problem.
    #[error(transparent)]
    Problem(#[from] ProblemError),
}

/// The quantities in which a variant differs from its family's actuator, by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Variant(Vec<Setting>);

impl Variant {
    /// The differing quantities.
    pub fn settings(&self) -> &[Setting] {
        &self.0
    }
}

/// Nominal actuator with its problem, from which variants are made.
#[derive(Clone, Debug)]
pub struct Family {
    /// Nominal actuator, as in its file.
    pub actuator: Actuator,
    /// Its problem.
    pub problem: Arc<Problem>,
}

impl Family {
    /// The variant with these quantities; nominal values are left out.
    ///
    /// # Errors
    /// Unknown names, a name given twice, values an `actuator.toml` may not have.
    pub fn variant(&self, settings: &[Setting]) -> Result<Variant, VariantError> {
        let mut sorted = settings.to_vec();
        sorted.sort_by(|a, b| a.0.cmp(&b.0));
        if let Some(pair) = sorted.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            let found = format!("{} and {}", pair[0].1, pair[1].1);
            return Err(VariantError::Values(vec![Diagnostic::new(
                &pair[0].0,
                "every parameter once",
                found,
            )]));
        }
        self.actuator.with(&sorted).map_err(VariantError::Values)?;
        sorted.retain(|(name, value)| self.actuator.quantity(name).is_ok_and(|nominal| nominal != *value));
        Ok(Variant(sorted))
    }

    /// A variant's actuator.
    ///
    /// # Errors
    /// Values an `actuator.toml` may not have.
    pub fn actuator_of(&self, variant: &Variant) -> Result<Actuator, VariantError> {
        self.actuator.with(&variant.0).map_err(VariantError::Values)
    }

    /// A variant's problem; the family's if nothing differs. Cost: about 0.1 s for 25,000 nodes.
    ///
    /// # Errors
    /// Invalid values or an invalid shape.
    pub fn problem_of(&self, variant: &Variant) -> Result<Arc<Problem>, VariantError> {
        if variant.0.is_empty() {
            return Ok(Arc::clone(&self.problem));
        }
        let actuator = self.actuator_of(variant)?;
        let nodes =
            moved_nodes(self.problem.mesh(), &self.actuator, &actuator).map_err(VariantError::Values)?;
        Ok(Arc::new(self.problem.varied(nodes, actuator.problem_config())?))
    }

    /// Variant at a fraction of the path from one to another.
    pub fn between(&self, from: &Variant, to: &Variant, fraction: f64) -> Variant {
        if fraction >= 1.0 || from == to {
            return to.clone();
        }
        let mut names: Vec<&String> = from.0.iter().chain(&to.0).map(|(name, _)| name).collect();
        names.sort();
        names.dedup();
        let mix = |name: &String| {
            let (a, b) = (self.value(from, name), self.value(to, name));
            (name.clone(), a + fraction * (b - a))
        };
        Variant(names.into_iter().map(mix).collect())
    }

    /// A variant's value of a quantity; NaN for an unknown name.
    pub fn value(&self, variant: &Variant, name: &str) -> f64 {
        let changed = variant.0.iter().find(|(key, _)| key == name).map(|(_, value)| *value);
        changed.or_else(|| self.actuator.quantity(name).ok()).unwrap_or(f64::NAN)
    }

    /// The variant with one quantity changed by `step`.
    pub fn stepped(&self, variant: &Variant, name: &str, step: f64) -> Variant {
        let mut settings = variant.0.clone();
        settings.retain(|(key, _)| key != name);
        settings.push((name.into(), self.value(variant, name) + step));
        settings.sort_by(|a, b| a.0.cmp(&b.0));
        Variant(settings)
    }

    /// Mark of a variant's checkpoints; `None` for the nominal actuator.
    pub fn mark(&self, variant: &Variant) -> Option<[u8; 32]> {
        if variant.0.is_empty() {
            return None;
        }
        let mut hasher = blake3::Hasher::new();
        // The debug form prints floats so that they can be read back.
        hasher.update(flat(&format!("{:?} {:?}", self.actuator, variant.0)).as_bytes());
        Some(*hasher.finalize().as_bytes())
    }
}
