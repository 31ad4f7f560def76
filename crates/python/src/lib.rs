//! The native half of the Python package `softtwin`: models, sessions, controllers and the shared-memory bus, by the same library functions
//! as of the programs. `clients/python` adds what is Python's own: names, broadcasting, tables, meshes.
//!
//! Arrays are numpy's and are written in place. Whatever computes or waits lets other threads of the interpreter run.

mod actuator;
mod bus;
mod control;
mod database;
mod layout;
mod measured;
mod model;
mod parameters;

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

#[pymodule]
mod _native {
    #[pymodule_export]
    use super::actuator::{Actuator, Simulation};
    #[pymodule_export]
    use super::bus::{Bus, Client, Reader, Sample, Writer, now_ns};
    #[pymodule_export]
    use super::control::Control;
    #[pymodule_export]
    use super::database::Database;
    #[pymodule_export]
    use super::layout::{codes, kind_of, layouts};
    #[pymodule_export]
    use super::measured::{compare, learn, to_unit};
    #[pymodule_export]
    use super::model::{Model, Session};
}
