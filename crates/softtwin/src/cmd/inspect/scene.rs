//! `softtwin inspect SCENE.toml`: what a scene will load, how many bytes, and how long a sample takes, measured here and now.

use crate::failure::configuration;
use crate::output;
use runtime::config::Scene;
use runtime::explain::{Explained, explain};
use runtime::load::load_scene;
use std::path::Path;

/// Prints what each actuator of a scene loads and costs.
pub fn explain_scene(path: &Path, json: bool) -> anyhow::Result<()> {
    let scene = Scene::load(path).map_err(configuration)?;
    let loaded = load_scene(&scene, path).map_err(configuration)?;
    let explained: Vec<Explained> = loaded.iter().map(explain).collect();
    if json {
        return output::json(&explained);
    }
    explained.iter().try_for_each(print)
}

fn print(explained: &Explained) -> anyhow::Result<()> {
    let mb = |bytes: u64| bytes as f64 / 1e6;
    let (min, max) = explained.gap_mm;
    output!(
        "{}: gap {min} .. {max} mm, so regimes: {}",
        explained.actuator,
        explained.regimes.join(" and ")
    )?;
    for input in &explained.inputs {
        output!("  input {input}")?;
    }
    output!(
        "  reads {:.2} MB of the model's {:.2} MB ({} blocks)",
        mb(explained.read_bytes),
        mb(explained.file_block_bytes),
        explained.blocks
    )?;
    output!("  state: {:.2} us a reading (coefficients, force, gradients, half-widths)", explained.state_us)?;
    for output in &explained.outputs {
        output!(
            "  {}: {} nodes x {} ({}), {:.2} us a sample, basis {:.2} MB (at most {:.2} read for a sample), sample {:.3} MB, {:.1} MB reserved in /dev/shm",
            output.topic,
            output.nodes,
            output.fields.len(),
            output.fields.join(", "),
            output.us,
            mb(output.basis_bytes),
            mb(output.most_read_bytes),
            mb(output.sample_bytes),
            mb(output.reserved_bytes)
        )?;
    }
    Ok(())
}
