//! The controller through the C interface: bit-identical to the one in Rust, by the library and by the compiled example; targets from C.

use crate::live::compile;
use capi::*;
use control::held::Stepping;
use control::inverse::Model as _;
use control::law::{Cycle, Reading, Target};
use control::twin_model::TwinModel;
use rom::model::Model;
use std::ffi::{CStr, CString, c_char};
use std::io::Write;
use std::mem::MaybeUninit;
use std::process::{Command, Stdio};
use std::ptr::{null, null_mut};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tests::wait::wait_for;
use tests::{Program, Stage};
use wire::layout::target_kind;
use wire::{Bus, SensorSample, SensorWriter, Setpoint, SetpointReader, TargetReader, Topic, now_ns};

const OK: softtwin_status = softtwin_status::SOFTTWIN_OK;
const ARGUMENT: softtwin_status = softtwin_status::SOFTTWIN_ARGUMENT;
const GAP_MM: f64 = 25.0;
const SCENE: &str = "name = \"s\"\n[[actuator]]\nname = \"beam\"\nmodel = \"beam.twin\"\n[actuator.sigma]\nforce_n = 0.001\n\
     [actuator.control]\nswing_hz = 4.0\ncorrection_s = 0.1\nplay = [{ threshold = 0.001, weight = 1.0 }]\n\
     [actuator.valve]\nrange_mpa = [0.0, 0.075]\nrate_mpa_per_s = 0.5\n";

/// Readings and what the law in Rust answers, on a plant with lag whose force is 10 % less than the model's.
fn series(model: &Model, scene: &str, column: &str) -> Vec<(u64, f64, Reading, Cycle)> {
    let mut stepping = Stepping::open(model, Some(scene), None, column).unwrap();
    let (quantity, mut body) = TwinModel::of_column(model, column, None).unwrap();
    let target = quantity.of(&body.at(0.06, GAP_MM), 0.06).0;
    let mut pressure_mpa = 0.01;
    (1..=200)
        .map(|k| {
            let t_ns = 1_000 + 5_000_000 * k;
            let measured = 0.9 * quantity.of(&body.at(pressure_mpa, GAP_MM), pressure_mpa).0;
            let measured = if k % 50 < 3 { f64::NAN } else { measured };
            let reading = Reading { pressure_mpa, gap_mm: GAP_MM, measured, written_mpa: f64::NAN };
            let target = if k < 120 { target } else { 0.7 * target };
            let cycle = stepping.step(t_ns, Target::step(target), reading).unwrap();
            pressure_mpa += 0.06 * (cycle.pressure_mpa - pressure_mpa);
            (t_ns, target, reading, cycle)
        })
        .collect()
}

struct Opened(*mut softtwin_control);

impl Drop for Opened {
    fn drop(&mut self) {
        // SAFETY: open, and not used any more.
        unsafe { softtwin_control_close(self.0) }
    }
}

impl Opened {
    fn new(stage: &Stage, scene: Option<&str>, held: &CStr) -> Result<Self, String> {
        let path = CString::new(stage.path("beam.twin").to_str().unwrap()).unwrap();
        let scene = scene.map(|name| CString::new(stage.path(name).to_str().unwrap()).unwrap());
        let scene: *const c_char = scene.as_ref().map_or(null(), |scene| scene.as_ptr());
        let (mut model, mut control) = (null_mut(), null_mut());
        // SAFETY: strings and places live across the calls; the model is closed once, and not used any more.
        unsafe {
            assert_eq!(softtwin_model_open(path.as_ptr(), &raw mut model), OK);
            let status = softtwin_control_open(model, scene, null(), held.as_ptr(), &raw mut control);
            let text = CStr::from_ptr(softtwin_last_error()).to_str().unwrap().to_owned();
            softtwin_model_close(model);
            if status == OK { Ok(Self(control)) } else { Err(text) }
        }
    }

    /// Status, setpoint, limits and fault of a cycle.
    fn step(&self, t_ns: u64, target: f64, reading: Reading) -> (softtwin_status, [u64; 8]) {
        let reading = [reading.pressure_mpa, reading.gap_mm, reading.measured, reading.written_mpa];
        let mut out = MaybeUninit::<[u64; 8]>::zeroed();
        // SAFETY: the controller is open; a reading is four numbers, a cycle is 56 bytes.
        unsafe {
            let status = softtwin_control_step(
                self.0,
                t_ns,
                target,
                0.0,
                reading.as_ptr().cast(),
                out.as_mut_ptr().cast(),
            );
            (status, out.assume_init())
        }
    }
}

#[test]
fn setpoints_in_c_are_those_of_the_law_in_rust() {
    let stage = Stage::new("capicontrol");
    let model = Model::from_bytes(tests::stage::model_bytes()).unwrap();
    let predictive = SCENE.replace("swing_hz", "law = \"predictive\"\nswing_hz");
    let program = compile(&stage, "cc", "-std=c11", "control.c").unwrap();
    let laws = [SCENE; 3].into_iter().chain([predictive.as_str(); 2]);
    for (column, scene) in
        ["force_n", "tip_y_mm", "pressure_mpa", "force_n", "tip_y_mm"].into_iter().zip(laws)
    {
        stage.write("beam.toml", scene);
        let expected = series(&model, scene, column);
        let moved = expected.iter().map(|(.., cycle)| cycle.pressure_mpa).fold(0.0, f64::max);
        // The plate stops the tip at 0.01 MPa, where the series begins; above it, the tip asks for no certain pressure.
        assert!(moved > if column == "tip_y_mm" { 0.015 } else { 0.03 }, "{column}: {moved} MPa");
        let held = CString::new(column).unwrap();
        let opened = Opened::new(&stage, Some("beam.toml"), &held).unwrap();
        let mut table = String::new();
        for (t_ns, target, reading, cycle) in &expected {
            let (status, found) = opened.step(*t_ns, *target, *reading);
            assert_eq!((status, found[0]), (OK, cycle.pressure_mpa.to_bits()), "{column} at {t_ns}");
            assert_eq!(found[3], cycle.followed.to_bits());
            let absent = Reading { pressure_mpa: f64::NAN, ..*reading };
            assert_eq!(opened.step(*t_ns + 1, *target, absent).0, ARGUMENT);
            assert_eq!(opened.step(*t_ns, *target, *reading).0, ARGUMENT, "a time that is not later");
            let Reading { pressure_mpa, gap_mm, measured, .. } = reading;
            table += &format!("{t_ns} {target:?} {pressure_mpa:?} {gap_mm:?} {measured:?}\n");
        }
        let mut child = Command::new(&program)
            .args([&stage.path("beam.twin"), &stage.path("beam.toml")])
            .arg(column)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        child.stdin.take().unwrap().write_all(table.as_bytes()).unwrap();
        let said = child.wait_with_output().unwrap();
        assert!(said.status.success());
        let said = String::from_utf8(said.stdout).unwrap();
        let setpoints = said.lines().map(|line| line.split(' ').next().unwrap().parse::<f64>().unwrap());
        let of_rust = expected.iter().map(|(.., cycle)| cycle.pressure_mpa.to_bits());
        assert!(setpoints.map(f64::to_bits).eq(of_rust), "{column}: {said}");
    }
}

#[test]
fn wrong_scene_or_quantity_is_refused_and_a_fault_stays_until_its_release() {
    let stage = Stage::new("capicontrolbad");
    stage.write("unknown.toml", "[[actuator]]\n[actuator.control]\nlag = 1.0\n");
    stage.write("below.toml", "[[actuator]]\n[actuator.valve]\nrange_mpa = [0.1, 0.0]\n");
    for (scene, held, expected) in [
        (Some("unknown.toml"), c"force_n", "unknown field `lag`"),
        (Some("below.toml"), c"force_n", "range_mpa: expected lowest < highest"),
        (Some("absent.toml"), c"force_n", "absent.toml"),
        (None, c"warmth", "expected an observable of the model"),
    ] {
        let refused = Opened::new(&stage, scene, held).err().unwrap_or_default();
        assert!(refused.contains(expected), "{refused}");
    }
    // The gauge stays at 0: supply gone.
    let opened = Opened::new(&stage, None, c"pressure_mpa").unwrap();
    let reading = Reading { pressure_mpa: 0.0, gap_mm: GAP_MM, measured: f64::NAN, written_mpa: f64::NAN };
    let faults: Vec<u32> = (1..=200)
        .map(|k| {
            let (status, found) = opened.step(5_000_000 * k, 0.05, reading);
            assert_eq!(status, OK);
            (found[6] >> 32) as u32
        })
        .collect();
    let first = faults.iter().position(|fault| *fault != 0).expect("a fault within 1 s");
    assert!(faults[first..].iter().all(|fault| *fault == faults[first]));
    // SAFETY: the text is static; the controller is open.
    unsafe {
        let name = CStr::from_ptr(softtwin_control_fault_name(faults[first]));
        assert_eq!(name, c"no-response");
        softtwin_control_release(opened.0);
    }
    assert_eq!(opened.step(2_000_000_000, 0.05, reading).1[6] >> 32, 0);
}

#[test]
fn targets_of_c_arrive_and_wrong_ones_are_not_sent() {
    let stage = Stage::new("capitarget");
    let [domain, root] = [stage.domain_name.clone(), stage.root().display().to_string()]
        .map(|text| CString::new(text).unwrap());
    let (mut bus, mut writer, mut second) = (null_mut(), null_mut(), null_mut());
    // SAFETY: strings and places live across the calls; handles are live until they are closed.
    unsafe {
        assert_eq!(softtwin_bus_open(domain.as_ptr(), root.as_ptr(), &mut bus), OK);
        let status = softtwin_writer_open_target(bus, c"finger".as_ptr(), c"planner".as_ptr(), &mut writer);
        assert_eq!(status, OK);
        let taken = softtwin_writer_open_target(bus, c"finger".as_ptr(), c"other".as_ptr(), &mut second);
        assert_eq!(taken, softtwin_status::SOFTTWIN_TAKEN);
        let text = CStr::from_ptr(softtwin_last_error()).to_str().unwrap();
        assert!(text.contains("`planner`"), "{text}");
    }
    let targets = TargetReader::attach(&stage.bus(), &Topic::target("finger").unwrap()).unwrap();
    let send = |kind, values: &[f64], rate_per_s, interval_s| {
        // SAFETY: the writer is live, the values live across the call.
        unsafe {
            softtwin_writer_send_target(writer, kind, values.as_ptr(), values.len(), rate_per_s, interval_s)
        }
    };
    for (kind, values, rate_per_s, interval_s) in [
        (target_kind::STEP, vec![f64::NAN], 0.0, 0.0),
        (target_kind::STEP, vec![], 0.0, 0.0),
        (target_kind::RAMP, vec![0.3], 0.0, 0.0),
        (target_kind::SERIES, vec![0.1; 65], 0.0, 0.1),
        (9, vec![0.3], 1.0, 1.0),
    ] {
        assert_eq!(send(kind, &values, rate_per_s, interval_s), ARGUMENT, "{kind} {values:?}");
    }
    assert!(targets.newest().unwrap().is_none());
    for (kind, values, rate_per_s, interval_s) in [
        (target_kind::STEP, vec![0.3], 0.0, 0.0),
        (target_kind::RAMP, vec![0.4], 0.2, 0.0),
        (target_kind::SERIES, vec![0.1, 0.2, 0.3], 0.0, 0.1),
    ] {
        assert_eq!(send(kind, &values, rate_per_s, interval_s), OK);
        let found = targets.newest().unwrap().expect("the target");
        assert_eq!(&found.values[..found.value_count as usize], values);
        assert_eq!(found.target_kind, kind);
        assert!(kind != target_kind::RAMP || found.rate_per_s == rate_per_s);
        assert!(kind != target_kind::SERIES || found.interval_s == interval_s);
    }
    hold_follows_the_target(&stage, send);
    setpoint_of_a_cavity_is_read(bus);
    // SAFETY: both are live and closed once.
    unsafe {
        softtwin_writer_close(writer);
        softtwin_bus_close(bus);
    }
}

/// A running `softtwin hold` takes a step of C, and refuses one out of reach.
fn hold_follows_the_target(stage: &Stage, send: impl Fn(u32, &[f64], f64, f64) -> softtwin_status) {
    let (bus, finger) = (stage.bus(), "finger");
    let scene =
        stage.write("finger.toml", "name = \"s\"\n[[actuator]]\nname = \"finger\"\nmodel = \"beam.twin\"\n");
    let _twin = Program::twin(stage, &scene);
    let stop = Arc::new(AtomicBool::new(false));
    let (stopped, domain) = (stop.clone(), stage.domain());
    let gauge = std::thread::spawn(move || {
        let mut sensor =
            SensorWriter::create(&Bus::open(&domain).unwrap(), &Topic::sensor(finger).unwrap()).unwrap();
        let mut seq = 0;
        while !stopped.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(5)); // pace of the readings
            seq += 1;
            let reading = SensorSample { boot_id: 3, seq, t_sensor_ns: now_ns(), ..SensorSample::default() };
            sensor.publish(SensorSample { pressure_mpa: 0.03, gap_mm: GAP_MM, ..reading }).unwrap();
        }
    });
    let setpoints = SetpointReader::attach(&bus, &Topic::setpoint(finger).unwrap()).unwrap();
    let path = scene.display().to_string();
    let mut holds = Program::tool(stage, &["hold", "--json", "--scene", &path, "--pressure", "0.03"]);
    let reaches = |mpa: f64| {
        wait_for(&setpoints, "the setpoint", |setpoints| {
            setpoints.newest().unwrap().filter(|setpoint| (setpoint.pressure_mpa - mpa).abs() < 3e-4)
        });
    };
    reaches(0.03);
    assert_eq!(send(target_kind::STEP, &[9.0], 0.0, 0.0), OK);
    holds.wait_for("of `planner` refused: 9 MPa cannot be held");
    assert_eq!(send(target_kind::STEP, &[0.032], 0.0, 0.0), OK);
    reaches(0.032);
    let (status, said) = holds.stop();
    assert!(status.success() && said.join("\n").contains("\"target\":0.032"), "{said:?}");
    stop.store(true, Ordering::Relaxed);
    gauge.join().unwrap();
}

/// Writer and reader of a further cavity's setpoints.
fn setpoint_of_a_cavity_is_read(bus: *mut softtwin_bus) {
    let (mut writer, mut reader, mut found) = (null_mut(), null_mut(), Setpoint::default());
    let (name, cavity, owner) = (c"finger".as_ptr(), c"left".as_ptr(), c"planner".as_ptr());
    // SAFETY: handles are live until they are closed; the place has the size that is given.
    unsafe {
        assert_eq!(softtwin_writer_open_setpoint(bus, name, cavity, owner, &mut writer), OK);
        assert_eq!(softtwin_reader_open(bus, name, c"setpoint/left".as_ptr(), null(), &mut reader), OK);
        assert_eq!(softtwin_writer_send_setpoint(writer, 0.02, 50, 7), OK);
        let place = (&raw mut found).cast();
        assert_eq!(softtwin_reader_read(reader, 1, 1000, place, size_of::<Setpoint>()), OK);
        softtwin_reader_close(reader);
        softtwin_writer_close(writer);
    }
    assert_eq!((found.pressure_mpa, found.t_sensor_ns, found.valid_for_ns), (0.02, 7, 50_000_000));
}
