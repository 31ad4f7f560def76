//! `softtwin top`: a table of all twins.

mod table;

use crate::live::{self, DomainArgs};
use crate::output;
use anyhow::Result;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use table::Known;
use wire::{
    Bus, Estimate, EstimateReader, Grasp, GraspReader, Health, HealthReader, KeyExpr, State, StateReader,
    Topic, TopicKind, WireError, now_ns,
};

const EXAMPLES: &str = "\
Examples:
  softtwin top
  softtwin top --key 'softtwin/left_*/**' --interval-s 0.5
  softtwin top --once --json | jq '.[] | select(.alive | not)'

RATE readings a second, P50/P99 time from sensor stamp to publication in microseconds, AGE of the newest good reading, \
HELD/DROP readings held and dropped since the start; below a twin the values of its model's parameters with the force's gradient by each, \
and its estimates and alarm. A twin that has published nothing for 3 s is marked `gone`.";

/// Watch all twins: rate, latency, age, regime, force, flags, faults.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Which twins, as a key expression
    #[arg(long, value_name = "KEY", default_value = "softtwin/**")]
    key: String,
    /// Time between two updates (0.05 to 3600)
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0, value_parser = crate::range::number(0.05, 3600.0))]
    interval_s: f64,
    /// Show the table once and end; also done when the output is no terminal
    #[arg(long)]
    once: bool,
    /// JSON instead of a table: one array an update
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

/// How long the first table waits for the health of every twin.
const FIRST_HEALTH: Duration = Duration::from_millis(1_200);
/// Time between two tries meanwhile.
const FIRST_INTERVAL: Duration = Duration::from_millis(50);

/// Latest data of one twin.
struct Twin {
    states: StateReader,
    healths: HealthReader,
    state: Option<State>,
    /// Key of the state topic.
    health: Option<Health>,
}

/// All twins and grasps seen so far.
#[derive(Default)]
struct TopicScan {
    twins: BTreeMap<String, Twin>,
    /// Twins by actuator.
    estimates: BTreeMap<String, (EstimateReader, Option<Estimate>)>,
    /// Bridges by scene.
    grasps: BTreeMap<String, (GraspReader, Option<Grasp>)>,
    /// Actuators and scenes with topics of another version, and what is different.
    skipped: BTreeMap<String, WireError>,
}

impl Args {
    /// Shows the table until a signal, or once.
    ///
    /// # Errors
    /// An invalid key expression; shared memory cannot be joined.
    pub fn run(self) -> Result<()> {
        let key = live::key(&self.key)?;
        let stop = runtime::service::stop_flag()?;
        let bus = self.domain.join()?;
        let mut scan = TopicScan::default();
        let is_live = !self.once && std::io::stdout().is_terminal();
        let first = Instant::now();
        loop {
            scan.update(&bus, &key)?;
            // A twin publishes its health once a second, so a single table waits for it.
            let is_incomplete = scan.twins.values().any(|twin| twin.health.is_none());
            let waits = !is_live && is_incomplete && first.elapsed() < FIRST_HEALTH;
            if !waits {
                self.show(&scan, is_live)?;
            }
            if stop.load(Ordering::Relaxed) || !(is_live || waits) {
                return Ok(());
            }
            std::thread::sleep(if waits { FIRST_INTERVAL } else { Duration::from_secs_f64(self.interval_s) });
        }
    }

    fn show<'a>(&self, scan: &'a TopicScan, is_live: bool) -> Result<()> {
        let TopicScan { twins, estimates, grasps, skipped } = scan;
        let now = now_ns();
        let known = |name: &String, twin: &'a Twin| Known {
            state: twin.state.as_ref(),
            health: twin.health.as_ref(),
            estimate: estimates.get(name).and_then(|(_, last)| last.as_ref()),
        };
        if self.json {
            let all: Vec<Value> =
                twins.iter().map(|(name, twin)| table::json(name, known(name, twin), now)).collect();
            return output::json(&all);
        }
        let clear_screen = if is_live { "\x1b[H\x1b[2J" } else { "" };
        output!("{clear_screen}{}", table::head())?;
        for (name, twin) in twins {
            output!("{}", table::row(name, known(name, twin), now))?;
            if let Some(parameters) = twin.state.as_ref().and_then(table::parameter_row) {
                output!("{parameters}")?;
            }
            if let Some(estimate) = known(name, twin).estimate {
                output!("{}", table::estimate_row(estimate))?;
            }
        }
        for (scene, (_, grasp)) in grasps {
            if let Some(grasp) = grasp {
                output!("{}", table::grasp_row(scene, grasp))?;
            }
        }
        for (name, error) in skipped {
            output!("{name:<14.14} not shown: {error}")?;
        }
        if twins.is_empty() && skipped.is_empty() {
            output!("no running twin matches {}; is `softtwind twin` running?", self.key)?;
        }
        Ok(())
    }
}

impl TopicScan {
    /// Finds new twins and reads what is new of the known ones.
    fn update(&mut self, bus: &Bus, key: &KeyExpr) -> Result<()> {
        for topic in bus.names(key)? {
            match self.add(bus, &topic) {
                Err(error @ WireError::Incompatible { .. }) => {
                    self.skipped.insert(topic.actuator().to_owned(), error);
                }
                added => added?,
            }
        }
        Ok(self.read()?)
    }

    /// Opens what is new of an actuator or a scene.
    fn add(&mut self, bus: &Bus, topic: &Topic) -> Result<(), WireError> {
        let name = topic.actuator();
        let is_twin = matches!(topic.kind(), TopicKind::State | TopicKind::Health);
        if is_twin && !self.twins.contains_key(name) {
            self.twins.insert(name.to_owned(), Twin::attach(bus, name)?);
        }
        if topic.kind() == TopicKind::Estimate && !self.estimates.contains_key(name) {
            self.estimates.insert(name.to_owned(), (EstimateReader::attach(bus, topic)?, None));
        }
        if topic.kind() == TopicKind::Grasp && !self.grasps.contains_key(name) {
            self.grasps.insert(name.to_owned(), (GraspReader::attach(bus, topic)?, None));
        }
        Ok(())
    }

    fn read(&mut self) -> Result<(), WireError> {
        for (reader, grasp) in self.grasps.values_mut() {
            *grasp = reader.newest()?.or(*grasp);
        }
        for (reader, estimate) in self.estimates.values_mut() {
            *estimate = reader.newest()?.or(*estimate);
        }
        for twin in self.twins.values_mut() {
            twin.state = twin.states.newest()?.or(twin.state);
            twin.health = twin.healths.newest()?.or(twin.health);
        }
        Ok(())
    }
}

impl Twin {
    fn attach(bus: &Bus, name: &str) -> Result<Self, WireError> {
        let states = StateReader::attach(bus, &Topic::state(name)?)?;
        let healths = HealthReader::attach(bus, &Topic::health(name)?)?;
        Ok(Self { states, healths, state: None, health: None })
    }
}
