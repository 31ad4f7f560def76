//! Whether the twins use what a bridge sends: they report it in their health.

use runtime::thread_group::StopFlag;
use runtime::wire::{Bus, Domain, Health, HealthReader, Outcome, Topic, WireError, now_ns};
use std::time::{Duration, Instant};

/// Interval of the search for twins.
const SEARCH: Duration = Duration::from_millis(500);
/// Longest wait for the last health, which a twin sends each second.
const LAST: Duration = Duration::from_millis(1500);
/// Time in which a twin takes what was sent to it.
const TAKEN_NS: u64 = 50_000_000;

/// The readings of all actuators.
pub(crate) struct ReadingUse {
    bus: Bus,
    boot_id: u64,
    begin_ns: u64,
    next_search: Instant,
    actuators: Vec<ActuatorUse>,
}

/// The readings of one actuator.
struct ActuatorUse {
    name: String,
    topic: Topic,
    /// Open from the time that there is a twin.
    reader: Option<HealthReader>,
    /// The last one before the bridge's first reading, if it was seen.
    before: Health,
    newest: Option<Health>,
    is_used: bool,
    is_reported: bool,
}

impl ReadingUse {
    /// For the bridge with this run id that sends its first reading after `begin_ns`.
    pub(crate) fn new(
        domain: &Domain,
        boot_id: u64,
        begin_ns: u64,
        names: &[String],
    ) -> Result<Self, WireError> {
        let actuator_use = |name: &String| {
            Ok(ActuatorUse {
                name: name.clone(),
                topic: Topic::health(name)?,
                reader: None,
                before: Health::default(),
                newest: None,
                is_used: false,
                is_reported: false,
            })
        };
        let actuators = names.iter().map(actuator_use).collect::<Result<_, WireError>>()?;
        Ok(Self { bus: Bus::open(domain)?, boot_id, begin_ns, next_search: Instant::now(), actuators })
    }

    /// Takes what the twins report; logs once per actuator that none of its readings could be used.
    pub(crate) fn update(&mut self) {
        let is_search = Instant::now() >= self.next_search;
        if is_search {
            self.next_search = Instant::now() + SEARCH;
        }
        for actuator in &mut self.actuators {
            if actuator.reader.is_none() && is_search {
                actuator.reader = HealthReader::open(&self.bus, &actuator.topic).ok();
            }
            actuator.update(self.boot_id, self.begin_ns);
        }
    }

    /// At the end of the sources: waits for the last health of each twin that used nothing yet. The actuators whose twins used
    /// nothing, if this holds for all that have a twin.
    pub(crate) fn unused(mut self) -> Option<String> {
        let (end, end_ns) = (Instant::now() + LAST, now_ns() + TAKEN_NS);
        let pause = StopFlag::default();
        let waits = |actuator: &ActuatorUse| {
            actuator.reader.is_some() && actuator.newest.is_none_or(|health| health.t_publish_ns < end_ns)
        };
        self.update();
        while Instant::now() < end
            && self.actuators.iter().any(|actuator| !actuator.is_used && waits(actuator))
        {
            pause.pause(Duration::from_millis(10));
            self.update();
        }
        let is_any_used = self.actuators.iter().any(|actuator| actuator.is_used);
        let unused: Vec<&str> = self
            .actuators
            .iter()
            .filter(|actuator| actuator.is_reported)
            .map(|actuator| actuator.name.as_str())
            .collect();
        (!is_any_used && !unused.is_empty()).then(|| unused.join(", "))
    }
}

impl ActuatorUse {
    fn update(&mut self, boot_id: u64, begin_ns: u64) {
        let found = self.reader.as_ref().and_then(|reader| reader.newest().ok().flatten());
        let Some(health) = found else { return };
        self.newest = Some(health);
        if self.is_used {
            return;
        }
        if health.sensor_boot_id != boot_id {
            self.before = health;
            return;
        }
        let before = self.before;
        let since = |outcome: Outcome| health.count(outcome).saturating_sub(before.count(outcome));
        // Those of an earlier bridge may be counted, too, but then the last good reading is older than this actuator.
        if since(Outcome::Published) > 0 && health.t_publish_ns.saturating_sub(health.age_ns) >= begin_ns {
            self.is_used = true;
            return;
        }
        let rejected = Outcome::ALL.iter().copied().filter(|outcome| *outcome != Outcome::Published);
        let worst = rejected.max_by_key(|outcome| since(*outcome));
        let Some(outcome) = worst.filter(|outcome| since(*outcome) > 0 && !self.is_reported) else { return };
        self.is_reported = true;
        tracing::warn!(
            "{}: the twin used no reading so far, {} are {outcome}; compare the source's values and units with the scene \
             (softtwin doctor, softtwin echo {})",
            self.name,
            since(outcome),
            self.topic.name().replace("/health", "/sensor")
        );
    }
}
