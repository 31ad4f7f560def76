//! `softtwin material fit` on synthetic tables as testing machines write them.

use crate::program::run;
use serde_json::Value;
use std::path::Path;

/// Nominal stress (MPa) of a Yeoh bar.
fn bar_mpa(l: f64) -> f64 {
    let e = l * l + 2.0 / l - 3.0;
    2.0 * (l - l.powi(-2)) * (0.02 + 2.0 * e * 2e-4)
}

/// Nominal stress (MPa) of the same law in pure shear.
fn strip_mpa(l: f64) -> f64 {
    let e = l * l + l.powi(-2) - 2.0;
    2.0 * (l - l.powi(-3)) * (0.02 + 2.0 * e * 2e-4)
}

fn rows(to: f64, row: impl Fn(f64) -> String) -> String {
    (1..=80).map(|k| row(1.0 + (to - 1.0) * f64::from(k) / 80.0) + "\n").collect()
}

fn fit(folder: &Path, args: &[&str]) -> Value {
    let (code, out, err) = run(folder, &[&["material", "fit", "--json"], args].concat());
    assert_eq!(code, 0, "{args:?}: {err}");
    serde_json::from_str(&out).unwrap()
}

fn shear_mpa(found: &Value) -> f64 {
    found["shear_modulus_mpa"].as_f64().unwrap()
}

#[test]
fn tables_of_machines_give_the_same_constants() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
    write(
        "a.csv",
        format!(
            "Specimen Width (mm);6;\n;;\nTime (s);Engineering Strain;Engineering Stress (MPa)\n{}",
            rows(4.0, |l| format!("{};{};{}", l, l - 1.0, bar_mpa(l)))
        ),
    );
    write(
        "b.csv",
        format!(
            "Strain (%),Stress (kPa)\n{}",
            rows(4.0, |l| format!("{},{}", 100.0 * (l - 1.0), 1e3 * bar_mpa(l)))
        ),
    );
    write(
        "c.txt",
        format!(
            "Dehnung strain\tTrue Stress [psi]\n{}",
            rows(4.0, |l| format!("{:.9}\t{:.9}", l - 1.0, l * bar_mpa(l) / 0.006_894_757_293)
                .replace('.', ","))
        ),
    );
    write(
        "d.csv",
        format!(
            "Extension (mm),Load (N)\n{}",
            rows(4.0, |l| format!("{},{}", 25.0 * (l - 1.0), 18.0 * bar_mpa(l)))
        ),
    );
    write(
        "head.csv",
        format!(
            "Specimen Thickness (mm);3\nSpecimen Width (mm);6\nSpecimen Length (cm);2.5\nMachine;X 5569\nExtension (mm);Load (N)\n{}",
            rows(4.0, |l| format!("{};{}", 25.0 * (l - 1.0), 18.0 * bar_mpa(l)))
        ),
    );
    write(
        "zwick.txt",
        format!(
            "\"Width\";\"6\";\"mm\"\nThickness;3;mm\nKraft;Standardweg;Dehnung\nN;mm;%\n{}Ende;;\n",
            rows(4.0, |l| format!("{:.9};{};{:.9}", 18.0 * bar_mpa(l), l, 100.0 * (l - 1.0))
                .replace('.', ","))
        ),
    );
    write("e.txt", rows(4.0, |l| format!("{} {}", bar_mpa(l), l)));
    let mut cyclic = "strain,stress_mpa\n".to_owned();
    for reach in [2.0, 4.0] {
        let loading = rows(reach, |l| format!("{},{}", l - 1.0, bar_mpa(l)));
        let unloading: Vec<String> = rows(reach, |l| format!("{},{}", l - 1.0, 0.8 * bar_mpa(l)))
            .lines()
            .rev()
            .map(str::to_owned)
            .collect();
        cyclic += &format!("{loading}{}\n", unloading.join("\n"));
    }
    write("f.csv", cyclic);
    let slack = |l: f64| if l < 1.05 { 0.0 } else { bar_mpa(l / 1.05) };
    write("g.csv", format!("strain,stress_mpa\n{}", rows(4.0, |l| format!("{},{}", l - 1.0, slack(l)))));
    write(
        "h.csv",
        format!("strain,stress_mpa\n{}", rows(4.0, |l| format!("{},{}", l - 1.0, 0.01 + bar_mpa(l)))),
    );
    let given = [
        "--deformation-column",
        "2",
        "--deformation",
        "stretch",
        "--load-column",
        "1",
        "--load",
        "nominal-stress",
        "--load-unit",
        "MPa",
    ];
    for args in [
        &["a.csv"][..],
        &["b.csv"],
        &["c.txt"],
        &["d.csv", "--length-mm", "25", "--area-mm2", "18"],
        &["head.csv"],
        &["zwick.txt"],
        &[&["e.txt"], &given[..]].concat(),
        &["f.csv"],
    ] {
        let found = fit(folder.path(), &[args, &["--law", "yeoh"]].concat());
        assert!((shear_mpa(&found) / 0.04 - 1.0).abs() < 1e-3, "{args:?}: {found}");
        assert!(found["rms_percent"].as_f64().unwrap() < 0.1, "{args:?}: {found}");
    }
    for (table, origin) in [("g.csv", "slack"), ("h.csv", "load")] {
        let found = fit(folder.path(), &[table, "--law", "yeoh", "--origin", origin]);
        assert!((shear_mpa(&found) / 0.04 - 1.0).abs() < 0.1, "{table}: {found}");
        let left = fit(folder.path(), &[table, "--law", "yeoh"]);
        assert!(left["tests"][0]["notes"].to_string().contains("--origin"), "{table}: {left}");
    }
    let cyclic = fit(folder.path(), &["f.csv", "--branch", "last"]);
    let lost = cyclic["tests"][0]["loops_lost_percent"][0].as_f64().unwrap();
    assert!((lost - 20.0).abs() < 2.0, "{lost}");
}

#[test]
fn several_tests_give_a_material_file_and_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
    write("bar.csv", format!("strain,stress_mpa\n{}", rows(4.0, |l| format!("{},{}", l - 1.0, bar_mpa(l)))));
    write(
        "shear.dat",
        format!(
            "# Time (s), Length (mm), Force (N)\n{}",
            rows(3.0, |l| format!("{} {} {}", l, 11.0 * l, 150.0 * strip_mpa(l)))
        ),
    );
    write(
        "compression.csv",
        format!("strain,stress_mpa\n{}", rows(0.6, |l| format!("{},{}", 1.0 - l, -bar_mpa(l)))),
    );
    write(
        "tests.toml",
        "[[test]]\nfile = \"bar.csv\"\nweight = 2.0\n[[test]]\nfile = \"compression.csv\"\n\
        [[test]]\nfile = \"shear.dat\"\ntest = \"planar\"\nlength_mm = 11.0\narea_mm2 = 150.0\n"
            .into(),
    );
    let found = fit(folder.path(), &["tests.toml", "--out", "silicone.toml", "--picture", "fit.svg"]);
    let kinds: Vec<&str> =
        found["tests"].as_array().unwrap().iter().map(|test| test["test"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["uniaxial", "compression", "planar"]);
    assert_eq!(found["remarks"].as_array().unwrap().len(), 0, "{found}");
    assert!(found["rms_percent"].as_f64().unwrap() < 0.5, "{found}");
    let range = &found["stretch_range"];
    assert!(range[0].as_f64().unwrap() < 0.61 && range[1].as_f64().unwrap() > 3.99, "{range}");
    let material = fem::material::MaterialFile::read(&folder.path().join("silicone.toml")).unwrap();
    assert!((material.elastomer.law.shear_modulus_mpa() / shear_mpa(&found) - 1.0).abs() < 1e-4);
    assert!(std::fs::read_to_string(folder.path().join("fit.svg")).unwrap().starts_with("<svg"));
    // A planar test in true stress given as nominal is bound by the others.
    write(
        "true.csv",
        format!("strain,stress_mpa\n{}", rows(3.0, |l| format!("{},{}", l - 1.0, l * strip_mpa(l)))),
    );
    let wrong = fit(folder.path(), &["bar.csv", "true.csv", "--test", "uniaxial", "--test", "planar"]);
    assert!(wrong["remarks"].to_string().contains("true-stress"), "{wrong}");
}

#[test]
fn bad_tables_have_defined_outcomes() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
    let table =
        |heading: &str| format!("{heading}\n{}", rows(4.0, |l| format!("{},{}", l - 1.0, bar_mpa(l))));
    write("good.csv", table("strain,stress_mpa"));
    write("unit.csv", table("strain,stress"));
    write("blank.csv", rows(4.0, |l| format!("{},{}", l - 1.0, bar_mpa(l))));
    write("force.csv", table("strain,Force (N)"));
    write("short.csv", "strain,stress_mpa\n0.1,0.01\n0.2,0.02\n".into());
    write("below.csv", format!("strain,stress_mpa\n{}", rows(3.0, |l| format!("{},{}", -l, -bar_mpa(l)))));
    write(
        "kpa.csv",
        format!("strain,stress_mpa\n{}", rows(4.0, |l| format!("{},{}", l - 1.0, 1e3 * bar_mpa(l)))),
    );
    write("list.toml", "[[test]]\nfile = \"good.csv\"\ncolour = 1\n".into());
    for (args, code, part) in [
        (&["none.csv"][..], 1, "none.csv"),
        (&["unit.csv"], 78, "--load-unit"),
        (&["blank.csv"], 78, "--deformation-column"),
        (&["force.csv"], 78, "--area-mm2"),
        (&["short.csv"], 78, "8 rows"),
        (&["below.csv"], 78, "strain of -1"),
        (&["list.toml"], 78, "colour"),
        (&["list.toml", "--origin", "load"], 2, "--origin"),
        (&["good.csv", "--load-unit", "mm"], 78, "Pressure"),
        (&["good.csv", "--deformation-column", "7"], 78, "7"),
        (
            &["good.csv", "unit.csv", "--test", "uniaxial", "--test", "planar", "--test", "planar"],
            2,
            "--test",
        ),
    ] {
        let (found, out, err) = run(folder.path(), &[&["material", "fit"], args].concat());
        assert_eq!(found, code, "{args:?}: {out} {err}");
        assert!(err.contains(part), "{args:?}: {err}");
    }
    let found = fit(folder.path(), &["kpa.csv", "--law", "yeoh"]);
    assert!(found["remarks"][0].as_str().unwrap().contains("kPa"), "{found}");
    assert!(found["remarks"].to_string().contains("nominal or true is not identifiable"), "{found}");
}

#[test]
fn data_sheets_and_silicones_become_elastomers_with_their_range() {
    let folder = tempfile::tempdir().unwrap();
    let elastomer = |name: &str, args: &[&str]| {
        let (code, out, err) = run(folder.path(), &[&["new", name, "--chambers", "3"], args].concat());
        assert_eq!(code, 0, "{args:?}: {err}");
        let path = folder.path().join(name).join("actuator.toml");
        (fem::actuator::Actuator::read(&path).unwrap().elastomer, out)
    };
    let (found, out) = elastomer("sheet", &["--shore-a", "30", "--elongation-percent", "364"]);
    let [low, high] = found.shear_interval_mpa.unwrap();
    assert!(low < 0.2 && high > 0.35 && high < 0.4, "{low} {high}");
    assert_eq!(found.stretch_range, Some([1.0, 4.64]));
    assert!(out.contains("material fit") && out.contains("sag [mm]"), "{out}");
    let (found, out) = elastomer("soft", &["--silicone", "ecoflex-00-30"]);
    assert_eq!((found.stretch_range, found.shear_interval_mpa), (Some([1.0, 4.0]), None));
    assert!(out.contains("--hanging"), "a soft finger that sags: {out}");
    let (_, out) = elastomer("hanging", &["--silicone", "ecoflex-00-30", "--hanging"]);
    assert!(out.contains("hangs"), "{out}");
    for args in
        [&["--shore-a", "30", "--shore-00", "30"][..], &["--elongation-percent", "300"], &["--shore-a", "95"]]
    {
        let (code, ..) = run(folder.path(), &[&["new", "other"], args].concat());
        assert_eq!(code, 2, "{args:?}");
    }
}

#[test]
fn one_point_and_too_many_tests_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
    let heading = "strain (-),nominal stress (MPa)\n";
    write("point.csv", format!("{heading}{}", "1,1\n".repeat(100)));
    assert_eq!(run(folder.path(), &["material", "fit", "point.csv"]).0, 78);
    write("good.csv", format!("{heading}{}", rows(2.0, |l| format!("{},{}", l - 1.0, bar_mpa(l)))));
    let list = |count: usize| "[[test]]\nfile = \"good.csv\"\ntest = \"uniaxial\"\n".repeat(count);
    write("few.toml", list(2));
    assert_eq!(run(folder.path(), &["material", "fit", "few.toml", "--law", "neo-hookean"]).0, 0);
    write("many.toml", list(300));
    assert_eq!(run(folder.path(), &["material", "fit", "many.toml"]).0, 78);
    let tables = [["material", "fit"].as_slice(), &["good.csv"; 65]].concat();
    assert_eq!(run(folder.path(), &tables).0, 78);
}
