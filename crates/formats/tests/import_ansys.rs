//! The snapshot exchange of static reduced-order models, as folders that a test writes.

use formats::database::{self, ObstacleKind};
use std::fs;
use std::path::Path;

fn binary(values: &[f64]) -> Vec<u8> {
    let count = (values.len() as u64).to_le_bytes();
    count.into_iter().chain(values.iter().flat_map(|v| v.to_le_bytes())).collect()
}

const DEFORMATION: &str =
    r#"{"name":"displacement","unit":"m","deformation":true,"dimensionality":[3],"ids":[1,-1,4]}"#;
const STRESS: &str = r#"{"name":"stress","unit":"Pa","deformation":false,"dimensionality":[1]}"#;
const DOE: &str =
    "displacement,pressure[kPa],gap[mm],contact_force[N],split\nfile0.bin,10,,,\nfile1.bin,50,40,0.25,test\n";

/// Four nodes of a metre's thousandths; state k moves all by (0, -k, 0) mm and stresses node n with n + k MPa.
fn write(dir: &Path) {
    let points: Vec<f64> = (0..12).map(|k| f64::from(k) * 1e-3).collect();
    for (name, settings, width) in [("displacement", DEFORMATION, 3), ("stress", STRESS, 1)] {
        let folder = dir.join(name);
        fs::create_dir_all(folder.join("snapshots")).unwrap();
        fs::write(folder.join("settings.json"), settings).unwrap();
        fs::write(folder.join("points.bin"), binary(&points)).unwrap();
        fs::write(folder.join("doe.csv"), DOE.replace("displacement", name)).unwrap();
        for state in 0..2 {
            let value = |k: usize| match width {
                3 if k % 3 == 1 => -1e-3 * state as f64,
                3 => 0.0,
                _ => (k + state) as f64 * 1e6,
            };
            let values: Vec<f64> = (0..4 * width).map(value).collect();
            fs::write(folder.join(format!("snapshots/file{state}.bin")), binary(&values)).unwrap();
        }
    }
}

fn refused(change: impl Fn(&Path)) -> String {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path());
    change(dir.path());
    database::read(dir.path(), ObstacleKind::Plate).expect_err("refused").to_string()
}

#[test]
fn units_become_mm_and_mpa_and_rows_become_cases() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path());
    let read = database::read(dir.path(), ObstacleKind::Plate).unwrap();
    assert_eq!((read.node_count, read.fields.len(), read.cases.len()), (4, 5, 2));
    let [free, contact] = read.cases.as_slice() else { panic!("two cases") };
    assert_eq!((free.pressure_mpa, free.gap_mm, free.regime.name()), (0.01, None, "free"));
    assert_eq!((contact.pressure_mpa, contact.gap_mm, contact.contact_force_n), (0.05, Some(40.0), 0.25));
    assert_eq!(contact.split, rom::snapshots::Split::Test);
    let close = |a: f32, b: f32| (a - b).abs() < 1e-5;
    for (node, row) in read.snapshot(1).chunks_exact(5).enumerate() {
        let [x, y, z] = [0, 1, 2].map(|k| (3 * node + k) as f32);
        let expected = [x, y - 1.0, z, 1.0, node as f32 + 1.0];
        assert!(row.iter().zip(expected).all(|(a, b)| close(*a, b)), "node {node}: {row:?}");
    }
    assert_eq!(read.undeformed_mm.unwrap()[1], [3.0, 4.0, 5.0]);
}

#[test]
fn what_does_not_fit_is_said_with_its_place() {
    let stress = |dir: &Path| dir.join("stress");
    let settings =
        |text: &'static str| move |dir: &Path| fs::write(dir.join("stress/settings.json"), text).unwrap();
    assert!(
        refused(settings(r#"{"name":"heat","unit":"W","dimensionality":[2]}"#)).contains("`heat` of [2]")
    );
    assert!(refused(settings(r#"{"name":"s","unit":"bananas","dimensionality":[1]}"#)).contains("`bananas`"));
    assert!(
        refused(settings(r#"{"name":"s","unit":"Pa","unitFactor":2.0,"dimensionality":[1]}"#))
            .contains("unitFactor")
    );
    assert!(
        refused(|dir| fs::write(stress(dir).join("snapshots/file1.bin"), binary(&[1.0; 3])).unwrap())
            .contains("4 (nodes")
    );
    assert!(
        refused(|dir| fs::remove_file(stress(dir).join("snapshots/file0.bin")).unwrap())
            .contains("file0.bin")
    );
    let doe =
        |text: &'static str| move |dir: &Path| fs::write(dir.join("displacement/doe.csv"), text).unwrap();
    assert!(refused(doe("displacement,flow[l/min]\nfile0.bin,1\n")).contains("`flow[l/min]`"));
    assert!(refused(doe("displacement,pressure[kPa]\nfile0.bin,much\n")).contains("line 2"));
    assert!(refused(doe("displacement,pressure[kPa]\n../../x.bin,1\n")).contains("without folders"));
    assert!(refused(doe("displacement,pressure[kPa]\nfile0.bin,1\n")).contains("the same states"));
    let no_force = |dir: &Path| {
        for name in ["displacement", "stress"] {
            fs::write(dir.join(name).join("doe.csv"), "q,pressure[kPa],gap[mm]\nfile0.bin,1,40\n").unwrap();
        }
    };
    assert!(refused(no_force).contains("contact_force[N]"));
    let twice = |dir: &Path| fs::write(dir.join("stress/settings.json"), DEFORMATION).unwrap();
    assert!(refused(twice).contains("one that deforms the points"));
}
