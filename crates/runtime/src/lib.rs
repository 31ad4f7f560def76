//! The run-time part: sources of readings, the bridge loop, scenes, the twin loop.
//!
//! ARCHITECTURE.md lists the way of a reading file by file.

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)
)]

pub mod address_limit;
pub mod bridge;
pub mod config;
pub mod estimation;
pub mod explain;
pub mod grasp;
pub mod http;
pub mod known_model;
pub mod latency;
pub mod load;
pub mod machine;
pub mod measured;
pub mod metrics;
mod named_outputs;
mod problems;
pub mod publish;
pub mod query;
pub mod realtime;
pub mod service;
pub mod side_service;
pub mod source;
pub mod twin;
pub mod valve;

/// Sizes that several crates have, because none of them uses another.
const _: () = {
    assert!(rom::inputs::MAX_INPUTS == wire::layout::INPUTS_MAX);
    assert!(estimate::MAX_INPUTS == rom::inputs::MAX_INPUTS);
    assert!(rom::observable::MAX_OBSERVABLES == wire::layout::OBSERVABLES_MAX);
    // The force, the coordinates of the markers, the named values of a reading.
    assert!(estimate::MAX_ROWS == 1 + 3 * wire::layout::MARKERS_MAX + wire::layout::PARAMETERS_MAX);
};

pub use formats::file;
pub use wire::{self, thread_group};
