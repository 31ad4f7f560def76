//! Mesh types of readers, generators and the solver.

use formats::mesh_file::{Tet10, Tri6};

/// Two walls that face each other across a narrow slot and may touch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Slot {
    /// Wall on the lower-x side of the slot.
    pub lower: Vec<Tri6>,
    /// Wall on the upper-x side of the slot.
    pub upper: Vec<Tri6>,
}

/// Undeformed actuator: nodes, elements and the surfaces of loads and supports.
///
/// The order of the nodes in an element is that of [`formats::mesh_file`]: corners first, then mid-sides.
/// Every surface triangle except the sheet's must be a face of one tetrahedron; its orientation does not matter (the
/// solver orients it from the owning tetrahedron). Sheet triangles have nodes of the tetrahedra they are bonded to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Undeformed node positions in the actuator frame (mm).
    pub nodes_mm: Vec<[f64; 3]>,
    /// Elements of elastomer and other solids.
    pub tets: Vec<Tet10>,
    /// Index of each tetrahedron's elastomer in the problem's list; empty means material 0 throughout.
    pub tet_material: Vec<u16>,
    /// Strain-limiting sheet (initially plane), as surface elements.
    pub sheet: Vec<Tri6>,
    /// Walls of the closed cavity the pressure acts on.
    pub cavity: Vec<Tri6>,
    /// Walls of further closed cavities, each with its own pressure.
    pub cavities: Vec<Vec<Tri6>>,
    /// Membranes bonded to faces of tetrahedra.
    pub films: Vec<Vec<Tri6>>,
    /// Nodes held in all three directions.
    pub fixed_nodes: Vec<u32>,
    /// Underside of the base: the surface a plate or a block can touch.
    pub bottom: Vec<Tri6>,
    /// Pairs of facing chamber walls.
    pub slots: Vec<Slot>,
    /// For each node the (element, local node) whose extrapolated von Mises stress represents it in
    /// `von_mises_owner_mpa`; `None` marks a node shown with zero stress (on the sheet).
    pub mises_owner: Option<Vec<Option<(u32, u8)>>>,
}
