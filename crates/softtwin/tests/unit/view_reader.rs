//! Tests of `src/view/reader.rs` that need its private parts.

use super::*;
use crate::view::Hub;
use std::thread;
use wire::layout::{VERSION, regime};
use wire::{RegimeNames, StateWriter, ToldRegimes};

/// The header of the newest frame, as the page reads it.
fn head(hub: &Hub) -> Option<serde_json::Value> {
    let message = hub.newer_than(0).pop()?.message;
    let (length, rest) = message.split_first_chunk::<4>()?;
    serde_json::from_slice(rest.get(..u32::from_le_bytes(*length) as usize)?).ok()
}

/// Frames say the names that a twin tells for the model of the state: after a reload those of the other model.
#[test]
fn frames_say_the_names_of_the_model_that_runs() {
    let domain = Domain::isolated("viewnames");
    let bus = Bus::open(&domain).unwrap();
    let mut writer = StateWriter::create(&bus, &Topic::state("strip").unwrap()).unwrap();
    let names =
        |name: &str| RegimeNames::from([(regime::NAMED1, "rest".into()), (regime::NAMED2, name.into())]);
    let models = [([7; 16], "up"), ([8; 16], "high")];
    let told = models.map(|(model, name)| ToldRegimes::tell(&bus, &model, &names(name)).unwrap());
    let (hub, stop) = (Arc::new(Hub::default()), AtomicBool::new(false));
    let catalogue = Arc::new(Catalogue::new(Vec::new(), Default::default()).unwrap());
    let reader =
        Reader { domain: domain.clone(), key: KeyExpr::new("**").unwrap(), catalogue, hub: hub.clone() };
    let viewer = hub.enter().unwrap();
    let seen = thread::scope(|scope| {
        let running = scope.spawn(|| reader.run(&stop));
        let end = Instant::now() + Duration::from_secs(60);
        let mut is_shown = |model_hash, name: &str| {
            let state =
                State { layout_version: VERSION, regime: regime::NAMED2, model_hash, ..State::default() };
            // A state a turn, until the page has one: its reader comes when it finds the topic.
            while head(&hub).is_none_or(|head| head["regime_name"] != name) {
                if Instant::now() >= end || running.is_finished() {
                    return false;
                }
                writer.publish(state).unwrap();
                thread::yield_now();
            }
            true
        };
        let seen = models.map(|(model, name)| is_shown(model, name));
        stop.store(true, Ordering::Relaxed);
        running.join().unwrap().unwrap();
        seen
    });
    assert_eq!(seen, [true; 2]);
    drop((viewer, told, writer, bus));
    domain.remove_leftovers().unwrap();
}
