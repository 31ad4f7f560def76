use super::*;

const SECOND: u64 = 1_000_000_000;

fn event(t_ns: u64, kind: EventKind, value: u64) -> Event {
    Event { t_ns, actuator: 0, kind, value, input: [0; 32] }
}

/// Eight bad readings a second, each with the good one after it, and a kind of its own in between.
#[test]
fn flickering_readings_have_one_line_per_second_and_kind() {
    let mut summary = Summary::default();
    let (mut lines, mut events) = (Vec::new(), 0);
    for at in 0..200 {
        let t_ns = SECOND + at * SECOND / 20;
        for outcome in [Outcome::HeldNotFinite, Outcome::Published] {
            lines.extend(summary.take(event(t_ns, EventKind::Outcome, outcome.code().into())));
            events += 1;
        }
        if at == 50 {
            lines.extend(summary.take(event(t_ns, EventKind::Missed, 3)));
            events += 1;
        }
        lines.extend(summary.due(t_ns));
    }
    lines.extend(summary.due(u64::MAX));
    assert!((20..=23).contains(&lines.len()), "{} lines in 10 s", lines.len());
    assert_eq!(lines.iter().map(|(_, more)| 1 + more).sum::<u64>(), events, "every event is counted");
    assert!(lines.iter().any(|(event, _)| event.kind == EventKind::Missed && event.value == 3));
    assert!(summary.due(u64::MAX).next().is_none());
}

#[test]
fn lost_readings_of_a_second_are_added_up() {
    let mut summary = Summary::default();
    assert_eq!(summary.take(event(0, EventKind::Missed, 1)).unwrap().0.value, 1);
    for count in [2, 3] {
        assert_eq!(summary.take(event(SECOND / 2, EventKind::Missed, count)), None);
    }
    let lines: Vec<(Event, u64)> = summary.due(SECOND).collect();
    assert_eq!(lines, [(event(SECOND / 2, EventKind::Missed, 5), 1)]);
}
