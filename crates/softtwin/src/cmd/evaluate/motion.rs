//! Series of one motion.

use formats::trace::SERIES;

/// Series of one motion at the same instants.
pub struct Motion {
    /// Name: that of its folder.
    pub name: String,
    /// Finite elements.
    pub truth: Vec<[f64; SERIES]>,
    /// Model.
    pub moving: Vec<[f64; SERIES]>,
    /// Model without inertia.
    pub still: Vec<[f64; SERIES]>,
}
