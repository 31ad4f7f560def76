//! A page that needs no server: viewer, model, and what computes it, in one HTML file.

use crate::catalogue::{Catalogue, NamedModel, Stand};
use crate::player::Strip;
use crate::server::{COLOURS, PARTS, SCRIPT};
use anyhow::{Context, Result};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use recording::{RecordedState, RecordingData, Track};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;

/// `crates/page`, compiled to WebAssembly; empty in a build without it.
const MODULE: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/page.wasm"));

/// States of a recording that a page keeps.
const MAX_STATES: usize = 1500;

/// What a page has in itself.
#[derive(Serialize)]
struct Embedded {
    colours: String,
    module: String,
    model: String,
    recording: Option<Recorded>,
}

/// A recording in a page.
#[derive(Serialize)]
struct Recorded {
    name: String,
    duration_s: f64,
    tracks: Vec<RecordedTrack>,
}

#[derive(Serialize)]
struct RecordedTrack {
    #[serde(flatten)]
    strip: Strip,
    /// Inputs of the states of the strip, by key.
    inputs: BTreeMap<String, Vec<f64>>,
}

/// True if this build can make pages.
pub fn can_save() -> bool {
    !MODULE.is_empty()
}

/// The page of a model over its visible nodes, with a recording that plays in it.
///
/// # Errors
/// A model without a surface, or one that cannot predict; a recording without states of it.
pub fn page(named: NamedModel, recording: Option<&RecordingData>) -> Result<String> {
    let hash = named.hash;
    let catalogue = Catalogue::new(std::slice::from_ref(&named), Stand::default())?;
    let visible = catalogue.visible(0);
    anyhow::ensure!(
        !visible.is_empty(),
        "{}: expected a model with a surface, which a page can draw; found nodes alone",
        named.path.display()
    );
    let part = named.model.at_nodes(visible)?;
    let name = named.path.file_stem().unwrap_or_default().to_string_lossy();
    let mut model = Vec::new();
    model.extend((name.len() as u32).to_le_bytes());
    model.extend((visible.len() as u32).to_le_bytes());
    model.extend(name.as_bytes());
    model.extend(visible.iter().flat_map(|node| node.to_le_bytes()));
    model.extend(part.to_bytes()?);
    let recording = recording.map(|data| recorded(data, &catalogue, hash)).transpose()?;
    let embedded = Embedded {
        colours: STANDARD.encode(&*COLOURS),
        module: packed(MODULE)?,
        model: packed(&model)?,
        recording,
    };
    // In a script element only `</script` would end the text.
    let embedded = serde_json::to_string(&embedded)?.replace("</", "<\\/");
    let content = |name: &str| {
        let found = PARTS.iter().find(|(path, ..)| *path == name);
        found.map(|(.., content)| *content).with_context(|| format!("the viewer has no {name}"))
    };
    let style = content("/app.css")?;
    let script = bundle()?;
    Ok(content("/")?
        .replace(r#"<link rel="stylesheet" href="app.css">"#, &format!("<style>\n{style}</style>"))
        .replace(r#"<script type="module" src="main.js"></script>"#, "")
        .replace("<title>softtwin view</title>", &format!("<title>{name}, softtwin</title>"))
        .replace(
            "</body>",
            &format!(
                "<script id=\"embedded\" type=\"application/json\">{embedded}</script>\n<script type=\"module\">\n{script}</script>\n</body>"
            ),
        ))
}

/// Compressed, as text.
fn packed(bytes: &[u8]) -> Result<String> {
    let mut packer = GzEncoder::new(Vec::new(), Compression::best());
    packer.write_all(bytes)?;
    Ok(STANDARD.encode(packer.finish()?))
}

fn recorded(data: &RecordingData, catalogue: &Catalogue, hash: [u8; 32]) -> Result<Recorded> {
    let is_of_model = |track: &&Track| {
        let hashes = track.states.last().map(|state| state.values.model_hash);
        hashes.is_some_and(|found| hash.starts_with(&found))
    };
    let of_model = data.tracks.iter().filter(|(_, track)| is_of_model(track));
    let tracks: Vec<RecordedTrack> = of_model
        .map(|(name, track)| {
            let states: Vec<&RecordedState> = track.thinned(MAX_STATES).collect();
            let specs = catalogue.inputs(0);
            let values = states.iter().map(|state| state.inputs(specs));
            let values: Vec<_> = values.map(|inputs| inputs.map(|inputs| *inputs.values())).collect();
            let column =
                |index: usize| values.iter().map(|row| row.map_or(f64::NAN, |row| row[index])).collect();
            let inputs = specs.iter().enumerate().map(|(index, spec)| (spec.key(), column(index))).collect();
            RecordedTrack { strip: Strip::new(name, track, catalogue), inputs }
        })
        .collect();
    anyhow::ensure!(
        !tracks.is_empty(),
        "{}: expected states of this model, found those of others; give the model that the twin ran",
        data.name
    );
    Ok(Recorded { name: data.name.clone(), duration_s: data.duration_s, tracks })
}

/// The scripts as one: each part becomes a function that returns what it exports, after those that it imports.
fn bundle() -> Result<String> {
    let mut out = String::new();
    add(&mut out, &mut BTreeSet::new(), "main.js")?;
    Ok(out)
}

fn add(out: &mut String, added: &mut BTreeSet<&'static str>, name: &str) -> Result<()> {
    let found = PARTS.iter().find(|(path, kind, _)| *kind == SCRIPT && path.strip_prefix('/') == Some(name));
    let (path, _, content) = *found.with_context(|| format!("the viewer has no {name}"))?;
    if !added.insert(path) {
        return Ok(());
    }
    let is_main = name == "main.js";
    let (mut body, mut exports) = (String::new(), Vec::new());
    for line in content.lines() {
        if let Some((names, from)) = imported(line) {
            add(out, added, from)?;
            body += &format!("const {names} = {};\n", variable(from));
            continue;
        }
        let plain = line.strip_prefix("export ").unwrap_or(line);
        if plain.len() < line.len() {
            exports.push(declared(plain).with_context(|| format!("{name}: no name in {line:?}"))?);
        }
        body += plain;
        body.push('\n');
    }
    *out += &if is_main {
        body
    } else {
        format!("const {} = (() => {{\n{body}return {{ {} }};\n}})();\n", variable(name), exports.join(", "))
    };
    Ok(())
}

/// Names in braces and file of `import { A, B } from "./part.js";`.
fn imported(line: &str) -> Option<(&str, &str)> {
    let (names, from) = line.strip_prefix("import ")?.split_once(" from \"./")?;
    Some((names, from.strip_suffix("\";")?))
}

/// Name that a declaration declares.
fn declared(line: &str) -> Option<&str> {
    let words = ["async function ", "function ", "class ", "const "];
    let rest = words.iter().find_map(|word| line.strip_prefix(word))?;
    rest.split(|c: char| !c.is_alphanumeric() && c != '_').next()
}

fn variable(file: &str) -> String {
    format!("part_{}", file.trim_end_matches(".js"))
}

#[cfg(test)]
#[path = "../tests/unit/saved.rs"]
mod tests;
