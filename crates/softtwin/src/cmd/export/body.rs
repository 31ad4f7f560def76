//! Nodes, undeformed shape and cells, the same for all states of an export.

use crate::failure::configuration;
use crate::files::refusal;
use anyhow::Result;
use formats::export::Series;
use formats::vtu::Cells;
use rom::model::Model;
use rom::snapshots::{Database, FieldSpec};
use std::path::Path;

/// A body without its states.
pub struct Body {
    pub nodes: usize,
    undeformed: Option<[Vec<f32>; 3]>,
    facets: Vec<[u32; 3]>,
    tets: Vec<[u32; 10]>,
}

impl Body {
    /// The body of a model.
    pub fn of_model(model: &Model) -> Self {
        Self {
            nodes: model.header.node_count,
            undeformed: model.undeformed_mm().map(|axes| axes.map(<[f32]>::to_vec)),
            facets: model.facets().to_vec(),
            tets: Vec::new(),
        }
    }

    /// The body of a database.
    pub fn of_database(database: &Database) -> Self {
        let axis = |points: &[[f64; 3]], k: usize| points.iter().map(|p| p[k] as f32).collect();
        Self {
            nodes: database.node_count,
            undeformed: database.undeformed_mm.as_ref().map(|points| [0, 1, 2].map(|k| axis(points, k))),
            facets: database.surface_triangles.clone(),
            tets: Vec::new(),
        }
    }

    /// Nodes of which nothing else is known.
    pub fn of_points(nodes: usize) -> Self {
        Self { nodes, undeformed: None, facets: Vec::new(), tets: Vec::new() }
    }

    /// The same with the cells of a mesh file.
    ///
    /// # Errors
    /// A file that cannot be read, or has another number of nodes.
    pub fn with_mesh(mut self, path: Option<&Path>) -> Result<Self> {
        let Some(path) = path else { return Ok(self) };
        let mesh = formats::read_mesh(path).map_err(refusal)?;
        let (expected, found) = (self.nodes, mesh.points_mm.len());
        if found != expected {
            return Err(configuration(anyhow::anyhow!(
                "--mesh: expected {expected} nodes as in the states, found {found}"
            )));
        }
        self.undeformed = Some([0, 1, 2].map(|k| mesh.points_mm.iter().map(|p| p[k] as f32).collect()));
        self.tets = mesh.tets;
        Ok(self)
    }

    /// The description of a series of `count` states.
    pub fn series<'a>(&'a self, fields: &'a [FieldSpec], count: usize) -> Series<'a> {
        let cells = match self.tets.as_slice() {
            [] => Cells::Triangles(&self.facets),
            tets => Cells::QuadraticTets(tets),
        };
        let undeformed = self.undeformed.as_ref().map(|[x, y, z]| [x.as_slice(), y, z]);
        Series { fields, nodes: self.nodes, cells, undeformed, count }
    }
}
