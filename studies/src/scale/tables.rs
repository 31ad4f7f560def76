//! The result of the scale study, and the tables of docs/scale.md.

use super::parts::{ActuatorsRow, Cost, SubscribersRow};
use serde::Serialize;
use softtwin::output;

/// The result.
#[derive(Debug, Serialize)]
pub struct Study {
    /// Cache sizes as the system reports them.
    pub caches: String,
    /// Against nodes, 6 modes per field.
    pub nodes: Vec<NodesRow>,
    /// Against modes, 25,022 nodes.
    pub modes: Vec<ModesRow>,
    /// Against actuators in one thread.
    pub actuators: Vec<ActuatorsRow>,
    /// Against readers of one field topic.
    pub subscribers: Vec<SubscribersRow>,
}

/// One size of mesh.
#[derive(Debug, Serialize)]
pub struct NodesRow {
    /// Nodes.
    pub nodes: usize,
    /// Its cost.
    #[serde(flatten)]
    pub cost: Cost,
    /// Full fields that one core finishes within 1 ms.
    pub actuators_at_1khz: usize,
}

/// One number of modes.
#[derive(Debug, Serialize)]
pub struct ModesRow {
    /// Modes of each field.
    pub modes: usize,
    /// Its cost.
    #[serde(flatten)]
    pub cost: Cost,
}

impl Study {
    /// Prints all tables.
    pub fn print(&self) -> anyhow::Result<()> {
        output!("caches of this core: {}", self.caches)?;
        head(
            "nodes | basis f32 | f32, us | i16, us | f32 GB/s | us a 1000 nodes | actuators a core at 1 kHz",
        )?;
        for NodesRow { nodes, cost, actuators_at_1khz } in &self.nodes {
            let Cost { f32_us, i16_us, gbps, .. } = cost;
            let (size, per_1000) = (bytes(cost.bytes), 1e3 * f32_us / *nodes as f64);
            output!(
                "| {nodes} | {size} | {f32_us:.2} | {i16_us:.2} | {gbps:.1} | {per_1000:.2} | {actuators_at_1khz} |"
            )?;
        }
        head("modes per field | basis f32 | f32, us | i16, us | f32 GB/s")?;
        for ModesRow { modes, cost } in &self.modes {
            let Cost { f32_us, i16_us, gbps, .. } = cost;
            output!("| {modes} | {} | {f32_us:.1} | {i16_us:.1} | {gbps:.1} |", bytes(cost.bytes))?;
        }
        head(
            "actuators in one twin | bases together | full field, us each | tip and force, us each | fraction of a core, tips at 1 kHz",
        )?;
        for row in &self.actuators {
            let ActuatorsRow { actuators, full_us, tip_us, .. } = row;
            let share = *actuators as f64 * tip_us / 10.0;
            output!("| {actuators} | {} | {full_us:.1} | {tip_us:.2} | {share:.1} % |", bytes(row.bytes))?;
        }
        head("subscribers of a full field | loan, us | send and wake, us")?;
        for SubscribersRow { subscribers, loan_us, send_us } in &self.subscribers {
            output!("| {subscribers} | {loan_us:.2} | {send_us:.2} |")?;
        }
        Ok(())
    }
}

/// An empty line and the head of a table of numbers.
fn head(columns: &str) -> anyhow::Result<()> {
    output!("\n| {columns} |")?;
    output!("|{}", " ---: |".repeat(columns.split(" | ").count()))?;
    Ok(())
}

/// Bytes in the unit that reads best.
fn bytes(count: usize) -> String {
    let count = count as f64;
    match count {
        c if c < 1e6 => format!("{:.0} kB", c / 1e3),
        c if c < 1e9 => format!("{:.1} MB", c / 1e6),
        c => format!("{:.2} GB", c / 1e9),
    }
}
