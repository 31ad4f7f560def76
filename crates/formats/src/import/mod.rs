//! Meshes and snapshots of other programs. One file a format; each refuses by name what it does not know.

pub mod abaqus;
pub mod ansys;
