//! Controllers that drive an actuator by its model, and the plants they are tried on ([docs/control.md](../../../docs/control.md)).
//!
//! | module | what |
//! | --- | --- |
//! | `law` | the controller: force or tip position, by the model's inverse and gradients, with two integrals. Pure, no allocation |
//! | `inverse` | which pressure gives a force or a tip position |
//! | `twin_model` | a trained model as the controller sees it |
//! | `table` | force and tip of a second finite-element mesh, as a table |
//! | `plant` | valve, line and actuator in motion |
//! | `trial` | many steps of the controller on the plant, in simulated time |
//! | `rig` | a plant as Modbus devices, with a valve that closes by itself |
//! | `report` | percentiles and step responses |
//!
//! The programs are in `src/bin/`.
#![forbid(unsafe_code)]

pub mod inverse;
pub mod law;
pub mod plant;
pub mod report;
pub mod rig;
pub mod table;
pub mod trial;
pub mod twin_model;
