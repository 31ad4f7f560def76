//! Tests of what the crate does not show: elements, assembly, checks of meshes. Compiled into the crate's unit tests.

#[path = "../common/actuators.rs"]
mod actuators;
mod builder;
mod closed_forms;
mod energy;
mod inputs;
mod physics;
mod tangents;
mod variants;
