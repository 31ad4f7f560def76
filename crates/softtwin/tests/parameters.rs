//! Models over parameters from the command line: files of their states, and databases that do not belong together.

use crate::synthetic::design;
use formats::database::{ObstacleKind, write};
use formats::npy;
use formats::vtu::{Cells, Content, read_content};
use rom::snapshots::{Database, Split};
use std::path::Path;
use std::process::{Command, Output};

/// One element: a mesh file has cells.
const CELLS: Cells<'_> = Cells::QuadraticTets(&[[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]]);

fn softtwin(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_softtwin"));
    command.args(line.split_whitespace()).current_dir(folder).env_remove("RUST_LOG").output().unwrap()
}

fn done(folder: &Path, line: &str) {
    let output = softtwin(folder, line);
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
}

fn refused(folder: &Path, line: &str, code: i32, parts: &[&str]) {
    let output = softtwin(folder, line);
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{line}: {text}");
    for part in parts {
        assert!(text.contains(part), "{line}: `{part}` is not in\n{text}");
    }
}

/// The beam of formulas; its length moves the undeformed mesh, by up to millimetres.
fn moving(count: usize) -> Database {
    let states: Vec<_> = design::states(0, count).into_iter().map(|state| (Split::Train, state)).collect();
    let mut database = design::database(&states, false);
    let mesh = database.undeformed_mm.clone().unwrap();
    let by_length = mesh.iter().map(|x| [0.05 * x[0] as f32, 0.1 * x[1] as f32, 0.0]).collect();
    database.undeformed_by = vec![vec![[0.0; 3]; mesh.len()], by_length];
    for k in 0..database.cases.len() {
        let moved = database.moved_mm(k).expect("a length that moves the mesh");
        for (node, values) in
            database.snapshots[k * mesh.len() * 5..][..mesh.len() * 5].chunks_mut(5).enumerate()
        {
            (0..3).for_each(|axis| values[axis] += moved[axis][node]);
        }
    }
    database.hash = database.content_hash();
    database
}

/// Points of the file are the predicted coordinates, and its vector is as long as the predicted displacement.
fn is_the_predicted(content: &Content, predicted: &[f32], largest_off_mm: f64) {
    let quantity = |name: &str| &content.point_data.iter().find(|q| q.name == name).expect(name).values;
    let (vector, length) = (quantity("displacement vector [mm]"), quantity("displacement [mm]"));
    let mut largest = 0.0_f64;
    for (node, values) in predicted.chunks(5).enumerate() {
        let place: Vec<f64> = values.iter().take(3).copied().map(f64::from).collect();
        assert_eq!(content.points[node][..], place[..], "node {node}");
        assert_eq!(length[node], f64::from(values[3]), "node {node}");
        let own = vector[3 * node..][..3].iter().map(|u| u * u).sum::<f64>().sqrt();
        assert!((own - length[node]).abs() < largest_off_mm, "node {node}: {own} is not {}", length[node]);
        largest = largest.max(own);
    }
    assert!(largest > 10.0, "{largest} mm");
}

#[test]
fn exported_states_have_the_mesh_of_their_parameters() {
    let stage = tempfile::tempdir().unwrap();
    let folder = stage.path();
    let database = moving(240);
    write(&folder.join("db"), &database, CELLS).unwrap();
    done(folder, "train --database db --out beam.twin");
    let set = "--set elastomer.law.mu_mpa=0.7 --set chambers.length_mm=3.3";
    for ending in ["pvd", "csv"] {
        done(folder, &format!("export beam.twin --pressure 0.03,0.06 --gap 25 {set} --out s.{ending}"));
    }
    let table = std::fs::read_to_string(folder.join("s.csv")).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    let column = |name: &str| rows[0].iter().position(|found| *found == name).expect(name);
    for (k, pressure) in ["0.03", "0.06"].iter().enumerate() {
        let state = format!("predict beam.twin --json --pressure {pressure} --gap 25 {set}");
        done(folder, &format!("{state} --out p.npy"));
        done(folder, &format!("{state} --out p.vtu"));
        let predicted = npy::read_f32(&folder.join("p.npy")).unwrap().data;
        for file in [format!("s_000{k}.vtu"), "p.vtu".into()] {
            is_the_predicted(&read_content(&folder.join(file)).unwrap(), &predicted, 1e-3);
        }
        for (node, values) in predicted.chunks(5).enumerate() {
            let row = &rows[1 + k * predicted.len() / 5 + node];
            for (name, value) in ["x_mm", "y_mm", "z_mm", "displacement_mm"].iter().zip(values) {
                assert_eq!(row[column(name)].parse::<f32>().unwrap(), *value, "{name} of node {node}");
            }
            assert_eq!(
                (row[column("elastomer.law.mu_mpa")], row[column("chambers.length_mm")]),
                ("0.7", "3.3")
            );
        }
    }
    // The states of a database have the mesh of their parameters too.
    done(folder, "export db --case 22 --out case.pvd");
    is_the_predicted(&read_content(&folder.join("case_0000.vtu")).unwrap(), database.snapshot(22), 1e-3);
    let wrong = "export beam.twin --pressure 0.03 --out x.pvd --set mu_mpa=0.7";
    refused(folder, wrong, 2, &["did you mean \"elastomer.law.mu_mpa\""]);
    refused(folder, "export db --out x.pvd --set elastomer.law.mu_mpa=0.7", 2, &["--set belongs to a model"]);
}

#[test]
fn databases_of_different_parameters_are_not_mixed() {
    let stage = tempfile::tempdir().unwrap();
    let folder = stage.path();
    let wall = moving(24);
    let mut base = wall.clone();
    base.parameters[1].name = "base.lower_mm".into();
    let mut plain = wall.clone();
    plain.parameters.clear();
    plain.undeformed_by.clear();
    plain.cases.iter_mut().for_each(|case| case.parameters.clear());
    for (name, database) in [("wall", &wall), ("base", &base), ("plain", &plain)] {
        write(&folder.join(name), database, CELLS).unwrap();
        assert!(formats::database::read(&folder.join(name), ObstacleKind::Plate).is_ok(), "{name}");
    }
    let mut two = std::fs::read_to_string(folder.join("wall/cases.csv")).unwrap();
    let rows = std::fs::read_to_string(folder.join("plain/cases.csv")).unwrap();
    two += rows.lines().nth(1).unwrap();
    std::fs::write(folder.join("two.csv"), two).unwrap();
    // The cases of one behind the description of the other; rows of both in one table.
    for (mixed, cases, parts) in [
        ("a", "base/cases.csv", &["a column `chambers.length_mm`", "`base.lower_mm`"][..]),
        ("b", "plain/cases.csv", &["a column `chambers.length_mm`", "a column `elastomer.law.mu_mpa`"]),
        ("c", "two.csv", &["line 26"]),
    ] {
        write(&folder.join(mixed), &wall, CELLS).unwrap();
        std::fs::copy(folder.join(cases), folder.join(mixed).join("cases.csv")).unwrap();
        refused(folder, &format!("train --database {mixed} --out x.twin"), 78, parts);
        refused(folder, &format!("pack --database {mixed} --out packed"), 78, parts);
        refused(folder, &format!("export {mixed} --out x.pvd"), 78, parts);
    }
    assert!(!folder.join("x.twin").exists() && !folder.join("packed").exists());
}
