//! Puts the parts of a database together.

use super::mesh;
use super::words::ObstacleKind;
use crate::error::FormatError;
use rom::inputs::Parameter;
use rom::snapshots::{Case, Database, FieldSpec, Sensitivities};
use std::path::Path;

/// What the reader of a layout found.
pub(crate) struct Parts {
    pub(crate) actuator: String,
    pub(crate) fields: Vec<FieldSpec>,
    pub(crate) node_count: usize,
    pub(crate) cases: Vec<Case>,
    /// Inputs beside pressure and gap.
    pub(crate) parameters: Vec<Parameter>,
    /// `cases x nodes x fields`.
    pub(crate) snapshots: Vec<f32>,
    /// Empty where no parameter moves the mesh.
    pub(crate) undeformed_by: Vec<Vec<[f32; 3]>>,
    pub(crate) sensitivities: Option<Sensitivities>,
}

impl Parts {
    /// The database with its mesh, where there is one, and its hash.
    ///
    /// # Errors
    /// A mesh that cannot be read or has another number of nodes.
    pub(crate) fn assemble(
        self,
        mesh: Option<&Path>,
        obstacle: ObstacleKind,
    ) -> Result<Database, FormatError> {
        let body = mesh.map(|path| mesh::read(path, self.node_count)).transpose()?;
        let has_mesh = body.is_some();
        let body = body.unwrap_or_default();
        let mut database = Database {
            actuator: self.actuator,
            fields: self.fields,
            node_count: self.node_count,
            cases: self.cases,
            snapshots: self.snapshots,
            undeformed_mm: has_mesh.then_some(body.points_mm),
            undeformed_by: self.undeformed_by,
            surface_triangles: body.triangles,
            node_sets: body.node_sets,
            obstacle: obstacle.footprint(),
            parameters: self.parameters,
            sensitivities: self.sensitivities,
            hash: [0; 32],
        };
        database.hash = database.content_hash();
        Ok(database)
    }
}
