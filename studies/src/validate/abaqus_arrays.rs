//! Reads a mesh from a folder of .npy arrays, the layout the commercial solver's mesh was recovered in.

use std::path::{Path, PathBuf};

use formats::mesh_file::{Tet10, Tri6};
use formats::{FormatError, npy};
use thiserror::Error;

use fem::{Mesh, Slot};

/// Why a folder of arrays is not a mesh.
#[derive(Debug, Error)]
pub enum ArrayError {
    /// A file cannot be read as .npy.
    #[error(transparent)]
    Read(#[from] FormatError),
    /// An array has another shape or other values than its name requires.
    #[error("{path}: found {found}, expected {expected}")]
    Layout {
        /// The file.
        path: PathBuf,
        /// Shape or value found.
        found: String,
        /// Shape or value expected.
        expected: String,
    },
}

/// Reads an n x `columns` array, row by row.
fn rows(folder: &Path, name: &str, columns: usize) -> Result<Vec<f64>, ArrayError> {
    let path = folder.join(name);
    let array = npy::read_f64(&path)?;
    if array.shape.len() != 2 || array.shape[1] != columns {
        let (found, expected) = (format!("shape {:?}", array.shape), format!("n x {columns}"));
        return Err(ArrayError::Layout { path, found, expected });
    }
    Ok(array.data)
}

/// An integer from 0 to below `count`.
fn index(value: f64, count: usize) -> Option<u32> {
    let whole = value.fract() == 0.0 && value >= 0.0 && value < count as f64;
    whole.then_some(value as u32)
}

/// Reads node lists of `N` columns and checks them against the number of nodes.
fn lists<const N: usize>(folder: &Path, name: &str, nodes: usize) -> Result<Vec<[u32; N]>, ArrayError> {
    let flat = rows(folder, name, N)?;
    flat.chunks_exact(N)
        .enumerate()
        .map(|(row, list)| {
            let mut out = [0; N];
            for (out, v) in out.iter_mut().zip(list) {
                *out = index(*v, nodes).ok_or_else(|| ArrayError::Layout {
                    path: folder.join(name),
                    found: format!("node {v} in row {row}"),
                    expected: format!("0 to {}", nodes - 1),
                })?;
            }
            Ok(out)
        })
        .collect()
}

/// Walls with their slot number in the first column.
fn walls(folder: &Path, name: &str, nodes: usize) -> Result<Vec<Vec<Tri6>>, ArrayError> {
    let mut slots: Vec<Vec<Tri6>> = Vec::new();
    for [slot, a, b, c, d, e, f] in lists::<7>(folder, name, nodes)? {
        let slot = slot as usize;
        if slots.len() <= slot {
            slots.resize(slot + 1, Vec::new());
        }
        slots[slot].push([a, b, c, d, e, f]);
    }
    Ok(slots)
}

/// Reads `nodes`, `tets`, `paper`, `cavity`, `fixed`, `bottom`, `slot_walls_a`, `slot_walls_b` and `mises_owner`.
///
/// # Errors
/// [`ArrayError`] names the file and its error.
pub fn read(folder: &Path) -> Result<Mesh, ArrayError> {
    let flat = rows(folder, "nodes.npy", 3)?;
    let nodes_mm: Vec<[f64; 3]> = flat.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
    let n = nodes_mm.len();
    let tets: Vec<Tet10> = lists(folder, "tets.npy", n)?;
    let fixed: Vec<Tri6> = lists(folder, "fixed.npy", n)?;
    let mut fixed_nodes: Vec<u32> = fixed.into_iter().flatten().collect();
    fixed_nodes.sort_unstable();
    fixed_nodes.dedup();
    let (lower, upper) = (walls(folder, "slot_walls_a.npy", n)?, walls(folder, "slot_walls_b.npy", n)?);
    let slots = lower.into_iter().zip(upper).map(|(lower, upper)| Slot { lower, upper }).collect();
    let owners = rows(folder, "mises_owner.npy", 2)?;
    // -1 marks a node without an owner: on the sheet.
    let owner = |pair: &[f64]| Some((index(pair[0], tets.len())?, u8::try_from(index(pair[1], 10)?).ok()?));
    let mises_owner = Some(owners.chunks_exact(2).map(owner).collect());
    Ok(Mesh {
        films: Vec::new(),
        cavities: Vec::new(),
        nodes_mm,
        tets,
        tet_material: Vec::new(),
        sheet: lists(folder, "paper.npy", n)?,
        cavity: lists(folder, "cavity.npy", n)?,
        fixed_nodes,
        bottom: lists(folder, "bottom.npy", n)?,
        slots,
        mises_owner,
    })
}
