//! The run-time part: sources of readings, the bridge loop, scenes, the twin loop. The only place where the model
//! (`rom`) and the shared memory (`wire`) meet.
//!
//! A reading on its way from a gauge on Modbus to the field that readers map, file by file:
//!
//! | | file | what happens | shape of the data |
//! | --- | --- | --- | --- |
//! | 1 | `source/sensor/modbus.rs` | asks the device, stamps its answer | registers -> raw numbers |
//! | 2 | `source/sensor/feed.rs`, `mixed.rs` | calibrates; newest values to a reading | -> [`source::Reading`] |
//! | 3 | `bridge.rs` | numbers the reading, sends it | -> `wire::SensorSample` |
//! | 4 | `wire/port/sized.rs` | writes it into shared memory; reads it there | |
//! | 5 | `twin/actuator.rs` | calls the steps: poll, ingest, evaluate, reconstruct, publish | |
//! | 6 | `twin/ingest.rs` | validates | |
//! | 7 | `rom/evaluator.rs` | evaluates the model | -> `rom::evaluation::Evaluation` |
//! | 8 | `payload.rs` | evaluation to state and header | -> `wire::State`, `wire::FieldHeader` |
//! | 9 | `twin/reconstruct.rs` | one field topic: has a sample on loan, sends it | |
//! | 10 | `rom/reconstructor.rs` | writes the field into the loaned slice | `[f32]` |
//!
//! A replayed or simulated reading comes out of `source/replay.rs` or `source/simulate.rs` in place of 1 and 2.

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)
)]

pub mod bridge;
pub mod config;
pub mod estimation;
pub mod explain;
pub mod file;
pub mod grasp;
pub mod http;
pub mod known_model;
pub mod latency;
pub mod load;
pub mod machine;
pub mod measured;
pub mod metrics;
pub mod process;
pub mod publish;
pub mod query;
pub mod realtime;
pub mod service;
pub mod side_service;
pub mod source;
pub mod twin;
pub mod valve;

pub use wire::{self, thread_group};
