//! XDMF as meshio, FEniCS and ParaView write it: a uniform grid, or temporal collections of such grids.
//!
//! A collection is a series of states. FEniCS writes one for every function: those of the same times are one series. The
//! mesh stands in every grid, is referred to (`xi:include`, `Reference`), or is a grid of its own beside the collections.

mod items;
mod topology;
mod tree;

use super::run::{Quantity, Run, Step, UNORDERED, counted};
use crate::cells::Block;
use crate::error::{Diagnostic, FormatError};
use crate::file;
use items::{Array, Items};
use std::path::Path;
use tree::Tree;

/// Points and cells, and the elements that they were read from.
struct Mesh {
    from: (u32, u32),
    points: Vec<[f64; 3]>,
    blocks: Vec<Block>,
}

/// Reads a file and those that it names.
pub(super) fn read(path: &Path) -> Result<Run, FormatError> {
    let text = file::read_text(path, file::MAX_DATA_BYTES)?;
    parse(&text, path)
}

/// [`super::read`] of the text of an `.xdmf`; files that it names are found from `path`.
///
/// # Errors
/// As [`super::read`].
pub fn parse(text: &str, path: &Path) -> Result<Run, FormatError> {
    let tree = Tree::parse(text).map_err(|diagnostic| FormatError::one(path, diagnostic))?;
    let items = Items::new(&tree, path, text.len());
    Reader { tree: &tree, path, items, mesh: None, run: Run::default() }.read()
}

struct Reader<'a> {
    tree: &'a Tree<'a>,
    path: &'a Path,
    items: Items<'a>,
    mesh: Option<Mesh>,
    run: Run,
}

impl Reader<'_> {
    fn wrong(&self, place: &str, expected: &str, found: impl std::fmt::Display) -> FormatError {
        FormatError::one(self.path, Diagnostic::new(place, expected, found))
    }

    fn read(mut self) -> Result<Run, FormatError> {
        let root = self.tree.children(0)[0];
        let grids: Vec<u32> =
            self.tree.named(root, "Domain").flat_map(|domain| self.tree.named(domain, "Grid")).collect();
        let (series, single): (Vec<u32>, Vec<u32>) =
            grids.iter().partition(|grid| self.is_collection(**grid));
        match (series.as_slice(), single.as_slice()) {
            ([], [grid]) => self.step(*grid, 0, true, None)?,
            ([], []) => return Err(self.wrong("Domain", "a Grid", "none")),
            ([], _) => {
                let expected = "one Grid, or a temporal collection (in ParaView: Merge Blocks, save again)";
                return Err(self.wrong("Domain", expected, format!("{} grids", single.len())));
            }
            // Grids beside the collections are the mesh that they refer to.
            _ => {
                for (nth, collection) in series.iter().enumerate() {
                    self.collection(*collection, nth == 0)?;
                }
            }
        }
        if let Some(mesh) = self.mesh {
            (self.run.points, self.run.blocks) = (mesh.points, mesh.blocks);
        }
        Ok(self.run)
    }

    fn is_collection(&self, grid: u32) -> bool {
        let kind = self.tree.attribute(grid, "GridType");
        kind.is_some_and(|kind| !kind.eq_ignore_ascii_case("uniform"))
    }

    /// A series of states, or further quantities of the states that there are.
    fn collection(&mut self, collection: u32, is_first: bool) -> Result<(), FormatError> {
        let place = self.tree.place(collection);
        let kind = ["GridType", "CollectionType"]
            .map(|name| self.tree.attribute(collection, name).unwrap_or_default());
        if !kind[1].eq_ignore_ascii_case("temporal") {
            let expected = "a uniform grid or a temporal collection (in ParaView: Merge Blocks, save again)";
            return Err(self.wrong(&place, expected, kind.join(" ")));
        }
        let times = self.times(collection)?;
        let grids: Vec<u32> = self.tree.named(collection, "Grid").collect();
        if !is_first && grids.len() != self.run.steps.len() {
            let expected = format!("{} grids, as in the first collection", self.run.steps.len());
            return Err(self.wrong(&place, &expected, grids.len()));
        }
        for (nth, grid) in grids.into_iter().enumerate() {
            if self.is_collection(grid) {
                let found = format!("{} within it", self.tree.place(grid));
                return Err(self.wrong(
                    &place,
                    "uniform grids (in ParaView: Merge Blocks, save again)",
                    found,
                ));
            }
            self.step(grid, nth, is_first, times.get(nth).copied())?;
        }
        Ok(())
    }

    /// Times that a collection lists.
    fn times(&mut self, collection: u32) -> Result<Vec<f64>, FormatError> {
        let Some(time) = self.tree.named(collection, "Time").next() else { return Ok(Vec::new()) };
        let kind = self.tree.attribute(time, "TimeType").unwrap_or_default().to_lowercase();
        let values = self.items.of(time)?.values;
        let count = self.tree.named(collection, "Grid").count();
        match (kind.as_str(), &values[..]) {
            ("list", _) => Ok(values),
            ("hyperslab", [first, step, _]) => Ok((0..count).map(|n| first + n as f64 * step).collect()),
            _ => Err(self.wrong("Time", "TimeType List or HyperSlab", format!("`{kind}`"))),
        }
    }

    /// One grid: its mesh, its time, its quantities.
    fn step(&mut self, grid: u32, nth: usize, is_new: bool, listed: Option<f64>) -> Result<(), FormatError> {
        let name = format!("step {}", nth + 1);
        let nodes = self.mesh(grid, &name)?;
        let time = self.tree.named(grid, "Time").next().and_then(|time| self.tree.attribute(time, "Value"));
        let time = match time.map(|text| text.parse::<f64>().map_err(|_| text)) {
            Some(Ok(time)) if time.is_finite() => Some(time),
            Some(Ok(_)) => return Err(self.wrong(&name, "a finite Time", "another")),
            Some(Err(text)) => return Err(self.wrong(&name, "a Time as a number", format!("`{text}`"))),
            None => listed,
        };
        if is_new {
            self.run.steps.push(Step { name: name.clone(), time, quantities: Vec::new() });
        } else if self.run.steps[nth].time != time {
            let expected = format!("the time of the first collection, {:?}", self.run.steps[nth].time);
            return Err(self.wrong(
                &format!("{}, {name}", self.tree.place(grid)),
                &expected,
                format!("{time:?}"),
            ));
        }
        for attribute in self.tree.named(grid, "Attribute") {
            if let Some(quantity) = self.quantity(attribute, &name, nodes)? {
                self.run.steps[nth].quantities.push(quantity);
            }
        }
        Ok(())
    }

    /// A quantity at the nodes; others are passed over.
    fn quantity(
        &mut self,
        attribute: u32,
        step: &str,
        nodes: usize,
    ) -> Result<Option<Quantity>, FormatError> {
        let place = format!("{step}, {}", self.tree.place(attribute));
        if self.tree.attribute(attribute, "ItemType").as_deref() == Some("FiniteElementFunction") {
            let expected = "values at nodes (in FEniCS: write(u, t) in place of write_checkpoint)";
            return Err(self.wrong(&place, expected, "a FiniteElementFunction"));
        }
        if self.tree.attribute(attribute, "Center").is_some_and(|centre| !centre.eq_ignore_ascii_case("node"))
        {
            return Ok(None);
        }
        let Array { shape, values } = self.items.of(attribute)?;
        if nodes == 0 || values.is_empty() || !values.len().is_multiple_of(nodes) {
            return Err(self.wrong(
                &place,
                &format!("values at {nodes} nodes"),
                format!("Dimensions {shape:?}"),
            ));
        }
        let count = values.len() / nodes;
        let kind = self.tree.attribute(attribute, "AttributeType").unwrap_or_default();
        let components = match count {
            6 if kind.eq_ignore_ascii_case("tensor6") => UNORDERED.map(str::to_owned).to_vec(),
            _ => counted(count),
        };
        let name = self.tree.attribute(attribute, "Name").unwrap_or_default();
        Ok(Some(Quantity { name, components, values }))
    }

    /// Reads the mesh of a grid, which must be that of the first one; answers its number of nodes.
    fn mesh(&mut self, grid: u32, step: &str) -> Result<usize, FormatError> {
        let mut parts = self.tree.children(grid).to_vec();
        for include in self.tree.named(grid, "include") {
            let pointer = self.tree.attribute(include, "xpointer").unwrap_or_default();
            parts.extend(
                self.tree.find(&pointer).map_err(|diagnostic| FormatError::one(self.path, diagnostic))?,
            );
        }
        let part = |name: &str| parts.iter().copied().find(|part| self.tree.name(*part) == name.as_bytes());
        let (Some(topology), Some(geometry)) = (part("Topology"), part("Geometry")) else {
            return Err(self.wrong(step, "a grid with Topology and Geometry", self.tree.place(grid)));
        };
        if let Some(mesh) = self.mesh.as_ref().filter(|mesh| mesh.from == (topology, geometry)) {
            return Ok(mesh.points.len());
        }
        let found = self.read_mesh(topology, geometry)?;
        let nodes = found.points.len();
        match &self.mesh {
            Some(first) if first.points != found.points || first.blocks != found.blocks => {
                let expected = "the undeformed mesh of the first grid, with the displacement as an Attribute";
                Err(self.wrong(step, expected, "another mesh"))
            }
            _ => {
                self.mesh = Some(found);
                Ok(nodes)
            }
        }
    }

    fn read_mesh(&mut self, topology: u32, geometry: u32) -> Result<Mesh, FormatError> {
        // An element may stand for another one, with the attributes of that.
        let meant = |at: u32| {
            let referred =
                self.tree.referred(at).map_err(|diagnostic| FormatError::one(self.path, diagnostic))?;
            Ok::<_, FormatError>(referred.unwrap_or(at))
        };
        let from = (topology, geometry);
        let (topology, geometry) = (meant(topology)?, meant(geometry)?);
        let kind = |at: u32, long: &str| {
            let name = self.tree.attribute(at, long).or_else(|| self.tree.attribute(at, "Type"));
            name.unwrap_or_default()
        };
        let (form, name) = (kind(geometry, "GeometryType"), kind(topology, "TopologyType"));
        let dimensions = match form.to_uppercase().as_str() {
            "" | "XYZ" => 3,
            "XY" => 2,
            _ => return Err(self.wrong("Geometry", "GeometryType XYZ or XY", format!("`{form}`"))),
        };
        let coordinates = self.items.of(geometry)?.values;
        if !coordinates.len().is_multiple_of(dimensions) || coordinates.iter().any(|value| !value.is_finite())
        {
            let found = format!("{} numbers, or some that are not finite", coordinates.len());
            return Err(self.wrong("Geometry", &format!("{dimensions} finite numbers a node"), found));
        }
        let point = |values: &[f64]| [values[0], values[1], values.get(2).copied().unwrap_or(0.0)];
        let points: Vec<[f64; 3]> = coordinates.chunks_exact(dimensions).map(point).collect();
        let base =
            self.tree.attribute(topology, "BaseOffset").and_then(|text| text.parse().ok()).unwrap_or(0.0);
        let numbers = self.items.of(topology)?.values;
        let blocks = topology::blocks(&name, &numbers, base, points.len())
            .map_err(|diagnostic| FormatError::one(self.path, diagnostic))?;
        Ok(Mesh { from, points, blocks })
    }
}
