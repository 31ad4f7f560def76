//! Series of one motion.

/// Series of one motion at the same instants.
pub struct Motion {
    /// Name: that of its folder.
    pub name: String,
    /// Finite elements.
    pub truth: Vec<[f64; 8]>,
    /// Model.
    pub moving: Vec<[f64; 8]>,
    /// Model without inertia.
    pub still: Vec<[f64; 8]>,
}
