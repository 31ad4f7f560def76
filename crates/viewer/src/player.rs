//! Plays a recording into the hub at the recorded pace. All pages show the same time of the recording.

use crate::catalogue::Catalogue;
use crate::frame::FrameHead;
use crate::hub::Hub;
use anyhow::{Context, Result};
use page::frame::{bits, encode};
use recording::{ReadError, RecordedState, RecordingData, RecordingFiles, Track};
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};
use wire::KeyExpr;
use wire::layout::field_id;

/// Frames at most this often: a screen's rate.
const TICK: Duration = Duration::from_millis(16);
/// Points of the strip charts; a screen shows no more.
const MAX_POINTS: usize = 1500;
/// States of which the model is asked for the largest stress: each costs a whole field.
const MAX_SHAPES: usize = 300;

/// Requests from a browser to the player.
#[derive(Debug)]
pub enum Command {
    /// Go to a time, s.
    Seek(f64),
    /// Run or stand still.
    Play(bool),
    /// Open another recording; the name was checked against [`Library::names`].
    Open(String),
}

/// The recordings that pages may choose from: one, or those of one folder. Rotated files are one recording.
#[derive(Clone, Debug)]
pub struct Library {
    recordings: Vec<RecordingFiles>,
}

impl Library {
    /// A recording alone, or all of a folder by name.
    ///
    /// # Errors
    /// A path that is not there, or a folder without recordings.
    pub fn new(path: &Path) -> Result<Self> {
        let place = || format!("cannot read the recording {}", path.display());
        if !path.is_dir() {
            return Ok(Self { recordings: vec![RecordingFiles::open(path).with_context(place)?] });
        }
        let recordings = RecordingFiles::all_in(path).with_context(place)?;
        anyhow::ensure!(
            !recordings.is_empty(),
            "expected recordings (.mcap) in {}, found none",
            path.display()
        );
        Ok(Self { recordings })
    }

    /// Names of the recordings, as pages show them.
    pub fn names(&self) -> Vec<String> {
        self.recordings.iter().map(|recording| recording.name.clone()).collect()
    }

    fn find(&self, name: &str) -> Option<&RecordingFiles> {
        self.recordings.iter().find(|recording| recording.name == name)
    }
}

/// Plays one recording of a library.
pub struct Player {
    library: Library,
    catalogue: Arc<Catalogue>,
    hub: Arc<Hub>,
    data: RecordingData,
    at_s: f64,
    playing: bool,
}

/// Message to browsers when a recording is opened.
#[derive(Serialize)]
struct Opened<'a> {
    r#type: &'static str,
    name: &'a str,
    names: Vec<String>,
    duration_s: f64,
    tracks: Vec<Strip>,
}

/// One actuator's quantities over time, thinned for the strip charts.
#[derive(Serialize)]
pub(crate) struct Strip {
    actuator: String,
    t_s: Vec<f64>,
    pressure_mpa: Vec<f64>,
    contact_force_n: Vec<f64>,
    measured_force_n: Vec<f64>,
    gap_mm: Vec<f64>,
    latency_ms: Vec<f64>,
    stress_t_s: Vec<f64>,
    max_von_mises_mpa: Vec<f64>,
}

impl Player {
    /// Opens the first recording.
    ///
    /// # Errors
    /// Why it cannot be opened.
    pub fn new(
        library: Library,
        catalogue: Arc<Catalogue>,
        hub: Arc<Hub>,
        stop: &AtomicBool,
    ) -> Result<Self, ReadError> {
        let data = read(&library.recordings[0], &catalogue, stop)?;
        data.remarks.iter().for_each(|remark| tracing::warn!("{remark}"));
        let player = Self { library, catalogue, hub, data, at_s: 0.0, playing: true };
        player.announce();
        Ok(player)
    }

    /// Plays until `stop` is set.
    pub fn run(mut self, commands: &Receiver<Command>, stop: &AtomicBool) {
        let mut last = Instant::now();
        let mut shown = None;
        while !stop.load(Ordering::Relaxed) {
            match commands.recv_timeout(TICK) {
                Ok(command) => self.execute(command, stop),
                Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) => {}
            }
            let passed_s = last.elapsed().as_secs_f64();
            last = Instant::now();
            if self.hub.viewers() == 0 {
                continue; // without viewers the recording waits
            }
            if self.playing {
                self.at_s = (self.at_s + passed_s).min(self.data.duration_s);
                self.playing = self.at_s < self.data.duration_s;
            }
            let now = (self.data.name.clone(), self.at_s, self.playing);
            if shown.as_ref() != Some(&now) {
                self.show();
                shown = Some(now);
            }
        }
    }

    fn execute(&mut self, command: Command, stop: &AtomicBool) {
        match command {
            Command::Seek(at_s) => self.at_s = at_s.clamp(0.0, self.data.duration_s),
            Command::Play(playing) => {
                self.playing = playing;
                if playing && self.at_s >= self.data.duration_s {
                    self.at_s = 0.0;
                }
            }
            Command::Open(name) => self.open(&name, stop),
        }
    }

    fn open(&mut self, name: &str, stop: &AtomicBool) {
        let Some(recording) = self.library.find(name) else { return };
        match read(recording, &self.catalogue, stop) {
            Ok(data) => {
                self.hub.clear();
                (self.data, self.at_s, self.playing) = (data, 0.0, true);
                self.announce();
            }
            Err(error) => tracing::warn!("the recording stays closed: {error:#}"),
        }
    }

    fn announce(&self) {
        let strips = self.data.tracks.iter().map(|(name, track)| Strip::new(name, track, &self.catalogue));
        let opened = Opened {
            r#type: "recording",
            name: &self.data.name,
            names: self.library.names(),
            duration_s: self.data.duration_s,
            tracks: strips.collect(),
        };
        self.hub.notify("recording", serde_json::to_string(&opened).unwrap_or_default()); // plain numbers and strings
    }

    /// One frame of every actuator at the present time.
    fn show(&self) {
        for (actuator, track) in &self.data.tracks {
            let mut head = FrameHead::empty(actuator);
            (head.t_s, head.playing) = (self.at_s, self.playing);
            let state = track.state_at(self.at_s);
            let model = state.and_then(|state| self.catalogue.find(state.values.model_hash));
            if let Some(state) = state {
                head.set_state(&state.values);
            }
            let inputs =
                model.zip(state).and_then(|(model, state)| state.inputs(self.catalogue.inputs(model)));
            let message = match model.zip(inputs) {
                Some((model, inputs)) => self.catalogue.replay(model, inputs, head),
                None => Ok(self.recorded_field(track, head)),
            };
            match message {
                Ok(message) => self.hub.put(actuator, message),
                Err(error) => tracing::warn!("{actuator}: a recorded state cannot be shown: {error:#}"),
            }
        }
    }

    /// The field that was recorded, as points; a frame of numbers alone when there is none.
    fn recorded_field(&self, track: &Track, mut head: FrameHead) -> Vec<u8> {
        let Some(field) = track.field_at(self.at_s) else { return encode(&head, &[]) };
        head.shape.fields = field.header.fields().map(field_id::as_str).collect();
        head.shape.count = field.header.node_count as usize;
        encode(&head, &[&bits(field.values.iter().copied())])
    }
}

/// Recorded fields are only needed where no model can make them again.
fn read(
    recording: &RecordingFiles,
    catalogue: &Catalogue,
    stop: &AtomicBool,
) -> Result<RecordingData, ReadError> {
    let data = RecordingData::read(recording, None, stop)?;
    let mut states = data.tracks.values().flat_map(|track| track.states.last());
    let all_known = !data.tracks.values().any(|track| track.states.is_empty())
        && states.all(|state| catalogue.find(state.values.model_hash).is_some());
    if all_known {
        return Ok(data);
    }
    drop(data); // a long recording is not held twice
    RecordingData::read(recording, KeyExpr::new("softtwin/**").ok().as_ref(), stop)
}

impl Strip {
    pub(crate) fn new(actuator: &str, track: &Track, catalogue: &Catalogue) -> Self {
        let column = |value: fn(&RecordedState) -> f64| track.thinned(MAX_POINTS).map(value).collect();
        let stress = |state: &RecordedState| {
            let model = catalogue.find(state.values.model_hash)?;
            let inputs = state.inputs(catalogue.inputs(model))?;
            Some((state.t_s, catalogue.largest_stress_mpa(model, inputs)?))
        };
        let (stress_t_s, max_von_mises_mpa) = track.thinned(MAX_SHAPES).filter_map(stress).unzip();
        Self {
            actuator: actuator.to_owned(),
            t_s: column(|state| state.t_s),
            pressure_mpa: column(|state| state.values.pressure_mpa),
            contact_force_n: column(|state| state.values.contact_force_n),
            measured_force_n: column(|state| state.values.measured_force_n),
            gap_mm: column(|state| state.values.gap_mm),
            latency_ms: column(RecordedState::latency_ms),
            stress_t_s,
            max_von_mises_mpa,
        }
    }
}
