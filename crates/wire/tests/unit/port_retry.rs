//! Tests of `src/port/retry.rs` that need its private parts.

use super::*;
use crate::Domain;
use tempfile::TempDir;

/// A folder of its own: domains in one folder share the start lock.
fn places_in(folder: &TempDir) -> Places {
    Domain::of(Some("retry"), Some(folder.path().display().to_string())).places().unwrap()
}

fn full() -> Refusal {
    Refusal::Full(WireError::TooManyPrograms { name: "topic".into(), limit: 1 })
}

/// Of two programs that start at once after a kill, one removes what the dead program left, and the other finds nothing to remove.
#[test]
fn a_place_that_another_program_has_freed_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let places = places_in(&folder);
    let mut tries = 0;
    let taken = within(&places, "topic", || {
        tries += 1;
        if tries == 1 { Err(full()) } else { Ok(tries) }
    });
    assert_eq!(taken.unwrap(), 2);
}

#[test]
fn a_place_that_is_taken_by_the_living_is_refused_at_the_second_try() {
    let folder = tempfile::tempdir().unwrap();
    let places = places_in(&folder);
    let mut tries = 0;
    let refused: Result<(), _> = within(&places, "topic", || {
        tries += 1;
        Err(full())
    });
    assert!(matches!(refused, Err(WireError::TooManyPrograms { .. })));
    assert_eq!(tries, 2);
}

/// While others create resources nothing can be removed: whether a place is that of a dead program stays open, and is asked again.
#[test]
fn a_full_place_is_tried_again_while_nothing_can_be_removed() {
    let folder = tempfile::tempdir().unwrap();
    let places = places_in(&folder);
    let creating = places.lock_to_create(FLUX_TIMEOUT).unwrap();
    let mut tries = 0;
    let taken = within(&places, "topic", || {
        tries += 1;
        if tries < 4 { Err(full()) } else { Ok(tries) }
    });
    assert!(creating.is_some());
    assert_eq!(taken.unwrap(), 4);
}
