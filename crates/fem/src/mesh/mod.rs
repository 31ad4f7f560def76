//! The mesh as plain data: what readers and generators fill and what the solver takes.
//!
//! Node order inside an element is fixed once, here: corners first, then mid-sides. A tetrahedron lists
//! `0 1 2 3` and the mid-sides of `01 12 02 03 13 23`; a triangle lists `0 1 2` and the mid-sides of `01 12 20`.

pub mod abaqus_arrays;
pub mod boxes;
pub mod check;
pub mod grid;
pub mod load;
pub mod orient;
pub mod surfaces;

/// A second-order triangle: three corners, then the mid-sides of 01, 12 and 20.
pub type Tri6 = [u32; 6];

/// A second-order tetrahedron: four corners, then the mid-sides of 01, 12, 02, 03, 13 and 23.
pub type Tet10 = [u32; 10];

/// Corner pairs of the six mid-side nodes 4 to 9 of a [`Tet10`].
pub const TET_EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]];

/// Corner pairs of the three mid-side nodes 3 to 5 of a [`Tri6`].
pub const TRI_EDGES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

/// Two walls that face each other across a narrow slot and may touch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Slot {
    /// Wall on the lower-x side of the slot.
    pub lower: Vec<Tri6>,
    /// Wall on the upper-x side of the slot.
    pub upper: Vec<Tri6>,
}

/// An undeformed actuator: nodes, elements and the named surfaces the loads and supports refer to.
///
/// Every surface triangle except the sheet's must be a face of one tetrahedron; its orientation does not matter (the
/// solver orients it from the owning tetrahedron). Sheet triangles share nodes with the tetrahedra they are bonded to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Undeformed node positions in the actuator frame (mm).
    pub nodes_mm: Vec<[f64; 3]>,
    /// Elastomer elements.
    pub tets: Vec<Tet10>,
    /// Index of each tetrahedron's elastomer in the problem's list; empty means material 0 throughout.
    pub tet_material: Vec<u16>,
    /// Strain-limiting sheet (initially plane), as surface elements.
    pub sheet: Vec<Tri6>,
    /// Walls of the closed cavity the pressure acts on.
    pub cavity: Vec<Tri6>,
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
