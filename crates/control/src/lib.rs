//! Control of an actuator by its model ([docs/control.md](../../../docs/control.md)).
//!
//! | module | content |
//! | --- | --- |
//! | `law` | controller: force, observable or pressure, by the model's inverse and gradients, with two integrals; pure, without allocation |
//! | `plan` | predictive law: the command from a horizon over line, play and swing, by a quadratic program |
//! | `settings` | dynamics of the actuator, times of the loop, limits |
//! | `monitor` | faults that readings show while the controller drives |
//! | `inverse` | pressure that gives a force or an observable |
//! | `twin_model` | force and observable of a trained model |
//! | `plant` | simulated actuator: delay, line, play, swing, noise |
//! | `ahead` | targets ahead of now, from a rate or a series |
//! | `experiment` | drive of the valve by which `softtwin tune` identifies it |
//! | `held` | held quantity with its model, settings and limits, from a scene; the controller in a loop that is not ours |
//! | `trial` | a controller on a plant in simulated time, and what is read off it |
#![forbid(unsafe_code)]

pub mod ahead;
pub mod experiment;
pub mod held;
pub mod inverse;
pub mod law;
pub mod monitor;
mod plan;
pub mod plant;
pub mod settings;
mod shape;
pub mod trial;
pub mod twin_model;
