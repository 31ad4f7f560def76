//! Damaged command lines and files for the offline commands of `softtwin`, from a fixed seed: no panic, no hang, exit codes
//! 0, 1, 2 and 78 alone, at most 2 GiB of memory.
//!
//! `SOFTTWIN_HOSTILE=100000 cargo test --workspace --test system -- --nocapture hostile::` tries 100000 command lines.

use rom::rng::Rng;
use rom::snapshots::{Case, Database, FieldSpec, Footprint, RegimeKind, Split};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::channel;
use std::time::Duration;
use tests::inputs::{ENTRANCES, damage};
use tests::process::binary;

/// Default number of command lines; takes at most a minute.
const USUAL_TOTAL: u64 = 1000;
/// Two at a time.
const WORKERS: u64 = 2;
/// Largest address space of a command: 2 GiB.
const MAX_MEMORY: u64 = 2 << 30;
/// Largest file a command writes: 256 MiB.
const MAX_FILE: u64 = 256 << 20;
/// A command that takes longer hangs.
const LIMIT: Duration = Duration::from_secs(60);

/// Command lines to be damaged; undamaged they succeed or fail properly.
const LINES: &[&str] = &[
    "predict beam.twin --pressure 0.05 --gap 40 --out state.npy",
    "predict beam.twin --pressure 0.05 --gap 40 --mesh mesh.vtu --out state.vtu",
    "predict beam.twin --pressure 0.05 --out state.dat",
    "inspect beam.twin --json",
    "export beam.twin --pressure 0.01,0.04 --gap 40 --out sweep.pvd",
    "export beam.twin --pressure 0.01,0.04 --out sweep.xdmf",
    "export db --out states.csv",
    "export run.mcap --out run.csv",
    "import mesh.vtu --out copy.vtu --json",
    "import mesh.inp --out copy.vtu",
    "import mesh.msh --out copy.vtu",
    "import results job.frd --ramp load_n=2 --length-unit mm --out imported --field DISP.D1=mm",
    "pack --database db --out packed --json",
    "pack --unpack --database packed --out plain",
    "train --database db --out other.twin",
    "evaluate beam.twin --database db",
    "sample --kind hypercube --n 4 --regime contact --out list.csv",
    "sample --kind grid --n 3 --n-gaps 2 --regime free --out list.csv",
    "sample --kind onset --n 3 --regime contact --database db --out list.csv",
    "mesh --actuator actuator.toml --size-mm 9 --out grid.vtu",
    "simulate --actuator actuator.toml --pressure 0.01 --gap 30",
    "simulate --actuator actuator.toml --cases cases.csv --out simulated",
    "draw beam.twin --pressure 0.05 --gap 40 --width 100 --out picture.png",
    "predict scene.toml --pressure 0.05 --json",
    "info run.mcap",
    "scene check scene.toml",
];

/// Files that the command lines read.
const FILES: &[&str] = &[
    "beam.twin",
    "mesh.vtu",
    "mesh.inp",
    "mesh.msh",
    "job.frd",
    "run.mcap",
    "actuator.toml",
    "cases.csv",
    "scene.toml",
    "db/database.toml",
    "db/cases.csv",
    "db/snapshots.npy",
];

/// Words that are wrong, extreme or something else than they should be nearly everywhere.
const WORDS: &[&str] = &[
    "",
    "-",
    "--",
    "-1",
    "0",
    "-0",
    "1e18",
    "1e308",
    "1e-320",
    "nan",
    "inf",
    "-inf",
    "0x10",
    "1,5",
    "18446744073709551616",
    "9223372036854775807",
    "/dev/zero",
    "/dev/null",
    "/dev/full",
    "/proc/self/mem",
    "/",
    ".",
    "..",
    "no/such/file",
    "beam.twin",
    "db",
    "mesh.vtu",
    "%s%n",
    "\u{1F980}",
    "a b\n\"c\"",
    "--json",
    "--help",
    "--out",
    "--model",
];

const INP: &str = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n5,.5,0,0\n6,.5,.5,0\n7,0,.5,0\n8,0,0,.5\n9,.5,0,.5\n10,0,.5,.5\n\
*ELEMENT, TYPE=C3D10\n1,1,2,3,4,5,6,7,8,9,10\n*NSET, NSET=TIP, GENERATE\n1,4,1\n";

const MSH: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n$EndNodes\n\
$Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 4\n$EndElements\n";

const SCENE: &str = "name = \"scene\"\n[[actuator]]\nname = \"finger\"\nmodel = \"beam.twin\"\ngap_mm = 40.0\n\
[actuator.source]\nkind = \"simulate\"\nrate_hz = 100.0\nprofile = { kind = \"constant\", pressure_mpa = 0.02, gap_mm = 40.0 }\n";

/// A small database: three free states and one in contact of two nodes.
fn database() -> Database {
    let case = |k: usize| Case {
        name: format!("c{k}"),
        regime: if k == 3 { RegimeKind::Contact } else { RegimeKind::Free },
        split: Split::Train,
        pressure_mpa: 0.01 * k as f64,
        gap_mm: (k == 3).then_some(30.0),
        contact_force_n: if k == 3 { 0.1 } else { 0.0 },
        parameters: vec![],
    };
    let mut database = Database {
        actuator: "beam".into(),
        fields: FieldSpec::of_the_paper(),
        node_count: 2,
        cases: (0..4).map(case).collect(),
        snapshots: (0..4 * 2 * 5).map(|k| k as f32 * 0.25).collect(),
        undeformed_mm: Some(vec![[0.0; 3], [9.0, 0.0, 0.0]]),
        undeformed_by: Vec::new(),
        surface_triangles: vec![],
        node_sets: vec![],
        obstacle: Footprint::PLATE,
        parameters: vec![],
        sensitivities: None,
        vibrations: Vec::new(),
        hash: [0; 32],
    };
    database.hash = database.content_hash();
    database
}

/// Writes the good files.
fn prepare(folder: &Path) {
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).expect("writable");
    formats::database::write(&folder.join("db"), &database(), formats::vtu::Cells::QuadraticTets(&[]))
        .expect("writable");
    write("beam.twin", tests::stage::model_bytes());
    write("mesh.inp", INP.as_bytes());
    write("mesh.msh", MSH.as_bytes());
    let job = ENTRANCES.iter().find(|entrance| entrance.name == "frd").expect("an entrance");
    write("job.frd", &(job.seed)());
    write("scene.toml", SCENE.as_bytes());
    write("cases.csv", b"case,regime,split,pressure_mpa,gap_mm\na,free,train,0.01,\n");
    let recording = ENTRANCES.iter().find(|entrance| entrance.name == "recording").expect("an entrance");
    write("run.mcap", &(recording.seed)());
    let mesh = formats::read_mesh(&folder.join("mesh.inp")).expect("a mesh");
    let cells = formats::vtu::Cells::QuadraticTets(&mesh.tets);
    let grid = formats::vtu::Grid { points_mm: &mesh.points_mm, cells, point_data: &[] };
    formats::vtu::write(&folder.join("mesh.vtu"), &grid).expect("writable");
    let actuator = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/pneunet/actuator.toml");
    let text = std::fs::read_to_string(actuator).expect("readable");
    // The mesh of one element is none of this actuator: it is refused, which a damaged file may change.
    write(
        "actuator.toml",
        text.replace("mesh.msh", "mesh.vtu").replace("nodes = 25022", "nodes = 0").as_bytes(),
    );
}

/// A command line with one to three damages.
fn damaged_line(rng: &mut Rng) -> Vec<String> {
    let pick = |rng: &mut Rng, list: &[&str]| list[rng.below(list.len())].to_owned();
    let mut line: Vec<String> = pick(rng, LINES).split(' ').map(str::to_owned).collect();
    for _ in 0..rng.below(4) {
        let at = 1 + rng.below(line.len().max(2) - 1);
        match rng.below(8) {
            0..=2 if at < line.len() => line[at] = pick(rng, WORDS),
            3 if at < line.len() => drop(line.remove(at)),
            4 => {
                let word = pick(rng, WORDS);
                line.insert(at.min(line.len()), word);
            }
            5 if at < line.len() => {
                let copy = line[at].clone();
                line.push(copy);
            }
            6 if at < line.len() => {
                let bytes = damage(line[at].as_bytes(), rng);
                line[at] = String::from_utf8_lossy(&bytes).replace('\0', "0");
            }
            _ => line.extend(pick(rng, LINES).split(' ').skip(1).map(str::to_owned)),
        }
    }
    line
}

/// Runs the tool; returns the fault of its end, if any.
fn run(folder: &Path, line: &[String]) -> Result<(), String> {
    let mut command = Command::new(binary("softtwin"));
    command.args(line).current_dir(folder).env_remove("RUST_LOG").env("RUST_BACKTRACE", "0");
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    let limit = |resource, most: u64| {
        let value = libc::rlimit { rlim_cur: most, rlim_max: most };
        // SAFETY: the pointer is to a local value; setrlimit may be called between fork and exec.
        if unsafe { libc::setrlimit(resource, &raw const value) } == 0 {
            Ok(())
        } else {
            Err(std::io::Error::last_os_error())
        }
    };
    // SAFETY: the closure calls nothing but setrlimit and reads errno, which are async-signal-safe.
    unsafe {
        command.pre_exec(move || {
            limit(libc::RLIMIT_AS, MAX_MEMORY)?;
            limit(libc::RLIMIT_FSIZE, MAX_FILE)
        });
    }
    let child = command.spawn().map_err(|error| error.to_string())?;
    let id = child.id();
    let (sender, ended) = channel();
    let output = std::thread::scope(|scope| {
        scope.spawn(move || {
            if ended.recv_timeout(LIMIT).is_err() {
                // SAFETY: a signal to our own child, which is not waited for before `sender` is used.
                unsafe { libc::kill(id as i32, libc::SIGKILL) };
            }
        });
        let output = child.wait_with_output();
        let _ = sender.send(());
        output
    });
    let output = output.map_err(|error| error.to_string())?;
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    let good = matches!(output.status.code(), Some(0 | 1 | 2 | 78));
    if good && !text.contains("panicked") {
        return Ok(());
    }
    Err(format!("softtwin {line:?}\nended with {}\n{text}", output.status))
}

/// The good files, with their bytes.
fn good_files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let paths = FILES.iter().map(|name| folder.join(name));
    paths.map(|path| (path.clone(), std::fs::read(path).expect("readable"))).collect()
}

/// One damaged try. All files are good again afterwards: those that a damaged `--out` names too, or a later `simulate` would
/// rightly work for minutes on a mesh that an earlier command wrote.
fn one(folder: &Path, good: &[(PathBuf, Vec<u8>)], rng: &mut Rng) -> Result<(), String> {
    let line = damaged_line(rng);
    let file = (rng.below(2) == 0).then(|| &good[rng.below(good.len())]);
    if let Some((path, bytes)) = file {
        std::fs::write(path, damage(bytes, rng)).expect("writable");
    }
    let ended = run(folder, &line).map_err(|text| match file {
        None => text,
        Some((path, _)) => {
            let kept = std::env::temp_dir().join("softtwin-hostile-file");
            let _ = std::fs::copy(path, &kept);
            format!("{text}\nwith {} damaged (kept as {})", path.display(), kept.display())
        }
    });
    for (path, bytes) in good {
        if std::fs::read(path).ok().as_ref() != Some(bytes) {
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
            std::fs::write(path, bytes).expect("writable");
        }
    }
    ended
}

#[test]
fn damaged_command_lines_and_files_end_with_documented_exit_codes() {
    let asked = std::env::var("SOFTTWIN_HOSTILE").ok().map(|count| count.parse().expect("a number"));
    let total: u64 = asked.unwrap_or(USUAL_TOTAL);
    let broken: Vec<String> = std::thread::scope(|scope| {
        let work = |worker: u64| {
            let folder = tempfile::tempdir().expect("a folder");
            prepare(folder.path());
            let mut rng = Rng::new(worker);
            let good = good_files(folder.path());
            let each = total.div_ceil(WORKERS);
            let mut tries = (0..each).map(|done| {
                if done % USUAL_TOTAL == 0 && done > 0 {
                    println!("worker {worker}: {done} of {each} tries");
                }
                one(folder.path(), &good, &mut rng)
            });
            tries.find_map(Result::err)
        };
        let threads: Vec<_> = (0..WORKERS).map(|worker| scope.spawn(move || work(worker))).collect();
        threads.into_iter().filter_map(|thread| thread.join().expect("no panic here")).collect()
    });
    assert!(broken.is_empty(), "{}", broken.join("\n\n"));
    println!("{total} damaged command lines and files");
}
