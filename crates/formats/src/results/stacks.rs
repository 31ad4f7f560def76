//! NumPy arrays in a folder or in one `.npz`: `points.npy` (nodes x 3), an array per kind of cell by meshio's name (`tetra10.npy`),
//! quantities by name (`displacement.npy`), steps x nodes or steps x nodes x components, and optionally `time.npy`.

use super::run::{NodalQuantity, Run, Step, counted};
use crate::cells::{Block, KINDS};
use crate::error::{Diagnostic, FormatError};
use crate::file;
use crate::npy::{self, Array};
use std::collections::BTreeMap;
use std::io::{Cursor, Read, Seek};
use std::path::Path;
use zip::ZipArchive;

type Arrays = BTreeMap<String, Array<f64>>;

/// Reads a folder.
pub(super) fn read(dir: &Path) -> Result<Run, FormatError> {
    let entries = std::fs::read_dir(dir).map_err(|error| FormatError::read(dir, error))?;
    let mut arrays = Arrays::new();
    for entry in entries.flatten() {
        if let Some(name) = entry.file_name().to_string_lossy().strip_suffix(".npy") {
            arrays.insert(name.to_owned(), npy::read_f64(&entry.path())?);
        }
    }
    assemble(dir, arrays)
}

/// Reads a `.npz`, compressed or not.
pub(super) fn read_archive(path: &Path) -> Result<Run, FormatError> {
    let (file, _) = file::open(path, file::MAX_DATA_BYTES)?;
    from_archive(file, path)
}

/// Reads a `.npz` in memory.
///
/// # Errors
/// As [`super::read`]; messages call it `bytes.npz`.
pub fn parse_archive(bytes: &[u8]) -> Result<Run, FormatError> {
    from_archive(Cursor::new(bytes), Path::new("bytes.npz"))
}

/// Reads a `.npz` of fields alone, for a mesh of `nodes` nodes from another file, in the order of its nodes.
pub(super) fn read_fields(path: &Path, nodes: usize) -> Result<Vec<Step>, FormatError> {
    let (file, _) = file::open(path, file::MAX_DATA_BYTES)?;
    let mut arrays = arrays_of(file, path)?;
    let times = times_of(&mut arrays);
    let known = arrays.into_iter().map(|(name, array)| quantity(path, name, array, nodes));
    steps_of(path, known.collect::<Result<_, _>>()?, nodes, &times)
}

fn from_archive(file: impl Read + Seek, path: &Path) -> Result<Run, FormatError> {
    assemble(path, arrays_of(file, path)?)
}

fn arrays_of(file: impl Read + Seek, path: &Path) -> Result<Arrays, FormatError> {
    let damaged = |place: &str, error: &dyn std::fmt::Display| {
        FormatError::one(path, Diagnostic::new(place, "an archive that numpy.savez wrote", error))
    };
    let mut archive = ZipArchive::new(file).map_err(|error| damaged("archive", &error))?;
    let mut arrays = Arrays::new();
    for at in 0..archive.len() {
        let entry = archive.by_index(at).map_err(|error| damaged(&format!("entry {}", at + 1), &error))?;
        let name = entry.name().map_err(|error| damaged(&format!("entry {}", at + 1), &error))?.into_owned();
        let Some(name) = name.strip_suffix(".npy").map(str::to_owned) else { continue };
        // The size that the archive announces is not relied on: memory grows with what is really there.
        let mut bytes = Vec::new();
        let read = entry.take(file::MAX_DATA_BYTES).read_to_end(&mut bytes);
        read.map_err(|error| damaged(&format!("{name}.npy"), &error))?;
        arrays.insert(name.clone(), npy::parse_f64(&bytes, &path.join(format!("{name}.npy")))?);
    }
    Ok(arrays)
}

fn times_of(arrays: &mut Arrays) -> Vec<f64> {
    arrays.remove("time").map_or_else(Vec::new, |times| times.data)
}

/// Name, steps, components and values of an array of a quantity.
type Stack = (String, usize, usize, Vec<f64>);

fn quantity(dir: &Path, name: String, array: Array<f64>, nodes: usize) -> Result<Stack, FormatError> {
    match array.shape[..] {
        [steps, found] if found == nodes => Ok((name, steps, 1, array.data)),
        [steps, found, components] if found == nodes && components > 0 => {
            Ok((name, steps, components, array.data))
        }
        _ => {
            let path = dir.join(format!("{name}.npy"));
            Err(shape(&path, &format!("steps x {nodes} nodes (x components)"), &array.shape))
        }
    }
}

fn assemble(dir: &Path, mut arrays: Arrays) -> Result<Run, FormatError> {
    let path = dir.join("points.npy");
    let found = arrays.keys().map(|name| format!("{name}.npy")).collect::<Vec<_>>().join(", ");
    let points = arrays.remove("points").ok_or_else(|| {
        FormatError::one(dir, Diagnostic::new("arrays", "points.npy (nodes x 3) among them", found))
    })?;
    let [nodes, 3] = points.shape[..] else { return Err(shape(&path, "nodes x 3", &points.shape)) };
    let points: Vec<[f64; 3]> = points.data.as_chunks::<3>().0.to_vec();
    let mut run = Run { points, ..Run::default() };
    let times = times_of(&mut arrays);
    let mut quantities = Vec::new();
    for (name, array) in arrays {
        let path = dir.join(format!("{name}.npy"));
        if let Some(kind) = KINDS.iter().find(|kind| kind.meshio == name) {
            let fits = matches!(array.shape[..], [_, count] if count == kind.nodes);
            if !fits || array.data.iter().any(|node| !(*node >= 0.0 && *node < nodes as f64)) {
                let expected = format!("cells x {}, nodes 0 .. {nodes}", kind.nodes);
                return Err(shape(&path, &expected, &array.shape));
            }
            let nodes = array.data.iter().map(|node| *node as u32).collect();
            run.blocks.push(Block { kind: kind.number, nodes_per_cell: kind.nodes, nodes });
            continue;
        }
        quantities.push(quantity(dir, name, array, nodes)?);
    }
    run.steps = steps_of(dir, quantities, nodes, &times)?;
    Ok(run)
}

fn steps_of(
    dir: &Path,
    quantities: Vec<Stack>,
    nodes: usize,
    times: &[f64],
) -> Result<Vec<Step>, FormatError> {
    let steps = quantities.first().map_or(0, |first| first.1);
    if let Some((name, found, ..)) = quantities.iter().find(|quantity| quantity.1 != steps) {
        let expected = format!("{steps} steps as in {}.npy", quantities[0].0);
        return Err(FormatError::one(dir, Diagnostic::new(format!("{name}.npy"), expected, found)));
    }
    let step = |step: usize| Step {
        name: format!("step {}", step + 1),
        time: times.get(step).copied(),
        quantities: quantities
            .iter()
            .map(|(name, _, components, data)| NodalQuantity {
                name: name.clone(),
                components: counted(*components),
                values: data[step * nodes * components..][..nodes * components].to_vec(),
            })
            .collect(),
    };
    Ok((0..steps).map(step).collect())
}

fn shape(path: &Path, expected: &str, found: &[usize]) -> FormatError {
    FormatError::one(path, Diagnostic::new("shape", expected, format!("{found:?}")))
}
