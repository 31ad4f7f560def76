//! Selection of a part of a model, and errors of models.

use crate::kernel::BasisError;
use thiserror::Error;

/// Fields and nodes to reconstruct. Default: all.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// Fields by name, in the order wanted; `None` for all in the model's order.
    pub fields: Option<Vec<String>>,
    /// The nodes that are reconstructed.
    pub nodes: Nodes,
}

/// Nodes to reconstruct.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Nodes {
    /// All of them.
    #[default]
    All,
    /// A node set of the model, by name.
    Set(String),
    /// These, in this order.
    List(Vec<u32>),
}

/// Why a model cannot be evaluated or reconstructed as asked.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs)] // the messages say what the values are
pub enum ModelError {
    /// No such field.
    #[error("the model has no field {found:?}; it has {}", .known.join(", "))]
    UnknownField { found: String, known: Vec<String> },
    /// No such node set.
    #[error("the model has no node set {found:?}; it has {}", if .known.is_empty() { "none".into() } else { .known.join(", ") })]
    UnknownNodeSet { found: String, known: Vec<String> },
    /// No such parameter.
    #[error(
        "the model has no parameter {found:?}{}; it has {}",
        .nearest.as_ref().map(|n| format!(" (did you mean {n:?}?)")).unwrap_or_default(),
        if .known.is_empty() { "none".into() } else { .known.join(", ") }
    )]
    UnknownInput { found: String, nearest: Option<String>, known: Vec<String> },
    /// Value of a parameter is not finite.
    #[error("parameter {name}: expected a number, found {value}")]
    NotFinite { name: String, value: f64 },
    /// A node index beyond the mesh.
    #[error("node {node} does not exist; the model has {node_count} nodes, numbered from 0")]
    NodeOutOfRange { node: u32, node_count: usize },
    /// A block the selection needs was not loaded, or has the wrong length.
    #[error("block {block}: expected {expected} values, found {found}; load the model with this selection")]
    MissingBlock {
        block: String,
        expected: usize,
        /// Length found, 0 when absent.
        found: usize,
    },
    /// The kernel cannot lay the basis out.
    #[error("the basis cannot be laid out: {0}")]
    Basis(#[from] BasisError),
    /// The header contradicts itself.
    #[error("the model is inconsistent: {0}")]
    Inconsistent(String),
}
