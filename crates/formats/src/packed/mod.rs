//! Snapshots packed for a repository: a bound on the error of every value, at most 20 % of the size.
//!
//! Every value is stored as an integer number of steps, `v = k * step`, so that no error exceeds `step / 2`. A case is
//! predicted as the linear combination of its nearest earlier cases that fits best (least squares; of the earlier cases
//! as stored, so errors do not accumulate); the remainders are small integers, which deflate well. Fields that
//! follow from others (the displacement magnitude) are not stored.

mod bits;
mod fit;

use crate::error::{Diagnostic, FormatError};
use crate::file;
use bits::{Reader, Writer};
use std::path::Path;

/// First bytes of a file.
const MAGIC: [u8; 8] = *b"STWNPACK";
const VERSION: u32 = 3;
/// Version of files whose steps differ from case to case.
const SHARES_VERSION: u32 = 4;
/// Largest number of earlier cases in a prediction.
const BASIS: usize = 32;
/// Largest number of values in a file (8 GB as f32).
const MAX_VALUES: usize = 1 << 31;

/// Storage of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stored {
    /// Rounded to steps of this size; the error is at most half of it.
    Steps(f64),
    /// Rounded, in each case, with an error of at most this fraction of the case's largest value.
    Share(f64),
    /// Not stored: the distance between fields 0 to 2 and the undeformed coordinates.
    Distance,
}

/// Snapshots in memory: `cases x nodes x fields`, node-interleaved.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshots {
    /// Cases, nodes, fields.
    pub shape: [usize; 3],
    pub values: Vec<f32>,
}

/// Packs snapshots with the storage of each field. Cost `O(cases x basis^2 x nodes)`.
///
/// # Errors
/// Shapes that do not fit, values that are not finite or too large for their step.
pub fn pack(snapshots: &Snapshots, fields: &[Stored]) -> Result<Vec<u8>, Diagnostic> {
    let [cases, nodes, count] = snapshots.shape;
    let values = cases.checked_mul(nodes).and_then(|n| n.checked_mul(count));
    if values != Some(snapshots.values.len()) || fields.len() != count {
        let found = format!("{} values, {} fields", snapshots.values.len(), fields.len());
        return Err(Diagnostic::new("snapshots", format!("{:?}", snapshots.shape), found));
    }
    let shares = fields.iter().any(|stored| matches!(stored, Stored::Share(_)));
    let mut out = Writer::new(&MAGIC, if shares { SHARES_VERSION } else { VERSION });
    [cases, nodes, count].iter().for_each(|n| out.count(*n));
    let steps: Vec<Vec<f64>> =
        fields.iter().enumerate().map(|(f, stored)| steps(snapshots, f, stored)).collect();
    for steps in &steps {
        let written = if shares { &steps[..] } else { &steps[..1] };
        written.iter().for_each(|step| out.number(*step));
    }
    for (f, steps) in steps.iter().enumerate().filter(|(f, _)| fields[*f] != Stored::Distance) {
        pack_field(&mut out, snapshots, f, steps)?;
    }
    Ok(out.finish())
}

/// Step of a field for each case, at least one entry; 0 if the field is not stored.
fn steps(snapshots: &Snapshots, field: usize, stored: &Stored) -> Vec<f64> {
    let [cases, nodes, count] = snapshots.shape;
    let share = match stored {
        Stored::Steps(step) => return vec![*step; cases.max(1)],
        Stored::Distance => return vec![0.0; cases.max(1)],
        Stored::Share(share) => share,
    };
    let largest = |case: usize| {
        let values =
            snapshots.values[case * nodes * count..][..nodes * count].iter().skip(field).step_by(count);
        values.fold(0.0_f32, |largest, v| largest.max(v.abs()))
    };
    // A case of nothing but zeros has any step.
    let step = |largest: f32| if largest > 0.0 { 2.0 * share * f64::from(largest) } else { 1.0 };
    (0..cases).map(|case| step(largest(case))).collect()
}

fn pack_field(
    out: &mut Writer,
    snapshots: &Snapshots,
    field: usize,
    steps: &[f64],
) -> Result<(), Diagnostic> {
    let [cases, nodes, count] = snapshots.shape;
    let mut known: Vec<Vec<i32>> = Vec::with_capacity(cases);
    for case in 0..cases {
        let values =
            snapshots.values[case * nodes * count..][..nodes * count].iter().skip(field).step_by(count);
        let steps: Vec<i32> = values
            .map(|v| {
                let steps = (f64::from(*v) / steps[case]).round();
                // Half the range is kept free, so that a difference always fits too.
                if steps.abs() < f64::from(i32::MAX / 4) { Ok(steps as i32) } else { Err(*v) }
            })
            .collect::<Result<_, _>>()
            .map_err(|v| {
                Diagnostic::new(format!("case {case}, field {field}"), "finite values within 5e8 steps", v)
            })?;
        let basis = fit::nearest(&known, &steps, BASIS);
        let weights = fit::weights(&known, &basis, &steps);
        let predicted = fit::predict(&known, &basis, &weights, nodes);
        out.count(basis.len());
        for (b, w) in basis.iter().zip(&weights) {
            out.count(*b);
            out.number(*w);
        }
        let rest: Vec<i32> = steps.iter().zip(predicted).map(|(s, p)| s.wrapping_sub(p)).collect();
        out.integers(&rest);
        known.push(steps);
    }
    Ok(())
}

/// Unpacks; `undeformed_mm` gives the fields that follow from the coordinates. Memory is bounded by the file's size.
///
/// # Errors
/// Damaged bytes, or a missing or foreign mesh.
pub fn unpack(bytes: &[u8], undeformed_mm: Option<&[[f64; 3]]>) -> Result<Snapshots, Diagnostic> {
    let (mut input, version) = Reader::new(bytes, &MAGIC, &[VERSION, SHARES_VERSION])?;
    let shape = [input.count("cases")?, input.count("nodes")?, input.count("fields")?];
    let [cases, nodes, count] = shape;
    // Deflate shrinks at most a thousandfold, so larger counts are damage or an attack on memory.
    let most = bytes.len().saturating_mul(2000).min(MAX_VALUES);
    let total =
        cases.checked_mul(nodes).and_then(|n| n.checked_mul(count)).filter(|n| (1..=most).contains(n));
    let Some(total) = total else {
        return Err(Diagnostic::new("shape", format!("1 to {most} values"), format!("{shape:?}")));
    };
    let per_field = if version == SHARES_VERSION { cases } else { 1 };
    let steps: Vec<f64> = (0..count * per_field).map(|_| input.number("step")).collect::<Result<_, _>>()?;
    if steps.iter().any(|s| !(s.is_finite() && *s >= 0.0)) {
        return Err(Diagnostic::new("step", "finite numbers, 0 or more", format!("{steps:?}")));
    }
    let mut values = vec![0.0_f32; total];
    let steps: Vec<&[f64]> = steps.chunks_exact(per_field).collect();
    for (field, steps) in steps.iter().enumerate().filter(|(_, steps)| steps[0] > 0.0) {
        let mut known: Vec<Vec<i32>> = Vec::with_capacity(cases);
        for case in 0..cases {
            let step = steps[case.min(per_field - 1)];
            let whole = unpack_case(&mut input, &known, nodes)?;
            let slots = values[case * nodes * count..][..nodes * count].iter_mut().skip(field).step_by(count);
            slots.zip(&whole).for_each(|(slot, k)| *slot = (f64::from(*k) * step) as f32);
            known.push(whole);
        }
    }
    input.end()?;
    let mut snapshots = Snapshots { shape, values };
    for field in (0..count).filter(|f| steps[*f][0] == 0.0) {
        distances(&mut snapshots, field, undeformed_mm)?;
    }
    Ok(snapshots)
}

fn unpack_case(input: &mut Reader, known: &[Vec<i32>], nodes: usize) -> Result<Vec<i32>, Diagnostic> {
    let count = input.count("basis")?;
    if count > BASIS {
        return Err(Diagnostic::new("basis", format!("at most {BASIS} cases"), count));
    }
    let (mut basis, mut weights) = (Vec::new(), Vec::new());
    for _ in 0..count {
        let case = input.count("basis")?;
        if case >= known.len() {
            return Err(Diagnostic::new("basis", format!("an earlier case than {}", known.len()), case));
        }
        basis.push(case);
        weights.push(input.number("weight")?);
    }
    let mut whole = input.integers(nodes)?;
    let predicted = fit::predict(known, &basis, &weights, nodes);
    whole.iter_mut().zip(predicted).for_each(|(k, p)| *k = k.wrapping_add(p));
    Ok(whole)
}

fn distances(snapshots: &mut Snapshots, field: usize, mesh: Option<&[[f64; 3]]>) -> Result<(), Diagnostic> {
    let [_, nodes, count] = snapshots.shape;
    let found = mesh.map_or("none".into(), |m| format!("{} nodes", m.len()));
    let expected = format!("the undeformed mesh of {nodes} nodes, and coordinates before field {field}");
    let Some(mesh) = mesh.filter(|m| m.len() == nodes && field >= 3) else {
        return Err(Diagnostic::new("mesh", expected, found));
    };
    for (entry, rest) in snapshots.values.chunks_exact_mut(count).zip(mesh.iter().cycle()) {
        let squared: f64 = (0..3).map(|k| (f64::from(entry[k]) - rest[k]).powi(2)).sum();
        entry[field] = squared.sqrt() as f32;
    }
    Ok(())
}

/// Writes a packed file.
///
/// # Errors
/// As [`pack`], or an I/O error.
pub fn write(path: &Path, snapshots: &Snapshots, fields: &[Stored]) -> Result<(), FormatError> {
    let bytes = pack(snapshots, fields).map_err(|p| FormatError::one(path, p))?;
    file::replace(path, &bytes)
}

/// Reads a packed file.
///
/// # Errors
/// As [`unpack`], or an I/O error.
pub fn read(path: &Path, undeformed_mm: Option<&[[f64; 3]]>) -> Result<Snapshots, FormatError> {
    let bytes = file::read_bytes(path, file::MAX_DATA_BYTES)?;
    unpack(&bytes, undeformed_mm).map_err(|p| FormatError::one(path, p))
}
