//! The simulator as a user runs it, on an actuator small enough for a test: mesh, states, paths, databases that survive
//! being killed, samples, refinement, packing.

use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant, SystemTime};

/// Long enough for any machine; reached only when something hangs.
const DEADLINE: Duration = Duration::from_secs(300);

/// A folder with the tiny actuator and its mesh.
pub struct WorkFolder(tempfile::TempDir);

pub struct Ended {
    code: Option<i32>,
    out: String,
    err: String,
}

impl Ended {
    pub fn lines(&self) -> Vec<Value> {
        assert_eq!(self.code, Some(0), "{}", self.err);
        self.out.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    pub fn json(&self) -> Value {
        let mut lines = self.lines();
        assert_eq!(lines.len(), 1, "{}", self.out);
        lines.remove(0)
    }

    pub fn refused(&self, code: i32, part: &str) {
        assert_eq!(self.code, Some(code), "{} {}", self.out, self.err);
        assert!(self.err.contains(part), "{}", self.err);
    }
}

impl WorkFolder {
    pub fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        place.put("a.toml", &crate::actuators::tiny());
        let mesh = place.run("mesh --actuator a.toml --size-mm 9 --json").json();
        assert!(mesh["nodes"].as_u64().unwrap() > 1000 && place.at("mesh.vtu").exists(), "{mesh}");
        place
    }

    pub fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn put(&self, name: &str, text: &str) {
        std::fs::write(self.at(name), text).unwrap();
    }

    pub fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.at(name)).unwrap()
    }

    pub fn command(&self, line: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_softtwin"));
        command.args(line.split_whitespace()).current_dir(self.0.path()).env_remove("RUST_LOG");
        command
    }

    pub fn run(&self, line: &str) -> Ended {
        let output = self.command(line).output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Ended { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
    }

    /// Checkpoints and when they were written.
    fn states(&self, folder: &str) -> BTreeMap<PathBuf, SystemTime> {
        let Ok(entries) = std::fs::read_dir(self.at(folder)) else { return BTreeMap::new() };
        let whole =
            entries.map(|e| e.unwrap().path()).filter(|p| p.extension().is_some_and(|e| e == "state"));
        whole.map(|p| (p.clone(), std::fs::metadata(&p).unwrap().modified().unwrap())).collect()
    }
}

pub fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap()
}

#[test]
fn single_state_and_path_are_written_and_described() {
    let place = WorkFolder::new();
    let path =
        place.run("simulate --actuator a.toml --pressure 0.06 --gap 0.3 --steps 3 --out s.npy").lines();
    assert_eq!(path.len(), 3);
    let of = |key: &str| path.iter().map(|line| line[key].as_f64().unwrap()).collect::<Vec<_>>();
    assert!(of("cavity_volume_mm3").windows(2).all(|w| w[0] < w[1]));
    assert!(of("contact_force_n")[2] > of("contact_force_n")[0]);
    assert!(of("lowest_point_mm")[2] < -0.2 && of("residual_n")[2] < 1.0e-3);
    let array = formats::npy::read_f32(&place.at("s.npy")).unwrap();
    let nodes = formats::vtu::read(&place.at("mesh.vtu")).unwrap().points_mm.len();
    assert_eq!(array.shape, [nodes, 5]);
    let largest = array.data.iter().skip(3).step_by(5).copied().fold(0.0, f32::max);
    assert!((f64::from(largest) - of("max_displacement_mm")[2]).abs() < 1.0e-5);
    let sets = place.run("simulate --actuator a.toml --pressure 0.06 --gap 0.3 --json").json();
    let set = sets["contact_node_set"].as_array().unwrap();
    assert!(!set.is_empty() && Some(set.len() as u64) == sets["contact_nodes"].as_u64(), "{sets}");
    let free = place.run("simulate --actuator a.toml --pressure 0.03 --out s.vtu").json();
    assert_eq!((free["gap_mm"].is_null(), free["contact_force_n"].as_f64()), (true, Some(0.0)));
    let grid = formats::vtu::read(&place.at("s.vtu")).unwrap();
    assert_eq!(grid.points_mm.len(), nodes);
}

#[test]
fn invalid_loads_are_refused_before_any_work() {
    let place = WorkFolder::new();
    place.run("simulate --actuator a.toml --pressure -0.1").refused(2, "expected a number from 0 to 100");
    place
        .run("simulate --actuator a.toml --pressure 0.01 --gap -2")
        .refused(2, "outside the undeformed base");
    place.run("simulate --actuator a.toml --pressure 0.01 --out s.stl").refused(2, ".vtu");
    place.run("simulate --actuator b.toml --pressure 0.01").refused(1, "b.toml");
    place.put("b.toml", &crate::actuators::with(&crate::actuators::tiny(), "slots", "floor_mm", "5.0"));
    place.run("simulate --actuator b.toml --pressure 0.01").refused(78, "slots.floor_mm");
    place.run("mesh --actuator b.toml").refused(78, "slots.floor_mm");
    place.run("mesh --actuator a.toml --size-mm 0").refused(2, "expected a number from 0.001");
}

#[test]
fn failed_case_does_not_stop_the_run_or_enter_the_database() {
    let place = WorkFolder::new();
    place.put(
        "cases.csv",
        "case,regime,split,pressure_mpa,gap_mm\nlow,free,train,0.02,\nburst,free,train,4,\nhigh,free,train,0.04,\n",
    );
    let ended = place.run("simulate --actuator a.toml --cases cases.csv --out db --json");
    ended.refused(1, "1 of 3 cases failed");
    let report: Value = serde_json::from_str(ended.out.trim()).unwrap();
    assert_eq!((report["solved"].as_u64(), report["failed"][0]["case"].as_str()), (Some(2), Some("burst")));
    let reason = report["failed"][0]["reason"].as_str().unwrap();
    assert!(reason.contains("4 MPa"), "{reason}");
    assert_eq!(place.read("db/cases.csv").lines().count(), 3, "heading and two cases");
    assert!(!place.read("db/cases.csv").contains("burst"));
    assert_eq!(formats::npy::read_f32(&place.at("db/snapshots.npy")).unwrap().shape[0], 2);
}

const LIST: &str = "case,regime,split,pressure_mpa,gap_mm
c0,free,train,0,
c1,free,train,0.01,
c2,free,train,0.02,
c3,free,train,0.03,
c4,free,train,0.04,
c5,free,train,0.05,
c6,free,train,0.06,
c7,contact,train,0.05,0.3
c8,contact,train,0.06,0.4
c9,contact,train,0.04,0.2
";

#[test]
fn killed_run_continues_without_solving_twice() {
    let place = WorkFolder::new();
    place.put("cases.csv", LIST);
    let line = "simulate --actuator a.toml --cases cases.csv --out db --threads 1 --json";
    let mut child = place.command(line).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let began = Instant::now();
    while place.states("db/states").len() < 3 {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it could be killed");
        assert!(began.elapsed() < DEADLINE, "no state within {DEADLINE:?}");
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap(); // SIGKILL: no handler runs
    child.wait().unwrap();
    let kept = place.states("db/states");
    assert!(!place.at("db/database.toml").exists(), "no database before all cases are there");
    let again = place.run(line).json();
    let count = |key: &str| again[key].as_u64().unwrap() as usize;
    assert_eq!(count("solved") + count("reused"), 10);
    // The state at rest is a checkpoint and a case at once.
    assert!(count("reused") >= kept.len() - 1 && count("reused") < 10, "{again} after {} states", kept.len());
    let now = place.states("db/states");
    assert!(kept.iter().all(|(path, time)| now[path] == *time), "a state was computed twice");
    assert_eq!(place.read("db/cases.csv").lines().count(), 11);
    let whole = bytes(&place.at("db/snapshots.npy"));
    let third = place.run(line).json();
    assert_eq!((third["solved"].as_u64(), third["reused"].as_u64()), (Some(0), Some(10)));
    assert_eq!(bytes(&place.at("db/snapshots.npy")), whole);

    pack_and_refine(&place);
}

/// A packed database is within its bound; a refined one has more states and a model.
fn pack_and_refine(place: &WorkFolder) {
    let packed = place.run("pack --database db --out small --json").json();
    let errors = packed["largest_error"].as_object().unwrap();
    assert!(
        errors["x"].as_f64().unwrap() <= 1.01e-3 && errors["von_mises"].as_f64().unwrap() <= 1.01e-5,
        "{packed}"
    );
    place.run("pack --database small --out again --json").json();
    assert_eq!(bytes(&place.at("again/snapshots.pack")), bytes(&place.at("small/snapshots.pack")));
    let gain = place
        .run("sample --refine 2 --regime free --database small --actuator a.toml --out more --json")
        .json();
    assert_eq!(gain["added"].as_u64(), Some(2));
    let blind = gain["before"]["added"][0].as_f64().unwrap();
    assert!(blind > 0.0 && gain["after"]["added"][0].as_f64().unwrap() <= blind, "{gain}");
    assert!(place.at("more/pneunet.twin").exists() && place.at("more/pneunet.json").exists());
    assert_eq!(place.read("more/cases.csv").lines().count(), 13);
    assert_eq!(place.read("small/cases.csv").lines().count(), 11, "the database it began with is kept");
    // The same once more: all that was solved is there.
    let kept = place.states("more/states");
    place.run("sample --refine 2 --regime free --database small --actuator a.toml --out more --json").json();
    assert_eq!(place.states("more/states"), kept);
    place
        .run("sample --refine 2 --database small --actuator a.toml --out small")
        .refused(2, "another folder than --database");
}

/// A line of the simulator's output without what differs from run to run or is said only of a variant.
fn physics(mut line: Value) -> Value {
    for key in ["seconds", "set", "mesh_quality"] {
        line.as_object_mut().unwrap().remove(key);
    }
    line
}

#[test]
fn set_value_equals_the_value_in_the_file() {
    let place = WorkFolder::new();
    let load = "--pressure 0.06 --gap 0.3 --json";
    let run = |file: &str, more: &str| {
        place.run(&format!("simulate --actuator {file} {load} --out s.npy {more}")).json()
    };
    let array = || bytes(&place.at("s.npy"));
    let nominal = physics(run("a.toml", ""));
    // Material: the mesh stays, so nothing may differ, not a bit.
    place.put("b.toml", &crate::actuators::with(&crate::actuators::tiny(), "elastomer.law", "mu_mpa", "0.6"));
    let set = run("a.toml", "--set elastomer.law.mu_mpa=0.6");
    let written = array();
    assert_eq!(set["set"]["elastomer.law.mu_mpa"].as_f64(), Some(0.6), "{set}");
    assert_eq!(physics(run("b.toml", "")), physics(set.clone()));
    assert_eq!(array(), written);
    assert!(
        set["contact_force_n"].as_f64() > nominal["contact_force_n"].as_f64(),
        "softer presses harder: {set}"
    );
    // Geometry: the moved mesh is the one that the grid makes of the changed actuator.
    place.put("c.toml", &crate::actuators::with(&crate::actuators::tiny(), "chambers", "top_mm", "17.6"));
    let set = run("a.toml", "--set chambers.top_mm=17.6");
    let quality = &set["mesh_quality"];
    assert!(quality["least"].as_f64() > Some(0.0) && quality["mean"].as_f64() < Some(1.0), "{set}");
    place.run("mesh --actuator c.toml --size-mm 9 --json").json();
    let own = run("c.toml", "");
    for key in ["contact_force_n", "cavity_volume_mm3", "max_displacement_mm"] {
        let [a, b, n] = [&set, &own, &nominal].map(|line| line[key].as_f64().unwrap());
        assert!((a - b).abs() < 1.0e-3 * (b - n).abs(), "{key}: {a} against {b}, nominal {n}");
    }
}

#[test]
fn invalid_names_and_values_are_refused() {
    let place = WorkFolder::new();
    let refused = |more: &str, code: i32, part: &str| {
        place.run(&format!("simulate --actuator a.toml --pressure 0.01 {more}")).refused(code, part);
    };
    refused("--set elastomer.law.mu=0.7", 78, "elastomer.law.mu_mpa");
    refused("--set elastomer.law.mu_mpa=-1", 78, "mu_mpa");
    refused("--set chambers.count=3", 78, "another mesh");
    refused("--set elastomer.law.mu_mpa", 2, "NAME=VALUE");
    refused("--set elastomer.law.mu_mpa=inf", 2, "finite number");
    place.put("list.csv", "case,regime,split,pressure_mpa,gap_mm,elastomer.law.mu\na,free,train,0.01,,0.7\n");
    place.run("simulate --actuator a.toml --cases list.csv --out db").refused(78, "elastomer.law.mu_mpa");
    place.put("list.csv", "case,regime,split,pressure_mpa,gap_mm,base.lower_mm\na,free,train,0.01,,\n");
    place.run("simulate --actuator a.toml --cases list.csv --out db").refused(78, "every case has one");
    place.put("list.csv", "case,regime,split,gap_mm,base.lower_mm\na,free,train,,2.1\n");
    place.run("simulate --actuator a.toml --cases list.csv --out db").refused(78, "pressure_mpa");
    let sample = "sample --kind sequence --n 2 --actuator a.toml --out x.csv --parameter";
    place.run(&format!("{sample} chambers.length_mm=2.6:8.0")).refused(78, "slots.width_mm");
    let designs = "--states-per-design 6 --parameter elastomer.law.mu_mpa=0.6:1";
    place
        .run(&format!("sample --kind hypercube --n 2 --actuator a.toml --out x.csv {designs}"))
        .refused(2, "--kind sequence");
    place
        .run("sample --kind sequence --n 2 --parameter elastomer.law.mu_mpa=0.6:1 --out x.csv")
        .refused(2, "--actuator");
    place.run("sample --kind grid --n 2 --actuator a.toml --out x.csv").refused(2, "--parameter");
    place
        .run("sample --kind sequence --n 2 --parameter elastomer.law.mu=0.6:1 --actuator a.toml --out x.csv")
        .refused(78, "elastomer.law.mu_mpa");
}

/// Files of a folder that a run of the same list must repeat; checkpoints hold the time they took.
fn database(place: &WorkFolder, folder: &str) -> BTreeMap<String, Vec<u8>> {
    let files =
        std::fs::read_dir(place.at(folder)).unwrap().map(|e| e.unwrap().path()).filter(|p| p.is_file());
    files.map(|p| (p.file_name().unwrap().to_str().unwrap().to_owned(), bytes(&p))).collect()
}

#[test]
fn threads_change_no_byte_of_a_database_over_parameters() {
    let place = WorkFolder::new();
    let line = "sample --kind sequence --n 8 --regime both --pressure 0.01 0.06 --gap 0.2 0.5 --actuator a.toml \
                --parameter elastomer.law.mu_mpa=0.7:0.9 --parameter base.lower_mm=1.8:2.2 --out list.csv";
    assert_eq!(place.run(line).code, Some(0));
    let simulate = |out: &str, more: &str| {
        let line =
            format!("simulate --actuator a.toml --cases list.csv --sensitivities --json --out {out} {more}");
        assert_eq!(place.run(&line).json()["cases"].as_u64(), Some(8));
    };
    simulate("one", "--threads 1");
    simulate("two", "--threads 2");
    let whole = database(&place, "one");
    let names: Vec<&str> = whole.keys().map(String::as_str).collect();
    for name in ["cases.csv", "residuals.csv", "sensitivities.csv", "sensitivities.pack", "snapshots.npy"] {
        assert!(names.contains(&name), "{names:?}");
    }
    assert!(whole == database(&place, "two"), "one thread and two");
}

#[test]
fn list_over_other_parameters_replaces_the_database() {
    let place = WorkFolder::new();
    let list = |name: &str, parameter: &str, value: f64| {
        let row = |k: i32| format!("s{k},free,train,0.0{k},,{value}\n");
        let rows: String = (1..3).map(row).collect();
        place.put(name, &format!("case,regime,split,pressure_mpa,gap_mm,{parameter}\n{rows}"));
    };
    list("soft.csv", "elastomer.law.mu_mpa", 0.7);
    list("thick.csv", "base.lower_mm", 2.1);
    let simulate = |cases: &str, out: &str| {
        place.run(&format!("simulate --actuator a.toml --cases {cases} --json --out {out}")).json()
    };
    simulate("soft.csv", "one");
    assert_eq!(simulate("thick.csv", "one")["reused"], 0, "states of other parameters are other states");
    simulate("thick.csv", "own");
    let (one, mut own) = (database(&place, "one"), database(&place, "own"));
    own.retain(|name, _| name != "residuals.csv"); // the work from other starting states
    assert!(own.iter().all(|(name, bytes)| one.get(name) == Some(bytes)), "{:?}", one.keys());
    assert!(
        place.read("one/cases.csv").contains("base.lower_mm")
            && !place.read("one/cases.csv").contains("mu_mpa")
    );
}

/// States of both regimes with derivatives, one of them held out: a database in `db`.
fn both_regimes(place: &WorkFolder) {
    let mut list = String::from("case,regime,split,pressure_mpa,gap_mm\naside,free,check,0.03,\n");
    (0..6).for_each(|i| list += &format!("f{i},free,train,{:.3},\n", 0.012 * f64::from(i)));
    for (i, j) in (0..4).flat_map(|i| [(i, 0), (i, 1), (i, 2)]) {
        let (i, j) = (f64::from(i), f64::from(j));
        let (pressure_mpa, gap_mm) = (0.015 + 0.015 * i + 0.002 * j, 0.1 + 0.1 * j + 0.01 * i);
        list += &format!("c{i}{j},contact,train,{pressure_mpa:.3},{gap_mm:.2}\n");
    }
    place.put("list.csv", &list);
    place.run("simulate --actuator a.toml --cases list.csv --sensitivities --json --out db").json();
}

/// Largest difference of two databases' derivatives over the first one's largest value, by row and field.
fn derivative_errors(place: &WorkFolder, [exact, other]: [&str; 2]) -> Vec<f32> {
    let read = |folder: &str| {
        let database = formats::database::read(&place.at(folder), formats::database::ObstacleKind::Plate);
        database.unwrap()
    };
    let (exact, other) = (read(exact), read(other));
    let (a, b) = (exact.sensitivities.as_ref().unwrap(), other.sensitivities.as_ref().unwrap());
    let (fields, entries) = (a.fields.len(), a.fields.len() * exact.node_count);
    let name = |database: &rom::snapshots::Database, case: usize| database.cases[case].name.clone();
    let mut errors = Vec::new();
    for (at, row) in b.rows.iter().enumerate() {
        let case = name(&other, row.case);
        let same = a.rows.iter().position(|r| name(&exact, r.case) == case && r.input == row.input).unwrap();
        let [a, b] = [(&a.values, same), (&b.values, at)].map(|(v, i)| &v[i * entries..(i + 1) * entries]);
        for field in 0..fields {
            let pairs = || a.iter().zip(b).skip(field).step_by(fields);
            let largest = pairs().fold(0.0, |most: f32, (a, _)| most.max(a.abs()));
            let error = pairs().fold(0.0, |most: f32, (a, b)| most.max((a - b).abs()));
            errors.push(if largest > 0.0 { error / largest } else { error });
        }
    }
    errors
}

#[test]
fn packed_derivatives_have_the_requested_error() {
    let place = WorkFolder::new();
    both_regimes(&place);
    let mut bytes = Vec::new();
    for share in ["5e-4", "5e-3", "0.05"] {
        let packed = format!(
            "pack --database db --out small{share} --derivative-error {share} \
             --stress-derivative-error {share} --json"
        );
        bytes.push(place.run(&packed).json()["bytes_of_derivatives"].as_u64().unwrap());
        let errors = derivative_errors(&place, ["db", &format!("small{share}")]);
        // 18 training states by the pressure, 12 of them by the gap as well; four fields each.
        assert_eq!(errors.len(), 30 * 4, "derivatives of the held-out state are left out");
        let (largest, asked) = (errors.iter().copied().fold(0.0, f32::max), share.parse::<f32>().unwrap());
        // `db` itself is packed within 5e-5; rounding to f32 adds its own.
        assert!(largest <= asked * 1.01 + 2e-7 && largest > 0.1 * asked, "{largest} for {asked}");
    }
    assert!(bytes.windows(2).all(|pair| pair[0] > pair[1]), "{bytes:?}");
}

#[test]
fn sealed_evaluation_is_reproducible_and_leaves_no_files() {
    let place = WorkFolder::new();
    both_regimes(&place);
    assert_eq!(place.run("train --database db --out a.twin").code, Some(0));
    // What a killed run left of another evaluation, and what another process has in use.
    let (leftover, used) = ("temporary/softtwin-sealed-0-1-10", "temporary/softtwin-sealed-0-2-10");
    std::fs::create_dir_all(place.at(leftover).join("states")).unwrap();
    std::fs::create_dir_all(place.at(used).join("states")).unwrap();
    let lock = std::fs::File::open(place.at(used)).unwrap();
    lock.lock().unwrap();
    let sealed = |seed: &str| {
        let line = format!("evaluate a.twin --actuator a.toml --sealed 10 --json {seed}");
        let mut command = place.command(&line);
        let output = command.env("TMPDIR", place.at("temporary")).output().unwrap();
        let left: Vec<_> =
            std::fs::read_dir(place.at("temporary")).unwrap().map(|at| at.unwrap().path()).collect();
        assert_eq!(left, [place.at(used)], "what nobody uses is removed, also after a refusal");
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Ended { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
    };
    let found = sealed("--seed 5").json();
    let states = found["cases"].as_array().unwrap();
    let free = states.iter().filter(|case| case["gap_mm"].is_null()).count();
    assert_eq!((states.len(), free), (10, 1), "{found}");
    assert!(states.iter().all(|case| case["domain"] == "inside"), "{found}");
    let inputs = |found: &Value| -> Vec<String> {
        let cases = found["cases"].as_array().unwrap().iter();
        cases.map(|case| format!("{} {}", case["pressure_mpa"], case["gap_mm"])).collect()
    };
    assert_eq!(sealed("--seed 5").json(), found, "a seed is a set of states");
    assert_ne!(inputs(&sealed("--seed 6").json()), inputs(&found));
    sealed("").refused(2, "--seed");
    place.run("evaluate a.twin --sealed 10 --seed 5").refused(2, "actuator.toml");
    place.run("mesh --actuator a.toml --size-mm 5 --json");
    sealed("--seed 5").refused(2, "another mesh");
}

#[test]
fn designs_share_their_parameters_and_onset_points_lie_on_the_onset() {
    use crate::synthetic::design;
    let place = WorkFolder::new();
    let states: Vec<_> =
        design::states(0, 100).into_iter().map(|s| (rom::snapshots::Split::Train, s)).collect();
    let cells = formats::vtu::Cells::QuadraticTets(&[]);
    formats::database::write(&place.at("db"), &design::database(&states, false), cells).unwrap();
    let over =
        "--actuator a.toml --parameter elastomer.law.mu_mpa=0.65:0.95 --parameter chambers.length_mm=2.7:3.3";
    let sample = |line: &str| {
        let ended = place.run(&format!("sample {line} {over} --out list.csv"));
        assert_eq!(ended.code, Some(0), "{}", ended.err);
        fem::cases::read(&place.at("list.csv")).unwrap()
    };
    let state = |case: &fem::cases::Case| {
        [case.pressure_mpa, case.gap_mm.unwrap(), case.settings[0].1, case.settings[1].1]
    };
    let line =
        "--kind sequence --n 6 --states-per-design 7 --regime both --gap 10 35 --database db --prefix v";
    let list = sample(line);
    assert_eq!(list.len(), 42);
    for design in list.chunks(7) {
        assert!(design.iter().all(|case| case.settings == design[0].settings), "{design:?}");
        let (free, touching) = design.split_at(4);
        assert!(free.iter().all(|case| case.regime == "free" && case.gap_mm.is_none()));
        assert!(
            free[0].pressure_mpa == 0.0 && free.is_sorted_by(|a, b| a.pressure_mpa < b.pressure_mpa),
            "{free:?}"
        );
        assert!(
            touching.iter().any(|case| case.pressure_mpa <= 0.17 * 0.09),
            "one at low pressure: {touching:?}"
        );
        assert!(touching.iter().all(|case| state(case)[0] > design::onset_mpa(state(case))), "{touching:?}");
        assert!(touching.is_sorted_by(|a, b| a.gap_mm > b.gap_mm), "{touching:?}");
    }
    assert_eq!((list[0].name.as_str(), list[41].name.as_str()), ("v01f1", "v06c3"));
    assert!(list.chunks(7).all(|design| design[0].settings != list[9].settings || design[0] == list[7]));
    assert_eq!(sample(line), list, "the same seed gives the same list");
    let onset = sample("--kind onset --n 12 --gap 22 35 --database db");
    assert!(onset.len() > 6, "{} of 12", onset.len());
    for case in &onset {
        let off = state(case)[0] - design::onset_mpa(state(case));
        assert!(off.abs() < 1e-3, "{case:?}: off by {off} MPa");
    }
}

#[test]
fn displacement_is_relative_to_the_mesh_of_the_parameters() {
    let place = WorkFolder::new();
    let row = |(k, name): (usize, &str)| {
        let (lower, sheet) = (1.7 + 0.1 * k as f64, 0.1 + 0.01 * k as f64);
        format!("{name},free,train,{},,0.8,{lower},{sheet}\n", 0.01 * k as f64)
    };
    let list: String = ["a", "b", "c"].into_iter().enumerate().map(row).collect();
    let names = "elastomer.law.mu_mpa,base.lower_mm,sheet.thickness_mm";
    place.put("list.csv", &format!("case,regime,split,pressure_mpa,gap_mm,{names}\n{list}"));
    place.run("simulate --actuator a.toml --cases list.csv --json --out moved").json();
    place.run("pack --database moved --out packed --json").json();
    for folder in ["moved", "packed"] {
        let kind = formats::database::ObstacleKind::Plate;
        let database = formats::database::read(&place.at(folder), kind).unwrap();
        let mesh = database.undeformed_mm.as_ref().unwrap();
        assert!(database.undeformed_by[0].as_flattened().iter().all(|v| *v == 0.0), "silicone moves nothing");
        for (case, known) in database.cases.iter().enumerate() {
            let (mut worst, mut nominal) = (0.0_f64, 0.0_f64);
            for (n, values) in database.snapshot(case).as_chunks::<5>().0.iter().enumerate() {
                let steps = known.parameters.iter().zip(&database.parameters).map(|(v, p)| v - p.nominal);
                let by: Vec<_> = steps.zip(&database.undeformed_by).collect();
                let moved = |k: usize| by.iter().map(|(step, by)| step * f64::from(by[n][k])).sum::<f64>();
                let [x, y, z] = [0, 1, 2].map(|k| f64::from(values[k]) - mesh[n][k]);
                let length = |u: [f64; 3]| (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]).sqrt();
                let own = length([x - moved(0), y - moved(1), z - moved(2)]);
                worst = worst.max((own - f64::from(values[3])).abs());
                nominal = nominal.max((length([x, y, z]) - f64::from(values[3])).abs());
            }
            assert!(worst < 1e-4 && nominal > 0.01, "{folder} {}: {worst}, nominal {nominal} mm", known.name);
        }
    }
}

#[test]
fn lists_are_sampled_reproducibly_and_can_be_simulated() {
    let place = WorkFolder::new();
    let line =
        "sample --kind hypercube --n 7 --regime contact --pressure 0.01 0.06 --gap 0.1 0.5 --out h.csv";
    assert_eq!(place.run(line).code, Some(0));
    let first = place.read("h.csv");
    place.run(line);
    assert_eq!(place.read("h.csv"), first, "the same seed gives the same list");
    place.run(&format!("{line} --seed 2"));
    assert_ne!(place.read("h.csv"), first);
    place.run("sample --kind grid --n 3 --n-gaps 2 --out g.csv");
    assert_eq!(fem::cases::read(&place.at("g.csv")).unwrap().len(), 6);
    for (wrong, part) in [
        ("sample --out x.csv", "--kind"),
        ("sample --kind grid --n 0 --out x.csv", "--n"),
        ("sample --kind grid --n 2 --gap 5 2 --out x.csv", "--gap"),
        ("sample --refine 2 --out x", "--database"),
        ("sample --refine 2 --kind grid --database db --out x", "--refine"),
    ] {
        place.run(wrong).refused(2, part);
    }
}

#[test]
fn a_coarse_mesh_of_the_same_body_is_a_start_only() {
    let place = WorkFolder::new();
    place.run("mesh --actuator a.toml --size-mm 5 --out fine.vtu --json").json();
    let text = place.read("a.toml");
    let fine = text.replace("\"mesh.vtu\"", "\"fine.vtu\"");
    assert_ne!(fine, text);
    place.put("fine.toml", &fine);
    let line = "simulate --actuator fine.toml --pressure 0.1 --json";
    let (alone, started) =
        (place.run(line).json(), place.run(&format!("{line} --coarse-mesh mesh.vtu,mesh.vtu")).json());
    let of = |report: &Value, key: &str| report[key].as_f64().unwrap();
    for key in ["max_displacement_mm", "max_von_mises_mpa", "volume_mm3"] {
        let (a, b) = (of(&alone, key), of(&started, key));
        assert!((a / b - 1.0).abs() < 1e-6, "{key}: {a} {b}");
    }
    place.run(&format!("{line} --coarse-mesh nowhere.vtu")).refused(1, "nowhere.vtu");
}
