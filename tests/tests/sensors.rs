//! A bridge with several sensors, as processes: one is held up, one is pulled, the bridge is killed.

use std::net::UdpSocket;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::Instant;
use tests::Stage;
use tests::process::Program;
use tests::wait::wait_until;
use wire::{Outcome, SensorReader, SensorSample, StateReader, Topic};

fn reading(reader: &SensorReader, what: &str, mut fits: impl FnMut(&SensorSample) -> bool) -> SensorSample {
    wait_until(what, || reader.newest().expect("readable").filter(&mut fits))
}

fn runs(pid: i32) -> bool {
    std::fs::read_to_string(format!("/proc/{pid}/stat")).is_ok_and(|stat| !stat.contains(") Z "))
}

fn signal(pid: i32, signal: i32) {
    // SAFETY: a signal to a process that the test has started.
    assert_eq!(unsafe { libc::kill(pid, signal) }, 0);
}

/// Model, trace and command of a scene count from its folder, also where it is named without one.
#[test]
fn paths_in_a_scene_named_without_a_folder_are_found() {
    let stage = Stage::new("bare");
    let gauge = stage.write("gauge.sh", "#!/bin/sh\nwhile echo \"0.03; 40\"; do sleep 0.01; done\n");
    std::fs::set_permissions(gauge, std::fs::Permissions::from_mode(0o755)).unwrap();
    stage.write(
        "gauge.toml",
        "name = \"bare\"\n[[actuator]]\nname = \"finger\"\nmodel = \"beam.twin\"\npace = 100\n\
         [actuator.sensors.gauge]\nkind = \"lines\"\ncommand = [\"./gauge.sh\"]\nage_limit_ms = 3000\n\
         values.pressure_mpa = { from = 1 }\nvalues.gap_mm = { from = 2 }\n",
    );
    stage.trace("short.csv", 10, 500.0, 0.03, 40.0);
    stage.finger("kind = \"replay\"\ntrace = \"short.csv\"");
    for folder in ["", "./"] {
        let twin = Program::twin(&stage, Path::new(&format!("{folder}finger.toml")));
        let replay = ["bridge", "--scene", &format!("{folder}finger.toml")];
        assert_eq!(Program::daemon(&stage, &replay).ended().0.code(), Some(0), "{folder}");
        let bridge = Program::bridge(&stage, Path::new(&format!("{folder}gauge.toml")));
        let readings = SensorReader::open(&stage.bus(), &Topic::sensor("finger").unwrap()).unwrap();
        reading(&readings, "a reading of the program", |reading| reading.pressure_mpa == 0.03);
        assert!(bridge.stop().0.success() && twin.stop().0.success(), "{folder}");
    }
}

#[test]
fn silent_sensor_holds_the_twin_and_killed_bridge_ends_its_program() {
    let stage = Stage::new("mixed");
    let scale = UdpSocket::bind("127.0.0.1:0").unwrap();
    let to = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    // A gauge that is a program; what it prints as the gap's second cell is its own number.
    stage.write("gauge.sh", "while echo \"0.03; 40; $$\"; do sleep 0.005; done\n");
    let scene = stage.write(
        "mixed.toml",
        &format!(
            "name = \"mixed\"\n[[actuator]]\nname = \"finger\"\nmodel = \"beam.twin\"\npace = 200\n\
             [actuator.sensors.gauge]\nkind = \"lines\"\ncommand = [\"/bin/sh\", \"gauge.sh\"]\nage_limit_ms = 300\n\
             values.pressure_mpa = {{ from = 1 }}\nvalues.gap_mm = {{ from = 2 }}\nvalues.marker1_x_mm = {{ from = 3 }}\n\
             [actuator.sensors.scale]\nkind = \"lines\"\nudp = \"{to}\"\nage_limit_ms = 300\nvalues.force_n = {{ from = 1 }}\n"
        ),
    );
    let twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    let bus = stage.bus();
    let readings = SensorReader::open(&bus, &Topic::sensor("finger").unwrap()).unwrap();
    let states = StateReader::open(&bus, &Topic::state("finger").unwrap()).unwrap();
    let whole = reading(&readings, "all values", |reading| {
        scale.send_to(b"0.25\n", to).unwrap();
        reading.stale_values == 0
    });
    assert_eq!(
        (whole.pressure_mpa, whole.gap_mm, whole.measured_force_n, whole.status),
        (0.03, 40.0, 0.25, 0)
    );
    assert_eq!((whole.age_count, whole.marker_values), (11, 3));
    let pid = whole.markers_mm[0].x as i32;
    assert!(runs(pid));

    // The scale is silent: its value becomes absent, the twin continues.
    let without = reading(&readings, "a reading without the force", |reading| reading.stale_values == 0b100);
    assert!(without.measured_force_n.is_nan() && without.status == 0 && without.pressure_mpa == 0.03);
    let state = wait_until("a state without a measured force", || {
        states.newest().unwrap().filter(|state| state.measured_force_n.is_nan() && state.sensor_seq > 0)
    });
    assert_eq!(Outcome::from_code(state.outcome), Some(Outcome::Published));

    // The gauge is held up: absent within its limit, and the twin holds the last state for this reason.
    signal(pid, libc::SIGSTOP);
    let held_up = reading(&readings, "a reading without the pressure", |reading| reading.status == 256);
    assert!(
        held_up.pressure_mpa.is_nan() && held_up.gap_mm.is_nan() && held_up.stale_values & 0b1011 == 0b1011
    );
    assert!((300_000_000..600_000_000).contains(&held_up.ages_ns.pressure), "{held_up:?}");
    wait_until("the held state", || {
        states.newest().unwrap().filter(|state| state.outcome == Outcome::HeldSensorFault.code())
    });
    signal(pid, libc::SIGCONT);
    reading(&readings, "the pressure again", |reading| reading.status == 0 && reading.pressure_mpa == 0.03);
    wait_until("a fresh state", || {
        states.newest().unwrap().filter(|state| state.outcome == Outcome::Published.code())
    });

    bridge.kill();
    wait_until("the end of the program", || (!runs(pid)).then_some(()));
    drop(twin);
}

/// Error output of a sensor's program is in the bridge's log, with a limit.
#[test]
fn sensor_programs_error_output_is_logged_up_to_a_limit() {
    const FLOOD: u64 = 3000;
    let stage = Stage::new("complains");
    // Its first start complains and ends, with last words that have no end of line; its second one measures.
    stage.write(
        "gauge.sh",
        &format!(
            "if [ -e begun ]; then while echo \"0.03; 40\"; do sleep 0.01; done; fi\n: > begun\n\
             echo 'the supply voltage is low' >&2\n\
             i=0; while [ $i -lt {FLOOD} ]; do echo \"flood $i\" >&2; i=$((i + 1)); done\n\
             printf 'long %09000d\\n' 7 >&2\nprintf 'no power' >&2\n"
        ),
    );
    let scene = stage.write(
        "complains.toml",
        "name = \"complains\"\n[[actuator]]\nname = \"finger\"\nmodel = \"beam.twin\"\npace = 100\n\
         [actuator.sensors.gauge]\nkind = \"lines\"\ncommand = [\"/bin/sh\", \"gauge.sh\"]\nage_limit_ms = 300\n\
         values.pressure_mpa = { from = 1 }\nvalues.gap_mm = { from = 2 }\n",
    );
    let mut bridge = Program::bridge(&stage, &scene);
    bridge.wait_for("no power");
    let readings = SensorReader::open(&stage.bus(), &Topic::sensor("finger").unwrap()).unwrap();
    reading(&readings, "a reading of the second start", |reading| reading.pressure_mpa == 0.03);
    let (status, said) = bridge.stop();
    assert!(status.success(), "{said:?}");
    let of_program: Vec<&str> =
        said.iter().filter_map(|line| Some(line.split_once("/bin/sh: ")?.1)).collect();
    assert_eq!(of_program[0], "the supply voltage is low", "{of_program:?}");
    let (hidden, shown): (Vec<&str>, Vec<&str>) =
        of_program.iter().partition(|line| line.contains(" more lines, "));
    let hidden = hidden.iter().map(|line| line.split(' ').next().unwrap().parse::<u64>().unwrap());
    assert_eq!(hidden.sum::<u64>() + shown.len() as u64, FLOOD + 3, "every line is shown or counted");
    assert!(shown.len() < 200, "{} lines of one program in some seconds", shown.len());
    assert!(of_program.iter().all(|line| line.len() < 3000), "a line longer than the limit");
}

/// A program that writes garbage as fast as it can, another line each time, and one whose line never ends.
#[test]
fn garbage_is_logged_at_a_limited_rate_and_a_line_without_end_is_reported() {
    let stage = Stage::new("garbage");
    let scene = stage.write(
        "garbage.toml",
        "name = \"garbage\"\n[[actuator]]\nname = \"finger\"\nmodel = \"beam.twin\"\npace = 100\n\
         [actuator.sensors.gauge]\nkind = \"lines\"\ncommand = [\"/bin/sh\", \"gauge.sh\"]\nage_limit_ms = 300\n\
         values.pressure_mpa = { from = 1 }\nvalues.gap_mm = { from = 2 }\n",
    );
    stage.write("gauge.sh", "i=0; while :; do i=$((i + 1)); echo \"bad$i; 40\"; done");
    let begin = Instant::now();
    let mut bridge = Program::bridge(&stage, &scene);
    bridge.wait_for("more lines");
    let (status, said) = bridge.stop();
    assert!(status.success(), "{said:?}");
    let shown = said.iter().filter(|line| line.contains("`bad") && !line.contains("more lines")).count();
    let periods = begin.elapsed().as_secs() as usize + 2;
    assert!((2..=20 * periods).contains(&shown), "{shown} lines in {periods} s");

    stage.write("gauge.sh", "while printf 0.03; do :; done");
    let mut bridge = Program::bridge(&stage, &scene);
    bridge.wait_for("more than 2048 bytes");
    assert!(bridge.stop().0.success());
}
