//! When the next sample of a source comes: period and phase of its last arrivals.

/// Regular arrivals after which a prediction is made.
const CONFIRMED: u32 = 8;
/// Arrivals over which the least squares reach at most: later ones follow the last of them, so that a drift is followed.
const REACH: u32 = 14;
/// An arrival this share of a period beside its prediction does not belong to the rhythm.
const BESIDE: f64 = 0.25;
/// One arrival that does not belong weighs as much as so many that do ...
const BESIDE_WEIGHT: u32 = 4;
/// ... and this weight, three of them in a row, ends a rhythm.
const MAX_BESIDE: u32 = 12;
/// Over more periods without an arrival the phase is lost: the period is not known well enough to count them.
const MAX_GAP: f64 = 16.0;
/// Share of a new deviation in the mean one.
const NEWEST: f64 = 0.125;

/// The rhythm of one source's arrivals. All times are ns of the monotonic clock.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Arrivals {
    /// The last arrival as the rhythm has it.
    phase_ns: u64,
    /// The last arrival as it was; 0: none yet.
    last_ns: u64,
    period_ns: f64,
    /// Mean deviation of an arrival from its prediction.
    jitter_ns: f64,
    /// Arrivals in the rhythm, from 1; stops counting where nothing depends on more.
    count: u32,
    /// Weight of those that were not in it.
    beside: u32,
}

impl Arrivals {
    /// A sample came.
    pub(super) fn arrived(&mut self, now_ns: u64) {
        let since_last_ns = now_ns.saturating_sub(self.last_ns) as f64;
        if self.last_ns == 0 {
            return self.restart(now_ns, 0.0);
        }
        // Samples that waited together came together.
        if since_last_ns < BESIDE * self.period_ns {
            return;
        }
        self.last_ns = now_ns;
        match self.count {
            1 => self.adjust(now_ns, 1.0),
            _ => self.compare(now_ns, since_last_ns),
        }
    }

    /// When the next sample comes, if the source has a rhythm.
    pub(super) fn next_ns(&self) -> Option<u64> {
        (self.count >= CONFIRMED).then(|| self.phase_ns.saturating_add(self.period_ns as u64))
    }

    /// Time between two samples, ns.
    pub(super) fn period_ns(&self) -> f64 {
        self.period_ns
    }

    /// Mean deviation of an arrival from its prediction, ns.
    pub(super) fn jitter_ns(&self) -> f64 {
        self.jitter_ns
    }

    /// An arrival after at least two others: one of the rhythm, after a gap or without, or one beside it.
    fn compare(&mut self, now_ns: u64, since_last_ns: f64) {
        let since_phase_ns = now_ns.saturating_sub(self.phase_ns) as f64;
        let periods = (since_phase_ns / self.period_ns).round().max(1.0);
        let deviation_ns = (since_phase_ns - periods * self.period_ns).abs();
        let is_beside = deviation_ns > BESIDE * self.period_ns;
        let is_gap = periods > 1.0;
        if self.count < CONFIRMED && (is_beside || is_gap) {
            return self.restart(now_ns, since_last_ns);
        }
        if periods > MAX_GAP {
            return self.restart(now_ns, self.period_ns);
        }
        if is_beside {
            self.beside += BESIDE_WEIGHT;
            if self.beside >= MAX_BESIDE {
                return self.restart(now_ns, since_last_ns);
            }
            self.jitter_ns += NEWEST * (deviation_ns - self.jitter_ns);
            // The rhythm goes on as if nothing had come: to the last time at which something was to come.
            self.phase_ns += ((since_phase_ns / self.period_ns).floor() * self.period_ns) as u64;
            return;
        }
        if is_gap {
            self.count = CONFIRMED / 2; // seen again some times before it is relied on
        }
        self.adjust(now_ns, periods);
    }

    /// Moves phase and period by the deviation: least squares over the arrivals so far, as a recursion.
    fn adjust(&mut self, now_ns: u64, periods: f64) {
        self.count = (self.count + 1).min(REACH);
        let n = f64::from(self.count);
        let (phase_gain, period_gain) = (2.0 * (2.0 * n - 1.0) / (n * (n + 1.0)), 6.0 / (n * (n + 1.0)));
        let step_ns = periods * self.period_ns;
        let deviation_ns = now_ns.saturating_sub(self.phase_ns) as f64 - step_ns;
        self.phase_ns = self.phase_ns.saturating_add((step_ns + phase_gain * deviation_ns) as u64);
        self.period_ns += period_gain * deviation_ns / periods;
        if self.count > 2 {
            self.jitter_ns += NEWEST * (deviation_ns.abs() - self.jitter_ns);
        }
        self.beside = self.beside.saturating_sub(1);
    }

    /// Begins anew with an arrival and a period; 0: none is known.
    fn restart(&mut self, now_ns: u64, period_ns: f64) {
        let count = if period_ns > 0.0 { 2 } else { 1 };
        *self = Self { phase_ns: now_ns, last_ns: now_ns, period_ns, jitter_ns: 0.0, count, beside: 0 };
    }
}

#[cfg(test)]
#[path = "../../tests/unit/spin_arrivals.rs"]
mod tests;
