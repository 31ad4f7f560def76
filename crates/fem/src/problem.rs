//! Problem: checked mesh and materials, with everything precomputed that does not change between states.

use std::sync::Arc;

use thiserror::Error;

use crate::algebra::{Vec3, add, axpy, cross, dot, norm, scale, sub};
use crate::config::ProblemConfig;
use crate::contact::SlotWalls;
use crate::element::bending::{self, BendingEntry};
use crate::element::cavity::face_terms;
use crate::element::membrane::{self, MembraneGeometry};
use crate::element::tet10::{self, TetGeometry};
use crate::linear::nested_dissection;
use crate::linear::{Analysis, LinearError};
use crate::linear::{CONSTRAINED, Rank, SymmetricBlocks};
use crate::material::{Elastomer, MaterialError, at_least_zero, positive};
use crate::mesh::{Boundary, Mesh, closed, flipped};
use formats::mesh_file::{Tet10, Tri6};

/// Error in mesh or materials.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs)] // the messages say what the values are
pub enum ProblemError {
    /// A material constant is out of range.
    #[error(transparent)]
    Material(#[from] MaterialError),
    /// A tetrahedron is inverted or flat.
    #[error(
        "element {element} at {at_mm:?} mm is inverted: Jacobian {jacobian_mm3:.3e} mm3, expected above 0; repair the mesh"
    )]
    Inverted { element: usize, at_mm: Vec3, jacobian_mm3: f64 },
    /// A list names a node, element or material that does not exist.
    #[error("{what} {index} names {found}, but there are only {count}; the mesh is inconsistent")]
    OutOfRange { what: &'static str, index: usize, found: usize, count: usize },
    /// A node belongs to no element.
    #[error("node {node} at {at_mm:?} mm belongs to no element; remove it from the mesh")]
    Unconnected { node: usize, at_mm: Vec3 },
    /// A named surface has a triangle that is not a face on the boundary of the solid.
    #[error(
        "{surface}: triangle {triangle} is not a boundary face of the tetrahedra; check the surface's name and mesh"
    )]
    NotOnBoundary { surface: &'static str, triangle: usize },
    /// The cavity has a hole, so that its volume is undefined.
    #[error("the cavity is open at the edge between nodes {0} and {1}; name all walls of the cavity")]
    OpenCavity(u32, u32),
    /// A required part is missing.
    #[error("{0}")]
    Missing(&'static str),
    /// The sheet is not plane or its triangles do not form a surface.
    #[error("the sheet is {0}; it must be one plane surface with at most two triangles at an edge")]
    Sheet(String),
    /// A film cannot lie on its surface.
    #[error("{0}")]
    Film(String),
    /// The linear solver refused the problem.
    #[error(transparent)]
    Linear(#[from] LinearError),
}

/// Ranks of a node group's pairs (a, b <= a) in the pattern, for elements of `PAIRS` pairs.
type Ranks<const PAIRS: usize> = [Rank; PAIRS];

/// Precomputed part of sheet and films.
#[derive(Debug, Default)]
pub(crate) struct Sheet {
    /// Triangles of the sheet, then of the films.
    pub triangles: Vec<Tri6>,
    pub membrane: Vec<MembraneGeometry>,
    /// In-plane axes of each triangle.
    pub axes: Vec<[Vec3; 2]>,
    pub ranks: Vec<Ranks<{ membrane::PAIRS }>>,
    /// Laws of sheet and films.
    laws: Vec<membrane::Law>,
    /// Law of each triangle.
    law_of: Vec<u16>,
    pub bending: Vec<BendingEntry>,
    pub bending_ranks: Vec<Rank>,
}

impl Sheet {
    /// Law of triangle `t`.
    pub(crate) fn law(&self, t: usize) -> &membrane::Law {
        &self.laws[usize::from(self.law_of[t])]
    }

    /// True if two triangles belong to the same sheet or film.
    pub(crate) fn same_film(&self, t: usize, other: &Self, u: usize) -> bool {
        self.law_of[t] == other.law_of[u]
    }

    fn add(
        &mut self,
        triangle: Tri6,
        x: &[Vec3; 6],
        axes: [Vec3; 2],
        law: usize,
    ) -> Result<(), ProblemError> {
        let index = self.triangles.len();
        let geometry = MembraneGeometry::new(x, axes);
        self.membrane.push(geometry.map_err(|_| ProblemError::Sheet(format!("flat at triangle {index}")))?);
        self.triangles.push(triangle);
        self.axes.push(axes);
        self.law_of.push(u16::try_from(law).unwrap_or(u16::MAX));
        Ok(())
    }
}

/// Walls of a further cavity.
#[derive(Clone, Debug)]
pub(crate) struct Cavity {
    /// Faces, normals out of the cavity.
    pub faces: Vec<Tri6>,
    pub ranks: Vec<Ranks<{ membrane::PAIRS }>>,
}

/// A checked problem; shared by the solvers of all threads.
#[derive(Debug)]
pub struct Problem {
    pub(crate) config: ProblemConfig,
    pub(crate) mesh: Mesh,
    /// Unknown block of each node, or [`CONSTRAINED`].
    pub(crate) free: Arc<Vec<u32>>,
    pub(crate) pattern: Arc<SymmetricBlocks>,
    pub(crate) analysis: Arc<Analysis>,
    pub(crate) tets: Vec<TetGeometry>,
    pub(crate) tet_ranks: Arc<Vec<Ranks<{ tet10::PAIRS }>>>,
    pub(crate) sheet: Sheet,
    /// Cavity faces, normals out of the cavity (into the solid).
    pub(crate) cavity: Vec<Tri6>,
    pub(crate) cavity_ranks: Vec<Ranks<{ membrane::PAIRS }>>,
    /// Further cavities, whose pressures are in the configuration.
    pub(crate) cavities: Vec<Cavity>,
    pub(crate) slots: Vec<SlotWalls>,
    pub(crate) contact_nodes: Vec<u32>,
    /// Stiffness of the obstacle at each of them (N/mm).
    pub(crate) contact_stiffness_n_per_mm: Vec<f64>,
    /// Elastomer mass at each node (t): consistent with the shape functions, negative at corners.
    pub(crate) node_mass_t: Vec<f64>,
}

impl Problem {
    /// Checks mesh and materials, precomputes geometry, pattern and ordering.
    ///
    /// Cost: about 0.5 s for 25,000 nodes.
    pub fn new(mesh: Mesh, config: ProblemConfig) -> Result<Self, ProblemError> {
        check_config(&mesh, &config)?;
        check_indices(&mesh, &config)?;
        let tets = tet_geometry(&mesh)?;
        let boundary = Boundary::new(&mesh.tets);
        let closed_walls = |walls: &[Tri6]| -> Result<Vec<Tri6>, ProblemError> {
            let walls = oriented(&boundary, walls, "cavity")?.iter().map(flipped).collect::<Vec<_>>();
            closed(walls.iter().map(|t| [t[0], t[1], t[2]]))
                .map_err(|[a, b]| ProblemError::OpenCavity(a, b))?;
            Ok(walls)
        };
        let cavity = closed_walls(&mesh.cavity)?;
        let cavities =
            mesh.cavities.iter().map(|walls| closed_walls(walls)).collect::<Result<Vec<_>, _>>()?;
        let slots = slot_walls(&mesh, &boundary)?;
        oriented(&boundary, &mesh.bottom, "bottom")?;
        let free = numbering(&mesh)?;
        let mut sheet = sheet_geometry(&mesh, &config, &boundary)?;
        let pattern = pattern(&mesh, &free, &sheet, &slots);
        let mut blocks = vec![[0.0; 3]; pattern.unknowns() / 3];
        for (x, f) in mesh.nodes_mm.iter().zip(&free).filter(|(_, f)| **f != CONSTRAINED) {
            blocks[*f as usize] = *x;
        }
        let order = nested_dissection(&pattern.graph(), &blocks);
        let analysis = Arc::new(Analysis::new(&pattern, &order)?);
        let tet_ranks = Arc::new(mesh.tets.iter().map(|t| ranks(&pattern, &free, t)).collect());
        sheet.ranks = sheet.triangles.iter().map(|t| ranks(&pattern, &free, t)).collect();
        let rank = |e: &BendingEntry| pattern.rank(free[e.row as usize], free[e.col as usize]);
        sheet.bending_ranks = sheet.bending.iter().map(rank).collect();
        let face_ranks = |faces: &[Tri6]| faces.iter().map(|t| ranks(&pattern, &free, t)).collect();
        let cavity_ranks = face_ranks(&cavity);
        let cavities =
            cavities.into_iter().map(|faces| Cavity { ranks: face_ranks(&faces), faces }).collect();
        let mut contact_nodes: Vec<u32> = mesh.bottom.iter().flatten().copied().collect();
        contact_nodes.sort_unstable();
        contact_nodes.dedup();
        let contact_stiffness_n_per_mm = contact_stiffness(&mesh, &config, &contact_nodes);
        let node_mass_t = masses(&mesh, &config, &tets);
        Ok(Self {
            config,
            mesh,
            free: Arc::new(free),
            pattern: Arc::new(pattern),
            analysis,
            tets,
            tet_ranks,
            sheet,
            cavity,
            cavity_ranks,
            cavities,
            slots,
            contact_nodes,
            contact_stiffness_n_per_mm,
            node_mass_t,
        })
    }

    /// The same body with other node positions and materials. Topology, pattern, elimination order and the pairs of points
    /// across the slots are kept, so that states of one are starts of the other and a result depends smoothly on both
    /// arguments. Cost: 10 % of [`Problem::new`].
    ///
    /// # Errors
    /// [`ProblemError`], for example for another number of nodes or an inverted element.
    pub fn varied(&self, nodes_mm: Vec<Vec3>, config: ProblemConfig) -> Result<Self, ProblemError> {
        let (found, count) = (nodes_mm.len(), self.mesh.nodes_mm.len());
        if found != count {
            return Err(ProblemError::OutOfRange {
                what: "nodes of the varied mesh",
                index: 0,
                found,
                count,
            });
        }
        let mesh = Mesh { nodes_mm, ..self.mesh.clone() };
        check_config(&mesh, &config)?;
        check_indices(&mesh, &config)?;
        let tets = tet_geometry(&mesh)?;
        let boundary = if mesh.films.is_empty() { Boundary::new(&[]) } else { Boundary::new(&mesh.tets) };
        let mut sheet = sheet_geometry(&mesh, &config, &boundary)?;
        sheet.ranks.clone_from(&self.sheet.ranks);
        sheet.bending_ranks.clone_from(&self.sheet.bending_ranks);
        let slots = self.slots.iter().map(|walls| walls.moved(&mesh.nodes_mm)).collect();
        let contact_stiffness_n_per_mm = contact_stiffness(&mesh, &config, &self.contact_nodes);
        let node_mass_t = masses(&mesh, &config, &tets);
        Ok(Self {
            config,
            free: Arc::clone(&self.free),
            pattern: Arc::clone(&self.pattern),
            analysis: Arc::clone(&self.analysis),
            tets,
            tet_ranks: Arc::clone(&self.tet_ranks),
            sheet,
            cavity: self.cavity.clone(),
            cavity_ranks: self.cavity_ranks.clone(),
            cavities: self.cavities.clone(),
            slots,
            contact_nodes: self.contact_nodes.clone(),
            contact_stiffness_n_per_mm,
            node_mass_t,
            mesh,
        })
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The configuration.
    pub fn config(&self) -> &ProblemConfig {
        &self.config
    }

    /// Scalar unknowns, stored stiffness entries and entries of the factor.
    pub fn sizes(&self) -> (usize, usize, usize) {
        (self.pattern.unknowns(), self.pattern.stored(), self.analysis.factor_entries())
    }

    /// The elastomer of element `e`.
    pub(crate) fn elastomer(&self, e: usize) -> &Elastomer {
        elastomer(&self.mesh, &self.config, e)
    }

    /// Volume of the undeformed cavity (mm3).
    pub fn undeformed_volume_mm3(&self) -> f64 {
        self.cavity_volume(&self.mesh.nodes_mm, None)
    }

    /// Volume of the cavity (mm3) at deformed positions `x`; its derivatives with respect to the unknowns (mm2) are added to `gradient`.
    pub(crate) fn cavity_volume(&self, x: &[Vec3], mut gradient: Option<&mut [f64]>) -> f64 {
        let mut volume_mm3 = 0.0;
        for nodes in &self.cavity {
            let terms = face_terms(&nodes.map(|n| x[n as usize]), self.config.cavity_load);
            volume_mm3 += terms.volume_mm3;
            let Some(gradient) = gradient.as_deref_mut() else { continue };
            for (n, by) in nodes.iter().zip(&terms.gradient) {
                let free = self.free[*n as usize];
                if free != CONSTRAINED {
                    let first = 3 * free as usize;
                    gradient[first..first + 3].iter_mut().zip(by).for_each(|(sum, by)| *sum += by);
                }
            }
        }
        volume_mm3
    }

    /// Deformed positions (mm) of displacements `u`.
    pub(crate) fn positions(&self, u: &[Vec3]) -> Vec<Vec3> {
        self.mesh.nodes_mm.iter().zip(u).map(|(x, u)| add(*x, *u)).collect()
    }
}

fn check_config(mesh: &Mesh, config: &ProblemConfig) -> Result<(), ProblemError> {
    for (place, elastomer) in config.elastomers.iter().enumerate() {
        if place == 0 { elastomer.check()? } else { elastomer.check_solid()? }
    }
    if let Some(sheet) = &config.sheet {
        sheet.check()?;
    }
    config.films.iter().try_for_each(|film| film.check())?;
    if mesh.films.len() != config.films.len() || mesh.cavities.len() != config.cavities_mpa.len() {
        return Err(ProblemError::Missing(
            "the mesh has other films or further cavities than the configuration; give each its material or pressure",
        ));
    }
    let contact = &config.contact;
    at_least_zero("contact", "slot_penalty_mpa_per_mm", contact.slot_penalty_mpa_per_mm)?;
    positive("contact", "slot_smoothing_mm", contact.slot_smoothing_mm)?;
    positive("contact", "obstacle_penalty_mpa_per_mm", contact.obstacle_penalty_mpa_per_mm)?;
    positive("contact", "obstacle_smoothing_mm", contact.obstacle_smoothing_mm)?;
    if config.elastomers.is_empty() {
        return Err(ProblemError::Missing("no elastomer is given; name at least one"));
    }
    if mesh.tets.is_empty() {
        return Err(ProblemError::Missing(
            "the mesh has no tetrahedra of second order; expected 10-node elements",
        ));
    }
    if mesh.fixed_nodes.is_empty() {
        return Err(ProblemError::Missing("no node is fixed; name the surface that holds the actuator"));
    }
    if !mesh.sheet.is_empty() && config.sheet.is_none() {
        return Err(ProblemError::Missing(
            "the mesh has a sheet but the problem has no sheet material; give one",
        ));
    }
    Ok(())
}

fn check_indices(mesh: &Mesh, config: &ProblemConfig) -> Result<(), ProblemError> {
    let nodes = mesh.nodes_mm.len();
    let range = |what, index, found: usize, count: usize| {
        if found < count { Ok(()) } else { Err(ProblemError::OutOfRange { what, index, found, count }) }
    };
    for (e, tet) in mesh.tets.iter().enumerate() {
        tet.iter().try_for_each(|n| range("tetrahedron", e, *n as usize, nodes))?;
    }
    let walls = mesh.slots.iter().flat_map(|s| s.lower.iter().chain(&s.upper));
    let further = mesh.cavities.iter().chain(&mesh.films).flatten();
    let surfaces = mesh.sheet.iter().chain(&mesh.cavity).chain(&mesh.bottom).chain(further).chain(walls);
    for (t, tri) in surfaces.enumerate() {
        tri.iter().try_for_each(|n| range("surface triangle", t, *n as usize, nodes))?;
    }
    for (k, n) in mesh.fixed_nodes.iter().enumerate() {
        range("fixed node", k, *n as usize, nodes)?;
    }
    if !mesh.tet_material.is_empty() {
        range("tet_material", mesh.tets.len() - 1, mesh.tets.len() - 1, mesh.tet_material.len())?;
    }
    for (e, m) in mesh.tet_material.iter().enumerate() {
        range("tet_material", e, usize::from(*m), config.elastomers.len())?;
    }
    if let Some(owners) = &mesh.mises_owner {
        range("mises_owner", nodes - 1, nodes - 1, owners.len())?;
        for (n, (e, local)) in owners.iter().enumerate().filter_map(|(n, o)| o.map(|o| (n, o))) {
            range("mises_owner", n, e as usize, mesh.tets.len())?;
            range("mises_owner", n, usize::from(local), 10)?;
        }
    }
    Ok(())
}

fn tet_geometry(mesh: &Mesh) -> Result<Vec<TetGeometry>, ProblemError> {
    let geometry = |(element, tet): (usize, &Tet10)| {
        let x = tet.map(|n| mesh.nodes_mm[n as usize]);
        TetGeometry::new(&x).map_err(|jacobian_mm3| ProblemError::Inverted {
            element,
            at_mm: x[0],
            jacobian_mm3,
        })
    };
    mesh.tets.iter().enumerate().map(geometry).collect()
}

fn oriented(boundary: &Boundary, tris: &[Tri6], surface: &'static str) -> Result<Vec<Tri6>, ProblemError> {
    let orient = |(triangle, t): (usize, &Tri6)| {
        boundary.outward(t).ok_or(ProblemError::NotOnBoundary { surface, triangle })
    };
    tris.iter().enumerate().map(orient).collect()
}

fn slot_walls(mesh: &Mesh, boundary: &Boundary) -> Result<Vec<SlotWalls>, ProblemError> {
    let mut walls = Vec::new();
    for slot in &mesh.slots {
        if slot.lower.is_empty() || slot.upper.is_empty() {
            return Err(ProblemError::Missing("a slot has only one wall; name both or leave the slot out"));
        }
        let lower = oriented(boundary, &slot.lower, "slot wall (lower)")?;
        let upper = oriented(boundary, &slot.upper, "slot wall (upper)")?;
        walls.push(SlotWalls::new(lower, upper, &mesh.nodes_mm));
    }
    Ok(walls)
}

/// Unknown blocks in order of position along the longest axis, which keeps assembly and solve local in memory.
fn numbering(mesh: &Mesh) -> Result<Vec<u32>, ProblemError> {
    let mut used = vec![false; mesh.nodes_mm.len()];
    for n in mesh.tets.iter().flatten() {
        used[*n as usize] = true;
    }
    if let Some(node) = used.iter().position(|u| !u) {
        return Err(ProblemError::Unconnected { node, at_mm: mesh.nodes_mm[node] });
    }
    let mut free = vec![0; mesh.nodes_mm.len()];
    for n in &mesh.fixed_nodes {
        free[*n as usize] = CONSTRAINED;
    }
    let mut order: Vec<usize> = (0..free.len()).filter(|n| free[*n] != CONSTRAINED).collect();
    order.sort_by(|a, b| mesh.nodes_mm[*a][0].total_cmp(&mesh.nodes_mm[*b][0]));
    for (k, n) in order.into_iter().enumerate() {
        free[n] = u32::try_from(k).unwrap_or(CONSTRAINED);
    }
    Ok(free)
}

/// Largest offset of a film's mid-side node from the plane of its corners, as a fraction of an edge.
const FILM_FLAT: f64 = 1.0e-3;
/// Smallest part of a film's axis in its surface.
const FILM_AXIS: f64 = 0.05;

fn sheet_geometry(mesh: &Mesh, config: &ProblemConfig, boundary: &Boundary) -> Result<Sheet, ProblemError> {
    let mut sheet = Sheet::default();
    let corners = |t: &Tri6| t.map(|n| mesh.nodes_mm[n as usize]);
    if let (Some(material), Some(first)) = (&config.sheet, mesh.sheet.first()) {
        let origin = corners(first);
        let axes = membrane::plane_axes(&origin);
        let normal = cross(axes[0], axes[1]);
        sheet.laws.push(membrane::Law::of_sheet(material));
        for (k, t) in mesh.sheet.iter().enumerate() {
            let x = corners(t);
            let off = x.iter().map(|p| dot(sub(*p, origin[0]), normal).abs()).fold(0.0, f64::max);
            if off > 1.0e-6 * norm(sub(x[1], x[0])) {
                return Err(ProblemError::Sheet(format!("{off:.3e} mm out of plane at triangle {k}")));
            }
            sheet.add(*t, &x, axes, 0)?;
        }
        let plane: Vec<_> = sheet.membrane.iter().map(|m| m.plane).collect();
        let stiffness = material.bending_stiffness_n_mm();
        sheet.bending =
            bending::assemble(&mesh.sheet, &plane, stiffness, material.poisson, material.bending_penalty)
                .map_err(|[a, b]| {
                    ProblemError::Sheet(format!("branched at the edge of nodes {a} and {b}"))
                })?;
    }
    for (film, (triangles, material)) in mesh.films.iter().zip(&config.films).enumerate() {
        sheet.laws.push(membrane::Law::of(material));
        let law = sheet.laws.len() - 1;
        for t in triangles {
            let t = boundary.outward(t).unwrap_or(*t);
            let x = corners(&t);
            let wrong = |what: &str| {
                let [a, b, c] = x[0];
                ProblemError::Film(format!("film {} at ({a:.3}, {b:.3}, {c:.3}) mm: {what}", film + 1))
            };
            let normal = cross(sub(x[1], x[0]), sub(x[2], x[0]));
            let normal = scale(1.0 / norm(normal), normal);
            let off = x.iter().map(|p| dot(sub(*p, x[0]), normal).abs()).fold(0.0, f64::max);
            if off > FILM_FLAT * norm(sub(x[1], x[0])) {
                return Err(wrong("a curved triangle; mesh with straight second-order edges"));
            }
            let axis = scale(1.0 / norm(material.axis), material.axis);
            let along = sub(axis, scale(dot(axis, normal), normal));
            if norm(along) < FILM_AXIS {
                return Err(wrong("its axis is normal to the surface; give another axis"));
            }
            let first = scale(1.0 / norm(along), along);
            sheet.add(t, &x, [first, cross(normal, first)], law)?;
        }
    }
    Ok(sheet)
}

fn pattern(mesh: &Mesh, free: &[u32], sheet: &Sheet, slots: &[SlotWalls]) -> SymmetricBlocks {
    let block = |n: &u32| free[*n as usize];
    let mut groups: Vec<Vec<u32>> = mesh.tets.iter().map(|t| t.iter().map(block).collect()).collect();
    groups.extend(sheet.triangles.iter().map(|t| t.iter().map(block).collect()));
    groups.extend(sheet.bending.iter().map(|e| vec![block(&e.row), block(&e.col)]));
    for walls in slots {
        groups.extend(walls.pairs().iter().map(|p| p.nodes.iter().map(block).collect()));
    }
    let count = free.iter().filter(|f| **f != CONSTRAINED).count();
    SymmetricBlocks::new(count, groups.iter().map(Vec::as_slice))
}

fn ranks<const N: usize, const PAIRS: usize>(
    pattern: &SymmetricBlocks,
    free: &[u32],
    nodes: &[u32; N],
) -> Ranks<PAIRS> {
    let mut out = [0; PAIRS];
    let pairs = (0..N).flat_map(|a| (0..=a).map(move |b| (a, b)));
    for (out, (a, b)) in out.iter_mut().zip(pairs) {
        *out = pattern.rank(free[nodes[a] as usize], free[nodes[b] as usize]);
    }
    out
}

fn elastomer<'a>(mesh: &Mesh, config: &'a ProblemConfig, e: usize) -> &'a Elastomer {
    &config.elastomers[mesh.tet_material.get(e).map_or(0, |material| usize::from(*material))]
}

/// Obstacle stiffness at each contact node: its part of the surface's area (four facets per face, a third of each per
/// vertex) times the penalty.
fn contact_stiffness(mesh: &Mesh, config: &ProblemConfig, contact_nodes: &[u32]) -> Vec<f64> {
    let mut area_mm2 = vec![0.0; mesh.nodes_mm.len()];
    for t in &mesh.bottom {
        let [a, b, c] = [t[0], t[1], t[2]].map(|n| mesh.nodes_mm[n as usize]);
        let area = 0.5 * norm(cross(sub(b, a), sub(c, a)));
        for (k, n) in t.iter().enumerate() {
            area_mm2[*n as usize] += area * if k < 3 { 1.0 / 12.0 } else { 0.25 };
        }
    }
    let penalty_mpa_per_mm = config.contact.obstacle_penalty_mpa_per_mm;
    contact_nodes.iter().map(|n| penalty_mpa_per_mm * area_mm2[*n as usize]).collect()
}

fn masses(mesh: &Mesh, config: &ProblemConfig, tets: &[TetGeometry]) -> Vec<f64> {
    let mut mass = vec![0.0; mesh.nodes_mm.len()];
    for (e, (tet, geometry)) in mesh.tets.iter().zip(tets).enumerate() {
        let density = elastomer(mesh, config, e).density_t_per_mm3;
        for q in 0..4 {
            let n = tet10::shape(tet10::gauss_point(q));
            for (node, n) in tet.iter().zip(n) {
                mass[*node as usize] += density * geometry.weights[q] * n;
            }
        }
    }
    mass
}

/// Force of gravity at each node (N), added to `out`.
pub(crate) fn add_gravity(problem: &Problem, gravity_mm_s2: Vec3, out: &mut [Vec3]) {
    for (f, m) in out.iter_mut().zip(&problem.node_mass_t) {
        axpy(1.0, scale(*m, gravity_mm_s2), f);
    }
}
