//! Control of an actuator by its model ([docs/control.md](../../../docs/control.md)).
//!
//! | module | content |
//! | --- | --- |
//! | `law` | controller: force or tip position, by the model's inverse and gradients, with two integrals; pure, without allocation |
//! | `inverse` | pressure that gives a force or a tip position |
//! | `twin_model` | force and tip of a trained model |
//!
//! `examples/hold_force.rs` is a complete controller in shared memory.
#![forbid(unsafe_code)]

pub mod inverse;
pub mod law;
pub mod twin_model;
