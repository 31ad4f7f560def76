//! A model over a parameter of the actuator, from nothing: states over pressure, gap and stiffness, a model, a prediction
//! that fresh finite elements confirm.

use formats::npy;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use tests::process::binary;

fn softtwin(folder: &Path, line: &str) -> Output {
    Command::new(binary("softtwin"))
        .args(line.split_whitespace())
        .current_dir(folder)
        .env_remove("RUST_LOG")
        .output()
        .expect("softtwin")
}

fn done(folder: &Path, line: &str) -> String {
    let output = softtwin(folder, line);
    let [printed, errors] =
        [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    assert!(output.status.success(), "{line}: {errors}{printed}");
    printed
}

fn json(folder: &Path, line: &str) -> Value {
    let text = done(folder, line);
    serde_json::from_str(text.trim()).unwrap_or_else(|error| panic!("{line}: {error}: {text}"))
}

/// The stiffness for a force between those of two others, beside it the same state by finite elements.
fn a_stiffness_is_found_for_a_force(folder: &Path) {
    let state = "finger.twin --pressure 0.05 --gap 0.5";
    let force = |mu: f64| {
        let predicted = json(folder, &format!("predict {state} --json --set elastomer.law.mu_mpa={mu}"));
        predicted["contact_force_n"].as_f64().expect("a force")
    };
    let goal = 0.5 * (force(0.7) + force(0.9));
    let design = |goal: f64, rest: &str| format!("design {state} --objective force_n={goal} {rest}");
    let within = "--within elastomer.law.mu_mpa=0.65:0.95";
    let kept = "--objective max_von_mises_mpa<=1000 --objective x_mm@0,0,0=0.187";
    let answer = json(folder, &design(goal, &format!("{within} {kept} --actuator finger/actuator.toml")));
    let mu = answer["inputs"]["elastomer.law.mu_mpa"].as_f64().expect("a stiffness");
    let missed = |of: &str| answer[of][0]["missed"].as_f64().expect("what is missed").abs();
    assert!(answer["met"] == true && 0.7 < mu && mu < 0.9 && missed("predicted") <= 1e-4, "{answer}");
    assert!(missed("confirmed") < 0.02 * goal && answer["confirmed"][1]["missed"] == 0.0, "{answer}");
    assert!(answer["confirmed"][2]["missed"].as_f64().expect("a place").abs() < 0.02, "{answer}");
    assert!((force(mu) - goal).abs() <= 1e-4, "{mu} MPa gives {} N, asked for {goal} N", force(mu));
    let refused = |line: &str, code: i32, text: &str| {
        let output = softtwin(folder, line);
        let all =
            [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
        assert!(
            output.status.code() == Some(code) && all.contains(text),
            "{line}: {:?}: {all}",
            output.status
        );
    };
    refused(&design(1000.0, within), 1, "the goal is not met within the bounds");
    refused(&design(goal, "--within elastomer.law.mu=0.65:0.95"), 2, "elastomer.law.mu_mpa");
    refused(&design(goal, "--within elastomer.law.mu_mpa=0.1:0.95"), 2, "where the model was trained");
    refused(&design(goal, &format!("{within} --set elastomer.law.mu_mpa=0.7")), 2, "given twice");
    refused(&design(goal, &format!("{within} --objective force_n=1")), 2, "given twice");
    refused(&format!("design {state} --objective force=1 {within}"), 2, "expected force_n=VALUE");
}

#[test]
fn stiffness_is_an_input_of_the_twin() {
    let stage = tempfile::tempdir().expect("a folder");
    let folder = stage.path();
    for line in [
        "new finger --chambers 2",
        "mesh --actuator finger/actuator.toml --size-mm 9",
        "sample --actuator finger/actuator.toml --parameter elastomer.law.mu_mpa=0.6:1.0 --regime both --kind sequence --n 40 \
         --pressure 0.01 0.06 --gap 0.2 1.0 --out cases.csv",
        "simulate --actuator finger/actuator.toml --cases cases.csv --sensitivities --out database",
        "train --database database --out finger.twin",
    ] {
        done(folder, line);
    }
    for (pressure, gap, mu) in [(0.05, 0.5, 0.72), (0.04, 0.3, 0.9)] {
        let state = format!("--pressure {pressure} --gap {gap} --set elastomer.law.mu_mpa={mu}");
        let predicted = json(folder, &format!("predict finger.twin --json {state} --out predicted.npy"));
        assert_eq!(
            (&predicted["in_domain"], &predicted["inputs"]["elastomer.law.mu_mpa"]),
            (&true.into(), &mu.into())
        );
        let simulated = json(
            folder,
            &format!("simulate --actuator finger/actuator.toml {state} --json --out simulated.npy"),
        );
        let force = |value: &Value| value["contact_force_n"].as_f64().expect("a force");
        let off = (force(&predicted) - force(&simulated)).abs();
        let halfwidth = predicted["half_widths"]["force_n"].as_f64().expect("a half-width");
        // Half-widths cover nine of ten states; the widest of ten is within twice of it.
        assert!(off < 2.0 * halfwidth && off < 0.02 * force(&simulated), "{state}: {off} N, {predicted}");
        let field = |name: &str| npy::read_f32(&folder.join(name)).expect("an array").data;
        let (found, exact) = (field("predicted.npy"), field("simulated.npy"));
        let of_axis = |axis: usize| {
            found.chunks(5).zip(exact.chunks(5)).map(move |(a, b)| f64::from(a[axis] - b[axis]))
        };
        let worst = (0..3).flat_map(of_axis).fold(0.0_f64, |worst, off| worst.max(off.abs()));
        let halfwidth = predicted["half_widths"]["displacement_mm"].as_f64().expect("a half-width");
        assert!(worst < 2.0 * halfwidth, "{state}: {worst} mm, {predicted}");
    }
    a_stiffness_is_found_for_a_force(folder);
    let wrong = softtwin(folder, "predict finger.twin --json --pressure 0.05 --set elastomer.law.mu=0.7");
    let text = String::from_utf8_lossy(&wrong.stderr).into_owned();
    assert!(!wrong.status.success() && text.contains("elastomer.law.mu_mpa"), "{text}");
}
