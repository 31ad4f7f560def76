//! The C and C++ examples, compiled and run with a twin.

use crate::synthetic::design;
use rom::evaluator::Evaluator;
use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use rom::observable::Observables;
use rom::snapshots::Split;
use std::path::{Path, PathBuf};
use std::process::Command;
use tests::skip::{Missing, skipped};
use tests::wait::wait_until;
use tests::{Program, Stage, moving};
use train::config::TrainConfig;
use train::measured::MeasuredStates;
use train::train;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// A folder with the library under its installed names, as `scripts/package.sh c` makes it.
fn libraries(stage: &Stage) -> PathBuf {
    // `target/<profile>/deps` is where cargo puts the library of the test that runs.
    let library = std::env::current_exe().unwrap().with_file_name("libcapi.so");
    let folder = stage.path("lib");
    std::fs::create_dir_all(&folder).unwrap();
    for name in ["libsofttwin.so", "libsofttwin.so.0"] {
        let link = folder.join(name);
        if !link.exists() {
            std::os::unix::fs::symlink(&library, link).unwrap();
        }
    }
    folder
}

/// Compiles an example; `None` without a C++ compiler.
pub fn compile(stage: &Stage, compiler: &str, standard: &str, example: &str) -> Option<String> {
    if compiler == "c++" && Command::new(compiler).arg("--version").output().is_err() {
        skipped(Missing::CppCompiler);
        return None;
    }
    let out = stage.path(&example.replace('.', "_"));
    let libraries = libraries(stage);
    let done = Command::new(compiler)
        .args([standard, "-Wall", "-Wextra", "-Werror", "-pedantic", "-O1"])
        .arg(repository().join("clients/c/examples").join(example))
        .arg("-I")
        .arg(repository().join("crates/capi/include"))
        .arg("-L")
        .arg(&libraries)
        .arg(format!("-Wl,-rpath,{}", libraries.display()))
        .args(["-lsofttwin", "-lm", "-o"])
        .arg(&out)
        .output()
        .unwrap();
    assert!(done.status.success(), "{example}:\n{}", String::from_utf8_lossy(&done.stderr));
    Some(out.display().to_string())
}

fn scene(stage: &Stage) -> PathBuf {
    stage.write(
        "finger.toml",
        "name = \"s\"\n[[actuator]]\nname = \"finger\"\nmodel = \"beam.twin\"\n[actuator.source]\nkind = \"simulate\"\n\
         rate_hz = 500.0\ngap_mm = 25.0\n[[actuator.output]]\nnodes = \"all\"",
    )
}

/// The beam with a tip that was measured 2 mm higher at all states with this gap.
fn corrected() -> Vec<u8> {
    let mut model = Model::from_bytes(tests::stage::model_bytes()).unwrap();
    let mut state = ModelState::new(&model, &Selection::default()).unwrap();
    let tip = rom::observable::Definition {
        kind: rom::observable::ObservableKind::Position,
        points: vec![rom::observable::PointSpec::Set("tip".into())],
        axis: Some([0.0, 1.0, 0.0]),
    };
    let tip = Observables::define(&model, &[("tip_y_mm".to_owned(), tip)].into()).unwrap();
    let states: Vec<Inputs> =
        (0..120).map(|k| Inputs::new(0.09 * (f64::from(k) / 119.0).powi(2), 25.0)).collect();
    let mut measured = |inputs: &Inputs| {
        state.update(*inputs).unwrap();
        2.0 + tip.value(0, state.evaluation()).value
    };
    let outputs = vec![states.iter().map(&mut measured).collect()];
    let run = MeasuredStates { states: states.into_iter().map(Some).collect(), outputs };
    train::measured::correct(&mut model, &["tip_y_mm".to_owned()], &[run], &mut Vec::new()).unwrap();
    model.to_bytes().unwrap()
}

#[test]
fn the_examples_run_in_c_and_in_cpp() {
    // The rlib of this test and the shared library are of the same build.
    assert_eq!(capi::softtwin_layout_version(), wire::layout::LAYOUT_VERSION);
    let stage = Stage::with_model("capi", &corrected());
    let scene = scene(&stage);
    let programs: Vec<String> = [("cc", "-std=c11", "twin.c"), ("c++", "-std=c++17", "twin.cpp")]
        .into_iter()
        .filter_map(|(compiler, standard, example)| compile(&stage, compiler, standard, example))
        .collect();
    assert!(!programs.is_empty(), "not even a C compiler is here");
    for program in &programs {
        let (status, said) = Program::shell(&stage, program).end();
        assert_eq!(status.code(), Some(1), "without a twin: {said:?}");
    }
    let twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    for program in &programs {
        let (status, said) = Program::shell(&stage, program).end();
        assert!(status.success(), "{program}: {said:?}");
        let all = said.join("\n");
        for expected in ["120 nodes", "what if: 0.", "refused: more force than the sampled states give here"]
        {
            assert!(all.contains(expected), "{program}: `{expected}` is missing in {all}");
        }
        assert!(all.contains("free") || all.contains("contact"), "{program}: no regime in {all}");
        if program.ends_with("twin_c") {
            let part = all.split_once("measured difference ").expect("an observable").1.lines().next();
            let part: f64 = part.unwrap().parse().expect("a number");
            assert!((part - 2.0).abs() < 0.3, "{all}");
        }
    }
    if let Some(latency) = compile(&stage, "cc", "-std=c11", "latency.c") {
        for what in ["state", "field"] {
            let (status, said) = Program::shell(&stage, &format!("{latency} 1 {what} finger")).end();
            assert!(status.success(), "{said:?}");
            assert!(said[0].contains(&format!("\"what\":\"{what}\"")), "{said:?}");
        }
    }
    drop((bridge, twin));
}

/// The loop is started first; its readers find the twin that comes after it.
#[test]
fn the_loop_of_the_example_may_start_before_its_twin() {
    let stage = Stage::new("capiloop");
    let scene = scene(&stage);
    let program = compile(&stage, "cc", "-std=c11", "loop.c").expect("a C compiler");
    let mut looping = Program::shell(&stage, &format!("exec {program} finger 500"));
    looping.wait_for("waiting");
    let _twin = Program::twin(&stage, &scene);
    let _bridge = Program::bridge(&stage, &scene);
    let (status, said) = looping.end();
    assert!(status.success(), "{said:?}");
    assert!(said.iter().any(|line| line.contains(" 0 lost")), "{said:?}");
}

/// One owner drives a valve; others are refused by its name, in C and C++ and from the shell. Killed, it loses the valve.
#[test]
fn a_valve_has_one_owner_in_c() {
    let stage = Stage::new("capivalve");
    let converter = stage.path("iio:device0");
    std::fs::create_dir(&converter).unwrap();
    let raw = converter.join("out_voltage0_raw");
    std::fs::write(&raw, "0\n").unwrap();
    let valve = format!(
        "\n[actuator.valve]\nrange_mpa = [0.0, 0.08]\nstate_max_age_ms = 60000\nstop_outside_domain = false\n\
         [actuator.valve.iio]\nroot = \"{}\"\ndevice = \"iio:device0\"\nscale = 2e-5\nraw_max = 4095\n",
        stage.folder.path().display()
    );
    let scene = scene(&stage);
    let text = std::fs::read_to_string(&scene).unwrap() + &valve;
    std::fs::write(&scene, text).unwrap();
    let program = compile(&stage, "cc", "-std=c11", "setpoint.c").expect("a C compiler");
    let (status, said) = Program::shell(&stage, &program).end();
    assert_eq!(status.code(), Some(1), "without a bridge: {said:?}");
    let in_cpp = compile(&stage, "c++", "-std=c++17", "setpoint.cpp");
    let _twin = Program::twin(&stage, &scene);
    let _bridge = Program::bridge(&stage, &scene);
    let written = |wanted: &str| {
        wait_until(&format!("{wanted} in the converter"), || {
            (std::fs::read_to_string(&raw).unwrap().trim() == wanted).then_some(())
        });
    };
    let mut owner = Program::shell(&stage, &format!("exec {program} finger 0.02 600"));
    owner.wait_for("follows: 0.0200 MPa");
    written("1000");
    let refusal = format!("(`setpoint.c`, process {})", owner.id());
    let others = [Some(&*program), Some("softtwin setpoint finger --pressure 0.05"), in_cpp.as_deref()];
    for second in others.into_iter().flatten() {
        let (status, said) = Program::shell(&stage, second).end();
        assert!(!status.success() && said.join("\n").contains(&refusal), "{second}: {said:?}");
    }
    owner.kill();
    written("0");
    let (status, said) = Program::shell(&stage, &format!("{program} finger 0.04 1")).end();
    assert!(status.success(), "{said:?}");
    written("0");
    if let Some(in_cpp) = in_cpp {
        let owner = Program::shell(&stage, &format!("exec {in_cpp} finger 0.03 600"));
        written("1500");
        owner.kill();
        written("0");
        let (status, said) = Program::shell(&stage, &format!("{in_cpp} finger 0.04 0.2")).end();
        assert!(status.success(), "{said:?}");
        written("0");
    }
    for (owner, expected) in [("", "name of 1 to 31 bytes"), ("a\nb", "name of 1 to 31 bytes")] {
        let text = refused_owner(&stage, owner);
        assert!(text.contains(expected), "{owner:?}: {text}");
    }
}

/// The library's error for an owner's name.
fn refused_owner(stage: &Stage, owner: &str) -> String {
    use std::ffi::{CStr, CString};
    let [domain, root] = [stage.domain_name.clone(), stage.root().display().to_string()]
        .map(|text| CString::new(text).unwrap());
    let (mut bus, mut writer) = (std::ptr::null_mut(), std::ptr::null_mut());
    let owner = CString::new(owner).unwrap();
    // SAFETY: strings and places live across the calls; the handle is live until it is closed.
    unsafe {
        assert_eq!(
            capi::softtwin_bus_open(domain.as_ptr(), root.as_ptr(), &mut bus),
            capi::softtwin_status::SOFTTWIN_OK
        );
        let status = capi::softtwin_writer_open_setpoint(
            bus,
            c"finger".as_ptr(),
            std::ptr::null(),
            owner.as_ptr(),
            &mut writer,
        );
        assert_eq!(status, capi::softtwin_status::SOFTTWIN_ARGUMENT);
        capi::softtwin_bus_close(bus);
        CStr::from_ptr(capi::softtwin_last_error()).to_str().unwrap().to_owned()
    }
}

/// A domain belongs to one user, also for programs in C.
#[test]
fn a_folder_of_another_user_and_one_open_to_others_are_refused_in_c() {
    use std::ffi::{CStr, CString};
    use std::os::unix::fs::{PermissionsExt, chown};
    let stage = Stage::new("capiuser");
    std::fs::create_dir(stage.root()).unwrap();
    let refusal = || {
        let root = CString::new(stage.root().display().to_string()).unwrap();
        let mut bus = std::ptr::null_mut();
        // SAFETY: the string and the place live across the calls.
        unsafe {
            let status = capi::softtwin_bus_open(std::ptr::null(), root.as_ptr(), &mut bus);
            assert_eq!(status, capi::softtwin_status::SOFTTWIN_ARGUMENT);
            CStr::from_ptr(capi::softtwin_last_error()).to_str().unwrap().to_owned()
        }
    };
    std::fs::set_permissions(stage.root(), std::fs::Permissions::from_mode(0o770)).unwrap();
    assert!(refusal().contains("chmod 700"));
    std::fs::set_permissions(stage.root(), std::fs::Permissions::from_mode(0o700)).unwrap();
    if chown(stage.root(), Some(54_321), None).is_err() {
        return skipped(Missing::SecondUser);
    }
    assert!(refusal().contains("belongs to user 54321"));
    assert_eq!(std::fs::read_dir(stage.root()).unwrap().count(), 0);
}

#[test]
fn named_inputs_of_a_reading_arrive_and_wrong_ones_are_refused() {
    use std::ffi::{CStr, CString};
    let stage = Stage::new("capiinputs");
    let [domain, root] = [stage.domain_name.clone(), stage.root().display().to_string()]
        .map(|text| CString::new(text).unwrap());
    let (mut bus, mut writer) = (std::ptr::null_mut(), std::ptr::null_mut());
    let send = |writer, names: &[&CStr], values: &[f64]| {
        let names: Vec<_> = names.iter().map(|name| name.as_ptr()).collect();
        // SAFETY: the writer is live, there are as many names as values.
        let status = unsafe {
            capi::softtwin_writer_send_inputs(
                writer,
                0.03,
                40.0,
                f64::NAN,
                names.as_ptr(),
                values.as_ptr(),
                names.len(),
            )
        };
        // SAFETY: the text lives until the next call of this thread.
        let text = unsafe { CStr::from_ptr(capi::softtwin_last_error()) };
        (status, text.to_str().unwrap().to_owned())
    };
    // SAFETY: strings and places live across the calls; handles are live until they are closed.
    unsafe {
        assert_eq!(
            capi::softtwin_bus_open(domain.as_ptr(), root.as_ptr(), &mut bus),
            capi::softtwin_status::SOFTTWIN_OK
        );
        let status = capi::softtwin_writer_open(bus, c"part".as_ptr(), c"sensor".as_ptr(), &mut writer);
        assert_eq!(status, capi::softtwin_status::SOFTTWIN_OK);
    }
    let readings = wire::SensorReader::attach(&stage.bus(), &wire::Topic::sensor("part").unwrap()).unwrap();
    let (status, text) = send(writer, &[c"load_n", c"turns_1"], &[2.5, f64::NAN]);
    assert_eq!(status, capi::softtwin_status::SOFTTWIN_OK, "{text}");
    let sample = readings.newest().unwrap().expect("the reading");
    let inputs: Vec<(String, f64)> = sample.inputs().collect();
    assert_eq!((inputs[0].0.as_str(), inputs[0].1, inputs[1].0.as_str()), ("load_n", 2.5, "turns_1"));
    assert!(inputs[1].1.is_nan() && inputs.len() == 2 && sample.pressure_mpa == 0.03, "{sample:?}");
    for (names, part) in [
        (vec![c""], "1 to 31 bytes"),
        (vec![c"a_mm", c"a_mm"], "no other input has"),
        (vec![c"a_1", c"b_1", c"c_1", c"d_1", c"e_1", c"f_1", c"g_1"], "at most 6"),
    ] {
        let (status, text) = send(writer, &names, &vec![1.0; names.len()]);
        assert_eq!(status, capi::softtwin_status::SOFTTWIN_ARGUMENT, "{names:?}");
        assert!(text.contains(part), "{names:?}: {text}");
    }
    assert_eq!(readings.newest().unwrap().map(|sample| sample.seq), None, "what is refused is not sent");
    // SAFETY: both are live and closed once.
    unsafe {
        capi::softtwin_writer_close(writer);
        capi::softtwin_bus_close(bus);
    }
}

/// Expected output of `model.c`, computed by the Rust API.
fn said_of(model: &Model, settings: &[(&str, f64)], inputs: Inputs) -> Vec<String> {
    let mut model = model.clone();
    model.header.set_parameters(settings.iter().copied()).unwrap();
    let mut state = ModelState::new(&model, &Selection::default()).unwrap();
    let peak = state.update(inputs).unwrap().stress_mpa.unwrap();
    let (specs, fields) = (&model.header.inputs, &model.header.fields);
    let mut said = vec![format!("force {:?} ", state.evaluation().contact_force_n)];
    let gradient = specs.iter().zip(state.evaluation().force_gradient);
    said.extend(gradient.map(|(input, d)| format!("by {} {d:?} N per {}", input.key(), input.unit)));
    let first = state.fields().chunks(model.header.node_count).map(|field| field[0]);
    said.extend(
        first.zip(fields).map(|(v, f)| format!("{} of node 0: {v:.8e} {}", f.spec.name, f.spec.unit)),
    );
    said.push(format!("largest stress {:.8e} MPa at node {}", peak.value, peak.node));
    said
}

/// A line with its numbers read, so that `0.5` and `0.50` are the same and nothing else is.
fn read_numbers(line: &str) -> Vec<Result<f64, String>> {
    line.split([' ', ':']).map(|word| word.parse().map_err(|_| word.to_owned())).collect()
}

#[test]
fn model_in_c_equals_the_model_in_rust() {
    let stage = Stage::new("capimodel");
    let states: Vec<_> = design::states(0, 160).into_iter().map(|state| (Split::Train, state)).collect();
    let (model, _) = train(&design::database(&states, false), &TrainConfig::default(), &mut |_| {}).unwrap();
    let path = stage.path("design.twin");
    std::fs::write(&path, model.to_bytes().unwrap()).unwrap();
    let program = compile(&stage, "cc", "-std=c11", "model.c").unwrap();
    let names: Vec<String> = model.header.inputs[2..].iter().map(|input| input.name.clone()).collect();
    let own = model.header.inputs[3].value.unwrap();
    for (settings, pressure_mpa, gap_mm) in [
        (vec![], 0.07, 30.0),
        (vec![(names[0].as_str(), 0.7), (names[1].as_str(), own * 1.1)], 0.05, 25.0),
        (vec![(names[0].as_str(), 0.9)], 0.03, f64::INFINITY),
    ] {
        let inputs = Inputs::new(pressure_mpa, gap_mm);
        let mut command = format!("{program} {} pressure_mpa={pressure_mpa} gap_mm={gap_mm}", path.display());
        settings.iter().for_each(|(name, value)| command += &format!(" {name}={value}"));
        let (status, said) = Program::shell(&stage, &command).end();
        assert!(status.success(), "{said:?}");
        for expected in said_of(&model, &settings, inputs) {
            let found =
                said.iter().any(|line| read_numbers(line).starts_with(&read_numbers(expected.trim_end())));
            assert!(found, "`{expected}` is missing in {said:#?}");
        }
    }
    for (arguments, expected) in [
        ("nowhere.twin", "No such file"),
        (".", "expected a model file, found a folder"),
        (&format!("{} pressure_mpa=nan", path.display()), "expected a number for pressure_mpa, found NaN"),
        (&format!("{} presure=1", path.display()), "expected NAME=VALUE with an input of the model"),
    ] {
        let (status, said) = Program::shell(&stage, &format!("{program} {arguments}")).end();
        assert!(!status.success() && said.join("\n").contains(expected), "{arguments}: {said:?}");
    }
}

/// Without a twin nothing moves: a model with inertia answers with the equilibrium under the load at rest, or under a given one.
#[test]
fn model_with_inertia_is_its_equilibrium_in_c() {
    let stage = Stage::with_model("capimoving", moving::model_bytes());
    let program = compile(&stage, "cc", "-std=c11", "model.c").unwrap();
    let model = Model::from_bytes(moving::model_bytes()).unwrap();
    let evaluator = Evaluator::new(&model.header).unwrap();
    let mut still = evaluator.evaluation();
    for (load, setting) in [(moving::REST, String::new()), (-20_000.0, format!(" {}=-20000", moving::LOAD))] {
        evaluator.evaluate(Inputs::new(0.18, 20.0).with(2, load), &mut still);
        assert!(still.contact_force_n > 0.005, "{}", still.contact_force_n);
        let command = format!("{program} beam.twin pressure_mpa=0.18 gap_mm=20{setting}");
        let (status, said) = Program::shell(&stage, &command).end();
        assert!(status.success(), "{said:?}");
        let force =
            said.iter().find_map(|line| line.strip_prefix("force ")?.split(' ').next()?.parse::<f64>().ok());
        let off = (force.unwrap() - still.contact_force_n).abs();
        assert!(off < 1e-9 * still.contact_force_n, "{load}: {said:?}, expected {}", still.contact_force_n);
    }
}
