//! Messages that Foxglove and rerun draw unasked, made of the topics' samples (docs/viewers.md): Foxglove's own types as
//! protocol buffers. `softtwin record --viewer` writes them into recordings, `softtwin foxglove` sends them.
//!
//! Lengths are metres there, as in ROS; frame `scene` holds one frame for each actuator.

mod geometry;
mod proto;
mod server;
mod topic;

pub use server::{Sender, Server};
pub use topic::ViewerMessages;

use crate::view::Catalogue;
use anyhow::Result;
use std::path::PathBuf;
use std::sync::Arc;

/// What viewers are to show.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Viewers")]
pub struct Looks {
    /// Model file of an actuator whose surface is to be drawn; repeat for several
    #[arg(long, value_name = "FILE")]
    model: Vec<PathBuf>,
    /// Scene file: its models, and where its actuators stand
    #[arg(long, value_name = "FILE.toml")]
    scene: Option<PathBuf>,
    /// Pictures a second of each field topic
    #[arg(long, value_name = "HZ", default_value_t = 30.0, value_parser = crate::range::number(0.1, 1000.0))]
    frames: f64,
}

impl Looks {
    /// Whatever makes these messages.
    ///
    /// # Errors
    /// A scene or model that cannot be read.
    pub fn messages(&self) -> Result<ViewerMessages> {
        let catalogue = Arc::new(Catalogue::load(&self.model, self.scene.as_deref())?);
        Ok(ViewerMessages { catalogue, period_ns: (1e9 / self.frames) as u64 })
    }
}
