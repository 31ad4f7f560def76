//! Database from finished simulations: units, fields by name, nodes with cells.

use super::run::{NodalQuantity, Run, Step, same_or_new};
use crate::cells::{self, Block};
use crate::error::{Diagnostic, FormatError};
use rom::inputs::Parameter;
use rom::snapshots::{Case, Database, FieldKind, FieldSpec, Footprint};
use std::path::Path;

/// Usual names of the displacement, lower case.
const DISPLACEMENT: [&str; 4] = ["disp", "u", "displacement", "displacements"];
/// Usual names of the stress tensor and of its equivalent value, lower case.
const STRESS: [&str; 8] =
    ["stress", "s", "von_mises", "mises", "vonmises", "s_mises", "von mises stress", "seqv"];
/// Numbers of components of a displacement.
const VECTOR: [usize; 1] = [3];
/// Numbers of components of a stress: equivalent value, symmetric tensor, full tensor.
const STRESS_SIZES: [usize; 3] = [1, 6, 9];
/// Distance of nodes up to which two meshes are equal, as a fraction of their size.
const SAME_SHARE: f64 = 1e-6;

/// Quantities taken from the files, and their units.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// Millimetres in the files' unit of length.
    pub length_mm: f64,
    /// MPa in the files' unit of stress; required if there is a stress.
    pub stress_mpa: Option<f64>,
    /// Name of the displacement; default: the usual names.
    pub displacement: Option<String>,
    /// Name of the stress, a tensor or the von Mises stress; default: the usual names.
    pub stress: Option<String>,
    /// Further fields: `NAME` of a scalar or `NAME.COMPONENT`, with their unit.
    pub fields: Vec<(String, String)>,
}

/// Quantities of a step that are fields.
#[derive(Clone, Debug)]
struct Chosen {
    displacement: String,
    stress: Option<String>,
    /// Quantity, component and unit of the further fields.
    further: Vec<(String, usize, FieldSpec)>,
}

/// Database to which states are added.
#[derive(Debug)]
pub struct Assembly {
    wanted: Wanted,
    chosen: Option<Chosen>,
    /// Positions in the files of the nodes with cells and values.
    used: Vec<u32>,
    points_mm: Vec<[f64; 3]>,
    /// Cells of the files.
    blocks: Vec<Block>,
    /// Cells of the nodes in use.
    kept: Vec<Block>,
    /// Parts without a value.
    left_out: Vec<String>,
    all_nodes: usize,
    shape_varies: bool,
    cases: Vec<Case>,
    snapshots: Vec<f32>,
}

impl Assembly {
    /// Creates an empty database.
    pub fn new(wanted: Wanted) -> Self {
        Self {
            wanted,
            chosen: None,
            used: Vec::new(),
            points_mm: Vec::new(),
            blocks: Vec::new(),
            kept: Vec::new(),
            left_out: Vec::new(),
            all_nodes: 0,
            shape_varies: false,
            cases: Vec::new(),
            snapshots: Vec::new(),
        }
    }

    /// Number of nodes of a state.
    pub fn nodes(&self) -> usize {
        self.used.len()
    }

    /// Parts of the mesh that no state has all values of.
    pub fn parts_left_out(&self) -> &[String] {
        &self.left_out
    }

    /// True if the undeformed nodes differ between simulations: a length is an input.
    pub fn shape_varies(&self) -> bool {
        self.shape_varies
    }

    /// Adds a state. Returns the reason if it is left out: quantities or values that are missing or not finite. Parts of the mesh
    /// that have no value at all in the first state are left out of all.
    ///
    /// # Errors
    /// A mesh that differs from the first simulation's, a quantity with other components, a stress without a unit.
    pub fn add(
        &mut self,
        path: &Path,
        run: &Run,
        step: &Step,
        case: Case,
    ) -> Result<Option<String>, FormatError> {
        let wrong = |diagnostic| FormatError::one(path, diagnostic);
        let chosen = match self.chosen.clone() {
            Some(chosen) => chosen,
            None => match choose(&self.wanted, step).map_err(wrong)? {
                Ok(chosen) => chosen,
                Err(missing) => return Ok(Some(missing.to_string())),
            },
        };
        let sources = match sources(step, &chosen) {
            Ok(sources) => sources,
            Err(missing) => return Ok(Some(missing.to_string())),
        };
        if self.chosen.is_none() {
            self.first(run, &sources).map_err(wrong)?;
        }
        if run.points.len() != self.all_nodes || run.blocks != self.blocks {
            let expected = "the nodes and elements of the first simulation, moved where a length is an input (one mesh, \
                            morphed; a new mesh for every case cannot be compared node by node)";
            let found = format!("{} nodes, or other elements", run.points.len());
            return Err(wrong(Diagnostic::new("mesh", expected, found)));
        }
        let snapshot = self.snapshot(run, &sources).map_err(wrong)?;
        let bad = snapshot.iter().filter(|value| !value.is_finite()).count();
        if bad > 0 {
            return Ok(Some(format!("{}: {bad} values are missing or not finite", step.name)));
        }
        let moved = self.used.iter().zip(&self.points_mm).any(|(node, first_mm)| {
            let point = run.points[*node as usize];
            (0..3).any(|k| (point[k] * self.wanted.length_mm - first_mm[k]).abs() > self.tolerance_mm())
        });
        self.shape_varies |= moved;
        self.chosen = Some(chosen);
        self.snapshots.extend(snapshot);
        self.cases.push(case);
        Ok(None)
    }

    fn tolerance_mm(&self) -> f64 {
        let largest = self.points_mm.first().into_iter().flatten().fold(0.0_f64, |m, v| m.max(v.abs()));
        let last = self.points_mm.last().into_iter().flatten().fold(largest, |m, v| m.max(v.abs()));
        SAME_SHARE * last
    }

    /// Takes the mesh of the first simulation, without nodes that have no cell and without parts that have no values.
    fn first(&mut self, run: &Run, sources: &Sources<'_>) -> Result<(), Diagnostic> {
        let parts = parts(run.points.len(), &run.blocks);
        let lacks = |part: &Vec<u32>| {
            let mut nodes = part.iter().map(|node| sources.lacking(*node as usize));
            let first = nodes.next().flatten();
            first.filter(|_| nodes.all(|lacking| lacking.is_some()))
        };
        let lacking: Vec<Option<&str>> = parts.iter().map(lacks).collect();
        let some_have = lacking.iter().any(Option::is_none);
        let mut is_used = vec![false; run.points.len()];
        self.left_out.clear();
        for (part, lacking) in parts.iter().zip(lacking) {
            match lacking.filter(|_| some_have) {
                None => part.iter().for_each(|node| is_used[*node as usize] = true),
                Some(quantity) => {
                    let [x, y, z] = run.points[part[0] as usize];
                    let nodes = part.len();
                    self.left_out.push(format!(
                        "a part of {nodes} nodes, the first at {x}, {y}, {z}: no values of {quantity}"
                    ));
                }
            }
        }
        let is_kept = |cell: &&[u32]| cell.iter().all(|node| is_used[*node as usize]);
        let kept = |block: &Block| Block {
            nodes: block
                .nodes
                .chunks_exact(block.nodes_per_cell)
                .filter(is_kept)
                .flatten()
                .copied()
                .collect(),
            ..block.clone()
        };
        self.kept = run.blocks.iter().map(kept).filter(|block| !block.nodes.is_empty()).collect();
        self.used = (0..run.points.len() as u32).filter(|node| is_used[*node as usize]).collect();
        if self.used.is_empty() || cells::surface(&run.points, &self.kept).is_empty() {
            return Err(Diagnostic::new(
                "mesh",
                "elements with a surface (a measured table without a mesh becomes a model by `softtwin learn`)",
                "none",
            ));
        }
        let length = self.wanted.length_mm;
        self.points_mm =
            self.used.iter().map(|node| run.points[*node as usize].map(|v| v * length)).collect();
        (self.blocks, self.all_nodes) = (run.blocks.clone(), run.points.len());
        Ok(())
    }

    /// Snapshot of a step, `nodes x fields`.
    fn snapshot(&self, run: &Run, sources: &Sources<'_>) -> Result<Vec<f32>, Diagnostic> {
        let Sources { displacement, stress, further } = sources;
        let stress = stress.map(|quantity| Ok((quantity, self.stress_mpa(quantity)?))).transpose()?;
        let length = self.wanted.length_mm;
        let mut snapshot = Vec::with_capacity(self.used.len() * (4 + 1 + further.len()));
        for node in self.used.iter().map(|node| *node as usize) {
            let u = [0, 1, 2].map(|k| displacement.values[3 * node + k] * length);
            snapshot.extend([0, 1, 2].map(|k| (run.points[node][k] * length + u[k]) as f32));
            snapshot.push(u.iter().map(|v| v * v).sum::<f64>().sqrt() as f32);
            if let Some((quantity, mpa)) = stress {
                snapshot.push((mpa * equivalent(quantity, node)) as f32);
            }
            let value = |(quantity, k): &(&NodalQuantity, usize)| {
                quantity.values[node * quantity.components.len() + k]
            };
            snapshot.extend(further.iter().map(|field| value(field) as f32));
        }
        Ok(snapshot)
    }

    fn stress_mpa(&self, quantity: &NodalQuantity) -> Result<f64, Diagnostic> {
        let place = format!("quantity {}", quantity.name);
        self.wanted
            .stress_mpa
            .ok_or_else(|| Diagnostic::new(place, "its unit (--stress-unit mpa, pa, ...)", "none"))
    }

    /// Database, and the cells of its mesh (the first simulation's).
    ///
    /// # Errors
    /// No states.
    pub fn finish(
        self,
        actuator: String,
        parameters: Vec<Parameter>,
    ) -> Result<(Database, Vec<Block>), Diagnostic> {
        let Some(chosen) = self.chosen else {
            return Err(Diagnostic::new("results", "at least one state", "none"));
        };
        let mut fields = FieldSpec::of_the_paper();
        if self.shape_varies {
            // Not the distance from one undeformed mesh: a separate kind of field.
            fields[3].kind = FieldKind::Other;
        }
        fields.truncate(if chosen.stress.is_some() { 5 } else { 4 });
        fields.extend(chosen.further.into_iter().map(|further| further.2));
        let mut place = vec![0; self.all_nodes];
        self.used.iter().enumerate().for_each(|(new, old)| place[*old as usize] = new as u32);
        let renumbered = |block: &Block| Block {
            nodes: block.nodes.iter().map(|node| place[*node as usize]).collect(),
            ..block.clone()
        };
        let database = Database {
            actuator,
            fields,
            node_count: self.used.len(),
            cases: self.cases,
            snapshots: self.snapshots,
            undeformed_mm: Some(self.points_mm),
            undeformed_by: Vec::new(),
            surface_triangles: Vec::new(),
            node_sets: Vec::new(),
            obstacle: Footprint::PLATE,
            parameters,
            sensitivities: None,
            vibrations: Vec::new(),
            hash: [0; 32],
        };
        Ok((database, self.kept.iter().map(renumbered).collect()))
    }
}

/// Von Mises stress of a tensor, or the scalar itself.
fn equivalent(quantity: &NodalQuantity, node: usize) -> f64 {
    let count = quantity.components.len();
    let s = &quantity.values[node * count..][..count];
    let [x, y, z, xy, yz, xz] = match *s {
        [value] => return value,
        [x, y, z, xy, yz, xz] => [x, y, z, xy, yz, xz],
        [x, xy, xz, _, y, yz, _, _, z] => [x, y, z, xy, yz, xz],
        _ => return f64::NAN,
    };
    let normal = (x - y).powi(2) + (y - z).powi(2) + (z - x).powi(2);
    (0.5 * normal + 3.0 * (xy * xy + yz * yz + xz * xz)).sqrt()
}

/// Quantities of a step from which a snapshot is made.
struct Sources<'a> {
    displacement: &'a NodalQuantity,
    stress: Option<&'a NodalQuantity>,
    /// With the component.
    further: Vec<(&'a NodalQuantity, usize)>,
}

impl Sources<'_> {
    /// A quantity that has no finite value at a node.
    fn lacking(&self, node: usize) -> Option<&str> {
        let all = std::iter::once(self.displacement)
            .chain(self.stress)
            .chain(self.further.iter().map(|further| further.0));
        let lacks = |quantity: &&NodalQuantity| {
            let count = quantity.components.len();
            quantity.values[node * count..][..count].iter().any(|value| !value.is_finite())
        };
        all.into_iter().find(lacks).map(|quantity| quantity.name.as_str())
    }
}

/// The chosen quantities of a step, or the one that it does not have.
fn sources<'a>(step: &'a Step, chosen: &Chosen) -> Result<Sources<'a>, Diagnostic> {
    let find = |name: &str| {
        let mut found = step.quantities.iter().filter(|quantity| quantity.name == name);
        let first = found.next().ok_or_else(|| missing(step, name))?;
        if found.any(|other| !same_or_new(&first.values, &other.values)) {
            let expected = format!("one quantity {name}");
            return Err(Diagnostic::new(&step.name, expected, "several with other values"));
        }
        Ok(first)
    };
    Ok(Sources {
        displacement: find(&chosen.displacement)?,
        stress: chosen.stress.as_deref().map(find).transpose()?,
        further: (chosen.further.iter())
            .map(|(name, component, _)| Ok((find(name)?, *component)))
            .collect::<Result<_, Diagnostic>>()?,
    })
}

/// Nodes by connected part, parts and nodes in the order of the first node; nodes without a cell are in none.
fn parts(nodes: usize, blocks: &[Block]) -> Vec<Vec<u32>> {
    fn root(parent: &mut [u32], mut node: u32) -> u32 {
        while parent[node as usize] != node {
            parent[node as usize] = parent[parent[node as usize] as usize];
            node = parent[node as usize];
        }
        node
    }
    let mut parent: Vec<u32> = (0..nodes as u32).collect();
    let mut has_cell = vec![false; nodes];
    for cell in blocks.iter().flat_map(|block| block.nodes.chunks_exact(block.nodes_per_cell)) {
        for node in cell {
            has_cell[*node as usize] = true;
            let (a, b) = (root(&mut parent, cell[0]), root(&mut parent, *node));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut parts: Vec<Vec<u32>> = vec![Vec::new(); nodes];
    for node in (0..nodes as u32).filter(|node| has_cell[*node as usize]) {
        parts[root(&mut parent, node) as usize].push(node);
    }
    parts.retain(|part| !part.is_empty());
    parts
}

/// Finds the quantities by their names in the first state; the inner error is a quantity that the step does not have.
fn choose(wanted: &Wanted, step: &Step) -> Result<Result<Chosen, Diagnostic>, Diagnostic> {
    let by_name = |name: &str| step.quantities.iter().find(|quantity| quantity.name == name);
    // Of several with a usual name the one of a suitable size: principal stresses S1, S2, S3 may come before the equivalent stress.
    let usual = |names: &[&str], sizes: &[usize]| {
        let known = |quantity: &&NodalQuantity| names.contains(&quantity.name.to_lowercase().as_str());
        let fits = |quantity: &&NodalQuantity| known(quantity) && sizes.contains(&quantity.components.len());
        step.quantities.iter().find(fits).or_else(|| step.quantities.iter().find(known))
    };
    let displacement = match &wanted.displacement {
        Some(name) => by_name(name),
        None => usual(&DISPLACEMENT, &VECTOR),
    };
    let asked = wanted.displacement.as_deref().unwrap_or("displacement (or name it: --displacement NAME)");
    let Some(displacement) = displacement else { return Ok(Err(missing(step, asked))) };
    sized(displacement, &VECTOR)?;
    let stress = match &wanted.stress {
        Some(name) => match by_name(name) {
            None => return Ok(Err(missing(step, name))),
            found => found,
        },
        None => usual(&STRESS, &STRESS_SIZES),
    };
    stress.map(|quantity| sized(quantity, &STRESS_SIZES)).transpose()?;
    let further = |(name, unit): &(String, String)| {
        let (quantity, component) = match by_name(name) {
            Some(quantity) => (quantity, None),
            None => {
                let (first, component) = name.rsplit_once('.').ok_or_else(|| missing(step, name))?;
                (by_name(first).ok_or_else(|| missing(step, first))?, Some(component))
            }
        };
        let names = &quantity.components;
        let at = match component {
            None if names.len() == 1 => Some(0),
            None => None,
            Some(component) => names.iter().position(|name| name == component),
        };
        let at = at.ok_or_else(|| {
            let expected = format!("{}.COMPONENT with one of {}", quantity.name, names.join(", "));
            Diagnostic::new("--field", expected, name)
        })?;
        let field = name.to_lowercase().replace(['.', ' '], "_");
        Ok((quantity.name.clone(), at, FieldSpec { name: field, unit: unit.clone(), kind: FieldKind::Other }))
    };
    Ok(Ok(Chosen {
        displacement: displacement.name.clone(),
        stress: stress.map(|quantity| quantity.name.clone()),
        further: wanted.fields.iter().map(further).collect::<Result<_, Diagnostic>>()?,
    }))
}

fn sized(quantity: &NodalQuantity, components: &[usize]) -> Result<(), Diagnostic> {
    if components.contains(&quantity.components.len()) {
        return Ok(());
    }
    let expected = components.iter().map(usize::to_string).collect::<Vec<_>>().join(" or ");
    let place = format!("quantity {}", quantity.name);
    Err(Diagnostic::new(place, format!("{expected} components"), quantity.components.len()))
}

fn missing(step: &Step, name: &str) -> Diagnostic {
    let names: Vec<&str> = step.quantities.iter().map(|quantity| quantity.name.as_str()).collect();
    let found = if names.is_empty() { "none".into() } else { names.join(", ") };
    Diagnostic::new(&step.name, format!("a quantity {name}"), format!("quantities {found}"))
}
