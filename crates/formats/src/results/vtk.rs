//! VTU files and ParaView's lists of them (`.pvd`).

use super::run::{NodalQuantity, Run, Step, counted};
use crate::error::{Diagnostic, FormatError};
use crate::{file, vtu};
use quick_xml::Reader;
use quick_xml::events::Event;
use std::collections::HashSet;
use std::path::Path;

/// Reads a single file: one step.
pub(super) fn read(path: &Path) -> Result<Run, FormatError> {
    let content = vtu::read_content(path)?;
    let quantity = |found: vtu::VtuArray| NodalQuantity {
        name: found.name,
        components: counted(found.components),
        values: found.values,
    };
    let quantities = content.point_data.into_iter().map(quantity).collect();
    let step = Step { name: "step 1".into(), time: content.time, quantities };
    Ok(Run {
        points: content.points,
        blocks: content.blocks,
        steps: vec![step],
        left_out: content.left_out,
        ..Run::default()
    })
}

/// Reads all files of a list, which must have one mesh.
pub(super) fn read_series(path: &Path) -> Result<Run, FormatError> {
    let text = file::read_text(path, file::MAX_TEXT_BYTES)?;
    let entries = parse_list(&text).map_err(|diagnostic| FormatError::one(path, diagnostic))?;
    let mut run = Run::default();
    for (index, (time, name)) in entries.into_iter().enumerate() {
        let member = path.with_file_name("").join(name);
        let mut one = read(&member)?;
        if index == 0 {
            (run.points, run.blocks, run.left_out) = (one.points, one.blocks, one.left_out);
        } else if run.points != one.points || run.blocks != one.blocks {
            let expected = "the undeformed mesh of the first file, with the displacement as point data";
            let diagnostic = Diagnostic::new("mesh", expected, "another mesh");
            return Err(FormatError::one(&member, diagnostic));
        }
        for step in &mut one.steps {
            step.name = format!("step {}", index + 1);
            step.time = Some(time);
        }
        run.steps.append(&mut one.steps);
    }
    Ok(run)
}

/// Time and file of every entry of a `.pvd`.
///
/// # Errors
/// Content that is not such a list; several parts at one time.
pub fn parse_list(text: &str) -> Result<Vec<(f64, String)>, Diagnostic> {
    let mut reader = Reader::from_str(text);
    let mut entries: Vec<(f64, String)> = Vec::new();
    let mut times = HashSet::new();
    loop {
        let place = format!("byte {}", reader.buffer_position());
        let event = reader.read_event().map_err(|e| Diagnostic::new(&place, "well-formed XML", e))?;
        let (Event::Start(tag) | Event::Empty(tag)) = &event else {
            if matches!(event, Event::Eof) { break } else { continue }
        };
        if tag.name().as_ref() != b"DataSet" {
            continue;
        }
        let attribute = |name: &str| {
            let value = tag.try_get_attribute(name).ok().flatten()?;
            value.normalized_value(quick_xml::XmlVersion::default()).ok().map(|value| value.trim().to_owned())
        };
        let time = attribute("timestep").and_then(|t| t.parse::<f64>().ok()).filter(|t| t.is_finite());
        let (Some(time), Some(name)) = (time, attribute("file")) else {
            return Err(Diagnostic::new(place, "a DataSet with timestep and file", "one without"));
        };
        // Adding 0 makes -0 the same time as 0.
        if !times.insert((time + 0.0).to_bits()) {
            let expected = "one file per time step (in ParaView: Merge Blocks, then save again)";
            return Err(Diagnostic::new(place, expected, format!("several at time {time}")));
        }
        entries.push((time, name));
    }
    if entries.is_empty() {
        return Err(Diagnostic::new("content", "a .pvd with DataSet entries", "none"));
    }
    Ok(entries)
}
