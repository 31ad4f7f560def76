//! Bounded retries while others create or remove the same resource.

use super::exhausted;
use crate::WireError;
use crate::leftover::Places;
use std::time::{Duration, Instant};

/// How long to wait for others who create or remove the same topic.
const FLUX_TIMEOUT: Duration = Duration::from_secs(2);
/// How long a program whose place is taken waits for others that are just creating something, to remove leftovers then.
const SWEEP_PATIENCE: Duration = Duration::from_millis(200);
/// Pause between tries; the others need a few hundred microseconds.
const FLUX_PAUSE: Duration = Duration::from_millis(2);

/// Why a try failed.
pub(crate) enum Refusal {
    /// For good.
    Final(WireError),
    /// For good, unless the places that are taken are those of dead programs.
    Full(WireError),
    /// Because another program is creating or removing resources, or died while doing so.
    Passing(String),
}

/// Tries until success, a final refusal, or [`FLUX_TIMEOUT`]. What dead programs left is removed between two tries.
pub(crate) fn within<T>(
    places: &Places,
    name: &str,
    mut attempt: impl FnMut() -> Result<T, Refusal>,
) -> Result<T, WireError> {
    let begin = Instant::now();
    let mut tries = 0;
    loop {
        tries += 1;
        let tried = locked(places, &mut attempt)?;
        let refusal = match tried {
            Ok(done) => return Ok(done),
            Err(Refusal::Final(WireError::NoSuchTopic { topic })) => {
                return Err(WireError::NoSuchTopic { topic });
            }
            Err(refusal) => refusal,
        };
        if let Some(error) = exhausted::named(name, places) {
            return Err(error);
        }
        let over = begin.elapsed() > FLUX_TIMEOUT;
        match refusal {
            Refusal::Final(error) => return Err(error),
            Refusal::Full(error) if over || !places.sweep(SWEEP_PATIENCE).any() => return Err(error),
            Refusal::Passing(cause) if over => {
                return Err(WireError::InFlux { topic: name.into(), tries, cause });
            }
            Refusal::Full(_) => {}
            Refusal::Passing(_) => {
                places.sweep(FLUX_PAUSE);
                std::thread::sleep(FLUX_PAUSE);
            }
        }
    }
}

/// One try under the start lock, which keeps other programs from removing our incomplete resources.
fn locked<T>(
    places: &Places,
    attempt: impl FnOnce() -> Result<T, Refusal>,
) -> Result<Result<T, Refusal>, WireError> {
    let path = || places.lock_path().display().to_string();
    let lock = places.lock_to_create(FLUX_TIMEOUT).map_err(|error| {
        let cause = format!("{}: {error}", path());
        exhausted::named(&path(), places).unwrap_or(WireError::Node { cause })
    })?;
    let waited_ms = FLUX_TIMEOUT.as_millis() as u64;
    let _lock = lock.ok_or_else(|| WireError::StartLocked { path: path(), waited_ms })?;
    Ok(match places.empty_segment() {
        Some(path) => Err(Refusal::Passing(format!(
            "{} has no size: it is being made, or was truncated",
            path.display()
        ))),
        None => attempt(),
    })
}
