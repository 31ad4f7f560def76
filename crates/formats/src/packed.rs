//! Snapshots packed for a repository: a bound on the error of every value, at most 20 % of the size.
//!
//! Every value is stored as an integer number of steps, `v = k * step`, so that no error exceeds `step / 2`. A case is
//! predicted as the linear combination of its nearest earlier cases that fits best (least squares; of the earlier cases
//! as stored, so errors do not accumulate); the remainders are small integers, which deflate well. Fields that
//! follow from others (the displacement magnitude) are not stored.

use crate::error::{Diagnostic, FormatError};
use crate::file;
use flate2::bufread::ZlibDecoder;
use miniz_oxide::deflate::core::{
    CompressionStrategy, CompressorOxide, TDEFLFlush, compress_to_output, create_comp_flags_from_zip_params,
};
use std::io::Read;
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
    let mut out = PackedWriter::new(&MAGIC, if shares { SHARES_VERSION } else { VERSION });
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
    out: &mut PackedWriter,
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
        let basis = nearest(&known, &steps, BASIS);
        let weights = weights(&known, &basis, &steps);
        let predicted = predict(&known, &basis, &weights, nodes);
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
    let (mut input, version) = PackedReader::new(bytes, &MAGIC, &[VERSION, SHARES_VERSION])?;
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

fn unpack_case(input: &mut PackedReader, known: &[Vec<i32>], nodes: usize) -> Result<Vec<i32>, Diagnostic> {
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
    let predicted = predict(known, &basis, &weights, nodes);
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

/// Counts, numbers and lists of integers; the lists as byte planes, deflated.
pub(super) struct PackedWriter(Vec<u8>);

impl PackedWriter {
    pub(crate) fn new(magic: &[u8; 8], version: u32) -> Self {
        let mut bytes = magic.to_vec();
        bytes.extend(version.to_le_bytes());
        Self(bytes)
    }

    pub(crate) fn count(&mut self, value: usize) {
        self.0.extend((value as u64).to_le_bytes());
    }

    pub(crate) fn number(&mut self, value: f64) {
        self.0.extend(value.to_le_bytes());
    }

    /// Appends integers: zigzag (small for small magnitudes), then one plane per byte; the upper planes are zeros.
    pub(crate) fn integers(&mut self, values: &[i32]) {
        let zigzag: Vec<u32> = values.iter().map(|v| ((v << 1) ^ (v >> 31)) as u32).collect();
        let planes = (0..4).map(|p| zigzag.iter().map(|z| (z >> (8 * p)) as u8).collect());
        let packed = deflate(&planes.collect::<Vec<Vec<u8>>>());
        self.count(packed.len());
        self.0.extend(packed);
    }

    /// Appends the checksum of everything before it.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        let sum = checksum(&self.0);
        self.0.extend(sum.to_le_bytes());
        self.0
    }
}

pub(super) struct PackedReader<'a>(&'a [u8]);

impl<'a> PackedReader<'a> {
    /// Reader after the head, and the version in the head.
    pub(crate) fn new(bytes: &'a [u8], magic: &[u8; 8], versions: &[u32]) -> Result<(Self, u32), Diagnostic> {
        let rest = bytes
            .strip_prefix(magic)
            .ok_or_else(|| Diagnostic::new("first bytes", "those of packed snapshots", "others"))?;
        let (body, sum) = rest
            .split_last_chunk::<8>()
            .ok_or_else(|| Diagnostic::new("file", "a checksum at its end", "less"))?;
        let expected = checksum(&bytes[..bytes.len() - 8]);
        if u64::from_le_bytes(*sum) != expected {
            return Err(Diagnostic::new(
                "checksum",
                format!("{expected:016x}"),
                "another: the file is damaged",
            ));
        }
        let mut reader = Self(body);
        let found = u32::from_le_bytes(reader.take("version")?);
        if !versions.contains(&found) {
            return Err(Diagnostic::new("version", format!("one of {versions:?}"), found));
        }
        Ok((reader, found))
    }

    pub(crate) fn count(&mut self, what: &str) -> Result<usize, Diagnostic> {
        let value = u64::from_le_bytes(self.take(what)?);
        usize::try_from(value).map_err(|_| Diagnostic::new(what, "a count that fits into memory", value))
    }

    pub(crate) fn number(&mut self, what: &str) -> Result<f64, Diagnostic> {
        Ok(f64::from_le_bytes(self.take(what)?))
    }

    /// Reads a list of `expected` integers.
    pub(crate) fn integers(&mut self, expected: usize) -> Result<Vec<i32>, Diagnostic> {
        let length = self.count("block")?;
        let wrong = |found: String| Diagnostic::new("block", format!("{expected} integers"), found);
        let (packed, rest) =
            self.0.split_at_checked(length).ok_or_else(|| wrong(format!("{} bytes left", self.0.len())))?;
        self.0 = rest;
        let mut planes = Vec::new(); // grows with what is really there
        let bound = (expected as u64).saturating_mul(4) + 1;
        ZlibDecoder::new(packed).take(bound).read_to_end(&mut planes).map_err(|e| wrong(e.to_string()))?;
        if planes.len() != expected * 4 {
            return Err(wrong(format!("{} bytes", planes.len())));
        }
        let plane = |p: usize| &planes[p * expected..(p + 1) * expected];
        let bytes = plane(0).iter().zip(plane(1)).zip(plane(2)).zip(plane(3));
        Ok(bytes
            .map(|(((a, b), c), d)| {
                let zigzag = u32::from_le_bytes([*a, *b, *c, *d]);
                (zigzag >> 1) as i32 ^ -((zigzag & 1) as i32)
            })
            .collect())
    }

    pub(crate) fn end(&self) -> Result<(), Diagnostic> {
        if self.0.is_empty() {
            Ok(())
        } else {
            Err(Diagnostic::new("end", "nothing more", format!("{} bytes", self.0.len())))
        }
    }

    fn take<const N: usize>(&mut self, what: &str) -> Result<[u8; N], Diagnostic> {
        let (head, rest) = self
            .0
            .split_first_chunk()
            .ok_or_else(|| Diagnostic::new(what, format!("{N} bytes"), "the end of the file"))?;
        self.0 = rest;
        Ok(*head)
    }
}

/// One zlib stream of all planes. Remainders of a prediction repeat only zeros: a search for runs with a separate code per plane
/// is 10 % smaller than a search for all repetitions.
fn deflate(planes: &[Vec<u8>]) -> Vec<u8> {
    let mut out = Vec::new();
    let flags = create_comp_flags_from_zip_params(9, 15, CompressionStrategy::RLE as i32);
    let mut compressor = CompressorOxide::new(flags);
    for (p, plane) in planes.iter().enumerate() {
        let flush = if p + 1 == planes.len() { TDEFLFlush::Finish } else { TDEFLFlush::Sync };
        // Takes all of its input where the output has no limit.
        compress_to_output(&mut compressor, plane, flush, |bytes| {
            out.extend_from_slice(bytes);
            true
        });
    }
    out
}

/// FNV-1a (Fowler, Noll, Vo), 64 bits: detects accidental damage. The reader's checks detect deliberate changes.
fn checksum(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |sum, byte| (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

// ---- linear prediction of a case from earlier ones. Reader and writer run the same operations in the same order ----

/// Indices of the earlier cases nearest to `target` (mean square over a few nodes), nearest first, at most `most`.
pub(super) fn nearest(known: &[Vec<i32>], target: &[i32], most: usize) -> Vec<usize> {
    let stride = (target.len() / 500).max(1);
    let distance = |case: &[i32]| -> f64 {
        let pairs = case.iter().zip(target).step_by(stride);
        pairs.map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum()
    };
    let mut order: Vec<(f64, usize)> =
        known.iter().enumerate().map(|(i, case)| (distance(case), i)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    order.into_iter().take(most).map(|(_, i)| i).collect()
}

/// Least-squares weights of the basis, by elimination of the damped normal equations. Inexact weights affect the size of the file, not its
/// accuracy.
pub(super) fn weights(known: &[Vec<i32>], basis: &[usize], target: &[i32]) -> Vec<f64> {
    let n = basis.len();
    let dot = |a: &[i32], b: &[i32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    let mut rows: Vec<Vec<f64>> = basis
        .iter()
        .map(|i| {
            let mut row: Vec<f64> = basis.iter().map(|j| dot(&known[*i], &known[*j])).collect();
            row.push(dot(&known[*i], target));
            row
        })
        .collect();
    for (k, row) in rows.iter_mut().enumerate() {
        row[k] += 1e-12 * row[k] + 1.0;
    }
    for k in 0..n {
        let (above, below) = rows.split_at_mut(k + 1);
        let pivot = &above[k];
        for row in below {
            let factor = row[k] / pivot[k];
            for (value, p) in row[k..].iter_mut().zip(&pivot[k..]) {
                *value -= factor * p;
            }
        }
    }
    let mut weights = vec![0.0; n];
    for k in (0..n).rev() {
        let rest: f64 = (k + 1..n).map(|j| rows[k][j] * weights[j]).sum();
        weights[k] = (rows[k][n] - rest) / rows[k][k];
    }
    if weights.iter().all(|w| w.is_finite()) { weights } else { vec![0.0; n] }
}

/// Prediction in integer steps.
pub(super) fn predict(known: &[Vec<i32>], basis: &[usize], weights: &[f64], nodes: usize) -> Vec<i32> {
    let mut sum = vec![0.0_f64; nodes];
    for (case, weight) in basis.iter().zip(weights) {
        for (s, k) in sum.iter_mut().zip(&known[*case]) {
            *s += weight * f64::from(*k);
        }
    }
    sum.into_iter().map(|s| s.round() as i32).collect()
}
