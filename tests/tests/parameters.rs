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
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn json(folder: &Path, line: &str) -> Value {
    let text = done(folder, line);
    serde_json::from_str(text.trim()).unwrap_or_else(|error| panic!("{line}: {error}: {text}"))
}

#[test]
fn a_stiffness_is_an_input_of_the_twin() {
    let stage = tempfile::tempdir().expect("a folder");
    let folder = stage.path();
    for line in [
        "new finger --chambers 2",
        "mesh --actuator finger/actuator.toml --size-mm 9",
        "sample --actuator finger/actuator.toml --parameter elastomer.law.mu_mpa=0.6:1.0 --regime both --kind sequence --n 40 \
         --pressure-mpa 0.01 0.06 --gap-mm 0.2 1.0 --out cases.csv",
        "simulate --actuator finger/actuator.toml --cases cases.csv --sensitivities --out database",
        "train --database database --out finger.twin",
    ] {
        done(folder, line);
    }
    for (pressure, gap, mu) in [(0.05, 0.5, 0.72), (0.04, 0.3, 0.9)] {
        let state = format!("--pressure-mpa {pressure} --gap-mm {gap} --set elastomer.law.mu_mpa={mu}");
        let predicted = json(folder, &format!("predict --model finger.twin {state} --out predicted.npy"));
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
        let halfwidth = predicted["bars"]["force_n"].as_f64().expect("a half-width");
        // Half-widths cover nine of ten states; the widest of ten is within twice of it.
        assert!(off < 2.0 * halfwidth && off < 0.02 * force(&simulated), "{state}: {off} N, {predicted}");
        let field = |name: &str| npy::read_f32(&folder.join(name)).expect("an array").data;
        let (found, exact) = (field("predicted.npy"), field("simulated.npy"));
        let of_axis = |axis: usize| {
            found.chunks(5).zip(exact.chunks(5)).map(move |(a, b)| f64::from(a[axis] - b[axis]))
        };
        let worst = (0..3).flat_map(of_axis).fold(0.0_f64, |worst, off| worst.max(off.abs()));
        let halfwidth = predicted["bars"]["displacement_mm"].as_f64().expect("a half-width");
        assert!(worst < 2.0 * halfwidth, "{state}: {worst} mm, {predicted}");
    }
    let wrong =
        softtwin(folder, "predict --model finger.twin --pressure-mpa 0.05 --set elastomer.law.mu=0.7");
    let text = String::from_utf8_lossy(&wrong.stderr).into_owned();
    assert!(!wrong.status.success() && text.contains("did you mean \"elastomer.law.mu_mpa\""), "{text}");
}
