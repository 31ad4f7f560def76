//! 3 x 3 matrices as plain arrays, beside the vectors of [`rom::vector`]: all the small algebra the elements need.

pub(crate) use rom::vector::{Vec3, add, axpy, cross, dot, norm, scale, sub};

/// A 3 x 3 matrix, row by row.
pub(crate) type Mat3 = [[f64; 3]; 3];

/// `m v`.
#[inline]
pub(crate) fn mat_vec(m: &Mat3, v: Vec3) -> Vec3 {
    [dot(m[0], v), dot(m[1], v), dot(m[2], v)]
}

/// Matrix `s a b^T`.
#[inline]
pub(crate) fn outer(s: f64, a: Vec3, b: Vec3) -> Mat3 {
    [scale(s * a[0], b), scale(s * a[1], b), scale(s * a[2], b)]
}

/// Skew matrix `[a]x` with `[a]x b = a x b`.
#[inline]
pub(crate) fn skew(a: Vec3) -> Mat3 {
    [[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]]
}

/// Determinant and the transposed inverse `m^-T`; the inverse is meaningless when the determinant is zero.
#[inline]
pub(crate) fn det_inv_transpose(m: &Mat3) -> (f64, Mat3) {
    let rows = [cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])];
    let det = dot(m[0], rows[0]);
    let inv = 1.0 / det;
    (det, [scale(inv, rows[0]), scale(inv, rows[1]), scale(inv, rows[2])])
}

/// Eigenvalues of a symmetric matrix and their orthonormal eigenvectors, one per row (Jacobi's method; equal eigenvalues are no special
/// case).
pub(crate) fn symmetric_eigen(m: &Mat3) -> (Vec3, Mat3) {
    let (mut a, mut axes) = (*m, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    // Convergence is quadratic: six sweeps reach rounding level from any start.
    for _ in 0..12 {
        let off = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
        if off <= 1.0e-17 * (a[0][0].abs() + a[1][1].abs() + a[2][2].abs()) {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            for k in 0..3 {
                (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
                (axes[p][k], axes[q][k]) = (c * axes[p][k] - s * axes[q][k], s * axes[p][k] + c * axes[q][k]);
            }
        }
    }
    ([a[0][0], a[1][1], a[2][2]], axes)
}
