//! `softtwin top`: all twins at a glance.

use crate::failure::usage;
use crate::live::DomainArgs;
use crate::output;
use anyhow::Result;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use wire::layout::{flags, grasp_status, regime};
use wire::{
    Bus, Grasp, GraspReader, Health, HealthReader, KeyExpr, Outcome, State, StateReader, Topic, TopicKind,
    now_ns,
};

const EXAMPLES: &str = "\
Examples:
  softtwin top
  softtwin top --key 'softtwin/left_*/**' --interval-s 0.5
  softtwin top --once --json | jq '.[] | select(.alive | not)'

RATE readings a second, P50/P99 sensor stamp to sent in microseconds, AGE of the newest good reading, HELD/DROP readings held
and dropped since the start. A twin that has not been heard of for 3 s is marked `gone`.";

/// Watch all twins: rate, latency, age, regime, force, flags, faults.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Which twins, as a key expression
    #[arg(long, value_name = "KEY", default_value = "softtwin/**")]
    key: String,
    /// Time between two looks
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0)]
    interval_s: f64,
    /// Look once and end (this is also what happens when the output is no terminal)
    #[arg(long)]
    once: bool,
    /// JSON instead of a table: one array a look
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

/// Health comes once a second; after so long without, the twin is gone.
const GONE_NS: u64 = 3_000_000_000;
/// How long a first look waits for a state or health of every twin.
const FIRST_LOOK: Duration = Duration::from_millis(1_200);

/// What is known of one twin.
struct Watched {
    states: StateReader,
    healths: HealthReader,
    state: Option<State>,
    health: Option<Health>,
}

/// All that is watched.
#[derive(Default)]
struct Watch {
    twins: BTreeMap<String, Watched>,
    /// By scene.
    grasps: BTreeMap<String, (GraspReader, Option<Grasp>)>,
}

impl Args {
    /// Shows until a signal, or once.
    ///
    /// # Errors
    /// A wrong key expression, a domain that cannot be joined.
    pub fn run(self) -> Result<()> {
        let key = KeyExpr::new(&self.key).map_err(usage)?;
        if !(self.interval_s > 0.0 && self.interval_s < 1e6) {
            return Err(usage(format!("--interval-s: expected a number above 0, found {}", self.interval_s)));
        }
        let stop = runtime::service::stop_flag()?;
        let bus = self.domain.join()?;
        let mut watch = Watch::default();
        let is_live = !self.once && std::io::stdout().is_terminal();
        let first = Instant::now();
        loop {
            look(&bus, &key, &mut watch)?;
            // The newest state is there at once; health comes once a second, so a single look waits for it.
            let waiting =
                watch.twins.values().any(|twin| twin.health.is_none()) && first.elapsed() < FIRST_LOOK;
            if is_live || !waiting {
                self.show(&watch, is_live)?;
            }
            if stop.load(Ordering::Relaxed) || (!is_live && !waiting) {
                return Ok(());
            }
            let pause =
                if is_live { Duration::from_secs_f64(self.interval_s) } else { Duration::from_millis(50) };
            std::thread::sleep(pause);
        }
    }

    fn show(&self, Watch { twins, grasps }: &Watch, is_live: bool) -> Result<()> {
        let now = now_ns();
        if self.json {
            let all: Vec<Value> = twins.iter().map(|(name, twin)| as_json(name, twin, now)).collect();
            return output::json(&all);
        }
        if is_live {
            output!("\x1b[H\x1b[2J{}", head())?;
        } else {
            output!("{}", head())?;
        }
        for (name, twin) in twins {
            output!("{}", row(name, twin.state.as_ref(), twin.health.as_ref(), now))?;
        }
        for (scene, grasp) in grasps.iter().filter_map(|(scene, (_, grasp))| Some((scene, (*grasp)?))) {
            output!("{}", grasp_row(scene, &grasp))?;
        }
        if twins.is_empty() {
            output!("no twin in this domain matches {}; is `softtwind twin` running?", self.key)?;
        }
        Ok(())
    }
}

/// Finds new twins, reads what is new of the known ones.
fn look(bus: &Bus, key: &KeyExpr, Watch { twins, grasps }: &mut Watch) -> Result<()> {
    for topic in bus.names(key)? {
        let name = topic.actuator();
        let is_twin = matches!(topic.kind(), TopicKind::State | TopicKind::Health);
        if is_twin && !twins.contains_key(name) {
            let states = StateReader::attach(bus, &Topic::state(name)?)?;
            let healths = HealthReader::attach(bus, &Topic::health(name)?)?;
            twins.insert(name.to_owned(), Watched { states, healths, state: None, health: None });
        }
        if topic.kind() == TopicKind::Grasp && !grasps.contains_key(name) {
            grasps.insert(name.to_owned(), (GraspReader::attach(bus, &topic)?, None));
        }
    }
    for (reader, grasp) in grasps.values_mut() {
        *grasp = reader.newest()?.or(*grasp);
    }
    for twin in twins.values_mut() {
        twin.state = twin.states.newest()?.or(twin.state);
        twin.health = twin.healths.newest()?.or(twin.health);
    }
    Ok(())
}

fn head() -> String {
    format!(
        "{:<14}{:>7}{:>7}{:>8}{:>8} {:<8}{:>8}{:>8}  {}",
        "ACTUATOR", "RATE", "P50us", "P99us", "AGE", "REGIME", "P/MPa", "F/N", "FLAGS, HELD/DROP"
    )
}

/// One line of the table; 80 columns for a healthy twin.
fn row(name: &str, state: Option<&State>, health: Option<&Health>, now: u64) -> String {
    let heard_ns =
        state.map_or(0, |state| state.t_publish_ns).max(health.map_or(0, |health| health.t_publish_ns));
    let number = |value: Option<f64>, digits: usize| match value {
        Some(value) if value.is_finite() => format!("{value:.digits$}"),
        _ => "-".into(),
    };
    let micros = |ns: Option<u64>| number(ns.map(|ns| ns as f64 * 1e-3), 0);
    let mut notes: Vec<String> =
        flags::names(state.map_or(0, |state| state.flags)).map(str::to_owned).collect();
    if now.saturating_sub(heard_ns) > GONE_NS {
        notes.insert(0, "gone".into());
    }
    let (held, dropped) = health.map_or((0, 0), faults);
    if held + dropped > 0 {
        notes.push(format!("{held}/{dropped}"));
    }
    let age_ns =
        state.filter(|state| state.t_sensor_ns > 0).map(|state| now.saturating_sub(state.t_sensor_ns));
    format!(
        "{name:<14.14}{:>7}{:>7}{:>8}{:>8} {:<8}{:>8}{:>8}  {}",
        number(health.map(|health| health.rate_hz), 0),
        micros(health.map(|health| health.latency_p50_ns)),
        micros(health.map(|health| health.latency_p99_ns)),
        age_ns.map_or("-".into(), age),
        regime::as_str(state.map_or(regime::UNKNOWN, |state| state.regime)),
        number(state.map(|state| state.pressure_mpa), 4),
        number(state.map(|state| state.contact_force_n), 3),
        notes.join(" ")
    )
}

/// One line for a grasp, below the fingers.
fn grasp_row(scene: &str, grasp: &Grasp) -> String {
    format!(
        "{scene:<14.14} grasp: {}, {:.3} of {:.3} N a finger, first held at {:.4} MPa",
        grasp_status::as_str(grasp.verdict),
        grasp.least_force_n,
        grasp.needed_force_n,
        grasp.stop_pressure_mpa
    )
}

/// Readings held and dropped since the start; superseded ones are the ordinary fate of a burst.
fn faults(health: &Health) -> (u64, u64) {
    let sum =
        |pick: fn(&Outcome) -> bool| Outcome::ALL.iter().filter(|o| pick(o)).map(|o| health.count(*o)).sum();
    (
        sum(|outcome| outcome.is_held()),
        sum(|outcome| outcome.is_dropped() && *outcome != Outcome::DroppedSuperseded),
    )
}

/// A time span in the unit that fits.
fn age(ns: u64) -> String {
    match ns {
        0..10_000_000 => format!("{:.1}ms", ns as f64 * 1e-6),
        10_000_000..10_000_000_000 => format!("{}ms", ns / 1_000_000),
        _ => format!("{}s", ns / 1_000_000_000),
    }
}

fn as_json(name: &str, twin: &Watched, now: u64) -> Value {
    let (state, health) = (twin.state.as_ref(), twin.health.as_ref());
    let heard_ns =
        state.map_or(0, |state| state.t_publish_ns).max(health.map_or(0, |health| health.t_publish_ns));
    let outcomes: BTreeMap<&str, u64> = health
        .iter()
        .flat_map(|health| Outcome::ALL.iter().map(|o| (o.as_str(), health.count(*o))))
        .collect();
    json!({
        "actuator": name,
        "alive": now.saturating_sub(heard_ns) <= GONE_NS,
        "rate_hz": health.map(|health| health.rate_hz),
        "latency_p50_us": health.map(|health| health.latency_p50_ns as f64 * 1e-3),
        "latency_p99_us": health.map(|health| health.latency_p99_ns as f64 * 1e-3),
        "age_ms": state.map(|state| now.saturating_sub(state.t_sensor_ns) as f64 * 1e-6),
        "regime": state.map(|state| regime::as_str(state.regime)),
        "pressure_mpa": state.map(|state| state.pressure_mpa),
        "gap_mm": state.map(|state| state.gap_mm),
        "contact_force_n": state.map(|state| state.contact_force_n),
        "flags": flags::names(state.map_or(0, |state| state.flags)).collect::<Vec<_>>(),
        "received": health.map(|health| health.received),
        "missed": health.map(|health| health.missed),
        "outcomes": outcomes,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> State {
        State {
            t_sensor_ns: 1_000_000_000,
            t_publish_ns: 1_000_100_000,
            pressure_mpa: 0.045,
            contact_force_n: 1.25,
            regime: regime::CONTACT,
            flags: 0,
            ..State::default()
        }
    }

    fn health() -> Health {
        let mut health = Health {
            rate_hz: 999.6,
            latency_p50_ns: 61_000,
            latency_p99_ns: 240_400,
            t_publish_ns: 1_000_000_000,
            ..Health::default()
        };
        health.outcomes[Outcome::HeldAbsurd.code() as usize] = 3;
        health.outcomes[Outcome::DroppedDuplicate.code() as usize] = 1;
        health.outcomes[Outcome::DroppedSuperseded.code() as usize] = 50;
        health
    }

    #[test]
    fn a_row_says_what_matters_in_eighty_columns() {
        let row = row("finger", Some(&state()), Some(&health()), 1_001_000_000);
        let cells: Vec<&str> = row.split_whitespace().collect();
        assert_eq!(cells, ["finger", "1000", "61", "240", "1.0ms", "contact", "0.0450", "1.250", "3/1"]);
        assert!(row.len() <= 80 && head().len() <= 90, "{row}");
    }

    #[test]
    fn a_grasp_has_a_row_of_its_own() {
        let grasp = Grasp {
            verdict: grasp_status::HELD,
            least_force_n: 0.5862,
            needed_force_n: 0.4169,
            stop_pressure_mpa: 0.0651,
            ..Grasp::default()
        };
        let row = grasp_row("gripper", &grasp);
        assert_eq!(row, "gripper        grasp: held, 0.586 of 0.417 N a finger, first held at 0.0651 MPa");
    }

    #[test]
    fn a_dead_twin_and_a_stale_state_are_plain() {
        let stale = State { flags: flags::STALE | flags::HELD, ..state() };
        let row = row("finger", Some(&stale), Some(&health()), 60_000_000_000);
        assert!(row.contains("gone stale held 3/1") && row.contains("59s"), "{row}");
    }

    #[test]
    fn a_twin_of_which_nothing_is_known_has_a_row() {
        let row = row("finger", None, None, 60_000_000_000);
        assert!(row.contains("unknown") && row.contains("gone"), "{row}");
    }
}
