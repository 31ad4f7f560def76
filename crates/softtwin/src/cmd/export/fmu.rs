//! A model as an FMU: description, library and resources in one archive, the same bytes for the same model.

use crate::failure::{configuration, usage};
use crate::{files, report};
use anyhow::{Context, Result};
use fmu::{ChosenNode, IDENTIFIER, MODEL_FILE, NODES_FILE};
use formats::file;
use rom::model::{MAX_MODEL_BYTES, Model};
use rom::probe::model_tip;
use serde_json::json;
use std::collections::BTreeMap;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// Largest library that is packed: 1 GiB.
const MAX_LIBRARY_BYTES: u64 = 1 << 30;

const ABOUT: &str = "<!DOCTYPE html><html><head><meta charset=\"utf-8\"><title>softtwin</title></head><body>
<h1>Digital twin of a soft pneumatic actuator</h1>
<p>Inputs pressure_mpa and gap_mm, parameters of the model; outputs force, its derivatives, onset pressure, half-widths, largest
stress, fields at chosen nodes. domain_status is 0 among the training states, 1 near them, 2 outside; half-widths are NaN unless it is 0.
Each output is computed when it is read.</p>
<p>The binary is for one platform. For another one, compile the crate fmu of softtwin there (cargo build --release -p fmu) and put
the library into binaries/PLATFORM/softtwin with that platform's ending; description and resources are unchanged. The functions are those of
fmi3Functions.h of the FMI standard 3.0; <a href=\"softtwin_fmi3.h\">softtwin_fmi3.h</a> beside this page declares them.</p>
</body></html>
";

/// Reads `NAME=NUMBER`.
pub fn chosen(text: &str) -> Result<ChosenNode, String> {
    let found = text.split_once('=').and_then(|(name, node)| Some((name, node.parse().ok()?)));
    match found {
        Some((name, node)) if !name.is_empty() && !name.contains(char::is_whitespace) => {
            Ok(ChosenNode { name: name.into(), node })
        }
        _ => Err("expected NAME=NUMBER, a node of the model counted from 0".into()),
    }
}

/// Writes the archive.
pub fn write(source: &Path, out: &Path, mut nodes: Vec<ChosenNode>, as_json: bool) -> Result<()> {
    let bytes = file::read_bytes(source, MAX_MODEL_BYTES).map_err(files::refusal)?;
    let place = || source.display().to_string();
    let model = Model::from_bytes(&bytes).with_context(place).map_err(configuration)?;
    if nodes.is_empty() && model.is_measured() {
        let marker = |(name, node): (&String, &u32)| ChosenNode { name: name.clone(), node: *node };
        let sets = model.header.node_sets.iter().filter_map(|set| Some((&set.name, set.nodes.first()?)));
        nodes.extend(sets.map(marker));
    }
    if nodes.is_empty() {
        nodes.extend(model_tip(&model).map(|node| ChosenNode { name: "tip".into(), node: node as u32 }));
    }
    for (index, chosen) in nodes.iter().enumerate() {
        if chosen.node as usize >= model.header.node_count {
            let (name, node, count) = (&chosen.name, chosen.node, model.header.node_count);
            return Err(usage(format!("--node {name}={node}: the model has {count} nodes, numbered from 0")));
        }
        if nodes[..index].iter().any(|other| other.name == chosen.name) {
            return Err(usage(format!("--node {}: expected every name once, found it twice", chosen.name)));
        }
    }
    let library_file = library()?;
    let library = file::read_bytes(&library_file, MAX_LIBRARY_BYTES).map_err(files::refusal)?;
    let binary = format!("binaries/{}-linux/{IDENTIFIER}.so", std::env::consts::ARCH);
    let description = fmu::describe(&model, &nodes, &fmu::token(&bytes, &nodes)).map_err(configuration)?;
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let stored = SimpleFileOptions::default().large_file(bytes.len() > u32::MAX as usize);
    for (name, content) in [
        ("modelDescription.xml", description.as_bytes()),
        (&binary, &library),
        (&format!("resources/{MODEL_FILE}"), &bytes),
        (&format!("resources/{NODES_FILE}"), fmu::nodes_text(&nodes).as_bytes()),
        ("documentation/index.html", ABOUT.as_bytes()),
        ("documentation/softtwin_fmi3.h", fmu::DECLARATIONS.as_bytes()),
    ] {
        archive.start_file(name, stored)?;
        archive.write_all(content)?;
    }
    files::save(out, &archive.finish()?.into_inner())?;
    let nodes: BTreeMap<String, u32> = nodes.into_iter().map(|chosen| (chosen.name, chosen.node)).collect();
    report::print(&json!({ "fmu": out, "library": library_file, "nodes": nodes }), as_json)
}

/// The FMU's library: beside this program, where cargo leaves it, or where the package has it.
fn library() -> Result<PathBuf> {
    let program = std::env::current_exe().context("where this program lies is not known")?;
    let folder = program.parent().context("a program lies in a folder")?;
    let places = ["libfmu.so", "deps/libfmu.so", "../lib/softtwin/libfmu.so"].map(|name| folder.join(name));
    let found = places.iter().find(|place| place.is_file()).cloned();
    found.with_context(|| {
        let all: Vec<String> = places.iter().map(|place| place.display().to_string()).collect();
        let build = "build it with `cargo build --release -p fmu`, or copy libfmu.so beside the program";
        format!("expected the FMU's library at {}, found none; {build}", all.join(" or "))
    })
}
