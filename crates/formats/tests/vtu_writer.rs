//! `.vtu`: the writer: golden bytes, round trip through the reader, refusals.

use formats::vtu::{Cells, Grid, PointData, read, write};
use std::path::PathBuf;

fn place() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("mesh.vtu");
    (dir, path)
}

fn written() -> (tempfile::TempDir, PathBuf) {
    let (dir, path) = place();
    let (points, tets) = crate::common::bar(2);
    write(&path, &Grid { points_mm: &points, cells: Cells::QuadraticTets(&tets), point_data: &[] }).unwrap();
    (dir, path)
}

#[test]
fn round_trip() {
    let (_dir, path) = written();
    let mesh = read(&path).unwrap();
    let (points, tets) = crate::common::bar(2);
    assert_eq!((mesh.points_mm, mesh.tets), (points, tets));
}

#[test]
fn golden_triangle() {
    let (_dir, path) = place();
    let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let data = [PointData { name: "S [MPa]", components: 1, values: &[1.0, 2.0, 3.0] }];
    write(&path, &Grid { points_mm: &points, cells: Cells::Triangles(&[[0, 1, 2]]), point_data: &data })
        .unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    // 8 bytes of length (12), then 1.0, 2.0, 3.0 as little-endian f32.
    assert!(
        text.contains(
            "\"S [MPa]\" NumberOfComponents=\"1\" format=\"binary\">\nDAAAAAAAAAAAAIA/AAAAQAAAQEA=\n"
        ),
        "{text}"
    );
    assert!(text.contains("NumberOfPoints=\"3\" NumberOfCells=\"1\""));
}

#[test]
fn bad_grids_are_not_written() {
    let (_dir, path) = place();
    let points = [[0.0; 3]; 3];
    let data = [PointData { name: "S", components: 1, values: &[1.0] }];
    let grid = Grid { points_mm: &points, cells: Cells::Triangles(&[[0, 1, 3]]), point_data: &data };
    let error = write(&path, &grid).unwrap_err().to_string();
    assert!(error.contains("cells: "), "{error}");
    assert!(error.contains("point data `S`: "), "{error}");
    assert!(!path.exists());
}
