//! A folder of NumPy arrays: `points.npy` (nodes x 3), one array of cells for each kind by meshio's name (`tetra10.npy`), and
//! quantities by name (`displacement.npy`), steps x nodes or steps x nodes x components. `time.npy` may give the times.

use super::run::{Quantity, Run, Step, counted};
use crate::cells::{Block, KINDS};
use crate::error::{Diagnostic, FormatError};
use crate::npy;
use std::path::Path;

/// Reads a folder.
pub(super) fn read(dir: &Path) -> Result<Run, FormatError> {
    let path = dir.join("points.npy");
    let points = npy::read_f64(&path)?;
    let [nodes, 3] = points.shape[..] else { return Err(shape(&path, "nodes x 3", &points.shape)) };
    let points: Vec<[f64; 3]> = points.data.as_chunks::<3>().0.to_vec();
    let mut run = Run { points, ..Run::default() };
    let mut names: Vec<String> = std::fs::read_dir(dir)
        .map_err(|error| FormatError::read(dir, error))?
        .flatten()
        .filter_map(|entry| entry.file_name().to_string_lossy().strip_suffix(".npy").map(str::to_owned))
        .filter(|name| name != "points" && name != "time")
        .collect();
    names.sort();
    let mut quantities = Vec::new();
    for name in names {
        let path = dir.join(format!("{name}.npy"));
        let array = npy::read_f64(&path)?;
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
        let (steps, components) = match array.shape[..] {
            [steps, found] if found == nodes => (steps, 1),
            [steps, found, components] if found == nodes && components > 0 => (steps, components),
            _ => return Err(shape(&path, &format!("steps x {nodes} nodes (x components)"), &array.shape)),
        };
        quantities.push((name, steps, components, array.data));
    }
    let steps = quantities.first().map_or(0, |first| first.1);
    if let Some((name, found, ..)) = quantities.iter().find(|quantity| quantity.1 != steps) {
        let expected = format!("{steps} steps as in {}.npy", quantities[0].0);
        return Err(FormatError::one(dir, Diagnostic::new(format!("{name}.npy"), expected, found)));
    }
    let times = dir.join("time.npy");
    let times = if times.is_file() { npy::read_f64(&times)?.data } else { Vec::new() };
    run.steps = (0..steps)
        .map(|step| Step {
            name: format!("step {}", step + 1),
            time: times.get(step).copied(),
            quantities: quantities
                .iter()
                .map(|(name, _, components, data)| Quantity {
                    name: name.clone(),
                    components: counted(*components),
                    values: data[step * nodes * components..][..nodes * components].to_vec(),
                })
                .collect(),
        })
        .collect();
    Ok(run)
}

fn shape(path: &Path, expected: &str, found: &[usize]) -> FormatError {
    FormatError::one(path, Diagnostic::new("shape", expected, format!("{found:?}")))
}
