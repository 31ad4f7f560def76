//! The viewers' messages of one topic.

use super::geometry::{FOXGLOVE, Look, Shape, frame};
use super::proto::{Proto, descriptors};
use crate::picture::colour::ColourMap;
use crate::view::Catalogue;
use recording::{Channel, Companion, Companions, Schema};
use runtime::config::PlaceSpec;
use std::sync::Arc;
use wire::layout::unpack_name;
use wire::{AnySample, FieldHeader, State, Topic, TopicKind};

/// Model and the places of a field's nodes on its skin.
type Place = (usize, Vec<u32>);
/// Channel and bytes of a message.
type Encoded = (Arc<Channel>, Vec<u8>);

/// Makes viewers' messages: of every state the numbers, of fields `viewer/<actuator>/<set>/points`, `.../surface` (when the
/// model is known) and `.../frame`.
pub struct ViewerMessages {
    /// Known models, and where actuators stand.
    pub catalogue: Arc<Catalogue>,
    /// Least time between two pictures of a topic, ns.
    pub period_ns: u64,
}

/// The numbers of a state that viewers plot.
const NUMBERS: &str = "Numbers pressure_mpa:double gap_mm:double contact_force_n:double force_halfwidth_n:double \
                       onset_pressure_mpa:double domain_distance:double latency_ms:double";

impl ViewerMessages {
    /// What makes the messages of each topic of a recording.
    pub fn companions(self) -> Companions {
        Companions::new(move |topic| self.of(topic))
    }

    /// What makes the messages of a topic; none for one that viewers do not draw.
    pub fn of(&self, topic: &Topic) -> Option<Box<dyn Companion>> {
        let actuator = topic.actuator().to_owned();
        match topic.kind() {
            TopicKind::State => {
                let topic = format!("viewer/{actuator}/numbers");
                Some(Box::new(StateMessages(channel(&topic, "softtwin", "Numbers", NUMBERS))))
            }
            TopicKind::Field => {
                let base = format!("viewer/{actuator}/{}", topic.node_set().unwrap_or("all"));
                let foxglove =
                    |what: &str, name| channel(&format!("{base}/{what}"), "foxglove", name, FOXGLOVE);
                Some(Box::new(FieldMessages {
                    place: self.catalogue.stand().place(&actuator),
                    actuator,
                    catalogue: self.catalogue.clone(),
                    period_ns: self.period_ns,
                    next_ns: 0,
                    colours: ColourMap::stress(),
                    scale_mpa: f32::MIN_POSITIVE,
                    mesh: None,
                    points: foxglove("points", "PointCloud"),
                    surface: foxglove("surface", "SceneUpdate"),
                    frame: foxglove("frame", "FrameTransforms"),
                }))
            }
            _ => None,
        }
    }
}

/// The numbers of every state.
struct StateMessages(Arc<Channel>);

impl Companion for StateMessages {
    fn messages(&mut self, sample: &AnySample, _: u64) -> Vec<Encoded> {
        let AnySample::State(state) = sample else { return Vec::new() };
        vec![(self.0.clone(), numbers(state).finish())]
    }
}

/// Pictures of a field topic, not faster than the viewer wants them.
struct FieldMessages {
    actuator: String,
    place: PlaceSpec,
    catalogue: Arc<Catalogue>,
    period_ns: u64,
    next_ns: u64,
    colours: ColourMap,
    /// The largest stress so far, MPa: the end of the colour scale.
    scale_mpa: f32,
    /// Model and node places of the last field, looked up again when its header changes.
    mesh: Option<([u8; 16], Option<Place>)>,
    points: Arc<Channel>,
    surface: Arc<Channel>,
    frame: Arc<Channel>,
}

impl Companion for FieldMessages {
    fn messages(&mut self, sample: &AnySample, publish_time_ns: u64) -> Vec<Encoded> {
        let AnySample::Field(sample) = sample else { return Vec::new() };
        if publish_time_ns < self.next_ns {
            return Vec::new();
        }
        let header = *sample.header();
        let Some(shape) = Shape::of(&header, sample.values(), self.place) else { return Vec::new() };
        // A whole number of periods after the first picture, so that the rate is kept on average.
        let due_ns = self.next_ns.saturating_add(self.period_ns);
        self.next_ns =
            if due_ns > publish_time_ns { due_ns } else { publish_time_ns.saturating_add(self.period_ns) };
        self.find_mesh(&header);
        self.scale_mpa = self.scale_mpa.max(header.max_von_mises_mpa as f32);
        let (colours, scale_mpa) = (&self.colours, self.scale_mpa);
        let look = Look { frame: &self.actuator, time_ns: publish_time_ns, colours, scale_mpa };
        let mut messages = vec![
            (self.frame.clone(), frame(&self.actuator, self.place, publish_time_ns).finish()),
            (self.points.clone(), shape.points(&look).finish()),
        ];
        if let Some((_, Some((model, places)))) = &self.mesh {
            let surface =
                shape.surface(places, self.catalogue.corners(*model), header.contact_force_n, &look);
            messages.push((self.surface.clone(), surface.finish()));
        }
        messages
    }
}

impl FieldMessages {
    fn find_mesh(&mut self, header: &FieldHeader) {
        if self.mesh.as_ref().is_some_and(|(hash, _)| *hash == header.model_hash) {
            return;
        }
        let found = self.catalogue.find(header.model_hash).and_then(|model| {
            let places = self.catalogue.places(model, &unpack_name(&header.node_set))?;
            let fits = places.iter().all(|place| *place < header.node_count);
            fits.then_some((model, places))
        });
        self.mesh = Some((header.model_hash, found));
    }
}

fn numbers(state: &State) -> Proto {
    let latency_ms = state.t_publish_ns.saturating_sub(state.t_sensor_ns) as f64 * 1e-6;
    let (halfwidth_n, distance) = (state.force_halfwidth_n.into(), state.domain_distance.into());
    let force_n = state.contact_force_n;
    let values = [
        state.pressure_mpa,
        state.gap_mm,
        force_n,
        halfwidth_n,
        state.onset_pressure_mpa,
        distance,
        latency_ms,
    ];
    (1..).zip(values).fold(Proto::default(), |message, (field, value)| message.double(field, value))
}

fn channel(topic: &str, package: &str, name: &str, messages: &str) -> Arc<Channel> {
    let schema = Schema::Protobuf(descriptors(package, messages));
    Arc::new(Channel { topic: topic.to_owned(), schema_name: format!("{package}.{name}"), schema })
}
