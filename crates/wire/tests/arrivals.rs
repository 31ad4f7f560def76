//! Counts of samples by their numbers, in whatever order they come.

use proptest::prelude::*;
use std::collections::HashSet;
use wire::{Arrival, Arrivals};

/// Numbers in the order of sending, some lost, repeated or moved back by a few places.
fn disordered() -> impl Strategy<Value = Vec<u64>> {
    prop::collection::vec((0_u8..10, 0_usize..40), 1..400).prop_map(|each| {
        let mut sent: Vec<(usize, u64)> = Vec::new();
        for (seq, (fate, by)) in each.into_iter().enumerate() {
            let number = seq as u64;
            match fate {
                0 => {}
                1 => sent.extend([(seq, number), (seq + by, number)]),
                2 => sent.push((seq + by, number)),
                _ => sent.push((seq, number)),
            }
        }
        sent.sort_by_key(|(at, _)| *at);
        sent.into_iter().map(|(_, number)| number).collect()
    })
}

proptest! {
    #[test]
    fn numbers_are_received_lost_or_repeated_and_nothing_else(came in disordered()) {
        let Some((first, rest)) = came.split_first() else { return Ok(()) };
        let mut arrivals = Arrivals::new(*first);
        let (mut lost, mut repeated, mut old) = (0, 0, 0);
        for seq in rest {
            let arrival = arrivals.take(*seq);
            lost += arrival.lost();
            repeated += i64::from(arrival == Arrival::Repeated);
            old += i64::from(arrival == Arrival::Before);
        }
        let different: HashSet<u64> = came.iter().copied().filter(|seq| seq >= first).collect();
        let sent = (arrivals.newest() - first + 1) as i64;
        prop_assert_eq!(sent, different.len() as i64 + lost);
        prop_assert_eq!(came.len() as i64, different.len() as i64 + repeated + old);
    }
}

#[test]
fn the_window_ends_and_numbers_do_not_overflow() {
    let mut arrivals = Arrivals::new(0);
    assert_eq!(arrivals.take(2000).lost(), 1999);
    assert_eq!((arrivals.take(977), arrivals.take(977)), (Arrival::Late, Arrival::Repeated));
    assert_eq!(arrivals.take(u64::MAX), Arrival::New { missing: u64::MAX - 2001 });
    assert_eq!(arrivals.take(u64::MAX), Arrival::Repeated);
    assert_eq!((arrivals.take(7), arrivals.take(9).lost()), (Arrival::Again, 1), "numbers begin again");
    assert_eq!((arrivals.take(6), arrivals.take(8)), (Arrival::Before, Arrival::Late));
}
