//! The tool's listening commands against a running twin.

use serde_json::Value;
use tests::wait::wait_until;
use tests::{Program, Stage, synthetic};

const SOURCE: &str = "kind = \"simulate\"\nrate_hz = 200.0\ngap_mm = 30.0\n";

/// Runs `softtwin` to its end and returns exit code and lines.
fn run(stage: &Stage, arguments: &[&str]) -> (Option<i32>, Vec<String>) {
    let (status, said) = Program::tool(stage, arguments).end();
    (status.code(), said)
}

fn json(lines: &[String]) -> Vec<Value> {
    lines
        .iter()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}")))
        .collect()
}

#[test]
fn empty_bus_is_reported_with_a_remedy() {
    let stage = Stage::new("empty");
    for (command, expected) in [
        (&["list"][..], 0),
        (&["list", "--long"], 0),
        (&["list", "--rate"], 1),
        (&["echo", "softtwin/finger/state"], 1),
    ] {
        let (code, said) = run(&stage, command);
        assert_eq!(code, Some(expected), "{said:?}");
    }
    let (code, said) = run(&stage, &["list", "--json"]);
    assert!(code == Some(0) && said.iter().any(|line| line == "[]"), "{said:?}");
    let (code, said) = run(&stage, &["list", "softtwin//x"]);
    assert_eq!(code, Some(2), "{said:?}");
}

#[test]
fn predictions_beyond_what_was_learned_have_an_interval_with_the_truth_or_none() {
    let stage = Stage::with_model("beyond", &tests::learned_model().to_bytes().unwrap());
    let model = stage.path("beam.twin").display().to_string();
    let truth_mm = 200.0 * (0.15 - 0.03);
    let (code, said) =
        run(&stage, &["predict", &model, "--pressure", "0.15", "--set", "outlet_mpa=0.03", "--json"]);
    assert_eq!(code, Some(0), "{said:?}");
    let answer = said.iter().position(|line| line.starts_with('{')).unwrap();
    let tip = &json(&said[answer..=answer])[0]["outputs"]["tip_y_mm"];
    let value = tip["value"].as_f64().unwrap();
    assert!(tip["half_width"].as_f64().is_none_or(|width| (value - truth_mm).abs() < width), "{tip}");
    let rows: String = (0..200).map(|k| format!("{},{},0.03\n", 0.02 * f64::from(k), 0.15)).collect();
    let trace = stage.write("trace.csv", &format!("t_s,pressure_mpa,outlet_mpa\n{rows}"));
    let series = stage.path("series.csv");
    let paths = [&trace, &series].map(|path| path.display().to_string());
    let (code, said) = run(&stage, &["predict", &model, "--trace", &paths[0], "--out", &paths[1]]);
    assert_eq!(code, Some(0), "{said:?}");
    let table = std::fs::read_to_string(series).unwrap();
    let mut lines = table.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let last: Vec<&str> = lines.next_back().unwrap().split(',').collect();
    let column = |name: &str| -> Option<f64> {
        last[names.iter().position(|known| *known == name).unwrap()]
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
    };
    let of_trace = column("tip_y_mm").unwrap();
    assert!((of_trace - value).abs() < 1e-3, "{of_trace} {value}");
    assert!(
        column("tip_y_mm_half_width").is_none_or(|width| (of_trace - truth_mm).abs() < width),
        "{last:?}"
    );
    let far = ["predict", &model, "--pressure", "1.0", "--set", "outlet_mpa=0.03", "--json"];
    let (code, said) = run(&stage, &far);
    assert!(code != Some(0), "no answer: {said:?}");
}

#[test]
fn commands_show_published_samples() {
    let stage = Stage::new("tool");
    let scene = stage.finger(SOURCE);
    let twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);

    let (code, said) = run(&stage, &["list", "--json"]);
    assert_eq!(code, Some(0), "{said:?}");
    let listed = json(&said).remove(0);
    let topics: Vec<&str> =
        listed.as_array().unwrap().iter().filter_map(|row| row["topic"].as_str()).collect();
    assert_eq!(
        topics,
        [
            "softtwin/finger/field",
            "softtwin/finger/field/tip",
            "softtwin/finger/health",
            "softtwin/finger/sensor",
            "softtwin/finger/state"
        ]
    );
    assert_eq!(listed[0]["writers"][0], twin.id());
    assert_eq!(listed[3]["writers"][0], bridge.id());
    let (code, said) = run(&stage, &["list", "softtwin/*/nothing"]);
    assert_eq!(code, Some(1));
    assert!(said.join("\n").contains("softtwin/finger/field"), "{said:?}");

    let (code, said) = run(&stage, &["echo", "softtwin/*/state", "--once", "--json"]);
    assert_eq!(code, Some(0), "{said:?}");
    let state = json(&said).remove(0);
    assert_eq!(state["topic"], "softtwin/finger/state");
    assert!(state["sample"]["contact_force_n"].is_number(), "{state}");

    let (code, said) = run(&stage, &["echo", "softtwin/finger/field", "--once", "--json"]);
    assert_eq!(code, Some(0), "{said:?}");
    assert_eq!(json(&said)[0]["sample"]["entries"], 5 * synthetic::NODES);
    let (_, said) = run(&stage, &["echo", "softtwin/finger/field", "--field", "y", "--once", "--json"]);
    assert_eq!(json(&said)[0]["values"]["y"].as_array().unwrap().len(), synthetic::NODES);
    let (_, said) =
        run(&stage, &["echo", "softtwin/finger/field/tip", "--node", "3", "--count", "2", "--json"]);
    let rows = json(&said);
    assert_eq!(rows.len(), 2);
    assert_eq!(rows[0]["values"].as_object().unwrap().len(), 2, "the tip has y and displacement");
    let (code, said) = run(&stage, &["echo", "softtwin/finger/field/tip", "--node", "10", "--once"]);
    assert_eq!(code, Some(2), "{said:?}");

    let (code, said) = run(&stage, &["list", "softtwin/finger/field", "--rate", "--seconds", "1", "--json"]);
    assert_eq!(code, Some(0), "{said:?}");
    let rate_hz = json(&said)[0]["rate_hz"].as_f64().unwrap();
    assert!(rate_hz > 20.0 && rate_hz < 400.0, "{rate_hz} Hz of 200");

    let (code, said) = run(&stage, &["list", "softtwin/finger/state", "--long", "--json"]);
    assert_eq!(code, Some(0), "{said:?}");
    let info = &json(&said)[0][0];
    assert_eq!(info["payload"], format!("softtwin.State.v{}", wire::layout::LAYOUT_VERSION));
    assert_eq!(info["writers"][0], twin.id());

    let (code, said) = run(&stage, &["inspect", "finger.toml", "--json"]);
    assert_eq!(code, Some(0), "{said:?}");
    assert_eq!(json(&said)[0][0]["outputs"][1]["nodes"], 10);
}

#[test]
fn closed_pipe_ends_echo_without_error() {
    let stage = Stage::new("pipe");
    let scene = stage.finger(SOURCE);
    let _twin = Program::twin(&stage, &scene);
    let _bridge = Program::bridge(&stage, &scene);
    let (status, said) = Program::shell(&stage, "softtwin echo softtwin/finger/state | head -2").end();
    assert!(status.success());
    assert_eq!(said.len(), 2, "two lines and not a word of complaint: {said:?}");
}

#[test]
fn demonstration_prints_its_documented_lines() {
    let stage = Stage::new("demo");
    stage.trace("trace.csv", 100, 100.0, 0.06, 30.0);
    stage.finger("kind = \"replay\"\ntrace = \"trace.csv\"");
    let mut demo = Program::tool(&stage, &["demo", "--scene", "finger.toml", "--json"]);
    let own_prefix = format!("iox2_demo_{}_", demo.id());
    let (status, said) = demo.end();
    assert!(status.success(), "{said:?}");
    let left =
        std::fs::read_dir("/dev/shm").unwrap().filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    assert_eq!(
        left.filter(|name| name.starts_with(&own_prefix)).count(),
        0,
        "the demonstration left files behind"
    );
    let summary = json(&said[said.len() - 1..]).remove(0);
    assert_eq!(summary["exit"], "end of trace");
    assert_eq!(summary["readings"], 100);
    let received = summary["fields_received"].as_u64().unwrap();
    assert_eq!(summary["lost"].as_u64().unwrap(), 100 - received);
    assert_eq!(summary["entries"], 5 * synthetic::NODES);
    let regimes: u64 = summary["regimes"].as_object().unwrap().values().filter_map(Value::as_u64).sum();
    assert_eq!(regimes, received);
    let truth_n = synthetic::force_n(0.06, 30.0);
    assert!((summary["max_force_n"].as_f64().unwrap() - truth_n).abs() < 0.1 * truth_n, "{summary}");
    let latency = |key: &str| summary["latency_us"][key].as_f64().unwrap();
    assert!(0.0 < latency("p50") && latency("p50") <= latency("p99") && latency("p99") <= latency("max"));
}

/// Every finding that is not good says what to do; warnings are no failure.
#[test]
fn doctor_passes_a_running_twin() {
    let stage = Stage::new("dr"); // its folder and prefix have a limit together
    let scene = stage.finger(SOURCE);
    let _twin = Program::twin(&stage, &scene);
    let _bridge = Program::bridge(&stage, &scene);
    let (code, said) = run(&stage, &["doctor", "--json", "--scene", &scene.display().to_string()]);
    assert_eq!(code, Some(0), "{said:?}");
    let found = json(&said).remove(0);
    let level = |subject: &str| {
        let finding = found.as_array().unwrap().iter().find(|finding| finding["subject"] == subject);
        finding.unwrap_or_else(|| panic!("{subject}: {found}"))["level"].as_str().unwrap().to_owned()
    };
    for subject in ["/dev/shm", "domain", "softtwin/finger/sensor", "softtwin/finger/state"] {
        assert_eq!(level(subject), "good", "{subject}: {found}");
    }
    for finding in found.as_array().unwrap() {
        assert_eq!(finding["level"] == "good", finding["remedy"] == "", "{finding}");
    }
    let shm = format!("/dev/shm/{}", stage.domain_name);
    let (_, said) = run(&stage, &["doctor", "--domain-root", &shm]);
    // Mostly something is left: the last one to leave an empty domain takes its folder away.
    if std::path::Path::new(&shm).exists() {
        std::fs::remove_dir_all(&shm).unwrap();
    }
    assert!(
        said.iter().any(|line| line.contains("management files") && line.contains("in memory")),
        "{said:?}"
    );
}

/// A damaged model and wrong settings, both at once, and what to do about each.
#[test]
fn doctor_lists_all_errors() {
    let stage = Stage::new("ill");
    let scene = stage.finger(SOURCE);
    stage.write("beam.twin", "no model");
    let settings = stage.write("twin.toml", "[realtime]\npriority = 4711\n");
    let [scene, settings] = [scene, settings].map(|path| path.display().to_string());
    let (code, said) = run(&stage, &["doctor", "--scene", &scene, "--config", &settings]);
    assert_eq!(code, Some(1), "{said:?}");
    let text = said.join("\n");
    for expected in ["beam.twin", "4711", "-> ", "things are wrong"] {
        assert!(text.contains(expected), "`{expected}`:\n{text}");
    }
}

/// The last finding about a subject: the first one about recordings is the machine's disk.
fn finding(said: &[String], subject: &str) -> Value {
    let found = said.iter().find(|line| line.starts_with('[')).unwrap_or_else(|| panic!("{said:?}"));
    let found: Vec<Value> = serde_json::from_str(found).unwrap();
    let last = found.iter().rfind(|finding| finding["subject"] == subject).cloned();
    last.unwrap_or_else(|| panic!("no {subject}: {found:?}"))
}

/// A recorder's folder: empty, recorded into, left alone, with the file of a power cut; and no folder at all.
#[test]
fn doctor_reports_recordings() {
    let stage = Stage::new("docrec");
    let folder = stage.path("recordings");
    std::fs::create_dir(&folder).unwrap();
    let doctor = || run(&stage, &["doctor", "--json", "--recordings", &folder.display().to_string()]);
    let says = |subject: &str, level: &str, text: &str| {
        let found = finding(&doctor().1, subject);
        assert_eq!(found["level"], level, "{found}");
        let whole = format!("{} {}", found["found"], found["remedy"]);
        assert!(whole.contains(text), "`{text}`: {found}");
    };
    says("recordings", "warning", "none in the folder");
    let _bridge = Program::bridge(&stage, &stage.finger(SOURCE));
    let out = folder.join("run.mcap").display().to_string();
    let recorder = Program::tool(&stage, &["record", "--out", &out, "--rotate-minutes", "60"]);
    let file = folder.join("run-0001.mcap");
    wait_until("a recording", || std::fs::metadata(&file).ok().filter(|file| file.len() > 0));
    says("recording run", "good", "1 files");
    assert!(recorder.stop().0.success());
    let long_ago = std::time::SystemTime::now() - std::time::Duration::from_secs(3600);
    std::fs::File::options().append(true).open(&file).unwrap().set_modified(long_ago).unwrap();
    says("recording run", "warning", "no recorder runs");
    std::fs::write(folder.join("run-0002.mcap"), "").unwrap();
    says("recording run", "warning", "1 of them empty");
    std::fs::remove_dir_all(&folder).unwrap();
    says("recordings", "bad", "name the folder of --out");
    assert_eq!(doctor().0, Some(1));
}

/// The gateway checks its configuration itself; where it is not installed the doctor says how to get it.
#[test]
fn doctor_asks_the_gateway() {
    let stage = Stage::new("docgate");
    // A folder of programs with a stand-in for the gateway.
    std::fs::copy(tests::process::binary("softtwin"), stage.path("softtwin")).unwrap();
    let doctor = || {
        let (status, said) =
            Program::shell(&stage, "PATH=. exec ./softtwin doctor --json --gateway gateway.toml").ended();
        (status.code(), finding(&said, "gateway"))
    };
    let (code, missing) = doctor();
    assert_eq!((code, &missing["level"]), (Some(1), &"bad".into()), "{missing}");
    assert!(missing["remedy"].as_str().unwrap().contains("softtwin-gateway"), "{missing}");
    for (script, level, text) in [
        ("echo \"$@: closed\" >&2", "good", "--config gateway.toml --check: closed"),
        ("echo 'listen: wrong' >&2; exit 78", "bad", "listen: wrong"),
    ] {
        let program = stage.write("softtwin-gateway", &format!("#!/bin/sh\n{script}\n"));
        let executable = std::os::unix::fs::PermissionsExt::from_mode(0o755);
        std::fs::set_permissions(program, executable).unwrap();
        let (_, found) = doctor();
        assert_eq!(found["level"], level, "{found}");
        assert!(found["found"].as_str().unwrap().contains(text), "{found}");
    }
}
