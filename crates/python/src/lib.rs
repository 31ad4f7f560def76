//! The native half of the Python package `softtwin`: models, sessions, controllers and the shared-memory bus, by the same library functions
//! as of the programs. `clients/python` adds what is Python's own: names, broadcasting, tables, meshes.
//!
//! Arrays are numpy's and are written in place. Whatever computes or waits lets other threads of the interpreter run.

mod actuator;
mod bus;
mod control;
mod database;
mod layout;
mod material;
mod measured;
mod model;
mod parameters;
mod progress;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

mod errors {
    pyo3::import_exception!(softtwin.errors, AlreadyPublished);
    pyo3::import_exception!(softtwin.errors, SofttwinError);
    pyo3::import_exception!(softtwin.errors, TwinAbsent);
    pyo3::import_exception!(softtwin.errors, TwinSilent);
    pyo3::import_exception!(softtwin.errors, VersionMismatch);
}

/// A value that Python passed and that cannot be used.
fn refused(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// The same of an error of ours: with its causes, and with options of the tool by their names as arguments.
fn named(error: &dyn std::error::Error) -> PyErr {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(next) = cause {
        let further = next.to_string();
        if !text.contains(&further) {
            text = format!("{text}: {further}");
        }
        cause = next.source();
    }
    let mut parts = text.split("--");
    let mut shown = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let is_option = part.starts_with(|c: char| c.is_ascii_lowercase());
        let end = part.find(|c: char| c != '-' && !c.is_ascii_alphanumeric()).unwrap_or(part.len());
        let (name, rest) = part.split_at(if is_option { end } else { 0 });
        shown += if is_option { "" } else { "--" };
        shown += &name.replace('-', "_");
        shown += rest;
    }
    refused(shown)
}

#[pymodule]
mod _native {
    #[pymodule_export]
    use super::actuator::{Actuator, Simulation, build, new_actuator};
    #[pymodule_export]
    use super::bus::{Bus, Client, Reader, Sample, Writer, now_ns};
    #[pymodule_export]
    use super::control::Control;
    #[pymodule_export]
    use super::database::Database;
    #[pymodule_export]
    use super::layout::{codes, kind_of, layouts};
    #[pymodule_export]
    use super::material::{Material, fit_material};
    #[pymodule_export]
    use super::measured::{compare, learn, to_unit};
    #[pymodule_export]
    use super::model::{Model, Session};
}
