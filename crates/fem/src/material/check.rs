//! Checks of constants.

use thiserror::Error;

/// Material constant outside the range in which the law is valid.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{law}: {name} = {found}, expected {expected}; correct the material's constants")]
pub struct MaterialError {
    /// The law the constant belongs to.
    pub law: &'static str,
    /// Name of the constant.
    pub name: &'static str,
    /// Value found.
    pub found: f64,
    /// Accepted values.
    pub expected: &'static str,
}

pub(crate) fn positive(law: &'static str, name: &'static str, found: f64) -> Result<(), MaterialError> {
    if found.is_finite() && found > 0.0 {
        return Ok(());
    }
    Err(MaterialError { law, name, found, expected: "a finite number above 0" })
}

pub(crate) fn at_least_zero(law: &'static str, name: &'static str, found: f64) -> Result<(), MaterialError> {
    if found.is_finite() && found >= 0.0 {
        return Ok(());
    }
    Err(MaterialError { law, name, found, expected: "a finite number, 0 or more" })
}
