//! Names of regimes that are a model's own. States carry the regime's number; a twin tells the names beside them, by the model's
//! hash: in the attributes of a service of its own, which is there as long as the twin is, and which readers look up without
//! taking part in it.

use super::service::{self, EventShape, Events};
use crate::bus::Bus;
use crate::error::WireError;
use crate::layout::hex;
use crate::transport::Ipc;
use iceoryx2::prelude::*;
use std::collections::BTreeMap;

/// Names by number, as in `regime` of states, fields and answers.
pub type RegimeNames = BTreeMap<u32, String>;

/// Tells the names of a model's regimes to all programs of the domain while it lives.
#[derive(Debug)]
pub struct ToldRegimes {
    _service: Events,
}

/// Names in one attribute: the transport has room for 8 attributes of 256 bytes, a name has at most 32.
const NAMES_EACH: usize = 4;
/// Between the names of an attribute; not part of any name.
const BETWEEN: char = ',';
/// Twins of one model, in processes of their own; nobody waits for an event.
const SHAPE: EventShape = EventShape { listeners: 1, notifiers: 1, nodes: 64 };

impl ToldRegimes {
    /// Tells the names of a model's regimes. Two twins of one model tell the same.
    ///
    /// # Errors
    /// [`WireError::Open`] for names that do not fit, and the refusals of the transport.
    pub fn tell(bus: &Bus, model_hash: &[u8; 16], names: &RegimeNames) -> Result<Self, WireError> {
        let name = service_name(model_hash);
        let failed = |cause: String| WireError::Open { topic: name.clone(), cause };
        let attributes = attributes(names).map_err(failed)?;
        Ok(Self { _service: service::events_with(bus, &name, SHAPE, &attributes)? })
    }
}

impl Bus {
    /// The names of the regimes of the model of this hash; empty where no running twin of this domain tells any. Reads one
    /// management file and writes none.
    ///
    /// # Errors
    /// [`WireError::List`] when the management files cannot be read.
    pub fn regime_names(&self, model_hash: &[u8; 16]) -> Result<RegimeNames, WireError> {
        let name = service::service_name(&service_name(model_hash))?;
        let found = Ipc::details(&name, &self.places.config, MessagingPattern::Event);
        let found = found.map_err(|error| WireError::List { cause: format!("{error:?}") })?;
        let mut names = RegimeNames::new();
        for attribute in found.iter().flat_map(|details| details.static_details.attributes().iter()) {
            let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
            let (first, list) = (text(attribute.key().as_bytes()), text(attribute.value().as_bytes()));
            // Of another version: its names are not known.
            let Ok(first) = first.parse::<u32>() else { return Ok(RegimeNames::new()) };
            names.extend((first..).zip(list.split(BETWEEN).map(str::to_owned)));
        }
        Ok(names)
    }
}

fn service_name(model_hash: &[u8; 16]) -> String {
    format!("softtwin.regimes.{}", hex(model_hash))
}

/// Runs of names that follow one another, each below the number of its first.
fn attributes(names: &RegimeNames) -> Result<AttributeVerifier, String> {
    let mut attributes = AttributeVerifier::new();
    let numbered: Vec<(&u32, &String)> = names.iter().collect();
    for run in numbered.chunk_by(|a, b| *a.0 + 1 == *b.0).flat_map(|run| run.chunks(NAMES_EACH)) {
        let Some((first, _)) = run.first() else { continue };
        let list: Vec<&str> = run.iter().map(|(_, name)| name.as_str()).collect();
        let key = first.to_string().as_str().try_into().map_err(|error| format!("{error:?}"))?;
        let value =
            list.join(&BETWEEN.to_string()).as_str().try_into().map_err(|error| format!("{error:?}"))?;
        attributes = attributes.require(&key, &value).map_err(|error| error.to_string())?;
    }
    Ok(attributes)
}
