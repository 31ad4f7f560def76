//! Stamps of another machine's clock, on ours.

/// How long a smallest delay counts: two clocks drift apart by less than 2 ms meanwhile (50 ppm).
const WINDOW_NS: u64 = 30_000_000_000;

/// Brings a sender's monotonic stamps onto the local clock: `t = t_sender + min(arrival - t_sender)` over the last 30 to 60
/// seconds. The smallest delay stands for the distance of the clocks, so the fastest reading counts as taken when it
/// arrived and a late one as old as it is late. No reading is younger than its arrival, and the order of the stamps stays
/// what the sender made it, also where a better measure of the distance arrives.
#[derive(Debug, Default)]
pub struct SenderClock {
    boot_id: u64,
    newest_sender_ns: u64,
    newest_local_ns: u64,
    window_ends_ns: u64,
    previous: Option<i128>,
    current: Option<i128>,
}

impl SenderClock {
    /// The local time of a stamp, ns. `O(1)`.
    pub fn local_ns(&mut self, boot_id: u64, t_sender_ns: u64, t_arrival_ns: u64) -> u64 {
        if boot_id != self.boot_id || self.current.is_none() {
            *self = Self { boot_id, ..Self::default() };
            self.window_ends_ns = t_arrival_ns.saturating_add(WINDOW_NS);
        }
        if t_arrival_ns >= self.window_ends_ns {
            (self.previous, self.current) = (self.current, None);
            self.window_ends_ns = t_arrival_ns.saturating_add(WINDOW_NS);
        }
        let distance = i128::from(t_arrival_ns) - i128::from(t_sender_ns);
        let current = self.current.map_or(distance, |smallest| smallest.min(distance));
        self.current = Some(current);
        let smallest = self.previous.map_or(current, |previous| previous.min(current));
        let local_ns = u64::try_from(i128::from(t_sender_ns) + smallest).unwrap_or(0);
        self.in_order(t_sender_ns, local_ns)
    }

    fn in_order(&mut self, t_sender_ns: u64, local_ns: u64) -> u64 {
        if t_sender_ns < self.newest_sender_ns {
            return local_ns.min(self.newest_local_ns.saturating_sub(1));
        }
        self.newest_sender_ns = t_sender_ns;
        self.newest_local_ns = self.newest_local_ns.max(local_ns);
        self.newest_local_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn a_late_reading_is_as_old_as_it_is_late() {
        let mut clock = SenderClock::default();
        let ours = |t_sender: u64| t_sender + 7_000_000 * MS; // the other machine was started later
        let mut local = |t_sender: u64, delay: u64| clock.local_ns(9, t_sender, ours(t_sender) + delay);
        assert_eq!(local(0, 3 * MS), ours(3 * MS), "the first counts as taken when it came");
        assert_eq!(local(10 * MS, MS), ours(11 * MS), "a faster one is the better measure");
        assert_eq!(local(20 * MS, 501 * MS), ours(21 * MS), "500 ms late");
        assert_eq!(local(15 * MS, 510 * MS), ours(16 * MS), "backwards stays backwards");
    }

    #[test]
    fn a_better_measure_of_the_distance_does_not_turn_the_order() {
        let mut clock = SenderClock::default();
        let first = clock.local_ns(1, 0, 5 * MS);
        let second = clock.local_ns(1, MS, 2 * MS + 5 * MS / 2);
        assert!(second >= first, "{second} before {first}");
        assert!(
            clock.local_ns(1, MS / 2, 6 * MS) < second,
            "what the sender turned round stays turned round"
        );
    }

    #[test]
    fn clocks_that_drift_stay_together() {
        let mut clock = SenderClock::default();
        for second in 0..3600u64 {
            let t_sender = second * 1000 * MS;
            let drifted = t_sender + t_sender / 20_000 + MS; // 50 ppm, 1 ms on the way
            let local = clock.local_ns(1, t_sender, drifted);
            assert!(
                local <= drifted && drifted - local <= 3 * MS,
                "after {second} s: {} ns",
                drifted - local
            );
        }
    }

    #[test]
    fn another_run_of_the_sender_begins_anew_and_no_stamp_overflows() {
        let mut clock = SenderClock::default();
        assert_eq!(clock.local_ns(1, u64::MAX, 5), 5);
        assert!(clock.local_ns(1, 0, 6) < 5, "older than this machine's clock");
        assert_eq!(clock.local_ns(2, 0, u64::MAX), u64::MAX);
    }
}
