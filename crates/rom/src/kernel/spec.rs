//! What to build a [`Basis`](super::Basis) from: plain slices, no type of the model.

use std::ops::Range;

use thiserror::Error;

/// One value a node, or one value a node and mode, in either precision of the source.
#[derive(Debug, Clone, Copy)]
pub enum Values<'a> {
    /// Single precision.
    F32(&'a [f32]),
    /// Double precision.
    F64(&'a [f64]),
}

impl Values<'_> {
    /// Entry `index` in f64.
    pub fn get(&self, index: usize) -> f64 {
        match self {
            Self::F32(values) => f64::from(values[index]),
            Self::F64(values) => values[index],
        }
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::F64(values) => values.len(),
        }
    }

    /// True when there is no entry.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl<'a> From<&'a [f32]> for Values<'a> {
    fn from(values: &'a [f32]) -> Self {
        Self::F32(values)
    }
}

impl<'a> From<&'a [f64]> for Values<'a> {
    fn from(values: &'a [f64]) -> Self {
        Self::F64(values)
    }
}

/// `mean + modes · coefficients[range]`: one field of one POD group.
#[derive(Debug, Clone)]
pub struct Affine<'a> {
    /// The mean of the snapshots, one value a node; `None` for an uncentred basis.
    pub mean: Option<Values<'a>>,
    /// Mode `j` at node `i` is `modes[j * stride + i]`; as many modes as `coefficients` is long.
    pub modes: Values<'a>,
    /// Distance between two modes in `modes`: the node count, or more when the modes of several fields are stacked.
    pub stride: usize,
    /// This field's part of the coefficient vector. Fields of a joint POD name the same range.
    pub coefficients: Range<usize>,
}

/// How the undeformed coordinates change with one more coefficient, which the kernel takes as it takes those of modes.
#[derive(Debug, Clone)]
pub struct Shift<'a> {
    /// Index in the coefficient vector.
    pub coefficient: usize,
    /// Change of x, y, z per unit of it, one value a node; `None` where there is none.
    pub axes: [Option<Values<'a>>; 3],
}

/// Where a field comes from.
#[derive(Debug, Clone)]
pub enum Source<'a> {
    /// A linear combination of modes.
    Affine(Affine<'a>),
    /// `|x - x0 - sum_i shift_i coefficient_i|` of three affine fields.
    Magnitude {
        /// Indices of x, y, z in [`Spec::fields`].
        coordinates: [usize; 3],
        /// Undeformed x, y, z, one value a node.
        rest: [Values<'a>; 3],
        /// What moves the undeformed coordinates.
        shifts: Vec<Shift<'a>>,
    },
}

/// What a field means, as far as the kernel must know.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Written as computed: coordinates, displacement components, strains.
    Plain,
    /// Displacement magnitude, mm: at least 0, its maximum is reported.
    Displacement,
    /// Von Mises stress, MPa: at least 0, its maximum is reported.
    Stress,
}

/// One field of a basis.
#[derive(Debug, Clone)]
pub struct Field<'a> {
    /// Where it comes from.
    pub source: Source<'a>,
    /// What it means.
    pub role: Role,
    /// Whether it is written. A coordinate that is not published is still computed when a published magnitude needs
    /// it, and costs nothing otherwise.
    pub published: bool,
}

/// The description of a basis: its fields in the order of output, and its nodes.
#[derive(Debug, Clone)]
pub struct Spec<'a> {
    /// Nodes of the model: the length of each mean and of each mode.
    pub node_count: usize,
    /// Nodes to compute, in the order of output; `None` for all. Indices may repeat.
    pub nodes: Option<&'a [u32]>,
    /// Fields in the order of output.
    pub fields: Vec<Field<'a>>,
}

impl<'a> Spec<'a> {
    /// The undeformed coordinate that a magnitude measures an affine field from, and what moves it, each with its entry in the
    /// coefficient vector.
    pub(super) fn rest_of(&self, field: usize) -> Option<(Values<'a>, Vec<(usize, Values<'a>)>)> {
        self.fields.iter().find_map(|of| {
            let Source::Magnitude { coordinates, rest, shifts } = &of.source else { return None };
            let axis = coordinates.iter().position(|&c| c == field)?;
            let along = |shift: &Shift<'a>| Some((shift.coefficient, shift.axes[axis]?));
            Some((rest[axis], shifts.iter().filter_map(along).collect()))
        })
    }

    /// Nodes that will be computed.
    pub fn output_nodes(&self) -> usize {
        self.nodes.map_or(self.node_count, <[u32]>::len)
    }

    /// Index in the model of output node `i`.
    pub fn source_node(&self, i: usize) -> usize {
        self.nodes.map_or(i, |nodes| nodes[i] as usize)
    }
}

/// A field of which no basis is as exact as was asked for. Root mean squares over the nodes, in the field's unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shortfall {
    /// Index of the field.
    pub field: usize,
    /// What storage may add.
    pub accepted: f64,
    /// What f32 adds.
    pub least: f64,
}

fn shortfalls(all: &[Shortfall]) -> String {
    let one =
        |s: &Shortfall| format!("field {}: accepted {:.1e}, f32 adds {:.1e}", s.field, s.accepted, s.least);
    let all: Vec<String> = all.iter().map(one).collect();
    format!("no basis adds as little error as is accepted ({}); accept more", all.join("; "))
}

/// Why a basis cannot be built.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum BasisError {
    /// No node, or more than the kernel can number.
    #[error("the node set has {found} nodes; expected 1 to {}", i32::MAX)]
    NodeCount {
        /// Nodes asked for.
        found: usize,
    },
    /// A node index beyond the model.
    #[error("node {node} is not in the model, which has nodes 0 to {last}; correct the node set", last = .node_count - 1)]
    NodeIndex {
        /// The index asked for.
        node: u32,
        /// Nodes in the model.
        node_count: usize,
    },
    /// Nothing to publish.
    #[error("no field is published; ask for at least one")]
    NothingPublished,
    /// A slice of the wrong length.
    #[error("field {field}: {what} has {found} values; expected {expected}")]
    Length {
        /// Index of the field.
        field: usize,
        /// Which slice.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length that fits.
        expected: usize,
    },
    /// A magnitude that refers to something other than an affine field, or a second magnitude.
    #[error(
        "field {field}: a magnitude needs three different affine fields, and a basis takes one magnitude"
    )]
    Magnitude {
        /// Index of the field.
        field: usize,
    },
    /// Two fields whose maximum would be reported under one name.
    #[error("field {field} is the second of role {role:?}; expected one")]
    DuplicateRole {
        /// Index of the second field.
        field: usize,
        /// The role both claim.
        role: Role,
    },
    /// Too many rows for the stack.
    #[error(
        "the fields need {found} rows of means, modes and rest coordinates; expected at most {}",
        super::MAX_ROWS
    )]
    Rows {
        /// Sum over the fields.
        found: usize,
    },
    /// NaN or infinity, or a value beyond f32.
    #[error("field {field}, node {node}: {value} cannot be stored as f32; the model is damaged")]
    NotFinite {
        /// Index of the field.
        field: usize,
        /// Node in the model.
        node: usize,
        /// The value found.
        value: f64,
    },
    /// Fields of which even f32 adds more than is accepted.
    #[error("{}", shortfalls(.0))]
    Budget(Vec<Shortfall>),
    /// A budget without coefficient vectors, or with shorter ones than the modes refer to.
    #[error(
        "the budget's typical coefficients: found vectors of {found} values; expected at least one, of {expected}"
    )]
    Typical {
        /// Least length given; 0 where there is none.
        found: usize,
        /// Least length.
        expected: usize,
    },
    /// An instruction set this processor does not have.
    #[error("this processor has no {isa}; let the kernel choose (it would take {detected})")]
    IsaMissing {
        /// What was asked for.
        isa: super::Isa,
        /// What would be chosen.
        detected: super::Isa,
    },
}
