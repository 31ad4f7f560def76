//! Waits for samples and conditions, with a deadline.

use crate::PATIENCE;
use std::time::{Duration, Instant};
use wire::layout::flags;
use wire::{Bus, State, StateReader, Topic, WakeSet, Wakeable};

/// Time between two checks of a condition that no event announces.
const POLL: Duration = Duration::from_millis(2);

/// Waits for samples of `reader` until `wanted` returns a value.
///
/// # Panics
/// After [`PATIENCE`].
pub fn wait_for<R: Wakeable, T>(reader: &R, what: &str, mut wanted: impl FnMut(&R) -> Option<T>) -> T {
    let mut wake = WakeSet::new([reader as &dyn Wakeable]);
    let end = Instant::now() + PATIENCE;
    loop {
        if let Some(found) = wanted(reader) {
            return found;
        }
        assert!(Instant::now() < end, "{what} did not come");
        wake.wait(Duration::from_millis(200)).expect("samples can be waited for");
    }
}

/// Polls `look` until it returns a value.
///
/// # Panics
/// After [`PATIENCE`].
pub fn wait_until<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + PATIENCE;
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(Instant::now() < end, "{what} did not come");
        std::thread::sleep(POLL);
    }
}

/// Reader of the finger's states.
///
/// # Panics
/// If the topic does not exist.
pub fn states(bus: &Bus) -> StateReader {
    StateReader::open(bus, &Topic::state("finger").expect("a name")).expect("a state topic")
}

/// Waits for a state that satisfies `wanted`.
///
/// # Panics
/// After [`PATIENCE`].
pub fn wait_state(reader: &StateReader, what: &str, mut wanted: impl FnMut(&State) -> bool) -> State {
    wait_for(reader, what, |reader| {
        while let Some(state) = reader.next().expect("readable") {
            if wanted(&state) {
                return Some(state);
            }
        }
        None
    })
}

/// True if the state results from the newest reading.
pub fn fresh(state: &State) -> bool {
    state.flags & (flags::STALE | flags::HELD | flags::NO_DATA) == 0
}
