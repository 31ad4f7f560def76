//! Every instruction set against the reference, and the edges of the description.

mod cases;
mod edges;
mod properties;
mod reference;
