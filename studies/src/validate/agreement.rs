//! Node-by-node agreement of a computed state with a reference of the same mesh.

use fem::Output;

/// Fields of a reference snapshot: X, Y, Z (mm), |U| (mm), von Mises stress (MPa).
pub const REFERENCE_FIELDS: usize = 5;

/// How far a state is from its reference.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Agreement {
    /// Mean distance between corresponding nodes (mm).
    pub mean_mm: f64,
    /// Largest distance between corresponding nodes (mm).
    pub max_mm: f64,
    /// Largest displacement of the state (mm).
    pub largest_mm: f64,
    /// Largest displacement of the reference (mm).
    pub reference_largest_mm: f64,
    /// Median relative error of the von Mises stress over nodes where the reference shows one.
    pub von_mises_median: f64,
}

/// Compares a state with a reference given as nodes x 5, whose frame is the actuator's plus `shift_mm`.
///
/// Stresses are compared in the convention of the mesh's `mises_owner` where it has one, else as nodal means.
/// `None` when the numbers of nodes differ.
#[must_use]
pub fn compare(output: &Output, reference: &[f32], shift_mm: [f64; 3]) -> Option<Agreement> {
    let nodes = output.coordinates_mm.len();
    if reference.len() != REFERENCE_FIELDS * nodes || nodes == 0 {
        return None;
    }
    let owned = !output.von_mises_owner_mpa.is_empty();
    let stress = if owned { &output.von_mises_owner_mpa } else { &output.von_mises_mpa };
    let mut out = Agreement::default();
    let mut relative = Vec::with_capacity(nodes);
    for (n, row) in reference.chunks_exact(REFERENCE_FIELDS).enumerate() {
        let row: [f64; REFERENCE_FIELDS] = std::array::from_fn(|k| f64::from(row[k]));
        let at = output.coordinates_mm[n];
        let d = (0..3).map(|k| (at[k] + shift_mm[k] - row[k]).powi(2)).sum::<f64>().sqrt();
        out.mean_mm += d / nodes as f64;
        out.max_mm = out.max_mm.max(d);
        out.largest_mm = out.largest_mm.max(output.displacement_mm[n]);
        out.reference_largest_mm = out.reference_largest_mm.max(row[3]);
        if row[4] > 0.0 {
            relative.push(((stress[n] - row[4]) / row[4]).abs());
        }
    }
    relative.sort_by(f64::total_cmp);
    out.von_mises_median = relative.get(relative.len() / 2).copied().unwrap_or(f64::NAN);
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shifted_copy_agrees_and_moved_node_is_found() {
        let mut output = Output {
            coordinates_mm: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
            displacement_mm: vec![0.5, 2.0],
            von_mises_mpa: vec![0.1, 0.2],
            ..Output::default()
        };
        let reference = [2.0, 2.0, 3.0, 0.5, 0.1, 5.0, 5.0, 6.0, 2.0, 0.2];
        let same = compare(&output, &reference, [1.0, 0.0, 0.0]).unwrap();
        assert!(same.max_mm < 1.0e-6 && same.von_mises_median < 1.0e-6);
        output.coordinates_mm[1][1] += 0.25;
        let moved = compare(&output, &reference, [1.0, 0.0, 0.0]).unwrap();
        assert!((moved.max_mm - 0.25).abs() < 1.0e-6 && (moved.mean_mm - 0.125).abs() < 1.0e-6);
        assert!(compare(&output, &reference[..5], [0.0; 3]).is_none());
    }
}
