//! Conversion of time stamps of another machine to the local clock.

/// Length of one window of smallest delays, ns: two clocks drift by less than 2 ms meanwhile (50 ppm).
const WINDOW_NS: u64 = 30_000_000_000;

/// Brings a sender's monotonic stamps onto the local clock: `t = t_sender + min(arrival - t_sender)` over the last 30 to 60
/// seconds. The smallest delay estimates the distance of the clocks: the fastest reading is stamped with its arrival, a later one
/// with its delay. No stamp is after the arrival, and stamps keep the sender's order when the estimate changes.
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
#[path = "../tests/unit/clock.rs"]
mod tests;
