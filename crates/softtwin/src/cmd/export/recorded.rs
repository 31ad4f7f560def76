//! States or fields of a recording, read when they are needed: a recording of months is not kept in memory.

use crate::failure::{configuration, usage};
use crate::files;
use anyhow::Result;
use recording::{Messages, ReadError, RecordedField, RecordedState, RecordingFiles};
use rom::inputs::{InputSpec, Inputs};
use std::collections::BTreeSet;
use std::iter::from_fn;
use std::path::Path;
use wire::{FieldHeader, KeyExpr, TopicKind};

/// One actuator's states or fields in a recording.
pub struct Recorded {
    series: RecordingFiles,
    topics: KeyExpr,
    actuator: String,
    every: usize,
    /// Inputs of the model that makes the fields of states; empty for recorded fields.
    inputs: Vec<InputSpec>,
    /// States that stand for a reading, or fields.
    found: usize,
    first_field: Option<FieldHeader>,
}

impl Recorded {
    /// Reads the recording once: which actuators it has, how many states or fields, and whether all fields have one shape.
    ///
    /// # Errors
    /// The file is not a recording, the actuator is not in it, or its fields differ in shape.
    pub fn find(
        path: &Path,
        topics: KeyExpr,
        actuator: Option<&str>,
        model: Option<&[InputSpec]>,
        every: usize,
    ) -> Result<Self> {
        let series = files::recording(path)?;
        let actuator = choose(&series, actuator)?;
        let inputs = model.unwrap_or_default().to_vec();
        let mut found = Self { series, topics, actuator, every, inputs, found: 0, first_field: None };
        if model.is_some() {
            let count = found.all_readings().try_fold(0, |count, one| one.map(|_| count + 1))?;
            found.found = count;
            return Ok(found);
        }
        let shape = |header: &FieldHeader| (header.node_count, header.field_ids);
        let (mut count, mut first) = (0, None);
        for field in found.all_fields() {
            let header = field?.header;
            if shape(first.get_or_insert(header)) != shape(&header) {
                let expected = "expected fields of one topic, found several shapes; choose one with --key (`softtwin export RECORDING --out \
                                tables` lists the topics), or make the fields with --model";
                return Err(usage(expected));
            }
            count += 1;
        }
        (found.found, found.first_field) = (count, first);
        Ok(found)
    }

    /// How many are exported.
    pub fn count(&self) -> usize {
        self.found.div_ceil(self.every)
    }

    pub fn first_field(&self) -> Option<&FieldHeader> {
        self.first_field.as_ref()
    }

    /// Times, s, and inputs of the states that stand for a reading.
    pub fn readings(&self) -> impl Iterator<Item = Result<(f64, Inputs)>> {
        self.all_readings().step_by(self.every)
    }

    pub fn fields(&self) -> impl Iterator<Item = Result<RecordedField>> {
        self.all_fields().step_by(self.every)
    }

    fn all_readings(&self) -> impl Iterator<Item = Result<(f64, Inputs)>> {
        let read = |data: &[u8], t_s| {
            RecordedState::read(data, t_s).and_then(|state| Some((t_s, state.inputs(&self.inputs)?)))
        };
        self.messages(TopicKind::State, read)
    }

    fn all_fields(&self) -> impl Iterator<Item = Result<RecordedField>> {
        self.messages(TopicKind::Field, RecordedField::read)
    }

    /// Results of `read` for each message of the actuator on topics of this kind.
    fn messages<T>(
        &self,
        kind: TopicKind,
        read: impl Fn(&[u8], f64) -> Option<T>,
    ) -> impl Iterator<Item = Result<T>> {
        let (actuator, topics) = (self.actuator.clone(), self.topics.clone());
        let mut messages = Messages::open(&self.series);
        from_fn(move || {
            loop {
                let (topic, t_s, message) = match messages.next_message() {
                    Ok(Some(next)) => next,
                    Ok(None) => return None,
                    Err(error) => return Some(Err(configuration(error))),
                };
                let is_wanted = topic.actuator() == actuator && topic.kind() == kind;
                // States are asked for by their actuator alone, fields by their topic as well.
                if !is_wanted || (kind == TopicKind::Field && !topics.matches(topic.name())) {
                    continue;
                }
                if let Some(value) = read(&message.data, t_s) {
                    return Some(Ok(value));
                }
            }
        })
    }
}

/// The actuator: the one asked for, or the only one with states or fields.
fn choose(series: &RecordingFiles, actuator: Option<&str>) -> Result<String> {
    let mut messages = Messages::open(series);
    let mut names = BTreeSet::new();
    while let Some((topic, ..)) = messages.next_message().map_err(configuration)? {
        if matches!(topic.kind(), TopicKind::State | TopicKind::Field) && !names.contains(topic.actuator()) {
            names.insert(topic.actuator().to_owned());
        }
    }
    if let Some(damage) = messages.damage() {
        tracing::warn!("{damage}");
    }
    let list = || names.iter().cloned().collect::<Vec<_>>().join(", ");
    match (actuator, names.len()) {
        (_, 0) => Err(configuration(ReadError::NoStates { place: series.name.clone() })),
        (Some(name), _) if names.contains(name) => Ok(name.to_owned()),
        (Some(name), _) => Err(usage(format!("--actuator {name}: the recording has {}", list()))),
        (None, 1) => Ok(list()),
        (None, _) => Err(usage(format!("--actuator: which of {}?", list()))),
    }
}
