//! Faults around a running twin, with real processes. After each fault all received samples are bit-identical to the model, the
//! stream continues, and no files remain.

use std::process::Command;
use std::time::Instant;
use tests::Verifier;
use tests::http::{free_address, metric};
use tests::skip::{Missing, skipped};
use tests::stage::{model_bytes, other_model_bytes};
use tests::wait::{fresh, states, wait_for, wait_state, wait_until};
use tests::{PATIENCE, Program, Stage};
use wire::layout::flags;
use wire::{
    Bus, FieldReader, Health, HealthReader, KeyExpr, Outcome, SensorSample, SensorWriter, StateReader, Topic,
    now_ns,
};

fn source(rate_hz: f64) -> String {
    format!(
        "kind = \"simulate\"\nrate_hz = {rate_hz:?}\ngap_mm = 30.0\n\
         profile = {{ shape = \"sine\", mean_mpa = 0.035, amplitude_mpa = 0.03, frequency_hz = 2.0 }}"
    )
}

fn all_fields(bus: &Bus) -> FieldReader {
    FieldReader::open(bus, &Topic::field("finger", None).unwrap()).unwrap()
}

/// Verifies fields until `count` of one run of the twin that is not `before` have come; returns that run.
fn verify_fields(reader: &FieldReader, verifier: &mut Verifier, before: u64, count: u64) -> u64 {
    let (mut run, mut seen) = (0, 0);
    wait_for(reader, "fields of the new twin", |reader| {
        // The verifier is slower than the twin: what comes after the last one wanted must not be waited out.
        while seen < count {
            let sample = reader.next().unwrap()?;
            verifier.field(&sample);
            if sample.header().boot_id != before {
                run = sample.header().boot_id;
                seen += 1;
            }
        }
        Some(())
    });
    run
}

/// Verifies what is still waiting: after a kill, the last samples of the killed program.
fn verify_rest(reader: &FieldReader, verifier: &mut Verifier) {
    while let Some(sample) = reader.next().unwrap() {
        verifier.field(&sample);
    }
}

fn open_files(process: u32) -> usize {
    std::fs::read_dir(format!("/proc/{process}/fd")).unwrap().count()
}

fn threads(process: u32) -> usize {
    std::fs::read_dir(format!("/proc/{process}/task")).unwrap().count()
}

/// Twin, bridge and reader die by signal 9 in every order and come back in every order.
#[test]
fn roles_recover_after_kills_in_every_order() {
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let stage = Stage::new("orders");
    let scene = stage.finger(&source(200.0));
    let text = scene.display().to_string();
    let start = |role: usize| match role {
        0 => Program::daemon(&stage, &["twin", "--scene", &text]),
        1 => Program::daemon(&stage, &["bridge", "--scene", &text]),
        _ => Program::tool(&stage, &["echo", "softtwin/finger/field", "--json"]),
    };
    let mut verifier = Verifier::new(model_bytes()).expect("a model");
    let twin = Program::twin(&stage, &scene);
    let bus = stage.bus();
    let (fields, states) = (all_fields(&bus), states(&bus));
    let mut roles: Vec<Option<Program>> = vec![Some(twin), Some(start(1)), Some(start(2))];
    let mut run = verify_fields(&fields, &mut verifier, 0, 5);
    let mut leftovers = Vec::new();
    for (round, order) in ORDERS.iter().enumerate() {
        for role in order {
            roles[*role].take().unwrap().kill();
        }
        verify_rest(&fields, &mut verifier);
        let begin = Instant::now();
        for role in ORDERS[(round * 5 + 1) % ORDERS.len()] {
            roles[role] = Some(start(role));
        }
        run = verify_fields(&fields, &mut verifier, run, 5);
        wait_state(&states, "a fresh state", |state| {
            verifier.state(state);
            state.boot_id == run && fresh(state)
        });
        roles[2].as_mut().unwrap().wait_for("max_von_mises");
        println!("killed {order:?} (twin, bridge, reader): all back after {:?}", begin.elapsed());
        // Programs that start at once may each leave a dead one's files to the other; the next to start removes them.
        drop(stage.bus());
        leftovers.push(stage.leftovers().len());
    }
    assert!(verifier.counts.all_correct(), "{:?}", verifier.counts);
    assert!(leftovers.iter().all(|count| *count <= leftovers[0] + 8), "files pile up: {leftovers:?}");
    for role in [2, 1, 0] {
        let program = roles[role].take().unwrap();
        program.signal(if role == 2 { libc::SIGINT } else { libc::SIGTERM });
        let (status, said) = program.ended();
        assert!(status.success(), "{said:?}");
    }
    drop((fields, states, bus));
    drop(stage.bus());
    assert_eq!(stage.leftovers(), Vec::<String>::new(), "files are left behind");
}

/// At 20 kHz the twin is always within a publish when it dies; whole fields of a real size show a torn one.
#[test]
fn twin_killed_during_publish_leaves_no_torn_field() {
    let bytes =
        std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../models/pneunet/pneunet.twin")).unwrap();
    let stage = Stage::with_model("publish", &bytes);
    let scene = stage.whole_finger(&source(20_000.0));
    let text = scene.display().to_string();
    let mut verifier = Verifier::new(&bytes).expect("a model");
    let mut twin = Program::twin(&stage, &scene);
    let bus = stage.bus();
    let fields = all_fields(&bus);
    let bridge = Program::bridge(&stage, &scene);
    let mut run = 0;
    for round in 0..8 {
        // Another number of fields each time: the kill falls into another place of the loop.
        run = verify_fields(&fields, &mut verifier, run, 3 + 7 * round);
        twin.kill();
        verify_rest(&fields, &mut verifier);
        twin = Program::daemon(&stage, &["twin", "--scene", &text]);
    }
    verify_fields(&fields, &mut verifier, run, 5);
    assert!(verifier.counts.all_correct(), "{:?}", verifier.counts);
    println!("{} whole fields around 8 kills, none wrong", verifier.counts.fields_checked);
    assert!(twin.stop().0.success() && bridge.stop().0.success());
}

/// A reader that holds what it has, one that is stopped, and twenty that come and go (half of them killed) cost the others
/// nothing: not a state is missing, and the twin holds no more files and threads than before.
#[test]
fn slow_stopped_and_short_lived_readers_do_not_delay_others() {
    let stage = Stage::new("readers");
    let scene = stage.finger(&source(200.0));
    let twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    let bus = stage.bus();
    let mut verifier = Verifier::new(model_bytes()).expect("a model");
    let (good, slow) = (states(&bus), all_fields(&bus));
    let listen = |verifier: &mut Verifier, count: u64| {
        let end = verifier.counts.states_checked + count;
        wait_state(&good, "states", |state| {
            verifier.state(state);
            verifier.counts.states_checked >= end
        });
    };
    listen(&mut verifier, 20);
    let before = (open_files(twin.id()), threads(twin.id()));
    let held = wait_for(&slow, "a field", |slow| slow.next().unwrap());
    let values: Vec<u32> = held.values().iter().map(|value| value.to_bits()).collect();
    let mut stopped = Program::tool(&stage, &["echo", "softtwin/finger/field", "--json"]);
    stopped.wait_for("max_von_mises");
    stopped.signal(libc::SIGSTOP);
    for group in 0..4 {
        let mut readers: Vec<Program> =
            (0..5).map(|_| Program::tool(&stage, &["echo", "softtwin/finger/*", "--json"])).collect();
        for reader in &mut readers {
            reader.wait_for("contact_force_n");
            // While it started, states came: the queue of 2048 must not run over before they are read.
            while let Some(state) = good.next().expect("readable") {
                verifier.state(&state);
            }
        }
        listen(&mut verifier, 50);
        for (number, reader) in readers.into_iter().enumerate() {
            if (group + number) % 2 == 0 {
                reader.kill();
            } else {
                reader.signal(libc::SIGINT);
                assert!(reader.ended().0.success());
            }
        }
    }
    listen(&mut verifier, 100);
    stopped.kill();
    assert!(verifier.counts.all_correct(), "{:?}", verifier.counts);
    assert_eq!(verifier.counts.states_lost, 0, "of {} states", verifier.counts.states_checked);
    assert!(held.values().iter().map(|value| value.to_bits()).eq(values), "a held field changed");
    drop(held);
    // What a dead reader held is given back when any program starts next, and its connections when the twin looks at its
    // readers again; a leak would be permanent, one per reader.
    let mut after = (usize::MAX, 0);
    for _ in 0..40 {
        drop(stage.bus());
        listen(&mut verifier, 50);
        after = (open_files(twin.id()), threads(twin.id()));
        if after.0 <= before.0 + 8 {
            break;
        }
    }
    assert!(after.0 <= before.0 + 8 && after.1 == before.1, "files and threads {before:?} -> {after:?}");
    assert!(twin.stop().0.success() && bridge.stop().0.success());
}

/// All memory of a running twin is its own from the start: it keeps running when other processes fill /dev/shm.
#[test]
fn memory_exhausted_after_the_start_refuses_new_programs_only() {
    let mount = "mount -t tmpfs -o size=64m tmpfs /dev/shm";
    if !Command::new("unshare").args(["-m", "sh", "-c", mount]).output().is_ok_and(|out| out.status.success())
    {
        return skipped(Missing::SmallSharedMemory);
    }
    let stage = Stage::new("exhausted");
    stage.finger(&source(200.0));
    let other =
        std::fs::read_to_string(stage.path("finger.toml")).unwrap().replace("\"finger\"", "\"thumb\"");
    stage.write("thumb.toml", &other);
    let script = format!(
        "{mount}
        softtwind twin --scene finger.toml & twin=$!
        softtwind bridge --scene finger.toml & bridge=$!
        until timeout 20 softtwin echo softtwin/finger/state --count 20 --json > before; do sleep 0.1; done
        echo before $(wc -l < before)
        dd if=/dev/zero of=/dev/shm/fill bs=64k 2>/dev/null
        softtwind twin --scene thumb.toml; echo newcomer $?
        timeout 20 softtwin echo softtwin/finger/state --count 1 --json > /dev/null; echo reader $?
        kill -0 $twin && kill -0 $bridge && echo alive
        rm /dev/shm/fill
        timeout 20 softtwin echo softtwin/finger/state --count 20 --json > after; echo after $(wc -l < after)
        kill $bridge $twin; wait $bridge; echo bridge $?; wait $twin; echo twin $?"
    );
    let script = stage.write("test.sh", &script).display().to_string();
    let (_, said) = Program::shell(&stage, &format!("unshare -m sh {script}")).end();
    let text = said.join("\n");
    let has = |line: &str| said.iter().any(|found| found == line);
    for line in ["before 20", "newcomer 1", "alive", "after 20", "bridge 0", "twin 0"] {
        assert!(has(line), "`{line}` is missing in:\n{text}");
    }
    assert!(text.contains("/dev/shm"), "{text}");
    // A reader allocates a little memory: it is served or refused, but never ended by a signal.
    assert!(has("reader 0") || has("reader 1"), "{text}");
}

/// The wall clock jumps by an hour, there and back: nothing here is stamped with it.
#[test]
fn steps_of_the_wall_clock_have_no_effect() {
    const JUMPING: &str = r#"
        #define _GNU_SOURCE
        #include <dlfcn.h>
        #include <time.h>
        int clock_gettime(clockid_t clock, struct timespec *now) {
            static int (*real)(clockid_t, struct timespec *);
            if (!real) real = dlsym(RTLD_NEXT, "clock_gettime");
            int result = real(clock, now);
            struct timespec up;
            real(CLOCK_MONOTONIC, &up);
            if (clock == CLOCK_REALTIME && up.tv_nsec / 100000000 % 2) now->tv_sec -= 3600;
            return result;
        }"#;
    let stage = Stage::new("clock");
    let (code, library) = (stage.write("jumping.c", JUMPING), stage.path("jumping.so"));
    let compiled =
        Command::new("cc").args(["-shared", "-fPIC", "-o"]).args([&library, &code]).arg("-ldl").status();
    assert!(compiled.is_ok_and(|status| status.success()), "a C compiler is among what the tests need");
    let scene = stage.finger(&source(200.0)).display().to_string();
    let jumping = [("LD_PRELOAD", library.display().to_string())];
    let mut twin = Program::daemon_with(&stage, &["twin", "--scene", &scene], &jumping);
    twin.wait_for("ready:");
    let bus = stage.bus();
    let reader = states(&bus);
    let bridge = Program::daemon_with(&stage, &["bridge", "--scene", &scene], &jumping);
    wait_state(&reader, "a fresh state", fresh);
    let (mut verifier, mut last_ns) = (Verifier::new(model_bytes()).expect("a model"), 0);
    let begin_ns = now_ns();
    wait_state(&reader, "two seconds of states", |state| {
        verifier.state(state);
        assert!(state.t_publish_ns >= last_ns && state.age_ns < 60_000_000_000, "{state:?}");
        last_ns = state.t_publish_ns;
        state.t_sensor_ns > begin_ns + 1_000_000_000
    });
    assert!(verifier.counts.all_correct(), "{:?}", verifier.counts);
    let health = HealthReader::open(&bus, &Topic::health("finger").unwrap()).unwrap();
    let health = wait_for(&health, "health", |health| health.newest().unwrap());
    let refused =
        [Outcome::HeldFuture, Outcome::HeldStale, Outcome::DroppedBackInTime].map(|o| health.count(o));
    assert_eq!(refused, [0; 3], "readings were refused for their time");
    assert!(twin.stop().0.success() && bridge.stop().0.success());
}

fn total(health: &Health) -> u64 {
    assert_eq!(health.outcomes.iter().sum::<u64>(), health.received, "a reading has no end");
    health.received + health.missed
}

/// No readings at all, then thousands at once: stale and recovered; each of the thousands is counted.
#[test]
fn silence_and_bursts_are_stale_and_counted() {
    let stage = Stage::new("bursts");
    let twin = Program::twin(&stage, &stage.finger(&source(200.0)));
    let bus = stage.bus();
    let (states, health) =
        (states(&bus), HealthReader::open(&bus, &Topic::health("finger").unwrap()).unwrap());
    wait_state(&states, "a state without data", |state| {
        state.flags & (flags::STALE | flags::NO_DATA) == flags::STALE | flags::NO_DATA
    });
    let mut sensor = SensorWriter::create(&bus, &Topic::sensor("finger").unwrap()).unwrap();
    let mut verifier = Verifier::new(model_bytes()).expect("a model");
    let mut sent = 0;
    for burst in [1u64, 5_000, 20_000] {
        for number in 0..burst {
            sent += 1;
            let pressure_mpa = 0.06 * number as f64 / burst as f64;
            let sample =
                SensorSample { boot_id: 5, seq: sent, t_sensor_ns: now_ns(), ..SensorSample::default() };
            sensor.publish(SensorSample { pressure_mpa, gap_mm: 30.0, ..sample }).unwrap();
        }
        wait_state(&states, "the newest reading's state", |state| {
            verifier.state(state);
            state.sensor_seq == sent
        });
        wait_state(&states, "stale after the burst", |state| state.flags & flags::STALE != 0);
    }
    let counted = wait_for(&health, "the last health", |health| {
        health.newest().unwrap().filter(|health| total(health) == sent)
    });
    assert!(verifier.counts.all_correct(), "{:?}", verifier.counts);
    println!("{sent} readings in bursts: {} received, {} never arrived", counted.received, counted.missed);
    assert!(twin.stop().0.success());
}

/// Extreme 64-bit numbers and jumping clocks: each reading has its outcome, no program ends, the next good one is
/// fresh, and what was recorded of it is read, exported and drawn.
#[test]
fn extreme_numbers_and_clocks_are_rejected_per_reading() {
    const JUMP: u64 = u64::MAX - 10;
    let stage = Stage::new("limits");
    let scene = stage.finger(&source(200.0)).display().to_string();
    // A loaded machine must not make good readings too old.
    let settings = stage.write("twin.toml", "[limits]\nmax_age_ms = 60000.0\n").display().to_string();
    let page = free_address();
    let mut twin =
        Program::daemon(&stage, &["twin", "--scene", &scene, "--config", &settings, "--metrics", &page]);
    twin.wait_for("ready:");
    let bus = stage.bus();
    let (states, topic) = (states(&bus), Topic::sensor("finger").unwrap());
    let health = HealthReader::open(&bus, &Topic::health("finger").unwrap()).unwrap();
    let out = stage.path("run.mcap").display().to_string();
    let mut recorder = Program::tool(&stage, &["record", "--out", &out, "--json"]);
    wait_until("a recorder", || {
        let found = bus.topics(&KeyExpr::new(topic.name()).unwrap()).unwrap();
        found.iter().any(|info| info.readers.contains(&recorder.id())).then_some(())
    });
    let mut sensor = SensorWriter::create(&bus, &topic).unwrap();
    let mut sent = 0_u64;
    let mut send = |boot_id: u64, seq: u64, t_sensor_ns: u64| {
        sent += 1;
        let reading = SensorSample {
            boot_id,
            seq,
            t_sensor_ns,
            pressure_mpa: 0.03,
            gap_mm: 30.0,
            ..SensorSample::default()
        };
        sensor.publish(reading).unwrap();
    };
    let answered = |boot_id: u64, seq: u64| {
        wait_state(&states, "a fresh state", |state| {
            fresh(state) && (state.sensor_boot_id, state.sensor_seq) == (boot_id, seq)
        });
    };
    let held = |outcome: Outcome| {
        wait_state(&states, outcome.as_str(), |state| state.outcome == outcome.code());
    };
    for seq in [u64::MAX - 1, u64::MAX, 0, 1] {
        send(1, seq, now_ns());
        answered(1, seq);
    }
    send(1, 2, u64::MAX);
    held(Outcome::HeldFuture);
    send(1, 3, 0); // back in time: dropped, and its number is still free
    send(1, 3, now_ns());
    answered(1, 3);
    send(2, 0, 0);
    held(Outcome::HeldStale);
    send(2, 1, now_ns());
    answered(2, 1);
    send(3, u64::MAX, u64::MAX);
    held(Outcome::HeldFuture);
    send(3, 0, now_ns());
    answered(3, 0);
    // Numbers that jump by more than a sender can have sent are a restart of it, and no readings are lost.
    for boot_id in [4, 5] {
        send(boot_id, 1, now_ns());
        answered(boot_id, 1);
        (JUMP..JUMP + 3).for_each(|seq| send(boot_id, seq, now_ns()));
        answered(boot_id, JUMP + 2);
    }
    let counted = wait_for(&health, "all readings in the health", |health| {
        health.newest().unwrap().filter(|health| health.received == sent)
    });
    assert_eq!((counted.missed, counted.outcomes.iter().sum()), (0, sent), "{counted:?}");
    let ends =
        [Outcome::HeldFuture, Outcome::HeldStale, Outcome::DroppedBackInTime, Outcome::DroppedSequenceJump];
    assert_eq!(ends.map(|outcome| counted.count(outcome)), [2, 1, 1, 4]);
    assert_eq!(metric(&page, "softtwin_missed_total{actuator=\"finger\"}"), Some(0.0));
    recorder.signal(libc::SIGINT);
    let (status, said) = recorder.end();
    assert!(status.success(), "{said:?}");
    let report: serde_json::Value = serde_json::from_str(said.last().unwrap()).unwrap();
    assert_eq!(report["messages"]["softtwin/finger/sensor"], sent, "{report}");
    assert!(report["missing"].as_u64().is_some_and(|missing| missing >= i64::MAX as u64), "{report}");
    let [tables, picture] = ["tables", "run.svg"].map(|name| stage.path(name).display().to_string());
    for arguments in [
        &["export", &out, "--out", &tables][..],
        &["draw", &out, "--out", &picture],
        &["echo", "softtwin/finger/state", "--once"],
        &["top", "--once"],
    ] {
        let (status, said) = Program::tool(&stage, arguments).end();
        assert!(status.success(), "{arguments:?}: {said:?}");
    }
    let (status, said) = twin.stop();
    assert!(status.success(), "{said:?}");
}

/// 20,000 readings a second: more than the twin answers one by one; each has an end, the answers are right.
#[test]
fn twenty_thousand_readings_a_second_are_all_accounted_for() {
    let stage = Stage::new("fast");
    let scene = stage.finger(&source(20_000.0));
    let twin = Program::twin(&stage, &scene);
    let bus = stage.bus();
    let (fields, health) =
        (all_fields(&bus), HealthReader::open(&bus, &Topic::health("finger").unwrap()).unwrap());
    let bridge = Program::bridge(&stage, &scene);
    let mut verifier = Verifier::new(model_bytes()).expect("a model");
    verify_fields(&fields, &mut verifier, 0, 2_000);
    let (status, said) = bridge.stop();
    assert!(status.success());
    let line = said.iter().find(|line| line.contains("readings sent")).expect("a summary");
    let words: Vec<&str> = line.split(' ').collect();
    let place = words.iter().position(|word| *word == "readings").unwrap();
    let sent: u64 = words[place - 1].parse().unwrap();
    wait_for(&health, "the last health", |health| {
        health.newest().unwrap().filter(|health| total(health) == sent)
    });
    verify_rest(&fields, &mut verifier);
    assert!(verifier.counts.all_correct(), "{:?}", verifier.counts);
    assert!(twin.stop().0.success());
}

/// A running twin has its own copy of the model file.
#[test]
fn changed_model_file_does_not_affect_a_running_twin() {
    let stage = Stage::new("disk");
    let scene = stage.finger(&source(200.0));
    let mut twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    let bus = stage.bus();
    let reader: StateReader = states(&bus);
    let mut verifier = Verifier::new(model_bytes()).expect("a model");
    let listen = |verifier: &mut Verifier| {
        let end = verifier.counts.states_checked + 20;
        wait_state(&reader, "states", |state| {
            verifier.state(state);
            verifier.counts.states_checked >= end
        });
    };
    let model = stage.path("beam.twin");
    let gripper =
        std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../models/gripper/gripper.twin")).unwrap();
    let mut flipped = model_bytes().to_vec();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    let damages: [(&str, &[u8]); 4] = [
        ("truncated", &model_bytes()[..100]),
        ("bit-flipped", &flipped),
        ("another actuator's", &gripper),
        ("another training's", other_model_bytes()),
    ];
    for (what, bytes) in damages {
        std::fs::write(&model, bytes).unwrap();
        listen(&mut verifier);
        println!("{what}: the stream continues");
    }
    // Asked for, another actuator's model is refused: its samples have another size.
    std::fs::write(&model, &gripper).unwrap();
    twin.signal(libc::SIGHUP);
    twin.wait_for("reload refused");
    listen(&mut verifier);
    assert!(verifier.counts.all_correct(), "{:?}", verifier.counts);
    // A restart with a damaged file is refused as a configuration error that names it.
    twin.kill();
    std::fs::write(&model, &flipped).unwrap();
    let mut again = Program::daemon(&stage, &["twin", "--scene", &scene.display().to_string()]);
    let (status, said) = again.end();
    assert_eq!(status.code(), Some(78), "{said:?}");
    assert!(said.join("\n").contains("beam.twin"), "{said:?}");
    std::fs::write(&model, model_bytes()).unwrap();
    let _twin = Program::twin(&stage, &scene);
    listen(&mut verifier);
    assert!(verifier.counts.all_correct(), "{:?}", verifier.counts);
    assert!(bridge.stop().0.success());
}

/// Mistakes in settings, one by one and all at once: exit code 78, each named with its key.
#[test]
fn every_configuration_error_is_named() {
    let stage = Stage::new("settings");
    let scene = stage.finger(&source(200.0)).display().to_string();
    let usual = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../config/twin.toml")).unwrap();
    let mut keys = 0;
    let refuse = |text: &str, wanted: &str| {
        let path = stage.write("twin.toml", text).display().to_string();
        let begin = Instant::now();
        let (status, said) = Program::daemon(&stage, &["twin", "--scene", &scene, "--config", &path]).end();
        let said = said.join("\n");
        assert_eq!(status.code(), Some(78), "{said}");
        assert!(said.contains(wanted) && begin.elapsed() < PATIENCE, "`{wanted}` is not in:\n{said}");
    };
    for line in usual.lines().filter(|line| !line.starts_with(['#', '[']) && line.contains(" = ")) {
        let (key, _) = line.split_once(" = ").unwrap();
        // A wrong type, and a wrong name.
        refuse(&usual.replace(line, &format!("{key} = {{ odd = 1 }}")), key);
        refuse(&usual.replace(line, &format!("{key}x = 1")), &format!("{key}x"));
        keys += 1;
    }
    assert!(keys >= 8, "only {keys} settings were found");
    refuse(
        "[limits]\npressure_min_mpa = 2.0\npressure_max_mpa = 1.0\ndeadline_ms = -1.0\nmax_age_ms = nan\n",
        "3 problems",
    );
}
