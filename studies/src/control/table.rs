//! The plant's table from a database of a second mesh.

use crate::plant::table::COLUMNS;
use anyhow::Context;
use formats::database::{self, ObstacleKind};
use softtwin::files::{refusal, save};
use std::fmt::Write;
use std::path::Path;

/// The tip of the reference actuator, undeformed, mm.
const TIP_MM: [f64; 3] = control::twin_model::Tip::REFERENCE.at_mm;
/// A tip farther from every node than this is another one's, mm.
const NEAR_MM: f64 = 0.5;

/// Reads force, tip and lowest point of every state of the databases, each of a stiffness (`STIFFNESS=DIR`), and writes them.
pub fn write(databases: &[String], out: &Path) -> anyhow::Result<()> {
    let mut text = format!(
        "# Written by `softtwin-studies control --database STIFFNESS=DIR`; what it means: studies/src/plant/table.rs\n{COLUMNS}\n"
    );
    for named in databases {
        let named = named.split_once('=').and_then(|(stiffness, dir)| Some((stiffness.parse().ok()?, dir)));
        let (stiffness, dir) =
            named.context("--database: expected STIFFNESS=DIR, such as 0.9=target/softer")?;
        add(&mut text, stiffness, Path::new(dir))?;
    }
    save(out, text.as_bytes())
}

fn add(text: &mut String, stiffness: f64, dir: &Path) -> anyhow::Result<()> {
    let database = database::read(dir, ObstacleKind::Plate).map_err(refusal)?;
    let y = database.coordinate(1).context("the database has no coordinate y")?;
    let undeformed = database.undeformed_mm.as_ref().context("the database has no mesh")?;
    let distance = |at: &[f64; 3]| at.iter().zip(TIP_MM).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let tip =
        (0..undeformed.len()).min_by(|a, b| distance(&undeformed[*a]).total_cmp(&distance(&undeformed[*b])));
    let tip = tip.filter(|tip| distance(&undeformed[*tip]) < NEAR_MM).context("no node is at the tip")?;
    for (index, case) in database.cases.iter().enumerate() {
        let heights: Vec<f32> = database.field(index, y).collect();
        let lowest = heights.iter().copied().fold(f32::INFINITY, f32::min);
        let gap = case.gap_mm.map(|gap_mm| gap_mm.to_string()).unwrap_or_default();
        let (pressure, force) = (case.pressure_mpa, case.contact_force_n);
        writeln!(text, "{stiffness},{pressure},{gap},{force:.6},{:.4},{lowest:.4}", heights[tip])?;
    }
    Ok(())
}
