//! Frictionless contact by penalty: chamber walls against each other, the base against a rigid plate or block.

pub(crate) mod obstacle;
pub(crate) mod penalty;
pub(crate) mod slot;
