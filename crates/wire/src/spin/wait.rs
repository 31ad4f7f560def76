//! The wait: asleep, then spinning, then asleep again.

use super::plan::{FoundAt, Plan, Planner, SpinCounts};
use crate::clock::now_ns;
use crate::error::WireError;
use crate::wake::{Wake, WakeSet, Wakeable};
use std::time::Duration;

/// Waits for samples as a [`WakeSet`] does, and in good time for those that come at a steady rate.
///
/// The wait learns when the next sample of each source comes, sleeps until shortly before, and then looks for it again and
/// again, so that it need not be woken: an idle core takes tens of microseconds for that. It spins for at most a stated share
/// of a core (at 1 kHz and 0.2 at most 200 us for each sample), and not at all where that does not help: for irregular sources,
/// below 50 Hz, on a machine with one processor. Between two looks others that are to run on the core do, the sender among them.
/// Nothing is lost where a prediction fails: the sample then wakes the wait.
///
/// It belongs to one thread, whose timed sleeps it makes exact as long as it lives (`PR_SET_TIMERSLACK`). It allocates nothing after
/// it was made.
#[derive(Debug)]
pub struct SpinWait {
    wake: WakeSet,
    /// Of the readers.
    count: usize,
    /// None: it never spins.
    planner: Option<Planner>,
    exact: Option<ExactSleep>,
    /// A sample was found without its event: that ends a sleep later, and means nothing then.
    has_left_event: bool,
}

/// What a [`SpinWait`] waits for; a closure says which sources have a sample and prepares nothing.
pub trait SpinSources {
    /// Whether a source (by its place among the readers) has a sample.
    fn has_next(&self, source: usize) -> bool;

    /// Awake, shortly before a sample of this source is expected: time to bring into the caches what its answer reads. Called between two
    /// looks with step 0, 1 and so on until it says that nothing is left; a sample that comes meanwhile waits for one step, which is therefore
    /// to take some microseconds only.
    fn prepare(&mut self, _source: usize, _step: usize) -> bool {
        true
    }
}

impl<F: Fn(usize) -> bool> SpinSources for F {
    fn has_next(&self, source: usize) -> bool {
        self(source)
    }
}

/// The clock, and sleep until an event comes or the time is over; simulated in tests.
trait Time {
    fn now_ns(&self) -> u64;
    fn sleep(&mut self, longest: Duration) -> Result<Wake, WireError>;
    /// Between two looks.
    fn pause(&mut self);
}

impl Time for WakeSet {
    fn now_ns(&self) -> u64 {
        now_ns()
    }

    fn sleep(&mut self, longest: Duration) -> Result<Wake, WireError> {
        self.wait(longest)
    }

    /// Whoever else is to run on this core runs: it may be the sender, which a spin would keep from sending. Some 0.5 us where nobody is.
    fn pause(&mut self) {
        std::thread::yield_now();
    }
}

/// A wait that has begun.
struct Waiting<'a, T, S> {
    time: &'a mut T,
    planner: &'a mut Planner,
    count: usize,
    sources: S,
    end_ns: u64,
    has_left_event: &'a mut bool,
}

impl SpinWait {
    /// Largest share of a core; who wants more looks at the readers without a pause.
    pub const MAX_SHARE: f64 = 0.5;

    /// Over `readers`, which are spun for with at most `share` of a core together (0: never; at most [`Self::MAX_SHARE`]).
    pub fn new<'a>(readers: impl IntoIterator<Item = &'a dyn Wakeable>, share: f64) -> Self {
        let mut count = 0;
        let wake = WakeSet::new(readers.into_iter().inspect(|_| count += 1));
        let spins = share > 0.0 && Self::is_possible();
        let planner = spins.then(|| Planner::new(count, share.min(Self::MAX_SHARE)));
        Self { wake, count, planner, exact: None, has_left_event: false }
    }

    /// Waits until one of `sources`, the readers in their order, has a sample, `timeout` is over, or a signal comes. It may also end by an event without a sample: look, then wait again. All samples are to be taken before the next
    /// wait.
    ///
    /// # Errors
    /// As [`WakeSet::wait`].
    pub fn wait(&mut self, timeout: Duration, sources: impl SpinSources) -> Result<Wake, WireError> {
        let Self { wake, count, planner, exact, has_left_event } = self;
        let Some(planner) = planner else { return wake.wait(timeout) };
        exact.get_or_insert_with(ExactSleep::new);
        let end_ns = now_ns().saturating_add(u64::try_from(timeout.as_nanos()).unwrap_or(u64::MAX));
        Waiting { time: wake, planner, count: *count, sources, end_ns, has_left_event }.run()
    }

    /// Whether this machine has the processors for it: on a single one, who spins keeps the sender from sending.
    pub fn is_possible() -> bool {
        processors() > 1
    }

    /// Whether it spins at all.
    pub fn spins(&self) -> bool {
        self.planner.is_some()
    }

    /// What spinning came to so far.
    pub fn counts(&self) -> SpinCounts {
        self.planner.as_ref().map(|planner| planner.counts).unwrap_or_default()
    }
}

impl<T: Time, S: SpinSources> Waiting<'_, T, S> {
    fn run(&mut self) -> Result<Wake, WireError> {
        if self.look(self.time.now_ns(), None, FoundAt::Waking) {
            *self.has_left_event = true;
            return Ok(Wake::Event);
        }
        loop {
            let now = self.time.now_ns();
            let plan = self.planner.next(now).filter(|plan| plan.from_ns < self.end_ns);
            let until_ns = plan.map_or(self.end_ns, |plan| plan.from_ns);
            if until_ns > now || plan.is_none() {
                let woken = self.time.sleep(Duration::from_nanos(until_ns.saturating_sub(now)))?;
                let now = self.time.now_ns();
                if self.look(now, plan.as_ref(), FoundAt::Waking) {
                    *self.has_left_event = woken != Wake::Event;
                    return Ok(Wake::Event);
                }
                match woken {
                    Wake::Timeout => {}
                    Wake::Event if std::mem::take(self.has_left_event) && now < self.end_ns => continue,
                    Wake::Event | Wake::Signal => return Ok(woken),
                }
            }
            let Some(plan) = plan else { return Ok(Wake::Timeout) };
            if self.spin(&plan) {
                *self.has_left_event = true;
                return Ok(Wake::Event);
            }
        }
    }

    /// Looks until a sample comes, or the time to spin or to wait is over. Whether one came.
    fn spin(&mut self, plan: &Plan) -> bool {
        let begin_ns = self.time.now_ns();
        let (mut step, mut found_at) = (0, FoundAt::Preparing);
        loop {
            let is_prepared = found_at == FoundAt::Spinning || self.sources.prepare(plan.source, step);
            step += 1;
            let now = self.time.now_ns();
            let is_found = self.look(now, Some(plan), found_at);
            if is_prepared {
                found_at = FoundAt::Spinning;
            }
            let is_over = now >= plan.until_ns;
            if is_found || is_over || now >= self.end_ns {
                self.planner.spun(begin_ns, now);
                if is_over && !is_found {
                    self.planner.in_vain(plan);
                }
                return is_found;
            }
            self.time.pause();
        }
    }

    /// Whether a sample is there; all that are there have arrived.
    fn look(&mut self, now_ns: u64, plan: Option<&Plan>, found_at: FoundAt) -> bool {
        let mut is_any = false;
        for source in (0..self.count).filter(|source| self.sources.has_next(*source)) {
            self.planner.arrived(source, now_ns, plan, found_at);
            is_any = true;
        }
        is_any
    }
}

/// Timed sleeps of the calling thread end at their time as long as this lives: by default Linux adds up to 50 us. Needs no rights;
/// where it is refused, sleeps end as late as before.
#[derive(Debug)]
struct ExactSleep {
    before_ns: i32,
}

impl ExactSleep {
    fn new() -> Self {
        // SAFETY: takes no pointers.
        let before_ns = unsafe { libc::prctl(libc::PR_GET_TIMERSLACK, 0_u64, 0_u64, 0_u64, 0_u64) };
        set_timer_slack(1);
        Self { before_ns }
    }
}

impl Drop for ExactSleep {
    fn drop(&mut self) {
        // 0, also where it could not be asked: the thread's default.
        set_timer_slack(u64::try_from(self.before_ns).unwrap_or(0));
    }
}

fn set_timer_slack(ns: u64) {
    // SAFETY: takes no pointers.
    let _as_before_otherwise = unsafe { libc::prctl(libc::PR_SET_TIMERSLACK, ns, 0_u64, 0_u64, 0_u64) };
}

/// Processors that run.
fn processors() -> i64 {
    // SAFETY: takes no pointers.
    unsafe { libc::sysconf(libc::_SC_NPROCESSORS_ONLN) }
}

#[cfg(test)]
#[path = "../../tests/unit/spin_wait.rs"]
mod tests;
