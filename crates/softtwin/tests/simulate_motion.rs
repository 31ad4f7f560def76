//! Motion of the tiny actuator as a user runs it: series, energies, fields, resuming, refusals.

use crate::simulate::{WorkFolder, bytes};
use std::process::Stdio;
use std::time::{Duration, Instant};

/// Long enough for any machine; reached only when something hangs.
const DEADLINE: Duration = Duration::from_secs(300);

const STEP: &str = "t_s,pressure_mpa,gap_mm\n0,0.02,0.3\n0.001,0.05,0.3\n0.03,0.05,0.3\n";

#[test]
fn killed_motion_continues_with_the_same_series() {
    let place = WorkFolder::new();
    place.put("step.csv", STEP);
    let line = |out: &str| {
        format!(
            "simulate --actuator a.toml --trace step.csv --out {out} --json --step-ms 0.5 --fields-s 0,0.02"
        )
    };
    let whole = place.run(&line("whole")).json();
    let series = place.read("whole/series.csv");
    let heading = "t_s,pressure_mpa,gap_mm,lowest_y_mm,tip_x_mm,tip_y_mm,contact_force_n,max_stress_mpa,tip_z_mm,volume_mm3";
    assert_eq!(series.lines().next(), Some(heading));
    assert_eq!((whole["instants"].as_u64(), series.lines().count()), (Some(61), 62));
    assert_eq!(place.read("whole/energy.csv").lines().count(), 62);
    assert!(whole["lowest_frequency_hz"].as_f64().unwrap() > 100.0, "{whole}");
    let grid = formats::vtu::read(&place.at("whole/fields/0.020000.vtu")).unwrap();
    assert!(grid.points_mm.len() > 1000 && place.at("whole/fields/0.000000.vtu").exists());
    // The first row is the static state.
    let first = place.run("simulate --actuator a.toml --pressure 0.02 --gap 0.3").json();
    let cells: Vec<f64> =
        series.lines().nth(1).unwrap().split(',').map(|cell| cell.parse().unwrap()).collect();
    assert!((cells[3] - first["lowest_point_mm"].as_f64().unwrap()).abs() < 1.0e-4, "{cells:?} {first}");
    assert!((cells[7] - first["max_von_mises_mpa"].as_f64().unwrap()).abs() < 1.0e-5, "{cells:?} {first}");

    let mut child =
        place.command(&line("killed")).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let began = Instant::now();
    while !place.at("killed/checkpoint.state").exists() {
        assert!(child.try_wait().unwrap().is_none() && began.elapsed() < DEADLINE);
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let again = place.run(&line("killed")).json();
    assert!(again["reused"].as_u64().unwrap() >= 25, "{again}");
    for file in ["series.csv", "energy.csv", "fields/0.020000.vtu"] {
        assert!(
            bytes(&place.at(&format!("killed/{file}"))) == bytes(&place.at(&format!("whole/{file}"))),
            "{file}"
        );
    }
    let third = place.run(&line("killed")).json();
    assert_eq!(third["reused"], third["instants"], "{third}");
}

#[test]
fn invalid_traces_and_constants_of_motion_are_refused() {
    let place = WorkFolder::new();
    let refused = |trace: &str, more: &str, code: i32, part: &str| {
        place.put("t.csv", trace);
        place.run(&format!("simulate --actuator a.toml --trace t.csv --out o {more}")).refused(code, part);
    };
    let plain = "t_s,pressure_mpa\n0,0.02\n0.1,0.02\n";
    refused("t_s,pressure_mpa\n0,0.02\n-0.1,0.02\n", "", 78, "after the row before");
    refused("t_s,pressure_mpa\n0,0.02\n0.1,20\n", "", 78, "0 to 10 MPa");
    // No equilibrium to begin from: the message names the limit of pressure.
    refused("t_s,pressure_mpa\n0,9\n0.1,9\n", "", 1, "the start of the motion");
    refused("t_s,pressure\n0,0.02\n0.1,0.02\n", "", 78, "pressure_mpa");
    refused(plain, "--step-ms -1", 2, "0.001 to 100");
    refused(plain, "--step-ms 100", 78, "lowest frequency");
    refused(plain, "--fields-s 0.2", 2, "0 to 0.1 s");
    refused("t_s,pressure_mpa\n0,0.02\n1e6,0.02\n", "", 2, "t = 0 s");
    refused(plain, "--gap 3", 2, "cannot be used with");
    refused(plain, "--set elastomer.density_t_per_mm3=0", 78, "density_t_per_mm3");
    refused(plain, "--set dynamics.beta_s=-1", 78, "beta_s");
    let prony = |value: &str| crate::actuators::with(&crate::actuators::tiny(), "dynamics", "prony", value);
    place.put("a.toml", &prony("[{ weight = 1.0, time_s = 0.1 }]"));
    refused(plain, "", 78, "prony.weight");
    place.put("a.toml", &prony("[{ weight = 0.5, time_s = 0.0 }]"));
    refused(plain, "", 78, "prony.time_s");
    place.put("a.toml", &crate::actuators::tiny().replace("density_t_per_mm3", "# density_t_per_mm3"));
    refused(plain, "", 78, "density_t_per_mm3");
}
