//! The live part: sources of readings, the bridge loop, scenes, the twin loop. The only place where the model
//! (`rom`) and the shared memory (`wire`) meet.
//!
//! ```text
//! scene.toml -> config::load -> [source] -> bridge::Bridge -> sensor topic
//!                            -> twin::Twin: sensor topic -> check -> regime -> evaluate -> field, state, health
//! ```

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)
)]

pub mod bridge;
pub mod config;
pub mod explain;
pub mod grasp;
pub mod machine;
pub mod metrics;
pub mod process;
pub mod query;
pub mod realtime;
pub mod service;
pub mod source;
pub mod twin;

pub use wire;
