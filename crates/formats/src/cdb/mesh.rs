//! What an archive holds.

use crate::cells::{Block, Kind};
use crate::error::Diagnostic;
use crate::mesh_file::MeshFile;

/// The mesh of an archive. Indices are 0-based positions in `points`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CdbMesh {
    /// Node positions in the file's unit of length.
    pub points: Vec<[f64; 3]>,
    /// The file's node numbers.
    pub labels: Vec<u64>,
    /// Solids and shells, a block a kind; node order is VTK's.
    pub blocks: Vec<Block>,
}

impl CdbMesh {
    /// The body alone; shells have no volume and are passed over.
    ///
    /// # Errors
    /// A mesh that holds other solids than 10-node tetrahedra, or none of them.
    pub fn tetrahedra(self) -> Result<MeshFile, Diagnostic> {
        let is_solid = |block: &&Block| Kind::of(block.kind.into()).is_some_and(|kind| kind.is_solid);
        let solids: Vec<&Block> = self.blocks.iter().filter(is_solid).collect();
        let [Block { kind: 24, nodes, .. }] = solids.as_slice() else {
            let count =
                |block: &&Block| format!("{} elements of {} nodes", block.count(), block.nodes_per_cell);
            let found = solids.iter().map(count).collect::<Vec<_>>().join(", ");
            return Err(Diagnostic::new("elements", "10-node tetrahedra only (SOLID187)", found));
        };
        let tets = nodes.as_chunks::<10>().0.to_vec();
        Ok(MeshFile { tets, points_mm: self.points, ..MeshFile::default() })
    }
}
