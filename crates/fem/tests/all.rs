//! What the crate shows: actuators, meshes, samples, closed forms, variants, the store of states. One program: linked once, and its
//! tests run beside each other.

#[path = "common/actuators.rs"]
mod actuators;
#[path = "common/builder.rs"]
mod builder;
mod closed_forms;
mod inputs;
mod meshes;
mod sample;
mod store;
mod variants;

use fem::Mesh;
