//! `actuator.toml`: geometry, materials, loads, supports and the obstacle of one actuator; and its mesh.
//!
//! `models/pneunet/actuator.toml` explains every key. The mesh script reads the same file.

mod boxes;
mod check;
mod file;
mod grid;
mod meshing;
mod reading;
mod surfaces;

pub use file::{
    Actuator, Base, Body, Chambers, Channels, Fixed, Loads, MeshSettings, ObstacleBody, Slots, Support,
};

#[cfg(test)]
pub(crate) use {meshing::named, surfaces::locate};
