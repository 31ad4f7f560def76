//! The services of each twin: `softtwin/<actuator>/describe`, answered here, and the queries, passed on to a separate thread.

use super::attachment::plain;
use super::config::Ros2;
use super::describe;
use super::names::Names;
use super::question::Question;
use super::questions::Asking;
use super::service::{Announced, Call, Service};
use super::types::TRIGGER;
use crate::link::Link;
use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};
use wire::{AnyReader, AnySample, Bus, State, Topic, TopicInfo, TopicKind, Waking, WireError};

/// Largest number of waiting requests.
const CALLS: usize = 64;
/// Longest wait of a request for the first state of its twin.
const PATIENCE: Duration = Duration::from_secs(2);
/// Time for which states are read after a request, so that repeated requests do not open a reader each.
const LINGER: Duration = Duration::from_secs(5);
/// First entity number of services, above those of publishers and subscriptions.
const FIRST: usize = 20_000;

/// The services of all twins seen so far.
pub struct Services {
    /// Twins, keyed by the actuator's name in ROS.
    twins: BTreeMap<String, Twin>,
    sender: SyncSender<Call<String>>,
    calls: Receiver<Call<String>>,
    waiting: Vec<(Call<String>, Instant)>,
    questions: SyncSender<Call<Asking>>,
}

/// One twin. Its state is read for [`LINGER`] after a request.
struct Twin {
    topic: Topic,
    is_alive: bool,
    read_until: Option<Instant>,
    reader: Option<AnyReader>,
    newest: Option<AnySample>,
    _services: Vec<Service>,
}

impl Services {
    /// No services yet; queries go to `questions`.
    pub fn new(questions: SyncSender<Call<Asking>>) -> Self {
        let (sender, calls) = sync_channel(CALLS);
        Self { twins: BTreeMap::new(), sender, calls, waiting: Vec::new(), questions }
    }

    /// Announces the services of new twins. Those of an ended twin stay and answer with the reason.
    ///
    /// # Errors
    /// When the session is closed.
    pub fn announce(&mut self, link: &Link, names: &Names, found: &[TopicInfo]) -> anyhow::Result<()> {
        self.twins.values_mut().for_each(|twin| twin.is_alive = false);
        let is_alive = |info: &&TopicInfo| info.topic.kind() == TopicKind::State && !info.writers.is_empty();
        for topic in found.iter().filter(is_alive).map(|info| &info.topic) {
            let name = plain(topic.actuator());
            match self.twins.get_mut(&name) {
                Some(twin) => twin.is_alive = true,
                None => {
                    let services = self.declare(link, names, &name, topic.actuator())?;
                    self.twins.insert(name, Twin::new(topic.clone(), services));
                }
            }
        }
        Ok(())
    }

    fn declare(
        &self,
        link: &Link,
        names: &Names,
        name: &str,
        actuator: &str,
    ) -> anyhow::Result<Vec<Service>> {
        let first = FIRST + self.twins.len() * (1 + Question::ALL.len());
        let describe = format!("softtwin/{name}/describe");
        let announced = Announced { number: first, name: &describe, of: TRIGGER };
        let mut services =
            vec![Service::declare(link, names, &announced, name.to_owned(), self.sender.clone())?];
        for (number, question) in (first + 1..).zip(Question::ALL) {
            let (kind, of) = question.service();
            let service = format!("softtwin/{name}/{kind}");
            let announced = Announced { number, name: &service, of };
            let asking = Asking { actuator: actuator.to_owned(), question };
            services.push(Service::declare(link, names, &announced, asking, self.questions.clone())?);
        }
        Ok(services)
    }

    /// True if requests wait for a state.
    pub fn are_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// Sleeps until a request arrives, at most `longest`, then answers all requests whose state is there or that waited too long.
    pub fn serve(&mut self, bus: &Bus, ros: &Ros2, longest: Duration) {
        let arrived = self.calls.recv_timeout(longest);
        let now = Instant::now();
        let capacity = CALLS.saturating_sub(self.waiting.len());
        for call in arrived.into_iter().chain(self.calls.try_iter().take(capacity)) {
            if let Some(twin) = self.twins.get_mut(&call.what) {
                twin.read_until = Some(now + LINGER);
            }
            self.waiting.push((call, now + PATIENCE));
        }
        self.twins.values_mut().for_each(|twin| twin.update(bus, now));
        let twins = &self.twins;
        let is_due = |(call, until): &mut (Call<String>, Instant)| {
            let has_ended = |twin: &Twin| twin.newest.is_some() || !twin.is_alive;
            now >= *until || twins.get(&call.what).is_none_or(has_ended)
        };
        for (call, _) in self.waiting.extract_if(.., is_due) {
            let state = twins.get(&call.what).and_then(Twin::state);
            match describe::answer(&call.request, ros, &call.what, state) {
                Some(message) => call.reply(message),
                None => call.refuse("expected an empty request in little-endian CDR"),
            }
        }
    }
}

impl Twin {
    fn new(topic: Topic, services: Vec<Service>) -> Self {
        Self { topic, is_alive: true, read_until: None, reader: None, newest: None, _services: services }
    }

    fn state(&self) -> Option<&State> {
        match self.newest.as_ref()? {
            AnySample::State(state) => Some(state),
            _ => None,
        }
    }

    /// Takes the newest state after a request; closes the reader otherwise.
    fn update(&mut self, bus: &Bus, now: Instant) {
        if !self.is_alive || self.read_until.is_none_or(|until| now >= until) {
            (self.reader, self.newest) = (None, None);
        } else if let Err(error) = self.read(bus) {
            tracing::warn!("{error}; opening the topic again");
            self.reader = None;
        }
    }

    fn read(&mut self, bus: &Bus) -> Result<(), WireError> {
        let reader = match self.reader.take() {
            Some(reader) => reader,
            None => AnyReader::attach_as(bus, &self.topic, Waking::Never)?,
        };
        if let Some(sample) = reader.newest()? {
            self.newest = Some(sample);
        }
        self.reader = Some(reader);
        Ok(())
    }
}
