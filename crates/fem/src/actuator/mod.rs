//! `actuator.toml`: geometry, materials, loads, supports and the obstacle of one actuator; and its mesh.
//!
//! `models/pneunet/actuator.toml` explains every key. The mesh script reads the same file.

mod boxes;
mod check;
mod file;
mod grid;
mod inventory;
mod meshing;
mod new;
mod parameters;
mod reading;
mod sag;
mod shape;
mod surfaces;
mod template;

pub use file::{
    Actuator, Base, BodySpec, Chambers, Channels, Fixed, Loads, MeshSettings, ObstacleBody, ObstacleShape,
    Shape, Slots, Support,
};

pub use inventory::NamedPart;
pub use meshing::GridError;
pub use new::{BoxesReport, NewError, NewReport};
pub use parameters::{Setting, unit};
pub use shape::{mesh_quality, moved_nodes};
pub use template::{NewActuator, NewBoxes, NewMaterial, NewShape, cross_section};

#[cfg(test)]
pub(crate) use surfaces::locate;
