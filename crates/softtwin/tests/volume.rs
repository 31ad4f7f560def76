//! The injected volume in place of the pressure: single states, lists, the database, and the path through a limit.

use crate::simulate::WorkFolder;
use serde_json::Value;

const LIST: &str = "case,regime,split,volume_mm3,gap_mm
v0,free,train,0,
v1,free,train,300,
v2,free,train,600,
v3,free,train,900,
touching,contact,check,900,0.4
";

#[test]
fn list_of_volumes_gives_the_states_of_the_pressures_found() {
    let place = WorkFolder::new();
    place.put("cases.csv", LIST);
    place
        .run("simulate --actuator a.toml --cases cases.csv --out db --sensitivities")
        .refused(2, "found volume_mm3");
    let report = place.run("simulate --actuator a.toml --cases cases.csv --out db --json").json();
    assert_eq!(report["solved"].as_u64(), Some(5), "{report}");
    let table = place.read("db/cases.csv");
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(
        rows[0],
        ["case", "regime", "split", "volume_mm3", "gap_mm", "contact_force_n", "pressure_mpa"]
    );
    let pressures: Vec<f64> = rows[1..].iter().map(|row| row[6].parse().unwrap()).collect();
    assert!(pressures[..4].windows(2).all(|pair| pair[0] < pair[1]), "{pressures:?}");
    let snapshots = formats::npy::read_f32(&place.at("db/snapshots.npy")).unwrap();
    assert_eq!(snapshots.shape[2], 6);
    assert!(snapshots.data.iter().skip(5).step_by(6).zip([0; 3]).all(|(p, _)| *p == pressures[0] as f32));
    let given = format!("simulate --actuator a.toml --pressure {}", pressures[3]);
    let volume = place.run(&given).json()["volume_mm3"].as_f64().unwrap();
    assert!((volume - 900.0).abs() < 1.0e-3, "{volume}");
    // Masses of gas in cavity and supply: Boyle's law gives the state of the volume found.
    let path = place.run("simulate --actuator a.toml --gas-mg 2 --dead-volume-mm3 5000 --steps 2").lines();
    let of = |gas: &Value| {
        ["gas_mg", "pressure_mpa", "volume_mm3", "cavity_volume_mm3"].map(|key| gas[key].as_f64().unwrap())
    };
    for (gas, expected_mg) in path.iter().zip([1.0, 2.0]) {
        let [mg, mpa, injected, cavity] = of(gas);
        let (air_j, space) = (mg * 287.05e-6 * 293.15, 0.101325 * (cavity - injected + 5000.0));
        assert!(((mpa + 0.101325) * (cavity + 5000.0) / (space + 1e3 * air_j) - 1.0).abs() < 1e-6, "{gas}");
        assert!((mg - expected_mg).abs() < 1e-9, "{gas}");
    }
    let [_, mpa, injected, _] = of(&path[1]);
    let given = place.run(&format!("simulate --actuator a.toml --volume-mm3 {injected}")).json();
    assert!((given["pressure_mpa"].as_f64().unwrap() / mpa - 1.0).abs() < 1e-5, "{path:?} {given}");
    place.run("simulate --actuator a.toml --gas-mg 2").refused(2, "--dead-volume-mm3");
    // What was solved is found again.
    let again = place.run("simulate --actuator a.toml --cases cases.csv --out db --json").json();
    assert_eq!(again["reused"].as_u64(), Some(5), "{again}");
}

#[test]
fn path_through_a_limit_of_pressure_is_a_table_and_a_picture() {
    let place = WorkFolder::new();
    let soft = crate::actuators::tiny().replace("law = \"gent\" ", "law = \"neo-hookean\" ");
    let without: Vec<&str> = soft.lines().filter(|line| !line.starts_with("jm =")).collect();
    place.put("a.toml", &without.join("\n"));
    let path =
        place.run("simulate --actuator a.toml --volume-mm3 5300 --path --steps 6 --out path --json").json();
    let limits = path["limits"].as_array().unwrap();
    assert_eq!((limits.len(), &limits[0]["limit"]), (1, &"pressure_maximum".into()), "{path}");
    let limit_mpa = limits[0]["pressure_mpa"].as_f64().unwrap();
    let points = path["points"].as_array().unwrap();
    assert!(
        points[0]["stable_at_pressure"] == true && points[points.len() - 1]["stable_at_pressure"] == false
    );
    assert_eq!(place.read("path/path.csv").lines().count(), 1 + points.len());
    assert!(place.at("path/path.png").exists());
    // A model over the volume has the pressure among its fields, behind the limit too.
    let row = |split: &str, volume: i32| format!("{split}{volume},free,{split},{volume},\n");
    let train: String = (0..13).map(|k| row("train", 450 * k)).collect();
    let check: String = [700, 2900, 4600].map(|volume| row("check", volume)).concat();
    place.put("cases.csv", &format!("case,regime,split,volume_mm3,gap_mm\n{train}{check}"));
    place.run("simulate --actuator a.toml --cases cases.csv --out db --json").json();
    place.run("train --database db --out m.twin --json").json();
    let cell = |table: &str, line: usize, column: &str| -> f64 {
        let at = table.lines().next().unwrap().split(',').position(|name| name == column).unwrap();
        table.lines().nth(line).unwrap().split(',').nth(at).unwrap().parse().unwrap()
    };
    let solved = place.read("db/cases.csv");
    for (line, volume) in [(14, 700), (15, 2900), (16, 4600)] {
        let answer =
            place.run(&format!("predict m.twin --json --set volume_mm3={volume} --out s.csv")).json();
        let predicted = cell(&place.read("s.csv"), 1, "pressure_mpa");
        let exact = cell(&solved, line, "pressure_mpa");
        println!("{volume} mm3: {predicted} MPa predicted, {exact} MPa solved");
        assert!((predicted / exact - 1.0).abs() < 5.0e-3, "{predicted} {exact}");
        assert!((answer["pressure_mpa"].as_f64().unwrap() / predicted - 1.0).abs() < 1.0e-6, "{answer}");
        // Along a trace of volumes the pressure is a result too.
        place.put("t.csv", &format!("t_s,volume_mm3\n0,{volume}\n1,900\n"));
        place.run("predict m.twin --json --trace t.csv --step-ms 1000 --out series.csv").json();
        let along = cell(&place.read("series.csv"), 1, "pressure_mpa");
        assert!((along / predicted - 1.0).abs() < 1.0e-6, "{along} {predicted}");
    }
    // Along a trace of pressures the volume is the result; beyond the limit there is no state in this model.
    let mpa = 0.5 * limit_mpa;
    place.put("t.csv", &format!("t_s,pressure_mpa\n0,{mpa}\n1,{}\n", 1.1 * limit_mpa));
    let report = place.run("predict m.twin --json --trace t.csv --step-ms 1000 --out series.csv").json();
    assert_eq!(
        (&report["limits_passed"], &report["outside_training_range"]),
        (&1.into(), &1.into()),
        "{report}"
    );
    let volume = cell(&place.read("series.csv"), 1, "volume_mm3");
    let answer = place.run(&format!("predict m.twin --json --set volume_mm3={volume}")).json();
    assert!((answer["pressure_mpa"].as_f64().unwrap() / mpa - 1.0).abs() < 1.0e-5, "{answer}");
    assert_eq!(cell(&place.read("series.csv"), 1, "pressure_mpa"), mpa);
    assert!(
        (cell(&place.read("series.csv"), 2, "volume_mm3") / limits[0]["volume_mm3"].as_f64().unwrap() - 1.0)
            .abs()
            < 0.05
    );
    place.put("t.csv", "t_s,gap_mm\n0,\n1,\n");
    place
        .run("predict m.twin --json --trace t.csv --out series.csv")
        .refused(78, "`volume_mm3` or `pressure_mpa`");
    // The same limit at given pressure, named.
    let beyond = format!("simulate --actuator a.toml --pressure {}", 1.2 * limit_mpa);
    place.run(&beyond).refused(1, &format!("limit of {limit_mpa:.6}"));
}
