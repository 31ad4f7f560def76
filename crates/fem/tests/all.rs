//! Tests of the public API: actuators, meshes, samples, closed forms, variants, checkpoints. One program, which is linked once and
//! runs its tests in parallel.

#[path = "common/actuators.rs"]
mod actuators;
mod boxes;
#[path = "common/builder.rs"]
mod builder;
mod closed_forms;
mod fits;
mod inputs;
mod limits;
mod meshes;
mod parts;
mod sample;
mod store;
mod transient;
mod variants;

use fem::Mesh;
