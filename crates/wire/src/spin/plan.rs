//! From when until when to spin for the next expected sample, and what is left of the share of a core.

use super::arrivals::Arrivals;

/// A slower source is not spun for: its next sample is known too badly, and its delay matters less.
const MAX_PERIOD_NS: f64 = 20e6;
/// Longest spin for one sample.
const MAX_SPIN_NS: f64 = 500_000.0;
/// A spin that the share makes shorter than this is over before a sleeper is awake.
const MIN_SPIN_NS: f64 = 20_000.0;
/// A source whose samples deviate more than this share of the spin is not spun for.
const MAX_JITTER: f64 = 0.5;
/// Most of the spin that may lie before the expected time; the rest is for samples that come later.
const MAX_BEFORE: f64 = 0.75;
/// A sample that was there before all was ready for it makes the next spins begin earlier by so much ...
const LATE_STEP_NS: f64 = 32_000.0;
/// ... and any other makes them begin later by so much: one of 256 comes too early.
const READY_STEP_NS: f64 = LATE_STEP_NS / 256.0;

/// What spinning came to so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SpinCounts {
    /// Samples that came while the wait spun for them.
    pub caught: u64,
    /// Samples that were there before the spin that was meant for them.
    pub before: u64,
    /// Spins that ended without a sample.
    pub in_vain: u64,
    /// Time spun, ns.
    pub spun_ns: u64,
}

/// When a sample was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FoundAt {
    /// At the end of a sleep, before the spin that was meant for it.
    Waking,
    /// In a spin, before all was prepared for it.
    Preparing,
    /// In a spin, with nothing left to prepare.
    Spinning,
}

/// A spin that is to come. Times are ns of the monotonic clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Plan {
    pub(super) source: usize,
    /// When the sample is expected.
    expected_ns: u64,
    /// When to be awake.
    pub(super) from_ns: u64,
    /// When to sleep again.
    pub(super) until_ns: u64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Source {
    arrivals: Arrivals,
    /// How long before the expected time the spin begins: what wake-ups were late by, samples early, and preparations long. None: not learned yet,
    /// and as long as it may be.
    before_ns: Option<f64>,
    /// A spin for the expected sample ended without it.
    is_over: bool,
}

/// Predictions of all sources of a wait, and their share of a core.
#[derive(Debug)]
pub(super) struct Planner {
    share: f64,
    sources: Vec<Source>,
    /// Time that may be spun, ns: grows with the time that passes, at most to one longest spin.
    allowed_ns: f64,
    counted_ns: u64,
    pub(super) counts: SpinCounts,
}

impl Planner {
    /// For a number of sources; `share` of a core at most.
    pub(super) fn new(sources: usize, share: f64) -> Self {
        let sources = vec![Source::default(); sources];
        Self { share, sources, allowed_ns: 0.0, counted_ns: 0, counts: SpinCounts::default() }
    }

    /// The next spin, if one helps and the share allows it.
    pub(super) fn next(&mut self, now_ns: u64) -> Option<Plan> {
        let passed_ns = now_ns.saturating_sub(std::mem::replace(&mut self.counted_ns, now_ns));
        self.allowed_ns = (self.allowed_ns + self.share * passed_ns as f64).min(MAX_SPIN_NS);
        let (share, allowed_ns) = (self.share, self.allowed_ns);
        let plans = self.sources.iter().enumerate().filter_map(|(at, source)| source.plan(at, share));
        let open = plans.filter(|plan| {
            let left_ns = plan.until_ns.saturating_sub(now_ns.max(plan.from_ns)) as f64;
            let then_allowed_ns = allowed_ns + share * plan.from_ns.saturating_sub(now_ns) as f64;
            left_ns > 0.0 && left_ns <= then_allowed_ns
        });
        open.min_by_key(|plan| plan.from_ns)
    }

    /// A spin ended: it counts, whatever it came to.
    pub(super) fn spun(&mut self, from_ns: u64, to_ns: u64) {
        let spun_ns = to_ns.saturating_sub(from_ns);
        self.counts.spun_ns += spun_ns;
        self.allowed_ns -= spun_ns as f64;
    }

    /// The spin ended without a sample: until one comes, none is expected.
    pub(super) fn in_vain(&mut self, plan: &Plan) {
        self.counts.in_vain += 1;
        if let Some(source) = self.sources.get_mut(plan.source) {
            source.is_over = true;
        }
    }

    /// A sample came, before or while the wait spun for `plan`.
    pub(super) fn arrived(&mut self, source: usize, now_ns: u64, plan: Option<&Plan>, found_at: FoundAt) {
        let share = self.share;
        let Some(found) = self.sources.get_mut(source) else { return };
        if let Some(plan) = plan.filter(|plan| plan.source == source) {
            let step_ns = if found_at == FoundAt::Spinning { -READY_STEP_NS } else { LATE_STEP_NS };
            let is_before = found_at == FoundAt::Waking;
            let count = if is_before { &mut self.counts.before } else { &mut self.counts.caught };
            *count += 1;
            // A sample long before its time says nothing of wake-ups.
            let longest_ns = found.longest_spin_ns(share);
            if plan.expected_ns.saturating_sub(now_ns) as f64 <= longest_ns {
                let most_ns = MAX_BEFORE * longest_ns;
                found.before_ns = Some((found.before_ns.unwrap_or(most_ns) + step_ns).clamp(0.0, most_ns));
            }
        }
        found.arrivals.arrived(now_ns);
        found.is_over = false;
    }
}

impl Source {
    /// The spin for its next sample, if it has a rhythm that spinning helps.
    fn plan(&self, source: usize, share: f64) -> Option<Plan> {
        let expected_ns = self.arrivals.next_ns().filter(|_| !self.is_over)?;
        let longest_ns = self.longest_spin_ns(share);
        let helps = self.arrivals.period_ns() <= MAX_PERIOD_NS
            && longest_ns >= MIN_SPIN_NS
            && self.arrivals.jitter_ns() <= MAX_JITTER * longest_ns;
        let most_ns = MAX_BEFORE * longest_ns;
        let before_ns = self.before_ns.map_or(most_ns, |before_ns| before_ns.min(most_ns));
        let from_ns = expected_ns.saturating_sub(before_ns as u64);
        let until_ns = from_ns.saturating_add(longest_ns as u64);
        helps.then_some(Plan { source, expected_ns, from_ns, until_ns })
    }

    /// What the share leaves for one sample.
    fn longest_spin_ns(&self, share: f64) -> f64 {
        (share * self.arrivals.period_ns()).min(MAX_SPIN_NS)
    }
}

#[cfg(test)]
#[path = "../../tests/unit/spin_plan.rs"]
mod tests;
