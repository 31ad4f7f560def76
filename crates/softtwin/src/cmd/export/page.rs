//! A model as a page that needs nothing but a browser.

use super::is_recording;
use crate::failure::configuration;
use crate::{files, output};
use anyhow::{Context, Result};
use recording::{RecordedState, RecordingData, RecordingFiles};
use rom::session::{Gaps, Session};
use runtime::load::PayloadContents;
use runtime::publish::state_of;
use serde_json::json;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use train::trace::InputTrace;
use viewer::NamedModel;

/// Writes the page.
///
/// # Errors
/// A build without the page's module, a source that is no model, a recording of another model.
pub fn write(model: &Path, recording: Option<&Path>, out: &Path, as_json: bool) -> Result<()> {
    if !viewer::can_save() {
        return Err(configuration(anyhow::anyhow!(
            "this build cannot make pages, because the model's code was not compiled for browsers; \
             `rustup target add wasm32-unknown-unknown && scripts/page.sh`, then build again"
        )));
    }
    let (read, hash) = files::model_and_hash(model)?;
    let named = NamedModel { path: model.into(), model: read, hash };
    let recording = recording.map(|path| recorded(path, &named)).transpose()?;
    let page = viewer::page(named, recording.as_ref())?;
    files::save(out, page.as_bytes())?;
    if as_json {
        return output::json(&json!({ "files": [out], "bytes": page.len() }));
    }
    Ok(output!("{}: {:.1} MB; open it in any browser", out.display(), page.len() as f64 * 1e-6)?)
}

/// What plays in the page: a recording, or the answers of the model along a trace.
fn recorded(path: &Path, named: &NamedModel) -> Result<RecordingData> {
    if is_recording(path) {
        let series = RecordingFiles::open(path).map_err(configuration)?;
        return RecordingData::read(&series, None, &AtomicBool::new(false)).map_err(configuration);
    }
    let NamedModel { model, hash, .. } = named;
    let trace = InputTrace::read(path, model).map_err(configuration)?;
    let mut session = Session::new(model, Gaps::Recorded)?;
    let mut evaluation = session.evaluation();
    let contents = PayloadContents::new(model, session.evaluator())?;
    let mut states = Vec::new();
    for (t_ns, inputs) in trace.rows() {
        session.step(t_ns, inputs, &mut evaluation).with_context(|| path.display().to_string())?;
        let mut values = state_of(&evaluation, &contents);
        values.model_hash.copy_from_slice(&hash[..16]);
        states.push(RecordedState { t_s: 1e-9 * t_ns as f64, values });
    }
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    Ok(RecordingData::of_states(&name, &model.header.actuator, states))
}
