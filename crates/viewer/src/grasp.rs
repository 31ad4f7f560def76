//! Grasps, as strings for the browser.

use crate::hub::Hub;
use serde_json::json;
use softtwind::text;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use wire::layout::{grasp_status, unpack_name};
use wire::{Bus, GraspReader, Topic, WireError};

/// A person reads no faster.
const INTERVAL: Duration = Duration::from_millis(100);

/// Readers of all grasps that are there.
#[derive(Default)]
pub struct Grasps {
    readers: BTreeMap<String, GraspReader>,
    notified: Option<Instant>,
}

impl Grasps {
    /// Opens a topic that is new.
    pub fn open(&mut self, bus: &Bus, topic: &Topic) -> Result<(), WireError> {
        if !self.readers.contains_key(topic.name()) {
            self.readers.insert(topic.name().to_owned(), GraspReader::open(bus, topic)?);
        }
        Ok(())
    }

    /// Sends the pages what is new, a few times a second.
    pub fn update(&mut self, hub: &Hub) {
        if self.notified.is_some_and(|at| at.elapsed() < INTERVAL) {
            return;
        }
        self.notified = Some(Instant::now());
        self.readers.retain(|topic, reader| match reader.newest() {
            Ok(Some(grasp)) => {
                let scene = unpack_name(&grasp.scene);
                let status = grasp_status::as_str(grasp.grasp_status);
                let text = text::grasp_forces(&grasp);
                let message = json!({ "type": "grasp", "scene": scene, "status": status, "text": text });
                hub.notify(&scene, message.to_string());
                true
            }
            Ok(None) => true,
            Err(error) => {
                tracing::warn!("{topic}: reading failed; it is opened again: {error}");
                false
            }
        });
    }

    /// Closes the ports, when there are no viewers.
    pub fn clear(&mut self) {
        self.readers.clear();
    }
}
