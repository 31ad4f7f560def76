//! Model, scene and settings files of a row.

use super::super::compute;
use crate::testbed::{Sine, Testbed};
use rom::inputs::Inputs;
use rom::model::Model;
use serde::Serialize;
use std::path::PathBuf;

/// Name of the actuator.
pub const ACTUATOR: &str = "bench";
/// Topic of the tip's fields.
pub const TIP: &str = "tip";
/// Topic of the surface's fields.
pub const SURFACE: &str = "surface";

/// Payload for the reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Payload {
    /// Coefficients, force, gradients, half-widths.
    StateOnly,
    /// Fields of the tip.
    Tip,
    /// Fields of the surface.
    Surface,
    /// Fields of all nodes, from the basis of the shipped scene.
    All,
}

/// How twin and reader wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum WakeUp {
    /// Asleep until notified.
    Event,
    /// Asleep until notified, with the cores kept from sleeping (`realtime.stay_awake`).
    EventAwake,
    /// Spinning, one core each.
    BusyPoll,
}

/// One row of the table.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// Readings a second.
    pub rate_hz: f64,
    /// Payload that is published and read.
    pub payload: Payload,
    /// How twin and reader wait.
    pub wake: WakeUp,
}

/// Common parts of the scenes of all rows.
pub struct Scenes<'a> {
    testbed: &'a Testbed,
    readings: Sine,
    tip_nodes: Vec<u32>,
    /// The model's surface, or all nodes where it names none.
    surface_nodes: &'static str,
}

impl<'a> Scenes<'a> {
    /// Saves the model.
    pub fn new(testbed: &'a Testbed, model: &Model) -> anyhow::Result<Self> {
        let inputs = compute::inputs(model)?;
        let pressures = inputs.iter().map(Inputs::pressure_mpa);
        let (low, high) = pressures.fold((f64::MAX, f64::MIN), |(low, high), p| (low.min(p), high.max(p)));
        let gap_mm = inputs.first().map_or(f64::INFINITY, Inputs::gap_mm);
        testbed.write("bench.twin", model.to_bytes()?)?;
        let has_surface = model.header.node_sets.iter().any(|set| set.name == SURFACE);
        Ok(Self {
            testbed,
            readings: Sine {
                rate_hz: 0.0,
                // A scene without a plate: a gap out of reach.
                gap_mm: if gap_mm.is_finite() { gap_mm } else { 1e3 },
                mean_mpa: (low + high) / 2.0,
                amplitude_mpa: (high - low) / 2.0,
                frequency_hz: 1.0,
            },
            tip_nodes: compute::tip_nodes(model),
            surface_nodes: if has_surface { SURFACE } else { "all" },
        })
    }

    /// Writes scene and settings of a row; returns their paths.
    pub fn write(&self, row: Row) -> anyhow::Result<(PathBuf, PathBuf)> {
        let output = match row.payload {
            Payload::StateOnly => None,
            Payload::Tip => Some(format!("name = \"{TIP}\"\nnodes = {{ list = {:?} }}", self.tip_nodes)),
            Payload::Surface => Some(format!("name = \"{SURFACE}\"\nnodes = \"{}\"", self.surface_nodes)),
            Payload::All => Some("nodes = \"all\"".into()),
        };
        let outputs: Vec<String> = output.into_iter().collect();
        // Every reading is answered, also after an interruption: what is lost is then lost by the transport.
        let keys = "backlog = 64\nqueries = \"off\"";
        let readings = Sine { rate_hz: row.rate_hz, ..self.readings };
        let scene = readings.scene(ACTUATOR, "bench.twin".as_ref(), keys, &outputs);
        let settings = format!(
            "[realtime]\nbusy_poll = {}\nstay_awake = {}\nprefault = true\n",
            row.wake == WakeUp::BusyPoll,
            row.wake == WakeUp::EventAwake
        );
        Ok((self.testbed.write("scene.toml", scene)?, self.testbed.write("twin.toml", settings)?))
    }
}
