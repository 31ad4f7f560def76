//! Times of runs whose wall clock was set, whose machine was started again, whose metadata come late.

use recording::{Item, RunClock, Stamps};
use std::collections::BTreeMap;

fn run(boot: &str, offset_ns: i64) -> Item {
    let entries = [("boot_id", boot.to_owned()), ("wall_minus_monotonic_ns", offset_ns.to_string())];
    let entries = entries.map(|(key, value)| (key.to_owned(), value)).into_iter().collect::<BTreeMap<_, _>>();
    Item::Metadata { name: "softtwin.recording".into(), entries }
}

/// Times of monotonic stamps, and of the same moments by the wall clock, after the first.
fn times(parts: &[(Option<Item>, &[u64])], offsets: &[u64]) -> [Vec<i128>; 2] {
    [Stamps::Monotonic, Stamps::Wall].map(|stamps| {
        let mut clock = RunClock::new(stamps);
        let mut found = Vec::new();
        for ((item, at), offset) in parts.iter().zip(offsets) {
            item.iter().for_each(|item| clock.take(item));
            let offset = if stamps == Stamps::Wall { *offset } else { 0 };
            found.extend(at.iter().map(|t| clock.at(t + offset)));
        }
        found.iter().map(|t| t - found[0]).collect()
    })
}

#[test]
fn a_wall_clock_set_back_between_two_runs_of_one_boot_changes_nothing() {
    let parts: [(Option<Item>, &[u64]); 2] =
        [(Some(run("a", 1_000_000)), &[10, 20, 30]), (Some(run("a", 400_000)), &[50, 60])];
    for found in times(&parts, &[1_000_000, 400_000]) {
        assert_eq!(found, [0, 10, 20, 40, 50]);
    }
}

#[test]
fn a_run_of_another_boot_follows_by_the_wall_clock_and_never_begins_earlier() {
    let forward: [(Option<Item>, &[u64]); 2] =
        [(Some(run("a", 1_000)), &[500, 600]), (Some(run("b", 2_000)), &[10, 20])];
    for found in times(&forward, &[1_000, 2_000]) {
        assert_eq!(found, [0, 100, 510, 520], "1,500, 1,600, 2,010 and 2,020 of the wall clock");
    }
    let back: [(Option<Item>, &[u64]); 2] =
        [(Some(run("a", 1_000)), &[500, 600]), (Some(run("b", 100)), &[10, 20])];
    for found in times(&back, &[1_000, 100]) {
        assert_eq!(found, [0, 100, 100, 110]);
    }
}

#[test]
fn metadata_behind_the_messages_of_their_run_move_none_of_them() {
    let parts: [(Option<Item>, &[u64]); 2] = [(None, &[10, 20]), (Some(run("a", 1_000_000)), &[30, 25])];
    for found in times(&parts, &[1_000_000, 1_000_000]) {
        assert_eq!(found, [0, 10, 20, 15], "within a run times go back as their stamps do");
    }
}
