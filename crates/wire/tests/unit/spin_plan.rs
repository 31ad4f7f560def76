//! When to spin: bounds of the share, sources that are not spun for.

use super::*;

const MS: u64 = 1_000_000;
const START: u64 = 5_000_000 * MS;

/// A planner that has seen 50 exact arrivals, and the time right after the last.
fn steady(period_ns: u64, share: f64) -> (Planner, u64) {
    let mut planner = Planner::new(1, share);
    let times = (0..50).map(|k| START + k * period_ns);
    times.for_each(|time| planner.arrived(0, time, None, FoundAt::Waking));
    (planner, START + 49 * period_ns + 1000)
}

#[test]
fn the_first_spin_begins_as_early_as_the_share_allows() {
    let (mut planner, now) = steady(MS, 0.2);
    let plan = planner.next(now).unwrap();
    let expected = START + 50 * MS;
    assert!((expected - 150_000).abs_diff(plan.from_ns) < 100, "{plan:?}");
    assert!((expected + 50_000).abs_diff(plan.until_ns) < 100, "{plan:?}");
}

#[test]
fn rates_that_spinning_does_not_help_have_no_spin() {
    for (period_ns, spins) in
        [(25 * MS, false), (10 * MS, true), (MS, true), (MS / 4, true), (MS / 20, false)]
    {
        let (mut planner, now) = steady(period_ns, 0.2);
        assert_eq!(planner.next(now).is_some(), spins, "{period_ns} ns");
    }
    // At 100 Hz the share would allow 2 ms.
    let (mut planner, now) = steady(10 * MS, 0.2);
    let plan = planner.next(now).unwrap();
    assert!(plan.until_ns - plan.from_ns <= 500_000);
}

#[test]
fn the_spin_begins_later_when_it_catches_and_earlier_when_it_does_not() {
    let (mut planner, mut now) = steady(MS, 0.2);
    let mut before = Vec::new();
    for k in 50..650 {
        let plan = planner.next(now).unwrap();
        before.push(plan.expected_ns - plan.from_ns);
        let arrives = START + k * MS;
        planner.arrived(0, arrives, Some(&plan), FoundAt::Spinning);
        now = arrives + 1000;
    }
    assert!(before[599] + 70_000 < before[0] && before[599] > 60_000, "{} {}", before[0], before[599]);
    let plan = planner.next(now).unwrap();
    planner.arrived(0, START + 650 * MS, Some(&plan), FoundAt::Waking);
    let next = planner.next(START + 650 * MS + 1000).unwrap();
    assert!((next.expected_ns - next.from_ns).abs_diff(before[599] + 32_000) < 500);
    assert_eq!((planner.counts.caught, planner.counts.before), (600, 1));
}

#[test]
fn after_a_spin_in_vain_none_begins_until_a_sample_comes() {
    let (mut planner, now) = steady(MS, 0.2);
    let plan = planner.next(now).unwrap();
    planner.spun(plan.from_ns, plan.until_ns);
    planner.in_vain(&plan);
    assert!((0..100).all(|k| planner.next(plan.until_ns + k * MS).is_none()));
    planner.arrived(0, START + 50 * MS + 60_000, None, FoundAt::Waking);
    assert!(planner.next(START + 50 * MS + 61_000).is_some());
    assert_eq!((planner.counts.in_vain, planner.counts.spun_ns), (1, plan.until_ns - plan.from_ns));
}

#[test]
fn the_earliest_of_several_sources_comes_first() {
    let mut planner = Planner::new(3, 0.2);
    for k in 0..50 {
        planner.arrived(0, START + k * MS, None, FoundAt::Waking);
        planner.arrived(2, START + k * MS + 300_000, None, FoundAt::Waking);
    }
    assert_eq!(planner.next(START + 49 * MS + 310_000).unwrap().source, 0);
    planner.arrived(0, START + 50 * MS, None, FoundAt::Waking);
    assert_eq!(planner.next(START + 50 * MS + 10_000).unwrap().source, 2);
}

/// Whoever spends all that is allowed must wait until there is more.
#[test]
fn what_is_spent_is_not_allowed_again() {
    let (mut planner, mut now) = steady(MS, 0.2);
    let mut spun = 0;
    let begin = now;
    for k in 50..2050 {
        if let Some(plan) = planner.next(now) {
            planner.spun(plan.from_ns, plan.from_ns + 2 * (plan.until_ns - plan.from_ns)); // held up in between
            spun += 2 * (plan.until_ns - plan.from_ns);
        }
        planner.arrived(0, START + k * MS, None, FoundAt::Waking);
        now = START + k * MS + 1000;
    }
    let share = spun as f64 / (now - begin) as f64;
    assert!((0.15..0.201).contains(&share), "{share}");
}

/// Intervals of chance (exponential) have no rhythm.
#[test]
fn an_irregular_source_is_hardly_ever_spun_for() {
    let (mut planner, mut time) = (Planner::new(1, 0.2), START);
    let mut state = 11_u64;
    let mut plans = 0;
    for _ in 0..20_000 {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let chance = (state >> 11) as f64 / (1_u64 << 53) as f64;
        plans += usize::from(planner.next(time).is_some());
        time += (-1e6 * (1.0 - chance).ln()) as u64;
        planner.arrived(0, time, None, FoundAt::Waking);
    }
    assert!(plans < 400, "{plans} of 20000");
}
