//! Holds a contact force, or a height of the tip, by owning the setpoint of a valve: reads the twin's state, computes with the
//! twin's model, sends setpoints that must be renewed.
#![forbid(unsafe_code)]

use anyhow::{Context, bail, ensure};
use clap::Parser;
use control::inverse::{Model, Quantity};
use control::law::{Controller, Reading, Settings};
use control::twin_model::{OUT_OF_REACH_MM, Tip, TwinModel, read_model};
use rom::probe::MeshPoint;
use runtime::config::{ActuatorSpec, CameraSpec, Scene};
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use wire::layout::{flags, pack_name, valve_interlock, valve_reason};
use wire::{
    Bus, Domain, SensorReader, SensorSample, Setpoint, SetpointWriter, State, StateReader, Topic,
    ValveReader, Wake, WakeSet, Wakeable, Waking, boot_id, now_ns,
};

/// Controller: holds a contact force or a height of the tip. Range, rate and force limit of the valve, noise of the load cell, values
/// of the model's inputs and the marker at the tip are those of the scene.
#[derive(Debug, Parser)]
#[command(
    name = "hold_force",
    before_help = "Examples:\n  hold_force --scene config/scenes/force.toml --target-n 0.3\n  \
    hold_force --scene config/scenes/force.toml --tip-mm -40",
    after_help = "The last line is a JSON object: `followed` is the mean over the last quarter of what `measured_by` measured (without a \
    sensor the model's value), `final_error` that minus the target. `softtwin-studies plant --help` shows all programs of the example, \
    docs/control.md the law."
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
    /// Height to hold instead, mm: of the scene's marker, or of the reference actuator's tip if it has none.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    tip_mm: Option<f64>,
    /// Marker whose height is held; default: the scene's only one.
    #[arg(long, value_name = "NAME", requires = "tip_mm")]
    marker: Option<String>,
    /// Gap that is assumed if the twin's states have none, mm; default: no plate in reach.
    #[arg(long, value_name = "MM", default_value_t = OUT_OF_REACH_MM, hide_default_value = true)]
    gap_mm: f64,
    /// Force that must not be passed, N; the valve's limit if that is lower.
    #[arg(long, value_name = "N", default_value_t = 0.6)]
    force_max_n: f64,
    /// Validity of each setpoint, ms.
    #[arg(long, value_name = "MS", default_value_t = 50.0)]
    valid_ms: f64,
    /// The owner's name, by which another one is refused.
    #[arg(long, default_value = "hold_force")]
    owner: String,
    /// Controls without the load cell.
    #[arg(long)]
    no_load_cell: bool,
    /// Ends after this many seconds, or when no state arrives for one second.
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    seconds: f64,
}

/// A state older than this, or none: the pressure is let off.
const SILENCE: Duration = Duration::from_secs(1);
/// Longest wait for the first state with a reading.
const FIRST: Duration = Duration::from_secs(10);
/// Standard deviations of the load cell below which a force is no contact yet.
const CONTACT_SIGMAS: f64 = 3.0;
/// The vertical axis.
const Y: usize = 1;
/// Substituted readings are not used.
const NOT_A_READING: u32 = flags::NO_DATA | flags::STALE | flags::HELD;
/// Reasons for which the valve does not follow, and the controller waits.
const WAITS: [u32; 4] =
    [valve_reason::OVERRIDE, valve_reason::INTERLOCK, valve_reason::TIMEOUT, valve_reason::DEVICE_ERROR];

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let scene = Scene::load(&args.scene)?;
    let is_meant = |name: &str| args.actuator.as_ref().is_none_or(|meant| meant == name);
    let spec =
        scene.actuators.iter().find(|spec| is_meant(&spec.name)).context("the scene has no such actuator")?;
    let (quantity, target) = args.tip_mm.map_or((Quantity::Force, args.target_n), |mm| (Quantity::Tip, mm));
    let marker = if quantity == Quantity::Tip { marker(spec, args.marker.as_deref())? } else { None };
    let mut model = model(spec, quantity, marker)?;
    let settings = settings(spec, &model, args.force_max_n)?;
    let bus = Bus::open(&Domain::from_env())?;
    let states = StateReader::open(&bus, &Topic::state(&spec.name)?)?;
    let mut wake = WakeSet::new([&states as &dyn Wakeable]);
    let first = first(&states, &mut wake)?;
    model.set_inputs(&first.inputs);
    refuse_out_of_reach(&mut model, quantity, target, gap_mm(&first, &args), &settings)?;
    let mut sensors = Sensors::open(&bus, spec, quantity, marker)?;
    let valves = ValveReader::attach_as(&bus, &Topic::valve(&spec.name)?, Waking::Never)?;
    let writer = SetpointWriter::create_named(&bus, &Topic::setpoint(&spec.name)?, &args.owner)?;
    let mut owner = Owner::new(writer, &args);
    let mut controller = Controller::new(model, quantity, settings);
    let stop = runtime::service::stop_flag().context("cannot listen for signals")?;

    let begin = Instant::now();
    let (mut last, mut is_limited, mut delays_ns) = (None, false, Vec::new());
    let (mut measured, mut predicted) = (Vec::new(), Vec::new());
    let mut valve = None;
    let mut ended = Ok(());
    while begin.elapsed().as_secs_f64() < args.seconds && !stop.load(Ordering::Relaxed) {
        let Some(state) = states.newest()? else {
            if wake.wait(SILENCE)? == Wake::Timeout {
                break;
            }
            continue;
        };
        if state.flags & NOT_A_READING != 0 {
            // The setpoint expires.
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
        let seen = sensors.measured(&state)?;
        let is_used = quantity == Quantity::Tip || !args.no_load_cell;
        let reading = Reading {
            pressure_mpa: state.pressure_mpa,
            gap_mm: gap_mm(&state, &args),
            measured: if is_used { seen } else { f64::NAN },
        };
        controller.model_mut().set_inputs(&state.inputs);
        if WAITS.contains(&status.valve_reason) {
            controller.start(reading);
        }
        let turn = controller.update(target, reading, dt_s);
        owner.send(turn.pressure_mpa, state.t_sensor_ns)?;
        delays_ns.push(now_ns().saturating_sub(state.t_sensor_ns));
        if seen.is_finite() {
            measured.push(seen);
        }
        predicted.push(turn.followed);
        is_limited = turn.is_limited;
    }
    owner.send(f64::NAN, 0)?; // released, whatever ended it: the pressure is let off
    delays_ns.sort_unstable();
    let (values, by) =
        if measured.is_empty() { (&predicted, None) } else { (&measured, Some(&sensors.name)) };
    let followed = last_quarter(values);
    let report = json!({
        "target": target,
        "unit": unit(quantity),
        "followed": followed,
        "measured_by": by,
        "final_error": followed.map(|followed| followed - target),
        "is_limited": is_limited,
        "setpoints": delays_ns.len(),
        "reading_to_setpoint_us_p50": delays_ns.get(delays_ns.len() / 2).map(|ns| *ns as f64 * 1e-3),
    });
    writeln!(std::io::stdout(), "{report}")?;
    ended
}

/// Position of the marker whose height is held; `None` if the scene has no marker.
fn marker(spec: &ActuatorSpec, name: Option<&str>) -> anyhow::Result<Option<usize>> {
    let names: Vec<&str> = spec.markers.iter().map(|marker| marker.name.as_str()).collect();
    match (name, names.as_slice()) {
        (None, []) => Ok(None),
        (None, [_]) => Ok(Some(0)),
        (None, several) => {
            bail!("--tip-mm: expected --marker with one of the scene's {}, found none", several.join(", "))
        }
        (Some(name), known) => {
            let at = known.iter().position(|other| *other == name);
            let known = if known.is_empty() { "none".into() } else { known.join(", ") };
            at.map(Some).with_context(|| {
                format!("--marker: expected a marker of the scene ({known}), found `{name}`")
            })
        }
    }
}

/// The scene's model with its values of inputs, at the point that is held.
fn model(spec: &ActuatorSpec, quantity: Quantity, marker: Option<usize>) -> anyhow::Result<TwinModel> {
    let mut model = read_model(&spec.model)?;
    model.header.set_parameters(spec.given_inputs())?;
    Ok(match (quantity, marker.and_then(|at| spec.markers.get(at))) {
        // The force needs no point: any will do.
        (Quantity::Force, _) => TwinModel::of_point(&model, &MeshPoint::node(&model, 0)?, Y)?,
        (Quantity::Tip, Some(marker)) => TwinModel::of_point(&model, &marker.point(&model)?, Y)?,
        (Quantity::Tip, None) => TwinModel::new(&model, Tip::REFERENCE)?,
    })
}

/// Limits and noise of the scene; without a valve in it the range is the model's.
fn settings(spec: &ActuatorSpec, model: &TwinModel, force_max_n: f64) -> anyhow::Result<Settings> {
    let usual = Settings::default();
    let contact_n = CONTACT_SIGMAS * spec.force_sigma_n();
    let mut settings = Settings { contact_n, force_max_n, range_mpa: model.range_mpa(), ..usual };
    if let Some(valve) = &spec.valve {
        settings.range_mpa = valve.range_mpa;
        settings.rate_mpa_per_s = usual.rate_mpa_per_s.min(valve.rate_mpa_per_s);
        settings.force_max_n = force_max_n.min(valve.force_max_n);
    }
    let problems = settings.problems();
    ensure!(problems.is_empty(), "{}", problems.join("\n"));
    Ok(settings)
}

/// The first state with a reading: what it says of gap and inputs decides what is in reach.
fn first(states: &StateReader, wake: &mut WakeSet) -> anyhow::Result<State> {
    let end = Instant::now() + FIRST;
    loop {
        if let Some(state) = states.newest()?.filter(|state| state.flags & NOT_A_READING == 0) {
            return Ok(state);
        }
        let left = end.saturating_duration_since(Instant::now());
        ensure!(
            !left.is_zero(),
            "the twin has had no good reading for {} s: start the bridge, or look at `softtwin top`",
            FIRST.as_secs()
        );
        wake.wait(left)?;
    }
}

/// Gap of a state: measured, given or estimated; the option's if it has none.
fn gap_mm(state: &State, args: &Args) -> f64 {
    if state.gap_mm.is_finite() { state.gap_mm } else { args.gap_mm }
}

fn unit(quantity: Quantity) -> &'static str {
    if quantity == Quantity::Force { "N" } else { "mm" }
}

/// Mean over the last quarter.
fn last_quarter(values: &[f64]) -> Option<f64> {
    let tail = values.get(values.len() * 3 / 4..).unwrap_or_default();
    (!tail.is_empty()).then(|| tail.iter().sum::<f64>() / tail.len() as f64)
}

/// The sensor of the quantity: the load cell, whose value states carry, or a marker, whose place the readings carry.
struct Sensors {
    name: String,
    marker: Option<MarkerSensor>,
    quantity: Quantity,
}

struct MarkerSensor {
    reader: SensorReader,
    /// Position in the scene and in the readings.
    at: usize,
    camera: CameraSpec,
    last: SensorSample,
    /// When the marker was seen last, ns.
    seen_ns: u64,
}

impl Sensors {
    fn open(
        bus: &Bus,
        spec: &ActuatorSpec,
        quantity: Quantity,
        marker: Option<usize>,
    ) -> anyhow::Result<Self> {
        let Some(at) = marker else { return Ok(Self { name: "load cell".into(), marker: None, quantity }) };
        let reader = SensorReader::attach_as(bus, &Topic::sensor(spec.sensor())?, Waking::Never)?;
        let name = spec.markers.get(at).map_or_else(String::new, |marker| format!("marker {}", marker.name));
        let (camera, last) = (spec.camera, SensorSample::default());
        Ok(Self { name, marker: Some(MarkerSensor { reader, at, camera, last, seen_ns: 0 }), quantity })
    }

    /// Measured value of the quantity in the reading behind a state, N or mm; NaN if it has none.
    fn measured(&mut self, state: &State) -> anyhow::Result<f64> {
        match (&mut self.marker, self.quantity) {
            (Some(marker), _) => marker.height_mm(state),
            (None, Quantity::Force) => Ok(state.measured_force_n),
            (None, Quantity::Tip) => Ok(f64::NAN),
        }
    }
}

impl MarkerSensor {
    fn height_mm(&mut self, state: &State) -> anyhow::Result<f64> {
        let id = |sample: &SensorSample| (sample.boot_id, sample.seq);
        let of_state = (state.sensor_boot_id, state.sensor_seq);
        while self.last.boot_id != of_state.0 || self.last.seq < of_state.1 {
            let Some(sample) = self.reader.next()? else { return Ok(f64::NAN) };
            self.last = sample;
        }
        let marker = self.last.markers_mm.get(self.at).filter(|_| id(&self.last) == of_state);
        let age_ns = self.last.ages_ns.markers.get(self.at).filter(|_| self.last.age_count > 0);
        // A slow camera's value is in several readings: it counts once.
        let taken_ns = self.last.t_sensor_ns.saturating_sub(age_ns.copied().unwrap_or(0));
        let is_new = taken_ns > self.seen_ns;
        self.seen_ns = self.seen_ns.max(taken_ns);
        let place_mm = marker.filter(|_| is_new).map(|marker| self.camera.in_actuator_mm(*marker));
        Ok(place_mm.map_or(f64::NAN, |[_, y, _]| y))
    }
}

/// Nothing moves for a target that the model's pressures do not give.
fn refuse_out_of_reach(
    model: &mut TwinModel,
    quantity: Quantity,
    target: f64,
    gap_mm: f64,
    settings: &Settings,
) -> anyhow::Result<()> {
    let ([low_mpa, high_mpa], known) = (settings.range_mpa, model.range_mpa());
    let range_mpa = [low_mpa.max(known[0]), high_mpa.min(known[1])];
    let ends = range_mpa.map(|pressure_mpa| quantity.of(&model.at(pressure_mpa, gap_mm)).0);
    let (low, high, unit) = (ends[0].min(ends[1]), ends[0].max(ends[1]), unit(quantity));
    ensure!(
        (low..=high).contains(&target),
        "{target} {unit} cannot be held at a gap of {gap_mm} mm: {} to {} MPa give {low:.3} to {high:.3} {unit}",
        range_mpa[0],
        range_mpa[1]
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
