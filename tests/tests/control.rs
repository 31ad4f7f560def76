//! Whole loops: simulated hardware behind Modbus, bridge, twin and controller, each a process; the plant is not the twin's model.

use control::inverse::Model;
use control::twin_model::{OUT_OF_REACH_MM, Tip, TwinModel};
use rom::memory::{InputMemory, Line, MemorySpec, Slopes};
use rom::model::BlockKind;
use rom::observable::{Definition, ObservableKind, Observables, PointSpec};
use rom::probe::{MeshPoint, model_tip};
use serde_json::Value;
use std::ffi::CStr;
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::os::fd::{AsRawFd, FromRawFd};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;
use tests::wait::wait_state;
use tests::{PATIENCE, Program, Stage};
use wire::layout::{MARKERS_MAX, Marker, flags, pack_name, unpack_name, valve_interlock, valve_reason};
use wire::{
    Bus, SensorSample, SensorWriter, Setpoint, SetpointReader, SetpointWriter, StateReader, Target,
    TargetWriter, Topic, Valve, ValveReader, now_ns,
};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap()
}

/// The rig with its keyboard.
struct Rig {
    program: Program,
    keys: File,
    scene: PathBuf,
}

impl Rig {
    fn start(stage: &Stage) -> Self {
        let keys = stage.path("keys");
        let name = std::ffi::CString::new(keys.display().to_string()).unwrap();
        // SAFETY: the path is a C string that lives across the call.
        assert_eq!(unsafe { libc::mkfifo(name.as_ptr(), 0o600) }, 0);
        let mut program = Program::shell(stage, "exec softtwin-studies rig --listen 127.0.0.1:0 < keys");
        let keys = File::options().write(true).open(keys).unwrap();
        let ready = program.wait_for("ready: rig at ");
        let port = ready.rsplit_once(':').unwrap().1;
        let shipped = std::fs::read_to_string(repository().join("config/scenes/rig.toml")).unwrap();
        let model = repository().join("models/pneunet/pneunet.twin").display().to_string();
        let scene = shipped
            .replace(":5020", &format!(":{port}"))
            .replace("../../models/pneunet/pneunet.twin", &model);
        Self { program, keys, scene: stage.write("rig.toml", &scene) }
    }

    fn type_line(&mut self, line: &str) {
        writeln!(self.keys, "{line}").unwrap();
    }

    /// The time stamp of the next line of that kind that is not before `since_ns`.
    fn event(&mut self, what: &str, since_ns: u64) -> u64 {
        loop {
            let line = self.program.wait_for(what);
            let t_ns: u64 = line.rsplit_once(' ').unwrap().1.parse().unwrap();
            if t_ns >= since_ns {
                return t_ns;
            }
        }
    }

    /// Waits until the valve has closed after `since_ns`, and prints the delay.
    fn is_safe_since(&mut self, since_ns: u64, what: &str) {
        let took_ms = (self.event("safe ", since_ns) - since_ns) / 1_000_000;
        println!("safe {took_ms} ms after {what}");
    }
}

fn controller(stage: &Stage, rig: &Rig) -> Program {
    let scene = rig.scene.display().to_string();
    Program::tool(stage, &["hold", "--json", "--scene", &scene, "--force-n", "0.3"])
}

fn valves(bus: &Bus) -> ValveReader {
    ValveReader::open(bus, &Topic::valve("finger").unwrap()).unwrap()
}

fn wait_valve(reader: &ValveReader, what: &str, mut wanted: impl FnMut(&Valve) -> bool) -> Valve {
    tests::wait::wait_for(reader, what, |reader| {
        while let Some(valve) = reader.next().unwrap() {
            if wanted(&valve) {
                return Some(valve);
            }
        }
        None
    })
}

/// Waits until the valve has followed for this long without a break.
fn follow(bus: &Bus, time: Duration) {
    let (reader, mut since) = (valves(bus), None);
    wait_valve(&reader, "a valve that follows", |valve| {
        if valve.valve_reason != valve_reason::FOLLOWING {
            since = None;
            return false;
        }
        valve.t_publish_ns - *since.get_or_insert(valve.t_publish_ns) > time.as_nanos() as u64
    });
}

#[test]
fn force_loop_closes_the_valve_after_any_kill_or_unplug() {
    let stage = Stage::new("loop");
    let mut rig = Rig::start(&stage);
    let mut twin = Program::twin(&stage, &rig.scene);
    let mut bridge = Program::bridge(&stage, &rig.scene);
    let bus = Bus::open(&stage.domain()).unwrap();
    let mut holds = controller(&stage, &rig);
    rig.event("driven", 0);
    follow(&bus, Duration::from_millis(2500));
    rig.type_line("report");
    let report = rig.program.wait_for("report ");
    println!("{report}");
    let report: Value = serde_json::from_str(report.strip_prefix("report ").unwrap()).unwrap();
    assert!(report["settling_s"].as_f64().is_some_and(|s| s <= 1.0), "{report}");
    assert!(report["final_error"].as_f64().is_some_and(|share| share.abs() < 0.05), "{report}");

    for sensor in ["gauge", "gap", "cell"] {
        let pulled_ns = now_ns();
        rig.type_line(&format!("pull {sensor}"));
        rig.is_safe_since(pulled_ns, &format!("pulling the {sensor}"));
        let plugged_ns = now_ns();
        rig.type_line(&format!("plug {sensor}"));
        rig.event("driven", plugged_ns);
        follow(&bus, Duration::from_millis(200));
    }
    let killed_ns = now_ns();
    holds.kill();
    rig.is_safe_since(killed_ns, "killing the controller");
    holds = controller(&stage, &rig);
    follow(&bus, Duration::from_millis(200));

    let killed_ns = now_ns();
    twin.kill();
    rig.is_safe_since(killed_ns, "killing the twin");
    drop(holds);
    twin = Program::twin(&stage, &rig.scene);
    holds = controller(&stage, &rig);
    follow(&bus, Duration::from_millis(200));

    let killed_ns = now_ns();
    bridge.kill();
    rig.is_safe_since(killed_ns, "killing the bridge");
    bridge = Program::bridge(&stage, &rig.scene);
    rig.event("driven", killed_ns);

    // Stopped, it writes nothing: the device's own time-out closes.
    let stopped_ns = now_ns();
    bridge.signal(libc::SIGSTOP);
    rig.is_safe_since(stopped_ns, "stopping the bridge");
    bridge.signal(libc::SIGCONT);
    drop((bridge, twin, holds));
}

#[test]
fn second_owner_is_refused_and_operator_overrides() {
    let stage = Stage::new("owner");
    let mut rig = Rig::start(&stage);
    let twin = Program::twin(&stage, &rig.scene);
    let bridge = Program::bridge(&stage, &rig.scene);
    let bus = Bus::open(&stage.domain()).unwrap();
    let holds = controller(&stage, &rig);
    rig.event("driven", 0);
    let reader = valves(&bus);
    let owner = wait_valve(&reader, "an owner", |valve| valve.valve_reason == valve_reason::FOLLOWING).owner;
    assert_eq!(unpack_name(&owner), "softtwin-hold");

    let (status, said) = Program::tool(&stage, &["setpoint", "finger", "--pressure", "0.01"]).ended();
    let refusal = format!("(`softtwin-hold`, process {})", holds.id());
    assert!(!status.success() && said.join("\n").contains(&refusal), "{said:?}");

    let (status, said) =
        Program::tool(&stage, &["setpoint", "finger", "--override", "--pressure", "0.02"]).ended();
    assert!(status.success(), "{said:?}");
    wait_valve(&reader, "the override", |valve| valve.valve_reason == valve_reason::OVERRIDE);
    // The command has ended; the operator's value stays, also without a twin. A device without processor time may not confirm at once.
    twin.kill();
    let answered = |valve: &Valve| valve.valve_reason != valve_reason::DEVICE_ERROR;
    let closed = |valve: &Valve| answered(valve) && valve.valve_interlock & valve_interlock::STALE != 0;
    let valve = wait_valve(&reader, "a stale state", closed);
    assert_eq!((valve.valve_reason, valve.wanted_mpa), (valve_reason::OVERRIDE, 0.02));
    let settled = wait_valve(&reader, "the operator's value", |valve| valve.pressure_mpa == 0.02);
    assert_eq!(settled.valve_limit, 0);

    let (status, said) = Program::tool(&stage, &["setpoint", "finger", "--release"]).ended();
    assert!(status.success(), "{said:?}");
    let is_released = |valve: &Valve| answered(valve) && valve.valve_reason != valve_reason::OVERRIDE;
    let valve = wait_valve(&reader, "the release", is_released);
    assert_eq!(valve.pressure_mpa, 0.0, "{valve:?}");
    let (_, said) = bridge.stop();
    assert!(said.join("\n").contains("softtwin/finger/valve: override"), "{said:?}");
}

/// Sensors on an actuator behind a lag of 80 ms, which another program's setpoints move.
struct Finger {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<f64>,
}

const GAP_MM: f64 = 60.0;
const TIP_MM: [f64; 3] = [115.0, 2.0, 16.0];
const CAMERA_MM: [f64; 3] = [200.0, 50.0, 16.0];
const SOFTER_MPA: f64 = 0.72;
const HIGHEST_MPA: f64 = 0.05;

/// The softer finger, with this coordinate of its tip.
fn softer_finger(axis: usize) -> TwinModel {
    let mut model =
        softtwin::files::model(&repository().join("models/pneunet-design/pneunet-design.twin")).unwrap();
    model.header.set_parameters([("elastomer.law.mu_mpa", SOFTER_MPA)]).unwrap();
    TwinModel::new(&model, Tip { at_mm: TIP_MM, axis }).unwrap()
}

impl Finger {
    /// Publishes what `sense` makes of the pressure, MPa.
    fn start(stage: &Stage, mut sense: impl FnMut(f64) -> SensorSample + Send + 'static) -> Self {
        let (stop, domain) = (Arc::new(AtomicBool::new(false)), stage.domain());
        let stopped = stop.clone();
        let thread = std::thread::spawn(move || {
            let bus = Bus::open(&domain).unwrap();
            let mut sensor = SensorWriter::create(&bus, &Topic::sensor("finger").unwrap()).unwrap();
            let setpoints = SetpointReader::attach(&bus, &Topic::setpoint("finger").unwrap()).unwrap();
            let (mut seq, mut last_ns) = (0, now_ns());
            let (mut wanted_mpa, mut most_mpa, mut pressure_mpa) = (0.0_f64, 0.0_f64, 0.0_f64);
            while !stopped.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(5)); // pace of the readings
                if let Some(setpoint) = setpoints.newest().unwrap() {
                    wanted_mpa = if setpoint.pressure_mpa.is_finite() { setpoint.pressure_mpa } else { 0.0 };
                    most_mpa = most_mpa.max(wanted_mpa);
                }
                let t_sensor_ns = now_ns();
                pressure_mpa += (wanted_mpa - pressure_mpa)
                    * (1.0 - (-1e-9 * (t_sensor_ns - last_ns) as f64 / 0.08).exp());
                (last_ns, seq) = (t_sensor_ns, seq + 1);
                let sensed = sense(pressure_mpa);
                sensor
                    .publish(SensorSample { boot_id: 5, seq, t_sensor_ns, pressure_mpa, ..sensed })
                    .unwrap();
            }
            most_mpa
        });
        Self { stop, thread }
    }

    /// The design model's finger with gap sensor, load cell and a marker at the tip, `off_mm` above the model's, in a camera's frame that is
    /// turned by 90 degrees about z.
    fn with_marker(stage: &Stage, off_mm: f64) -> Self {
        let (mut along, mut model) = (softer_finger(0), softer_finger(1));
        Self::start(stage, move |pressure_mpa| {
            let truth = model.at(pressure_mpa, GAP_MM);
            let mut markers_mm = [Marker::ABSENT; MARKERS_MAX];
            let tip_x_mm = along.at(pressure_mpa, GAP_MM).observable;
            let (x, y) = (truth.observable + off_mm - CAMERA_MM[1], CAMERA_MM[0] - tip_x_mm);
            markers_mm[0] = Marker { x, y, z: 0.0 };
            let (gap_mm, measured_force_n) = (GAP_MM, truth.force_n);
            SensorSample { gap_mm, measured_force_n, marker_values: 3, markers_mm, ..SensorSample::default() }
        })
    }

    /// The highest setpoint, MPa.
    fn end(self) -> f64 {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}

/// Stiffness, valve range, gap, marker and camera of a scene hold for its controller, whose report is about what was measured.
#[test]
fn scene_holds_for_the_controller() {
    let stage = Stage::new("holds");
    let model = repository().join("models/pneunet-design/pneunet-design.twin");
    let scene_with = |name: &str, is_measured: bool| {
        stage.write(
            name,
            &format!(
                "name = \"holds\"\n[[actuator]]\nname = \"finger\"\nmodel = \"{}\"\n\
             [actuator.inputs]\n\"elastomer.law.mu_mpa\" = {SOFTER_MPA}\n\
             [[actuator.marker]]\nname = \"tip\"\nat_mm = {TIP_MM:?}\n\
             [actuator.camera]\nposition_mm = {CAMERA_MM:?}\nrotation_deg = [0.0, 0.0, 90.0]\n\
             [actuator.control]\nis_measured = {is_measured}\n\
             [actuator.valve]\nrange_mpa = [0.0, {HIGHEST_MPA}]\n\
             [actuator.valve.modbus]\ntcp = \"127.0.0.1:1\"\nvalue = {{ from = {{ register = 0 }} }}\n",
                model.display()
            ),
        )
    };
    let scene = scene_with("holds.toml", true).display().to_string();
    let model_only = scene_with("model.toml", false).display().to_string();
    let twin = Program::twin(&stage, Path::new(&scene));
    let hold = |target: &[&str], off_mm: f64| -> (Option<Value>, f64) {
        let finger = Finger::with_marker(&stage, off_mm);
        let program = [&["hold", "--json", "--seconds", "1.6"], target].concat();
        let (status, said) = Program::tool(&stage, &program).ended();
        let report = status.success().then(|| serde_json::from_str(said.last().unwrap()).unwrap());
        (report, finger.end())
    };
    let near = |report: &Value, by: &str, error: f64| {
        let found = report["final_error"].as_f64().unwrap();
        assert!(found.abs() < error && report["measured_by"] == by, "{report}");
        assert_eq!(report["is_limited"], false, "{report}");
    };
    let mut truth = softer_finger(1);
    // In reach at the measured gap only; the marker is elsewhere than the model's tip.
    let (report, _) = hold(&["--scene", &scene, "--tip-y-mm", "-45"], -3.4);
    near(&report.unwrap(), "marker tip", 0.1);
    // The published half-width contains what the marker shows of the model's error.
    let states = StateReader::open(&stage.bus(), &Topic::state("finger").unwrap()).unwrap();
    let state = wait_state(&states, "a state", |_| true);
    assert!((3.3..5.0).contains(&state.displacement_halfwidth_mm), "{state:?}");
    // The model at the scene's stiffness, without the load cell in the loop.
    let target_n = truth.at(0.045, GAP_MM).force_n;
    assert!(target_n > 0.05, "{target_n} N");
    let (report, _) = hold(&["--scene", &model_only, "--force-n", &target_n.to_string()], 0.0);
    near(&report.unwrap(), "load cell", 0.02 * target_n);
    // The model reaches it within the valve's range, the finger does not.
    let target_mm = truth.at(0.95 * HIGHEST_MPA, GAP_MM).observable.to_string();
    let (report, most_mpa) = hold(&["--scene", &scene, "--tip-y-mm", &target_mm], 12.0);
    let report = report.unwrap();
    assert!(report["is_limited"] == true && report["final_error"].as_f64().unwrap() > 1.0, "{report}");
    assert!(most_mpa <= HIGHEST_MPA, "{most_mpa} MPa");
    // Beyond the valve's range, within the model's.
    let far_n = truth.at(0.08, GAP_MM).force_n.to_string();
    assert_eq!(hold(&["--scene", &scene, "--force-n", &far_n], 0.0), (None, 0.0));
    drop(twin);
}

/// A model's own height of the tip is held, wherever it is; a model without one is held at the middle of its end face.
#[test]
fn height_without_a_marker_is_that_of_the_models_own_tip() {
    let mut model = softtwin::files::model(&repository().join("models/pneunet/pneunet.twin")).unwrap();
    let at = |model: &rom::model::Model, point: &MeshPoint| {
        TwinModel::of_point(model, point, 1).unwrap().at(0.04, OUT_OF_REACH_MM).observable
    };
    let held = |model: &rom::model::Model| {
        let (_, mut held) = TwinModel::of_column(model, "tip_y_mm", None).unwrap();
        held.at(0.04, OUT_OF_REACH_MM).observable
    };
    model.blocks.retain(|(kind, _)| *kind != BlockKind::Observables);
    let tip = MeshPoint::node(&model, model_tip(&model).unwrap() as u32).unwrap();
    assert!((held(&model) - at(&model, &tip)).abs() < 1e-6);
    let place = PointSpec::At([60.0, 2.0, 16.0]);
    let of = Definition { kind: ObservableKind::Position, points: vec![place], axis: Some([0.0, 1.0, 0.0]) };
    let own = Observables::define(&model, &[("tip_y_mm".to_owned(), of)].into()).unwrap();
    model.set_record(BlockKind::Observables, &own).unwrap();
    let middle = MeshPoint::at(&model, [60.0, 2.0, 16.0]).unwrap();
    assert!((at(&model, &middle) - at(&model, &tip)).abs() > 5.0);
    assert!((held(&model) - at(&model, &middle)).abs() < 1e-3, "{} {}", held(&model), at(&model, &middle));
}

/// An angle is held by its sensor, which shows 8 % less than a whole model with a line; the twin raises its flag on the difference.
#[test]
fn angle_is_held_by_its_sensor_with_a_model_that_has_memory() {
    const SHOWN: f64 = 0.92;
    let stage = Stage::new("angle");
    let name = "bending_angle_deg";
    let mut model = softtwin::files::model(&repository().join("models/pneunet/pneunet.twin")).unwrap();
    let mut statics = TwinModel::of_observable(&model, name).unwrap();
    let line = Line { fill_s: 0.1, empty_s: 0.2 };
    let (range, slopes) = (model.header.inputs[0].range, Slopes::default());
    let of =
        InputMemory { input: 0, range, line: Some(line), orifice: None, play: vec![], creep: vec![], slopes };
    model.set_record(BlockKind::Memory, &MemorySpec { inputs: vec![of], max_gap_s: 1.0 }).unwrap();
    std::fs::write(stage.path("finger.twin"), model.to_bytes().unwrap()).unwrap();
    let scene = stage.write(
        "angle.toml",
        &format!(
            "name = \"angle\"\n[[actuator]]\nname = \"finger\"\nmodel = \"finger.twin\"\n\
             [actuator.observables.{name}]\nsigma = 0.05\n[actuator.control]\nhold = \"{name}\"\n"
        ),
    );
    let _twin = Program::twin(&stage, &scene);
    let (mut behind_mpa, mut last_ns) = (0.0, now_ns());
    let finger = Finger::start(&stage, move |pressure_mpa| {
        let dt_s = 1e-9 * (now_ns() - last_ns) as f64;
        last_ns = now_ns();
        let time_s = if pressure_mpa > behind_mpa { line.fill_s } else { line.empty_s };
        behind_mpa += (pressure_mpa - behind_mpa) * (1.0 - (-dt_s / time_s).exp());
        let mut sample = SensorSample { gap_mm: 80.0, ..SensorSample::default() };
        assert!(sample.add_input(name, SHOWN * statics.at(behind_mpa, 80.0).observable));
        sample
    });
    let states = StateReader::attach(&stage.bus(), &Topic::state("finger").unwrap()).unwrap();
    let scene = scene.display().to_string();
    let program = ["hold", "--json", "--seconds", "2.5", "--scene", &scene, "--angle-deg", "40"];
    let (status, said) = Program::tool(&stage, &program).ended();
    assert!(status.success(), "{said:?}");
    let report: Value = serde_json::from_str(said.last().unwrap()).unwrap();
    assert_eq!(report["measured_by"], format!("sensor of {name}"), "{report}");
    assert!(report["final_error"].as_f64().is_some_and(|deg| deg.abs() < 0.4), "{report}");
    wait_state(&states, "the flag", |state| state.flags & flags::OBSERVABLE_MISMATCH != 0);
    finger.end();
}

/// A target of the bus moves what is held; one out of reach, not finite or of a second owner changes nothing.
#[test]
fn target_moves_without_letting_go() {
    let stage = Stage::new("target");
    let mut rig = Rig::start(&stage);
    let _twin = Program::twin(&stage, &rig.scene);
    let _bridge = Program::bridge(&stage, &rig.scene);
    let bus = Bus::open(&stage.domain()).unwrap();
    let mut holds = controller(&stage, &rig);
    rig.event("driven", 0);
    follow(&bus, Duration::from_millis(200));
    let states = StateReader::open(&bus, &Topic::state("finger").unwrap()).unwrap();
    let near = |target_n: f64| {
        let is_near = |state: &wire::State| (state.measured_force_n - target_n).abs() < 0.01;
        wait_state(&states, "the target", is_near);
    };
    near(0.3);
    let closed = |valve: &Valve| (valve.timeouts, valve.interlocks);
    let before = closed(&wait_valve(&valves(&bus), "the valve", |_| true));
    let target = |arguments: &[&str]| {
        let (status, said) = Program::tool(&stage, &[&["setpoint", "finger"], arguments].concat()).ended();
        assert!(status.success(), "{said:?}");
    };
    target(&["0.2"]);
    near(0.2);
    target(&["0.4", "--rate", "0.5"]);
    near(0.4);
    target(&["9"]);
    holds.wait_for("refused: 9 N cannot be held");
    target(&["0.3", "0.1", "--interval-s", "0.2"]);
    near(0.1);
    let valve = wait_valve(&valves(&bus), "the valve", |_| true);
    assert_eq!(closed(&valve), before, "{valve:?}");

    let mut owner = TargetWriter::create_named(&bus, &Topic::target("finger").unwrap(), "test").unwrap();
    let sample = Target { boot_id: 3, seq: 1, t_publish_ns: now_ns(), value_count: 1, ..Target::default() };
    owner.publish(sample).unwrap();
    holds.wait_for("finite values");
    let (status, said) = Program::tool(&stage, &["setpoint", "finger", "0.2"]).ended();
    assert!(!status.success() && said.join("\n").contains("`test`"), "{said:?}");
    let (status, said) = holds.stop();
    assert!(status.success(), "{said:?}");
    let report: Value =
        serde_json::from_str(said.iter().rfind(|line| line.contains("setpoints")).unwrap()).unwrap();
    println!("reading to written: {} us", report["reading_to_written_us"]);
    assert!(report["reading_to_written_us"]["p50"].is_f64(), "{report}");
    tripped_limit_stays_until_its_release(&stage, &rig, &bus);
}

/// A force beyond the limit closes the valve; no new setpoint and no new controller opens it until the operator's release.
fn tripped_limit_stays_until_its_release(stage: &Stage, rig: &Rig, bus: &Bus) {
    let reader = valves(bus);
    let drive = |mpa: &str| Program::shell(stage, &format!("exec softtwin setpoint finger --pressure {mpa}"));
    let is_tripped = |valve: &Valve| valve.valve_interlock & valve_interlock::FORCE != 0;
    let mut owner = drive("0.085");
    let tripped = wait_valve(&reader, "the limit", is_tripped);
    assert_eq!(tripped.pressure_mpa, 0.0, "{tripped:?}");
    let states = StateReader::open(bus, &Topic::state("finger").unwrap()).unwrap();
    wait_state(&states, "no force", |state| state.measured_force_n < 0.05);
    owner.kill();
    owner = drive("0.01");
    let refused = |valve: &Valve| valve.valve_reason == valve_reason::INTERLOCK && valve.wanted_mpa == 0.01;
    let stays = wait_valve(&reader, "a small setpoint", refused);
    assert!(is_tripped(&stays) && stays.pressure_mpa == 0.0, "{stays:?}");
    owner.kill();
    let (status, said) = controller(stage, rig).ended();
    assert!(!status.success() && said.join("\n").contains("setpoint finger --release"), "{said:?}");
    owner = drive("0.01");
    wait_valve(&reader, "a small setpoint", refused);
    let (status, said) = Program::tool(stage, &["setpoint", "finger", "--release"]).ended();
    assert!(status.success(), "{said:?}");
    let opened = |valve: &Valve| valve.valve_reason == valve_reason::FOLLOWING && valve.pressure_mpa == 0.01;
    assert!(!is_tripped(&wait_valve(&reader, "the release", opened)));
    owner.kill();
}

/// A regulator on a serial line: a pseudo-terminal behind a name, as a device behind `/dev/ttyUSB0`. It answers each line with
/// `reply`; an empty one is silence.
struct Regulator {
    lines: Receiver<String>,
    reply: Arc<Mutex<&'static str>>,
    device: JoinHandle<()>,
}

impl Regulator {
    fn plug(port: &Path) -> Self {
        // SAFETY: each call gets the open descriptor of the one before, and a buffer with its length.
        let (line, name) = unsafe {
            let line = File::from_raw_fd(libc::posix_openpt(libc::O_RDWR | libc::O_NOCTTY));
            let (descriptor, mut name) = (line.as_raw_fd(), [0; 64]);
            assert_eq!(libc::grantpt(descriptor) + libc::unlockpt(descriptor), 0);
            assert_eq!(libc::ptsname_r(descriptor, name.as_mut_ptr(), name.len()), 0);
            (line, CStr::from_ptr(name.as_ptr()).to_str().unwrap().to_owned())
        };
        // Held open, so that the line survives a bridge that reopens it.
        let held = File::options().read(true).custom_flags(libc::O_NOCTTY).open(&name).unwrap();
        let _first_time = std::fs::remove_file(port);
        std::os::unix::fs::symlink(name, port).unwrap();
        let reply = Arc::new(Mutex::new("OK\r\n"));
        let (sender, lines) = channel();
        let (mut answers, said) = (line.try_clone().unwrap(), reply.clone());
        let device = std::thread::spawn(move || {
            let _held = held;
            for line in BufReader::new(line).lines().map_while(Result::ok) {
                let reply = *said.lock().unwrap();
                if sender.send(line).is_err() || answers.write_all(reply.as_bytes()).is_err() {
                    return;
                }
            }
        });
        Self { lines, reply, device }
    }

    fn answers(&self, reply: &'static str) {
        *self.reply.lock().unwrap() = reply;
    }

    /// Waits until this line comes.
    fn gets(&self, wanted: &str) {
        while self.lines.recv_timeout(PATIENCE).unwrap_or_else(|_| panic!("`{wanted}` did not come"))
            != wanted
        {}
    }

    /// The line is pulled: the other end hangs up.
    fn pull(self) {
        drop(self.lines);
        self.device.join().unwrap();
    }
}

/// One valve behind a line protocol: driven, refused, silent, released by its time-out, pulled and plugged in again.
#[test]
fn valve_is_driven_by_lines_on_a_serial_port() {
    let stage = Stage::new("linevalve");
    let port = stage.path("regulator");
    let regulator = Regulator::plug(&port);
    let source = "kind = \"simulate\"\nrate_hz = 200.0\ngap_mm = 30.0";
    let scene = stage.finger(source);
    let text = std::fs::read_to_string(&scene).unwrap();
    // A loaded machine must close nothing.
    let valve = format!(
        "[actuator.valve]\nrange_mpa = [0.0, 0.08]\nvalid_max_ms = 60000\nstate_max_age_ms = 60000\nstop_outside_domain = false\n\
         [actuator.valve.lines]\nserial = {{ port = \"{}\", baud = 115200 }}\nformat = \"SP {{value}}\\r\\n\"\nunit = \"kPa\"\n\
         decimals = 2\nreply = \"OK\"\ntimeout_ms = 1000\n",
        port.display()
    );
    let text = text.lines().map(str::trim).collect::<Vec<_>>().join("\n") + "\n" + &valve;
    std::fs::write(&scene, text).unwrap();
    let _twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    regulator.gets("SP 0.00");
    let bus = stage.bus();
    let reader = valves(&bus);
    let mut owner = SetpointWriter::create_named(&bus, &Topic::setpoint("finger").unwrap(), "test").unwrap();
    let mut seq = 0;
    let mut ask = |pressure_mpa: f64, valid: Duration| {
        seq += 1;
        let (t_publish_ns, valid_for_ns) = (now_ns(), valid.as_nanos() as u64);
        let setpoint =
            Setpoint { boot_id: 9, seq, t_publish_ns, valid_for_ns, pressure_mpa, ..Setpoint::default() };
        owner.publish(Setpoint { owner: pack_name("test"), ..setpoint }).unwrap();
    };
    let becomes = |reason: u32, pressure_mpa: f64| {
        let fits = |valve: &Valve| valve.valve_reason == reason && valve.pressure_mpa == pressure_mpa;
        wait_valve(&reader, valve_reason::as_str(reason), fits)
    };
    ask(0.04, PATIENCE);
    let followed = becomes(valve_reason::FOLLOWING, 0.04);
    assert_eq!((unpack_name(&followed.owner).as_str(), followed.setpoint_seq), ("test", 1));
    regulator.gets("SP 40.00");
    regulator.answers("ERR 5\r\n");
    let refused = becomes(valve_reason::DEVICE_ERROR, 0.04);
    assert!(refused.failures > 0 && refused.writes >= followed.writes);
    regulator.answers(""); // silence: the time-out of the line
    let failures = refused.failures;
    wait_valve(&reader, "a write without an answer", |valve| valve.failures > failures + 1);
    regulator.answers("OK\r\n");
    becomes(valve_reason::FOLLOWING, 0.04);
    ask(0.05, Duration::from_millis(50));
    let closed = becomes(valve_reason::TIMEOUT, 0.0);
    assert_eq!(closed.timeouts, 1);
    regulator.gets("SP 0.00");
    regulator.pull();
    becomes(valve_reason::DEVICE_ERROR, 0.0);
    let regulator = Regulator::plug(&port);
    becomes(valve_reason::TIMEOUT, 0.0);
    ask(0.03, PATIENCE);
    regulator.gets("SP 30.00");
    let (status, said) = bridge.stop();
    assert!(status.success(), "{said:?}");
    regulator.gets("SP 0.00");
    let said = said.join("\n");
    for expected in ["the device sent `ERR 5`", "no answer within 1000 ms", "device-error"] {
        assert!(said.contains(expected), "`{expected}` is missing in {said}");
    }
}
