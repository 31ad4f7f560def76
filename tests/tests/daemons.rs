//! Daemons in hostile surroundings: a log that cannot be written, sources that never wait, floods, files taken away.

use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use tests::skip::{Missing, skipped};
use tests::wait::{fresh, states, wait_for, wait_state, wait_until};
use tests::{PATIENCE, Program, Stage, process};
use wire::layout::query_kind;
use wire::{HealthReader, Query, QueryClient, Topic};

const STEADY: &str = r#"kind = "simulate"
rate_hz = 200.0
gap_mm = 30.0
profile = { shape = "sine", mean_mpa = 0.035, amplitude_mpa = 0.03, frequency_hz = 1.0 }"#;

/// Where a daemon's log goes.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Log {
    FullDisk,
    ClosedPipe,
}

/// A daemon whose log cannot be written.
fn mute(stage: &Stage, daemon: &str, scene: &Path, log: Log) -> Child {
    let stderr = match log {
        Log::FullDisk => Stdio::from(std::fs::File::options().write(true).open("/dev/full").unwrap()),
        Log::ClosedPipe => Stdio::piped(),
    };
    let mut child = Command::new(process::binary("softtwind"))
        .args([daemon, "--scene", &scene.display().to_string()])
        .env("SOFTTWIN_DOMAIN", &stage.domain_name)
        .env("SOFTTWIN_ROOT", stage.root())
        .env_remove("NOTIFY_SOCKET")
        .env_remove("RUST_LOG")
        .stdout(Stdio::null())
        .stderr(stderr)
        .spawn()
        .unwrap();
    drop(child.stderr.take());
    child
}

/// Asks a child to end and returns its exit code.
fn stop(mut child: Child) -> Option<i32> {
    // SAFETY: the child is ours and not yet waited for.
    assert_eq!(unsafe { libc::kill(child.id() as i32, libc::SIGTERM) }, 0);
    wait_until("the end of the program", || child.try_wait().unwrap()).code()
}

#[test]
fn unwritable_log_is_counted_and_daemons_keep_serving() {
    for log in [Log::FullDisk, Log::ClosedPipe] {
        let stage = Stage::new("mute");
        let scene = stage.finger(STEADY);
        let twin = mute(&stage, "twin", &scene, log);
        let bus = stage.bus();
        let health = HealthReader::attach(&bus, &Topic::health("finger").unwrap()).unwrap();
        let state = wire::StateReader::attach(&bus, &Topic::state("finger").unwrap()).unwrap();
        let bridge = mute(&stage, "bridge", &scene, log);
        wait_state(&state, "a fresh state", fresh);
        // The start of the bridge, changes of the regime and more are lines for the log.
        let lost = wait_for(&health, "lost lines", |health| {
            health.newest().unwrap().map(|health| health.log_lost).filter(|lost| *lost > 3)
        });
        // The reporter lives: the count continues with the next changes.
        wait_for(&health, "more lost lines", |health| {
            health.newest().unwrap().filter(|health| health.log_lost > lost)
        });
        assert_eq!((stop(bridge), stop(twin)), (Some(0), Some(0)), "{log:?}");
    }
}

#[test]
fn source_without_pauses_ends_on_sigterm() {
    let stage = Stage::new("busy");
    stage.trace("trace.csv", 200, 100.0, 0.06, 30.0);
    let scene = stage.finger("kind = \"replay\"\ntrace = \"trace.csv\"").display().to_string();
    let fast = stage.finger(&STEADY.replace("200.0", "2e4")).display().to_string();
    for arguments in
        [vec!["bridge", "--scene", &scene, "--loop", "--speed", "1e6"], vec!["bridge", "--scene", &fast]]
    {
        let stage = Stage::new("busy");
        let mut bridge = Program::daemon(&stage, &arguments);
        bridge.wait_for("ready:");
        let (status, said) = bridge.stop();
        assert!(status.success(), "{said:?}");
    }
    // The twin that gets such a flood ends as well.
    let twin = Program::twin(&stage, Path::new(&fast));
    let mut bridge = Program::daemon(&stage, &["bridge", "--scene", &fast]);
    bridge.wait_for("ready:");
    wait_state(&states(&stage.bus()), "a state", |state| state.sensor_seq > 1000);
    let (status, said) = twin.stop();
    assert!(status.success(), "{said:?}");
    assert!(bridge.stop().0.success());
}

/// Many clients that ask as fast as they can: all are answered, the stream continues, and the twin ends on SIGTERM.
#[test]
fn flood_of_queries_delays_neither_stream_nor_end() {
    let stage = Stage::new("flood");
    let scene = stage.finger(STEADY);
    let twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    let flooding = AtomicBool::new(true);
    std::thread::scope(|scope| {
        for number in 0..4_u32 {
            let (domain, flooding) = (stage.domain(), &flooding);
            scope.spawn(move || {
                let bus = wire::Bus::open(&domain).unwrap();
                let mut client = QueryClient::open(&bus, "finger").unwrap();
                let pressure_mpa = 0.01 + 0.01 * f64::from(number);
                let query =
                    Query { kind: query_kind::WHATIF, pressure_mpa, gap_mm: 30.0, ..Query::default() };
                let mut answered = 0;
                while flooding.load(Ordering::Relaxed) || answered == 0 {
                    let sample = client.ask(&query, PATIENCE).unwrap();
                    assert_eq!(sample.answer().pressure_mpa, pressure_mpa, "an answer to another question");
                    answered += 1;
                }
            });
        }
        let bus = stage.bus();
        let state = states(&bus);
        let first = wait_state(&state, "a state", fresh).sensor_seq;
        wait_state(&state, "the stream", |state| fresh(state) && state.sensor_seq > first + 400);
        flooding.store(false, Ordering::Relaxed);
    });
    let (status, said) = twin.stop();
    assert!(status.success(), "{said:?}");
    assert!(bridge.stop().0.success());
    let _ = std::io::stdout().flush();
}

/// A cleaner of temporary files empties iceoryx2's folder, or /dev/shm: the daemons report it and end with a failure, so that the
/// service manager restarts them.
#[test]
fn removed_iceoryx2_files_end_the_daemons() {
    let stage = Stage::new("cleaner");
    let scene = stage.finger(STEADY);
    for removed in ["", ".dynamic", ".data", ".writer"] {
        let mut twin = Program::twin(&stage, &scene);
        let mut bridge = Program::bridge(&stage, &scene);
        // A recorder, which publishes nothing, has no files of the last two kinds.
        let run = stage.path(&format!("run{removed}.mcap"));
        let mut recorder = ["", ".dynamic"]
            .contains(&removed)
            .then(|| Program::tool(&stage, &["record", "--out", &run.display().to_string()]));
        if recorder.is_some() {
            wait_until("a recording", || std::fs::metadata(&run).ok().filter(|file| file.len() > 100_000));
        }
        if removed.is_empty() {
            // A daemon may make a file in it meanwhile.
            while stage.root().exists() {
                let _ = std::fs::remove_dir_all(stage.root());
            }
        }
        for file in stage.everything() {
            if !removed.is_empty() && file.to_string_lossy().ends_with(removed) {
                std::fs::remove_file(file).unwrap();
            }
        }
        for daemon in [&mut twin, &mut bridge].into_iter().chain(&mut recorder) {
            let (status, said) = daemon.end();
            assert_eq!(status.code(), Some(1), "{removed}: {said:?}");
        }
        if recorder.is_some() {
            let (status, said) =
                Program::tool(&stage, &["export", &run.display().to_string(), "--out", "tables"]).ended();
            assert!(status.success(), "the recording is whole up to then: {said:?}");
            std::fs::remove_dir_all(stage.path("tables")).unwrap();
        }
    }
    // The next ones start with what is left.
    let twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    wait_state(&states(&stage.bus()), "a fresh state", fresh);
    assert!(bridge.stop().0.success() && twin.stop().0.success());
}

/// Endless files and pipes without a writer in place of every file that a daemon reads.
#[test]
fn endless_files_are_refused() {
    let stage = Stage::new("endless");
    let scene = stage.finger(STEADY).display().to_string();
    let pipe = stage.path("pipe").display().to_string();
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for endless in ["/dev/zero", &pipe] {
        for command in [
            vec!["twin", "--scene", endless],
            vec!["bridge", "--scene", endless],
            vec!["twin", "--scene", &scene, "--config", endless],
            vec!["twin", "--scene", &scene, "--model", endless],
            vec!["bridge", "--scene", &scene, "--trace", endless],
        ] {
            let (status, said) = Program::daemon(&stage, &command).ended();
            let said = said.join("\n");
            assert_eq!(status.code(), Some(78), "{command:?}: {said}");
            assert!(said.contains(endless), "{command:?}: {said}");
        }
    }
}

/// Attaches to one thread of a program and lets its next `call` fail, which the standard library and tokio take for impossible:
/// the thread panics.
fn panic_in(program: &Program, thread: &str, call: &str) -> Child {
    // A thread gives itself its name a moment after it is started.
    let number = wait_until(thread, || {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", program.id())).unwrap();
        let is_named =
            |task: &Path| std::fs::read_to_string(task.join("comm")).is_ok_and(|name| name.trim() == thread);
        let task = tasks.map(|task| task.unwrap().path()).find(|task| is_named(task))?;
        Some(task.file_name().unwrap().to_str().unwrap().to_owned())
    });
    let inject = format!("inject={call}:error=EINVAL");
    Command::new("strace")
        .args(["-qq", "-o", "/dev/null", "-p", &number, "-e", &format!("trace={call}"), "-e", &inject])
        .stderr(Stdio::null())
        .spawn()
        .expect("strace is installed (.ci/run does it)")
}

#[test]
fn panicked_thread_ends_the_daemon_and_is_named() {
    let stage = Stage::new("thread");
    let scene = stage.finger(STEADY).display().to_string();
    for (daemon, thread, call) in [
        ("twin", "reporter", "clock_nanosleep"),
        ("twin", "loader", "clock_nanosleep"),
        ("twin", "files", "clock_nanosleep"),
        ("twin", "metrics", "epoll_wait"),
        ("bridge", "status", "clock_nanosleep"),
        ("bridge", "metrics", "epoll_wait"),
    ] {
        let mut program = Program::daemon(&stage, &[daemon, "--scene", &scene, "--metrics", "127.0.0.1:0"]);
        program.wait_for("ready:");
        let mut tracer = panic_in(&program, thread, call);
        let (status, said) = program.end();
        let said = said.join("\n");
        tracer.wait().unwrap();
        assert_eq!(status.code(), Some(1), "{daemon}, {thread}: {said}");
        let expected = format!("the thread `{thread}` ended the program: it panicked");
        assert!(said.contains(&expected), "{daemon}, {thread}: {said}");
    }
}

/// All inodes of iceoryx2's folder are in use while bytes are free.
#[test]
fn exhausted_inodes_are_named() {
    let stage = Stage::new("inodes");
    stage.finger(STEADY);
    std::fs::create_dir_all(stage.root()).unwrap();
    let mount = format!("mount -t tmpfs -o size=64m,nr_inodes=20,mode=700 tmpfs {}", stage.root().display());
    if !Command::new("unshare")
        .args(["-m", "sh", "-c", &mount])
        .output()
        .is_ok_and(|out| out.status.success())
    {
        return skipped(Missing::SmallSharedMemory);
    }
    let script = stage.write("test.sh", &format!("{mount}\nexec softtwind twin --scene finger.toml"));
    let (status, said) = Program::shell(&stage, &format!("exec unshare -m sh {}", script.display())).ended();
    let said = said.join("\n");
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(said.contains("inodes") && !said.contains("panicked"), "{said}");
}
