//! Real-time settings of a running twin: in force where the system grants them, said by name where it does not.

use std::path::PathBuf;
use tests::{Program, Stage};

/// Starts the twin with these real-time settings; returns it when it is ready.
fn start(stage: &Stage, realtime: &str) -> Program {
    let (scene, settings) = files(stage, realtime);
    let arguments =
        ["twin", "--scene", &scene.display().to_string(), "--config", &settings.display().to_string()];
    let mut twin = Program::daemon(stage, &arguments);
    twin.wait_for("ready:");
    twin
}

fn files(stage: &Stage, realtime: &str) -> (PathBuf, PathBuf) {
    let settings = stage.write("twin.toml", &format!("[realtime]\n{realtime}"));
    (stage.finger("kind = \"simulate\""), settings)
}

/// A value of the process's status file, such as `VmLck`.
fn status(process: &str, key: &str) -> String {
    let text = std::fs::read_to_string(format!("/proc/{process}/status")).expect("the process lives");
    let line = text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':'));
    line.expect("the system tells").trim().to_owned()
}

/// Real-time priority and scheduling policy of the thread that runs the loop, the program's first.
fn scheduling(process: u32) -> (u32, u32) {
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).expect("the process lives");
    let after_name = text.rsplit_once(')').expect("the name is in parentheses").1;
    let number =
        |field: usize| after_name.split_whitespace().nth(field - 3).and_then(|text| text.parse().ok());
    (number(40).expect("rt_priority"), number(41).expect("policy"))
}

#[test]
fn granted_real_time_settings_apply_and_refused_ones_are_logged() {
    let stage = Stage::new("realtime");
    let cores = status("self", "Cpus_allowed_list");
    let core: usize = cores.split(['-', ',']).next().and_then(|first| first.parse().ok()).expect("a core");
    let settings = format!("lock_memory = true\nprefault = true\nfifo_priority = 7\ncores = [{core}]");
    let twin = start(&stage, &settings);
    let refused =
        |setting: &str| twin.said.iter().any(|line| line.contains(&format!("realtime.{setting}: refused")));
    let process = twin.id();
    assert!(!refused("cores"), "a permitted core is always granted: {:?}", twin.said);
    assert_eq!(status(&process.to_string(), "Cpus_allowed_list"), core.to_string());
    assert_ne!(refused("lock_memory"), status(&process.to_string(), "VmLck") != "0 kB");
    assert_ne!(refused("fifo_priority"), scheduling(process) == (7, libc::SCHED_FIFO as u32));
}

/// The request is in force as long as its file is open.
#[test]
fn stay_awake_holds_while_the_twin_runs() {
    let stage = Stage::new("awake");
    let twin = start(&stage, "stay_awake = true");
    let refused = twin.said.iter().any(|line| line.contains("realtime.stay_awake: refused"));
    let files = std::fs::read_dir(format!("/proc/{}/fd", twin.id())).expect("the process lives");
    let names = files.filter_map(|file| std::fs::read_link(file.ok()?.path()).ok());
    let held = names.filter(|name| name == std::path::Path::new("/dev/cpu_dma_latency")).count();
    assert_eq!(held, usize::from(!refused), "{:?}", twin.said);
}

#[test]
fn missing_right_warns_or_ends_as_configured() {
    let stage = Stage::new("rights");
    let nowhere = "cores = [1023]";
    let twin = start(&stage, nowhere);
    let warnings = twin.said.iter().filter(|line| line.contains("realtime.cores: refused"));
    assert_eq!(warnings.count(), 1, "{:?}", twin.said);
    drop(twin);

    let (scene, settings) = files(&stage, &format!("{nowhere}\non_missing_rights = \"stop\""));
    let arguments =
        ["twin", "--scene", &scene.display().to_string(), "--config", &settings.display().to_string()];
    let (status, said) = Program::daemon(&stage, &arguments).ended();
    assert_eq!(status.code(), Some(1), "{said:?}");
    assert!(said.iter().any(|line| line.contains("realtime.cores: refused")), "{said:?}");
    assert!(!said.iter().any(|line| line.contains("ready:")), "{said:?}");
}

#[test]
fn busy_polling_twin_publishes_the_same_states() {
    let stage = Stage::new("spin");
    let twin = start(&stage, "busy_poll = true");
    let bridge = Program::bridge(&stage, &stage.finger("kind = \"simulate\""));
    let mut echo = Program::tool(&stage, &["echo", "softtwin/finger/state", "--once", "--json"]);
    echo.wait_for("contact_force_n");
    drop(bridge);
    let (status, said) = twin.stop();
    assert!(status.success(), "{said:?}");
}
