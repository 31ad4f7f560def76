//! Reads shared memory into the hub while there are viewers.

use crate::catalogue::Catalogue;
use crate::frame::FrameHead;
use crate::grasp::Grasps;
use crate::hub::Hub;
use crate::readings::Reading;
use anyhow::{Context, Result};
use page::frame::{bits, encode};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use wire::{
    Bus, Domain, EstimateReader, FieldHeader, FieldReader, KeyExpr, State, StateReader, Topic, TopicKind,
    Waking,
};

/// Frames at most this often: a screen's rate.
const TICK: Duration = Duration::from_millis(16);
/// Time between two searches for new topics.
const SCAN_INTERVAL: Duration = Duration::from_secs(1);
/// The node set that viewers prefer.
const SURFACE: &str = "surface";

/// Source and destination of the readings.
pub struct Reader {
    /// Domain of the twins.
    pub domain: Domain,
    /// Which topics.
    pub key: KeyExpr,
    /// Known models.
    pub catalogue: Arc<Catalogue>,
    /// Receives the frames.
    pub hub: Arc<Hub>,
}

/// The ports of one actuator and what was last seen on them.
struct ActuatorPorts {
    field: Option<FieldReader>,
    state: Option<StateReader>,
    estimate: Option<EstimateReader>,
    last_state: Option<State>,
    head: FrameHead,
    pace: Pace,
    /// Model and node places of the last field, looked up again when its header changes.
    mesh: Option<([u8; 16], Option<FieldMesh>)>,
}

/// Model and the places of a field's nodes on its skin.
type FieldMesh = (usize, Vec<u32>);

/// Readings a second, from sequence numbers about a second apart.
struct Pace {
    since: Instant,
    seq: u64,
}

impl Reader {
    /// Reads until `stop` is set. Ports exist only while there are viewers, so that a twin without viewers has one reader
    /// less.
    ///
    /// # Errors
    /// The shared-memory domain cannot be joined.
    pub fn run(self, stop: &AtomicBool) -> Result<()> {
        let bus = Bus::open(&self.domain).context("cannot join the shared-memory domain")?;
        let (mut sources, mut grasps, mut warned) = (BTreeMap::new(), Grasps::default(), BTreeSet::new());
        let mut scanned: Option<Instant> = None;
        while !stop.load(Ordering::Relaxed) {
            std::thread::sleep(TICK);
            if self.hub.viewers() == 0 {
                if !sources.is_empty() {
                    sources.clear();
                    grasps.clear();
                    self.hub.clear();
                }
                scanned = None;
                continue;
            }
            if scanned.is_none_or(|at| at.elapsed() > SCAN_INTERVAL) {
                self.open_new_topics(&bus, &mut sources, &mut grasps, &mut warned);
                scanned = Some(Instant::now());
            }
            grasps.update(&self.hub);
            for (actuator, source) in &mut sources {
                if let Err(error) = source.update(actuator, &self.catalogue, &self.hub) {
                    tracing::warn!("{actuator}: reading failed; the topic is opened again: {error}");
                    (source.field, source.state, source.estimate) = (None, None, None);
                }
            }
        }
        Ok(())
    }

    /// Opens ports of new topics: of the fields the surface, else all nodes, else any node set.
    /// A topic that cannot be opened is skipped and tried again; `warned` has those that were logged.
    fn open_new_topics(
        &self,
        bus: &Bus,
        sources: &mut BTreeMap<String, ActuatorPorts>,
        grasps: &mut Grasps,
        warned: &mut BTreeSet<String>,
    ) {
        let topics = bus.topics(&self.key).unwrap_or_else(|error| {
            tracing::warn!("topics cannot be listed: {error}");
            Vec::new()
        });
        let rank = |topic: &Topic| match topic.node_set() {
            Some(SURFACE) => 0,
            None => 1,
            Some(_) => 2,
        };
        let mut live: Vec<Topic> =
            topics.into_iter().filter(|info| !info.writers.is_empty()).map(|info| info.topic).collect();
        live.sort_by_key(rank);
        for topic in live {
            let opened = match topic.kind() {
                TopicKind::Field | TopicKind::State | TopicKind::Estimate => {
                    let source = sources.entry(topic.actuator().to_owned());
                    source.or_insert_with(|| ActuatorPorts::new(topic.actuator())).open(bus, &topic)
                }
                TopicKind::Grasp => grasps.open(bus, &topic),
                TopicKind::Sensor | TopicKind::Health | TopicKind::Command => Ok(()),
                TopicKind::Setpoint | TopicKind::Override | TopicKind::Target | TopicKind::Valve => Ok(()),
            };
            if let Err(error) = opened
                && warned.insert(topic.name().to_owned())
            {
                tracing::warn!("not shown (topic {} of these): {error}", warned.len());
            }
        }
    }
}

impl ActuatorPorts {
    fn new(actuator: &str) -> Self {
        Self {
            field: None,
            state: None,
            estimate: None,
            last_state: None,
            head: FrameHead::empty(actuator),
            pace: Pace { since: Instant::now(), seq: 0 },
            mesh: None,
        }
    }

    /// Opens without wake-ups: this thread reads at a fixed rate, and wake-ups would cost the twin time.
    fn open(&mut self, bus: &Bus, topic: &Topic) -> Result<(), wire::WireError> {
        match topic.kind() {
            TopicKind::Field if self.field.is_none() => {
                self.field = Some(FieldReader::attach_as(bus, topic, Waking::Never)?)
            }
            TopicKind::State if self.state.is_none() => {
                self.state = Some(StateReader::attach_as(bus, topic, Waking::Never)?)
            }
            TopicKind::Estimate if self.estimate.is_none() => {
                self.estimate = Some(EstimateReader::attach_as(bus, topic, Waking::Never)?)
            }
            _ => {}
        }
        Ok(())
    }

    /// Reads all topics: every state, estimate and field's header for the charts; of the newest a frame goes to the hub.
    fn update(&mut self, actuator: &str, catalogue: &Catalogue, hub: &Hub) -> Result<(), wire::WireError> {
        let (mut state, mut sample) = (None, None);
        while let Some(next) = self.state.as_ref().map(StateReader::next).transpose()?.flatten() {
            hub.record(actuator, Reading::of_state(&next));
            state = Some(next);
        }
        if let Some(state) = state {
            self.pace.count(state.seq, &mut self.head);
            self.last_state = Some(state);
        }
        while let Some(next) = self.estimate.as_ref().map(EstimateReader::next).transpose()?.flatten() {
            hub.record(actuator, Reading::of_estimate(&next));
        }
        while let Some(next) = self.field.as_ref().map(FieldReader::next).transpose()?.flatten() {
            hub.record(actuator, Reading::of_field(next.header(), self.state.is_some()));
            sample = Some(next);
        }
        let header = sample.as_ref().map(|sample| *sample.header());
        if let Some((sample, header)) = sample.as_ref().zip(header) {
            if self.state.is_none() {
                self.pace.count(header.seq, &mut self.head);
            }
            let values = self.field_values(&header, sample.values(), catalogue);
            self.add_state();
            hub.put(actuator, encode(&self.head, &[&values]));
        } else if state.is_some() {
            self.add_state();
            self.head.shape.count = 0;
            hub.put(actuator, encode(&self.head, &[]));
        }
        Ok(())
    }

    fn add_state(&mut self) {
        if let Some(state) = &self.last_state {
            self.head.set_state(state);
        }
    }

    /// The header's facts and the numbers to send: of the visible nodes when the model is known, else of all.
    fn field_values(&mut self, header: &FieldHeader, values: &[f32], catalogue: &Catalogue) -> Vec<u32> {
        self.head.set_field(header);
        let set = wire::layout::unpack_name(&header.node_set);
        if self.mesh.as_ref().is_none_or(|(hash, _)| *hash != header.model_hash) {
            let found = catalogue.find(header.model_hash);
            let places = found.and_then(|model| Some((model, catalogue.places(model, &set)?)));
            self.mesh = Some((header.model_hash, places));
        }
        let nodes = (header.node_count as usize).max(1);
        match self.mesh.as_ref().and_then(|(_, mesh)| mesh.as_ref()) {
            Some((model, places)) if places.iter().all(|place| (*place as usize) < nodes) => {
                self.head.shape.model = Some(*model);
                self.head.shape.count = places.len();
                let columns = values.chunks_exact(nodes);
                bits(columns.flat_map(|column| places.iter().map(|place| column[*place as usize])))
            }
            _ => {
                self.head.shape.model = None;
                self.head.shape.count = header.node_count as usize;
                bits(values.iter().copied())
            }
        }
    }
}

impl Pace {
    fn count(&mut self, seq: u64, head: &mut FrameHead) {
        if seq < self.seq || self.seq == 0 {
            *self = Self { since: Instant::now(), seq };
        } else if self.since.elapsed() > Duration::from_secs(1) {
            head.rate_hz = (seq - self.seq) as f64 / self.since.elapsed().as_secs_f64();
            *self = Self { since: Instant::now(), seq };
        }
    }
}
