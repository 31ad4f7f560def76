//! Shape functions and quadrature of the 6-node triangle, shared by sheet, cavity and contact.

/// Values of the six shape functions at (r, s); the corners are (0,0), (1,0), (0,1).
pub(crate) fn shape(r: f64, s: f64) -> [f64; 6] {
    let l = [1.0 - r - s, r, s];
    [
        l[0] * (2.0 * l[0] - 1.0),
        l[1] * (2.0 * l[1] - 1.0),
        l[2] * (2.0 * l[2] - 1.0),
        4.0 * l[0] * l[1],
        4.0 * l[1] * l[2],
        4.0 * l[2] * l[0],
    ]
}

/// Derivatives of the shape functions with respect to (r, s).
pub(crate) fn derivatives(r: f64, s: f64) -> [[f64; 2]; 6] {
    let l = 1.0 - r - s;
    [
        [1.0 - 4.0 * l, 1.0 - 4.0 * l],
        [4.0 * r - 1.0, 0.0],
        [0.0, 4.0 * s - 1.0],
        [4.0 * (l - r), -4.0 * r],
        [4.0 * s, 4.0 * r],
        [-4.0 * s, 4.0 * (l - s)],
    ]
}

/// Second derivatives (rr, ss, rs) of the shape functions: constant.
pub(crate) const SECOND: [[f64; 3]; 6] = [
    [4.0, 4.0, 4.0],
    [4.0, 0.0, 0.0],
    [0.0, 4.0, 0.0],
    [-8.0, 0.0, -4.0],
    [0.0, 0.0, 4.0],
    [0.0, -8.0, -4.0],
];

/// Three-point rule (exact to degree 2): (r, s, weight), weights summing to 1.
pub(crate) const THREE_POINTS: [[f64; 3]; 3] =
    [[1.0 / 6.0, 1.0 / 6.0, 1.0 / 3.0], [2.0 / 3.0, 1.0 / 6.0, 1.0 / 3.0], [1.0 / 6.0, 2.0 / 3.0, 1.0 / 3.0]];

/// Six-point rule (exact to degree 4): (r, s, weight), weights summing to 1.
pub(crate) const SIX_POINTS: [[f64; 3]; 6] = [
    [0.445_948_490_915_965, 0.445_948_490_915_965, 0.223_381_589_678_011],
    [0.108_103_018_168_070, 0.445_948_490_915_965, 0.223_381_589_678_011],
    [0.445_948_490_915_965, 0.108_103_018_168_070, 0.223_381_589_678_011],
    [0.091_576_213_509_771, 0.091_576_213_509_771, 0.109_951_743_655_322],
    [0.816_847_572_980_459, 0.091_576_213_509_771, 0.109_951_743_655_322],
    [0.091_576_213_509_771, 0.816_847_572_980_459, 0.109_951_743_655_322],
];
