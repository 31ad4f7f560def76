//! `softtwin setpoint`.

mod target;

use crate::live::{DomainArgs, Owner, text};
use crate::output;
use anyhow::Context;
use runtime::valve::ValveSpec;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use wire::layout::{valve_interlock, valve_reason};
use wire::{Bus, Topic, Valve, ValveReader, WakeSet, Wakeable, WireError};

const EXAMPLES: &str = "\
Examples:
  A new target for `softtwin hold`, in the unit of what it holds: at once, with 0.05 units per second, a value every 0.1 s
    softtwin setpoint finger 0.4
    softtwin setpoint finger 0.4 --rate 0.05
    softtwin setpoint finger 0.1 0.2 0.3 0.2 --interval-s 0.1
  Without a controller: hold 0.03 MPa as the owner of the valve, until Ctrl-C:
    softtwin setpoint finger --pressure 0.03
  The operator's value, whatever setpoint and interlocks say, until it is released:
    softtwin setpoint finger --override --pressure 0.02
    softtwin setpoint finger --release
  A further cavity:
    softtwin setpoint finger --cavity left --pressure 0.01

A release also ends the interlock of a force beyond its limit, for all valves of the actuator, once the force is below it. An override keeps to the valve's range and rate and to nothing else. It ends with --release, or when the bridge ends. \
What the valve does: softtwin echo softtwin/finger/valve";

/// Change what `softtwin hold` holds, drive a valve by hand, or override its owner.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Actuator whose controller or valve is meant.
    actuator: String,
    /// New target of the controller, or the values of a series.
    #[arg(value_name = "VALUE", allow_negative_numbers = true, conflicts_with_all = ["pressure_mpa", "is_override", "release", "cavity"], value_parser = crate::range::number(-1e6, 1e6))]
    values: Vec<f64>,
    /// Speed at which the target is reached from the one before, units per second.
    #[arg(long, value_name = "PER_S", requires = "values", value_parser = crate::range::number(1e-9, 1e9), conflicts_with = "interval_s")]
    rate: Option<f64>,
    /// Time between the values of a series, s.
    #[arg(long, value_name = "S", requires = "values", value_parser = crate::range::number(1e-3, 1e6))]
    interval_s: Option<f64>,
    /// Further cavity, the one of the input `pressure_mpa.NAME`.
    #[arg(long, value_name = "NAME")]
    cavity: Option<String>,
    /// Gauge pressure: MPa, or with a unit (50kPa, 0.5bar, 7psi).
    #[arg(long = "pressure", value_name = "MPA", required_unless_present_any = ["release", "values"], value_parser = crate::range::pressure_mpa)]
    pressure_mpa: Option<f64>,
    /// The operator's value: wins over the owner's setpoint and the interlocks until it is released.
    #[arg(long = "override")]
    is_override: bool,
    /// Release the override and a tripped force limit.
    #[arg(long, conflicts_with_all = ["pressure_mpa", "is_override"])]
    release: bool,
    /// Ends after this number of seconds (without --override).
    #[arg(long, value_name = "S", default_value_t = 3600.0, value_parser = crate::range::number(0.0, 1e9))]
    seconds: f64,
    #[command(flatten)]
    domain: DomainArgs,
}

/// Name of the owner.
const OWNER: &str = "softtwin-setpoint";
/// Validity of a setpoint; it is renewed four times in that time.
const VALID: Duration = Duration::from_millis(200);
/// Longest wait for the bridge to take up an override.
const PATIENCE: Duration = Duration::from_secs(2);

impl Args {
    /// Sends setpoints, or one override.
    pub fn run(self) -> anyhow::Result<()> {
        let bus = self.domain.join()?;
        if !self.values.is_empty() {
            return self.retarget(&bus);
        }
        let valves = match ValveReader::open(&bus, &self.topic(Topic::valve)?) {
            Err(WireError::NoSuchTopic { .. }) => anyhow::bail!(
                "no bridge drives that valve of `{0}`: start `softtwind bridge` with a scene whose actuator `{0}` has [actuator.{1}]",
                self.actuator,
                ValveSpec::key(self.cavity.as_deref())
            ),
            opened => opened?,
        };
        match self.is_override || self.release {
            true => self.operate(&bus, &valves),
            false => self.hold(&bus, &valves),
        }
    }

    fn topic(&self, kind: fn(&str) -> Result<Topic, WireError>) -> Result<Topic, WireError> {
        kind(&self.actuator)?.of_cavity(self.cavity.as_deref())
    }

    /// One override or its release; done when the bridge says that it acts on it.
    fn operate(&self, bus: &Bus, valves: &ValveReader) -> anyhow::Result<()> {
        let mut owner = Owner::new(bus, &self.topic(Topic::operator)?, OWNER, Duration::ZERO)?;
        owner.send(self.pressure_mpa.unwrap_or(f64::NAN), 0)?;
        let is_done = |valve: &Valve| {
            let is_ours =
                valve.valve_reason == valve_reason::OVERRIDE && valve.setpoint_boot_id == owner.boot_id;
            let is_released = valve.valve_reason != valve_reason::OVERRIDE
                && valve.valve_interlock & valve_interlock::FORCE == 0;
            if self.release { is_released } else { is_ours }
        };
        let (mut wake, begin) = (WakeSet::new([valves as &dyn Wakeable]), Instant::now());
        let mut last = None;
        while begin.elapsed() < PATIENCE {
            while let Some(valve) = valves.next()? {
                // One that was sent before is none of the answers.
                if valve.t_publish_ns > owner.sent_ns && is_done(&valve) {
                    output!("{}", text::valve(&valve))?;
                    return Ok(());
                }
                last = Some(valve);
            }
            wake.wait(Duration::from_millis(100))?;
        }
        let last = last.as_ref().map_or("nothing".into(), text::valve);
        anyhow::bail!("the bridge has not taken it up within {} s; it said last: {last}", PATIENCE.as_secs())
    }

    /// Setpoints until a signal, each renewed in time; every change of what the valve does is printed.
    fn hold(&self, bus: &Bus, valves: &ValveReader) -> anyhow::Result<()> {
        let pressure_mpa = self.pressure_mpa.context("--pressure is missing")?;
        let mut owner = Owner::new(bus, &self.topic(Topic::setpoint)?, OWNER, VALID)?;
        let stop = runtime::service::stop_flag().context("cannot listen for signals")?;
        let (begin, mut before) = (Instant::now(), None);
        while !stop.load(Ordering::Relaxed) && begin.elapsed().as_secs_f64() < self.seconds {
            owner.send(pressure_mpa, 0)?;
            while let Some(valve) = valves.next()? {
                let now = (valve.valve_reason, valve.valve_interlock, valve.valve_limit);
                if before.replace(now) != Some(now) {
                    output!("{}", text::valve(&valve))?;
                }
            }
            std::thread::sleep(VALID / 4);
        }
        owner.send(f64::NAN, 0) // released: the valve closes at once
    }
}
