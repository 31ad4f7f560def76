//! Results that stand in a second file beside a mesh or a job: Abaqus' field reports and arrays, CalculiX's total forces. The reports are written here after
//! Abaqus' printed examples, the totals as ccx 2.20 prints them; no Abaqus was at hand.

use crate::common::{data, quantity};
use formats::results::{self, parse_dat, parse_rpt};
use std::fs;
use std::io::Write;
use std::path::Path;

const INP: &str = "*NODE\n11,0,0,0\n12,1,0,0\n13,0,1,0\n14,0,0,1\n*ELEMENT,TYPE=C3D4\n1,11,12,13,14\n";

fn report(step: &str, increment: usize, time: f64, factor: f64) -> String {
    let rows: String = (11..=14)
        .map(|node| {
            let u = factor * f64::from(node - 11);
            format!(
                "{node:>16} {:>15.6E} {:>15.6E} {:>15.6E} {:>15.6E}\n",
                0.1 * u,
                -0.2 * u,
                0.3 * u,
                1.0 + u
            )
        })
        .collect();
    format!(
        "********************************************************************************\n\
         Field Output Report, written Tue Nov 24 10:11:12 2026\n\nSource 1\n---------\n\n   ODB: C:/temp/run.odb\n   Step: {step}\n   \
         Frame: Increment {increment:>6}: Step Time = {time:>8.4}\n\nLoc 1 : Nodal values from source 1\n\nOutput sorted by column \
         \"Node Label\".\n\nField Output reported at nodes for part: PART-1-1\n\n            Node            U.U1            U.U2            \
         U.U3         S.Mises\n           Label          @Loc 1          @Loc 1          @Loc 1          @Loc 1\n\
         -------------------------------------------------------------------------------\n{rows}\n\n  Minimum          0.             \
         -1.              0.              1.\n      At Node              11              14              11              11\n\n  \
         Total            1.              2.              3.              4.\n\n\n"
    )
}

fn job(dir: &Path) -> std::path::PathBuf {
    fs::write(dir.join("run.inp"), INP).unwrap();
    dir.join("run.inp")
}

#[test]
fn a_field_report_gives_the_states_of_its_frames() {
    let dir = tempfile::tempdir().unwrap();
    let inp = job(dir.path());
    let text =
        report("Step-1", 5, 0.5, 1.0) + &report("Step-1", 9, 1.0, 2.0) + &report("Step-2", 1, 0.25, 3.0);
    fs::write(dir.path().join("run.rpt"), &text).unwrap();
    let run = results::read(&inp).unwrap();
    let steps: Vec<_> = run.steps.iter().map(|step| (step.name.as_str(), step.time)).collect();
    let expected = [("step 1 substep 5", 0.5), ("step 1 substep 9", 1.0), ("step 2 substep 1", 0.25)];
    assert_eq!(steps, expected.map(|(name, time)| (name, Some(time))));
    assert_eq!(quantity(&run, 1, "U").components, ["U1", "U2", "U3"]);
    let last = &quantity(&run, 1, "U").values[9..];
    assert!(last.iter().zip([0.6, -1.2, 1.8]).all(|(a, b)| (a - b).abs() < 1e-9), "{last:?}");
    assert_eq!(quantity(&run, 2, "Mises").values, [1.0, 4.0, 7.0, 10.0]);

    let refused = |text: String| -> String {
        let found = parse_rpt(&text, &[11, 12, 13, 14]).unwrap_err();
        found.iter().map(|diagnostic| format!("{diagnostic}\n")).collect()
    };
    let line = text.lines().position(|line| line.trim().starts_with("14 ")).unwrap() + 1;
    let found = refused(text.replacen("              14 ", "              15 ", 1));
    assert!(found.contains(&format!("line {line}: expected a node of the mesh, found 15")), "{found}");
    let found = refused(text.replacen("              14 ", "              13 ", 1));
    assert!(found.contains("every node once: Unique Nodal values of one part"), "{found}");
    assert!(refused("nothing".into()).contains("a report of Unique Nodal values"));
}

#[test]
fn arrays_of_fields_beside_a_mesh_are_in_the_order_of_its_nodes_and_two_files_are_one_too_many() {
    let dir = tempfile::tempdir().unwrap();
    let inp = job(dir.path());
    let missing = results::read(&inp).unwrap_err().to_string();
    assert!(missing.contains(".csv (a table), .rpt (a field report) or .npz (arrays)"), "{missing}");
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
    assert!(found.contains("job.dat: line 8: expected three numbers"), "{found}");
    // The job was killed while it printed.
    assert_eq!(parse_dat(&text[..text.find("-3.000000E-01").unwrap()]).unwrap().len(), 1);
}
