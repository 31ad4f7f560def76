//! Results in a second file of the same name: arrays for an Abaqus mesh, total forces of CalculiX as ccx 2.20 prints them.

use crate::common::{data, quantity};
use formats::results::{self, parse_dat};
use std::fs;
use std::io::Write;
use std::path::Path;

const INP: &str = "*NODE\n11,0,0,0\n12,1,0,0\n13,0,1,0\n14,0,0,1\n*ELEMENT,TYPE=C3D4\n1,11,12,13,14\n";

fn job(dir: &Path) -> std::path::PathBuf {
    fs::write(dir.join("run.inp"), INP).unwrap();
    dir.join("run.inp")
}

#[test]
fn arrays_of_fields_beside_a_mesh_are_in_the_order_of_its_nodes_and_two_files_are_one_too_many() {
    let dir = tempfile::tempdir().unwrap();
    let inp = job(dir.path());
    let missing = results::read(&inp).unwrap_err().to_string();
    assert!(missing.contains("run.inp: results: ") && missing.ends_with("found none"), "{missing}");
    let archive = |shape: &[usize], values: &[f32]| {
        let array = dir.path().join("u.npy");
        formats::npy::write_f32(&array, shape, values).unwrap();
        let mut zip = zip::ZipWriter::new(fs::File::create(dir.path().join("run.npz")).unwrap());
        zip.start_file("U.npy", zip::write::SimpleFileOptions::default()).unwrap();
        zip.write_all(&fs::read(array).unwrap()).unwrap();
        zip.finish().unwrap();
    };
    let values: Vec<f32> = (0..24).map(|k| k as f32).collect();
    archive(&[2, 4, 3], &values);
    let run = results::read(&inp).unwrap();
    assert_eq!((run.steps.len(), run.points.len()), (2, 4));
    assert_eq!(quantity(&run, 1, "U").values[9..], [21.0, 22.0, 23.0]);
    archive(&[2, 3, 4], &values);
    let text = results::read(&inp).unwrap_err().to_string();
    assert!(text.contains("steps x 4 nodes"), "{text}");
    fs::write(dir.path().join("run.csv"), "node,u1,u2,u3\n11,0,0,0\n").unwrap();
    let text = results::read(&inp).unwrap_err().to_string();
    assert!(text.contains("run.csv and ") && text.contains("run.npz"), "{text}");
}

#[test]
fn total_forces_beside_a_frd_belong_to_the_steps_of_their_time() {
    let dir = tempfile::tempdir().unwrap();
    let frd = dir.path().join("job.frd");
    fs::copy(data("cutback.frd"), &frd).unwrap();
    assert!(results::read(&frd).unwrap().totals.is_empty(), "no .dat, no totals");
    let of = |set: &str, time: &str, force: &str| {
        format!("\n total force (fx,fy,fz) for set {set} and time  {time}\n\n       {force}\n")
    };
    let text = "\n displacements (vx,vy,vz) for set BODY and time  0.1000000E+01\n\n         1  1.0E-01  2.0E-02  0.0E+00\n".to_owned()
        + &of("PLATE", "0.1000000E+01", " 3.000000E-01 -4.000000E-01  0.000000E+00")
        + &of("FIX", "0.1000000E+01", "-3.000000E-01  4.000000E-01  1.200000E+00");
    fs::write(dir.path().join("job.dat"), &text).unwrap();
    let run = results::read(&frd).unwrap();
    assert_eq!(run.totals.len(), 2);
    assert!((run.total_force("plate", &run.steps[1]).unwrap() - 0.5).abs() < 1e-12);
    assert!((run.total_force("FIX", &run.steps[1]).unwrap() - 1.3).abs() < 1e-12);
    assert_eq!(run.total_force("WALL", &run.steps[1]).unwrap_err(), ["PLATE", "FIX"]);
    assert!(
        run.total_force("PLATE", &run.steps[0]).unwrap_err().is_empty(),
        "nothing was printed at its time"
    );

    let damaged = text.replace("-4.000000E-01", "************");
    fs::write(dir.path().join("job.dat"), &damaged).unwrap();
    let found = results::read(&frd).unwrap_err().to_string();
    assert!(found.contains("job.dat: line 8: "), "{found}");
    // The job was killed while it printed.
    assert_eq!(parse_dat(&text[..text.find("-3.000000E-01").unwrap()]).unwrap().len(), 1);
}
