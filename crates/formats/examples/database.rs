//! Arrays as a database for training, read back, and one state as a file for ParaView.

use formats::database::{self, ObstacleKind};
use formats::export::{Label, Moment, StateSeries};
use formats::vtu::Cells;
use rom::snapshots::{Case, Database, FieldSpec, Footprint, RegimeKind, Split};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::temp_dir().join("softtwin-example-database");
    let case = |name: &str, pressure_mpa| Case {
        name: name.into(),
        regime: RegimeKind::Free,
        split: Split::Train,
        pressure_mpa,
        gap_mm: None,
        contact_force_n: 0.0,
        parameters: vec![],
    };
    let mut mine = Database {
        actuator: "mine".into(),
        fields: FieldSpec::of_the_paper(), // x, y, z, displacement in mm, von Mises stress in MPa
        node_count: 2,
        cases: vec![case("rest", 0.0), case("inflated", 0.05)],
        // cases x nodes x fields
        snapshots: vec![
            0.0, 0.0, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 0.0, //
            0.0, 0.0, 0.0, 0.0, 0.1, 8.0, 3.0, 0.0, 3.2, 0.2,
        ],
        undeformed_mm: None,
        undeformed_by: Vec::new(),
        surface_triangles: vec![],
        node_sets: vec![],
        obstacle: Footprint::PLATE,
        parameters: vec![],
        sensitivities: None,
        vibrations: vec![],
        hash: [0; 32],
    };
    mine.hash = mine.content_hash();
    database::write(&folder, &mine, Cells::QuadraticTets(&[]))?;
    let read = database::read(&folder, ObstacleKind::Plate)?;
    assert_eq!((read.hash, read.snapshots), (mine.hash, mine.snapshots.clone()));
    let by_field: Vec<f32> = (0..5).flat_map(|field| mine.field(1, field)).collect();
    let series = StateSeries {
        fields: &mine.fields,
        nodes: 2,
        cells: Cells::Triangles(&[]),
        undeformed: None,
        count: 1,
    };
    let state = Moment { time: 0.0, label: Label::default(), values: by_field, moved: None };
    series.write_state(&folder.join("inflated.vtu"), &state)?;
    println!("{}", folder.display());
    Ok(())
}
