//! Meshes and the store of states. One program: linked once, and its tests run beside each other.

#[path = "common/actuators.rs"]
mod actuators;
mod meshes;
mod store;
