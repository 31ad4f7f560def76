//! GMRES with an older factor as preconditioner.

use crate::mass::product;

/// Solves `A x = side` with the right preconditioner `B^-1` to a relative residual of `tolerance`, in at most `most` iterations.
///
/// Returns the solution; `None` if the residual is still larger.
pub(crate) fn solve(
    side: &[f64],
    (tolerance, most): (f64, usize),
    mut apply: impl FnMut(&[f64]) -> Vec<f64>,
    mut precondition: impl FnMut(&mut [f64]),
) -> Option<Vec<f64>> {
    let length = norm(side);
    if length <= 0.0 {
        return Some(vec![0.0; side.len()]);
    }
    let mut basis = vec![side.iter().map(|v| v / length).collect::<Vec<f64>>()];
    let mut directions: Vec<Vec<f64>> = Vec::new();
    // Columns of the triangle that the rotations make of the Hessenberg matrix, and the rotated right-hand side.
    let (mut triangle, mut rotations) = (Vec::<Vec<f64>>::new(), Vec::<[f64; 2]>::new());
    let mut rest = vec![length];
    for k in 0..most {
        let mut direction = basis[k].clone();
        precondition(&mut direction);
        let mut image = apply(&direction);
        directions.push(direction);
        let mut column = Vec::with_capacity(k + 2);
        for vector in &basis {
            let part = product(vector, &image);
            image.iter_mut().zip(vector).for_each(|(image, v)| *image -= part * v);
            column.push(part);
        }
        let height = norm(&image);
        for (i, [c, s]) in rotations.iter().enumerate() {
            let (a, b) = (column[i], column[i + 1]);
            (column[i], column[i + 1]) = (c * a + s * b, c * b - s * a);
        }
        let hypotenuse = column[k].hypot(height);
        let [c, s] = [column[k] / hypotenuse, height / hypotenuse];
        column[k] = hypotenuse;
        triangle.push(column);
        rotations.push([c, s]);
        let last = rest[k];
        rest[k] = c * last;
        rest.push(-s * last);
        if rest[k + 1].abs() <= tolerance * length {
            return Some(combined(&triangle, &rest, &directions));
        }
        if !(height > 0.0 && hypotenuse.is_finite()) {
            return None;
        }
        basis.push(image.into_iter().map(|v| v / height).collect());
    }
    None
}

/// Sum of the directions with the weights that solve the triangle.
fn combined(triangle: &[Vec<f64>], rest: &[f64], directions: &[Vec<f64>]) -> Vec<f64> {
    let mut weights = rest[..triangle.len()].to_vec();
    for i in (0..weights.len()).rev() {
        let known: f64 = (i + 1..weights.len()).map(|j| triangle[j][i] * weights[j]).sum();
        weights[i] = (weights[i] - known) / triangle[i][i];
    }
    let mut sum = vec![0.0; directions[0].len()];
    for (weight, direction) in weights.iter().zip(directions) {
        sum.iter_mut().zip(direction).for_each(|(sum, d)| *sum += weight * d);
    }
    sum
}

fn norm(v: &[f64]) -> f64 {
    product(v, v).sqrt()
}
