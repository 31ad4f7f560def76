//! Holds a contact force, or a height of the tip, by owning the setpoint of a valve: reads the twin's state, computes with the
//! twin's model, sends setpoints that must be renewed.
#![forbid(unsafe_code)]

use anyhow::Context;
use clap::Parser;
use control::inverse::{Model, Quantity};
use control::law::{Controller, Reading, Settings};
use control::twin_model::{Tip, TwinModel};
use runtime::config::Scene;
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use wire::layout::{flags, pack_name, valve_interlock, valve_reason};
use wire::{
    Bus, Domain, Setpoint, SetpointWriter, State, StateReader, Topic, ValveReader, Wake, WakeSet, Wakeable,
    Waking, boot_id, now_ns,
};

/// Controller: holds a contact force or a height of the tip.
#[derive(Debug, Parser)]
#[command(
    name = "hold_force",
    before_help = "Examples:\n  hold_force --scene config/scenes/force.toml --target-n 0.3\n  \
    hold_force --scene config/scenes/force.toml --tip-mm -40",
    after_help = "`softtwin-studies plant --help` shows all programs of the example, docs/control.md for the law."
)]
struct Args {
    /// Scene of the twin; its model is the controller's.
    #[arg(long, value_name = "FILE")]
    scene: PathBuf,
    /// Actuator; default: the scene's first.
    #[arg(long)]
    actuator: Option<String>,
    /// Force to hold, N.
    #[arg(long, value_name = "N", default_value_t = 0.3)]
    target_n: f64,
    /// Height of the tip to hold instead, mm.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    tip_mm: Option<f64>,
    /// Gap that is assumed while the twin's state shows none, mm.
    #[arg(long, value_name = "MM", default_value_t = 30.0)]
    gap_mm: f64,
    /// Force that must not be passed, N.
    #[arg(long, value_name = "N", default_value_t = 0.6)]
    force_max_n: f64,
    /// Validity of each setpoint, ms.
    #[arg(long, value_name = "MS", default_value_t = 50.0)]
    valid_ms: f64,
    /// The owner's name, by which another one is refused.
    #[arg(long, default_value = "hold_force")]
    owner: String,
    /// Does not use the load cell.
    #[arg(long)]
    no_load_cell: bool,
    /// Ends after this many seconds, or when no state arrives for one second.
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    seconds: f64,
}

/// A state older than this, or none: the pressure is let off.
const SILENCE: Duration = Duration::from_secs(1);
/// Reasons for which the valve does not follow, and the controller waits.
const WAITS: [u32; 4] =
    [valve_reason::OVERRIDE, valve_reason::INTERLOCK, valve_reason::TIMEOUT, valve_reason::DEVICE_ERROR];

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let scene = Scene::load(&args.scene)?;
    let is_meant = |name: &str| args.actuator.as_ref().is_none_or(|meant| meant == name);
    let spec =
        scene.actuators.iter().find(|spec| is_meant(&spec.name)).context("the scene has no such actuator")?;
    let mut model = TwinModel::load(&scene.resolve(&spec.model), Tip::REFERENCE)?;
    let (quantity, target) = args.tip_mm.map_or((Quantity::Force, args.target_n), |mm| (Quantity::Tip, mm));
    let settings = Settings { force_max_n: args.force_max_n, ..Settings::default() };
    let bus = Bus::open(&Domain::from_env())?;
    let states = StateReader::open(&bus, &Topic::state(&spec.name)?)?;
    let gap_mm = states
        .newest()?
        .map_or(args.gap_mm, |state| if state.gap_mm.is_finite() { state.gap_mm } else { args.gap_mm });
    refuse_out_of_reach(&mut model, quantity, target, gap_mm, &settings)?;
    let valves = ValveReader::attach_as(&bus, &Topic::valve(&spec.name)?, Waking::Never)?;
    let writer = SetpointWriter::create_named(&bus, &Topic::setpoint(&spec.name)?, &args.owner)?;
    let mut owner = Owner::new(writer, &args);
    let mut controller = Controller::new(model, quantity, settings);
    let mut wake = WakeSet::new([&states as &dyn Wakeable]);
    let stop = runtime::service::stop_flag().context("cannot listen for signals")?;

    let begin = Instant::now();
    let (mut last, mut followed, mut delays_ns) = (None, f64::NAN, Vec::new());
    let mut valve = None;
    let mut ended = Ok(());
    while begin.elapsed().as_secs_f64() < args.seconds && !stop.load(Ordering::Relaxed) {
        let Some(state) = states.newest()? else {
            if wake.wait(SILENCE)? == Wake::Timeout {
                break;
            }
            continue;
        };
        if state.flags & (flags::NO_DATA | flags::STALE | flags::HELD) != 0 {
            // Substituted readings are ignored: the setpoint expires.
            if state.age_ns > SILENCE.as_nanos() as u64 {
                break;
            }
            continue;
        }
        valve = valves.newest()?.or(valve);
        let status = valve.unwrap_or_default();
        if status.valve_interlock & valve_interlock::FORCE != 0 && status.setpoint_boot_id == owner.boot_id {
            ended = Err(anyhow::anyhow!(
                "the valve has closed: the force was beyond its limit; find out why, then start again"
            ));
            break;
        }
        let dt_s = last.map_or(0.0, |before| state.t_sensor_ns.saturating_sub(before) as f64 * 1e-9).min(0.1);
        last = Some(state.t_sensor_ns);
        let reading = reading(&state, quantity, args.no_load_cell);
        if WAITS.contains(&status.valve_reason) {
            controller.start(reading);
        }
        let turn = controller.update(target, reading, dt_s);
        owner.send(turn.pressure_mpa, state.t_sensor_ns)?;
        delays_ns.push(now_ns().saturating_sub(state.t_sensor_ns));
        followed = turn.followed;
    }
    owner.send(f64::NAN, 0)?; // released, whatever ended it: the pressure is let off
    delays_ns.sort_unstable();
    let report = json!({
        "target": target,
        "followed": followed,
        "setpoints": delays_ns.len(),
        "reading_to_setpoint_us_p50": delays_ns.get(delays_ns.len() / 2).map(|ns| *ns as f64 * 1e-3),
    });
    writeln!(std::io::stdout(), "{report}")?;
    ended
}

/// The state as the controller takes it: the load cell where there is one, the model at the state's pressure otherwise.
fn reading(state: &State, quantity: Quantity, no_load_cell: bool) -> Reading {
    let is_force = quantity == Quantity::Force && !no_load_cell;
    let measured = if is_force { state.measured_force_n } else { f64::NAN };
    Reading { pressure_mpa: state.pressure_mpa, gap_mm: state.gap_mm, measured }
}

/// Nothing moves for a target that the model's pressures do not give.
fn refuse_out_of_reach(
    model: &mut TwinModel,
    quantity: Quantity,
    target: f64,
    gap_mm: f64,
    settings: &Settings,
) -> anyhow::Result<()> {
    let highest_mpa = settings.range_mpa[1].min(model.range_mpa()[1]);
    let ends = [0.0, highest_mpa].map(|pressure_mpa| quantity.of(&model.at(pressure_mpa, gap_mm)).0);
    let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
    let unit = if quantity == Quantity::Force { "N" } else { "mm" };
    anyhow::ensure!(
        (low..=high).contains(&target),
        "{target} {unit} cannot be held at {gap_mm} mm: pressures up to {highest_mpa} MPa give {low:.3} to {high:.3} {unit}"
    );
    Ok(())
}

/// The right to drive the valve, with the numbers of what is sent.
struct Owner {
    writer: SetpointWriter,
    boot_id: u64,
    seq: u64,
    valid_for_ns: u64,
    name: [u8; 32],
}

impl Owner {
    fn new(writer: SetpointWriter, args: &Args) -> Self {
        let valid_for_ns = (args.valid_ms * 1e6) as u64;
        Self { writer, boot_id: boot_id(), seq: 0, valid_for_ns, name: pack_name(&args.owner) }
    }

    fn send(&mut self, pressure_mpa: f64, t_sensor_ns: u64) -> anyhow::Result<()> {
        self.seq += 1;
        let Self { boot_id, seq, valid_for_ns, name: owner, .. } = *self;
        let t_publish_ns = now_ns();
        let setpoint =
            Setpoint { boot_id, seq, t_sensor_ns, t_publish_ns, valid_for_ns, pressure_mpa, owner };
        Ok(self.writer.publish(setpoint)?)
    }
}
