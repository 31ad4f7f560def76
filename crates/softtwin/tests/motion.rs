//! Models with inertia from the command line: sampling, training, prediction and evaluation along traces.

use crate::program::{run, succeeds};
use serde_json::Value;
use std::path::Path;

/// Column of a table as numbers; empty cells are NaN.
fn column(folder: &Path, file: &str, name: &str) -> Vec<f64> {
    let text = std::fs::read_to_string(folder.join(file)).unwrap();
    let mut lines = text.lines();
    let at = lines.next().unwrap().split(',').position(|column| column == name).unwrap();
    lines.map(|line| line.split(',').nth(at).unwrap().parse().unwrap_or(f64::NAN)).collect()
}

#[test]
fn trained_inertia_swings_about_the_static_state_and_bad_traces_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let save = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    let new = "new f --chambers 1 --length-mm 24 --width-mm 10 --shear-modulus-mpa 0.4";
    let words = |line: &str| line.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    let succeed = |line: &str| {
        let words = words(line);
        succeeds(folder, &words.iter().map(String::as_str).collect::<Vec<_>>())
    };
    let end_of = |line: &str| {
        let words = words(line);
        run(folder, &words.iter().map(String::as_str).collect::<Vec<_>>())
    };
    succeed(new);
    succeed("mesh --actuator f/actuator.toml --size-mm 12 --out f/mesh.vtu");
    let sample = "sample --kind sequence --n 18 --regime free --pressure 0 0.03 --actuator f/actuator.toml --out c.csv";
    succeed(&format!(
        "{sample} --parameter loads.gravity_mm_s2.1=-400000:400000 --parameter loads.gravity_mm_s2.2=-400000:400000"
    ));
    succeed("simulate --actuator f/actuator.toml --cases c.csv --out db");
    succeed("train --database db --inertia f/actuator.toml --out moves.twin");
    succeed("train --database db --out still.twin");
    save("step.csv", "t_s,pressure_mpa\n0,0.01\n0.0005,0.02\n0.08,0.02\n");
    let report: Value = serde_json::from_str(&succeed(
        "predict moves.twin --json --trace step.csv --out moves.csv --step-ms 0.5",
    ))
    .unwrap();
    assert_eq!((report["moves"].as_bool(), report["restarts"].as_u64()), (Some(true), Some(0)));
    succeed("predict still.twin --json --trace step.csv --out still.csv --step-ms 0.5");
    // Times in the wrong unit are no hours of computation.
    save("long.csv", "t_s,pressure_mpa\n0,0.01\n1e6,0.02\n");
    assert_eq!(end_of("predict moves.twin --json --trace long.csv --out long-out.csv").0, 2);
    let tip = |file: &str| column(folder, file, "tip_y_mm");
    let (moves, still) = (tip("moves.csv"), tip("still.csv"));
    assert_eq!(moves.len(), still.len());
    assert!((moves[0] - still[0]).abs() < 1e-5);
    let (end, way) = (still.len() - 1, still[still.len() - 1] - still[0]);
    // The static model jumps with the pressure; the vibration of this short actuator is overdamped.
    assert!((still[1] - moves[1]) / way > 0.3, "{moves:?} {still:?}");
    assert!(((still[end] - moves[end]) / way).abs() < 0.01, "{moves:?} {still:?}");
    // A base that accelerates sideways moves the tip across, late and to the static place.
    save(
        "side.csv",
        "t_s,pressure_mpa,loads.gravity_mm_s2.2\n0,0.01,0\n0.0005,0.01,50000\n0.08,0.01,50000\n",
    );
    let across = ["moves", "still"].map(|model| {
        succeed(&format!(
            "predict {model}.twin --json --trace side.csv --out side-{model}.csv --step-ms 0.5"
        ));
        column(folder, &format!("side-{model}.csv"), "tip_z_mm")
    });
    let off = |i: usize| (across[1][i] - across[0][i]) / (across[1][end] - across[1][0]);
    assert!(off(1) > 0.3 && off(end).abs() < 0.01, "{across:?}");
    // A relaxing elastomer: the same static states, the pressure acts late; 20 % of it with (1 + r) tau, r = 0.25.
    let text = std::fs::read_to_string(folder.join("f/actuator.toml")).unwrap();
    let relaxing = text.replace("prony = []", "prony = [{ weight = 0.2, time_s = 0.05 }]");
    save("f/relaxing.toml", &relaxing);
    succeed("train --database db --inertia f/relaxing.toml --out late.twin");
    succeed("predict late.twin --json --trace step.csv --out late.csv --step-ms 0.5");
    let late = tip("late.csv");
    let behind = (still[end] - late[end]) / way;
    assert!((behind - 0.2 * (-0.0795_f64 / 0.0625).exp()).abs() < 0.015, "{behind}");
    // The series of a motion is a trace, here with the model's own answers.
    std::fs::create_dir(folder.join("own")).unwrap();
    std::fs::copy(folder.join("moves.csv"), folder.join("own/series.csv")).unwrap();
    let errors: Value =
        serde_json::from_str(&succeed("evaluate moves.twin --traces own --picture own.svg --json")).unwrap();
    assert!(std::fs::read_to_string(folder.join("own.svg")).unwrap().contains("<svg"));
    // The model's own motion lies within its half-widths.
    assert_eq!(errors[0]["quantities"][2]["coverage"], 100.0, "{errors}");
    assert_eq!(errors[0]["class"], "free");
    assert!(errors[0]["quantities"][2]["inertia"].as_f64().unwrap() < 0.01, "{errors}");
    assert!(errors[0]["quantities"][2]["statics"].as_f64().unwrap() > 1.0, "{errors}");
    // Pressures above the model are answered and counted, far above there is no answer. A hole of 3 s is a straight line.
    save("above.csv", "t_s,pressure_mpa\n0,0.01\n0.0005,0.035\n0.02,0.035\n");
    save("far.csv", "t_s,pressure_mpa\n0,0.01\n0.0005,0.3\n0.02,0.3\n");
    let (code, _, error) = end_of("predict moves.twin --json --trace far.csv --out far-out.csv --step-ms 10");
    assert!(code == 1 && error.contains("pressure_mpa") && !folder.join("far-out.csv").exists(), "{error}");
    save("hole.csv", "t_s,pressure_mpa\n0,0.01\n3,0.02\n3.1,0.02\n");
    let predict = |name: &str| -> Value {
        let line = format!("predict moves.twin --json --trace {name}.csv --out {name}-out.csv --step-ms 10");
        serde_json::from_str(&succeed(&line)).unwrap()
    };
    let above = predict("above");
    assert!(above["outside_training_range"].as_u64().unwrap() > 0, "{above}");
    let hole = predict("hole");
    assert_eq!(
        (hole["restarts"].as_u64(), hole["outside_training_range"].as_u64()),
        (Some(0), Some(0)),
        "{hole}"
    );
    let after = tip("hole-out.csv");
    assert!(((after[after.len() - 1] - still[end]) / way).abs() < 0.01, "{after:?}");
    save("back.csv", "t_s,pressure_mpa\n0,0.01\n0.1,0.02\n0.05,0.02\n");
    save("unknown.csv", "t_s,pressure_mpa,valve\n0,0.01,1\n0.1,0.02,1\n");
    for bad in ["back.csv", "unknown.csv"] {
        let (code, _, error) = end_of(&format!("predict moves.twin --json --trace {bad} --out x.csv"));
        assert_eq!(code, 78, "{bad}: {error}");
    }
    let (code, _, error) = end_of("train --database db --inertia c.csv --out x.twin");
    assert_eq!(code, 78, "{error}");
}
