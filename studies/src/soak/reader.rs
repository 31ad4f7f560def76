//! A reader of the soak test: takes states and fields off the wire and verifies each.

use crate::verify::{Counts, Verifier};
use std::time::{Duration, Instant};
use wire::{Bus, Domain, FieldReader, StateReader, Topic, WakeSet, Wakeable};

/// The newest field is verified this often, and every state.
const EVERY: Duration = Duration::from_millis(20);

/// Verifies the samples of an actuator until `end`.
pub fn verify(model: &[u8], domain: &Domain, actuator: &str, end: Instant) -> anyhow::Result<Counts> {
    let mut verifier = Verifier::new(model)?;
    let bus = Bus::open(domain)?;
    let fields = FieldReader::attach(&bus, &Topic::field(actuator, None)?)?;
    let states = StateReader::attach(&bus, &Topic::state(actuator)?)?;
    let mut next = Instant::now();
    let mut wake = WakeSet::new([&states as &dyn Wakeable]);
    while Instant::now() < end {
        wake.wait(EVERY)?;
        while let Some(state) = states.next()? {
            verifier.state(&state);
        }
        if Instant::now() >= next {
            next = Instant::now() + EVERY;
            if let Some(sample) = fields.newest()? {
                verifier.field(&sample);
            }
        }
    }
    Ok(verifier.counts)
}
