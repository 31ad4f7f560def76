//! XDMF of other programs. `data/series.xdmf` and `data/gzip.xdmf` were written by meshio 5.3.5, `data/fenics.h5` by h5py as DOLFINx
//! lays its files out: `scripts/checks/xdmf_fixtures.py`.

use crate::common::{at_rest, data, quantity, wanted};
use formats::results::{self, Assembly, Quantity, Run, parse_xdmf};
use proptest::prelude::*;
use std::fs;
use std::path::Path;

fn cells(run: &Run) -> Vec<(u8, usize)> {
    run.blocks.iter().map(|block| (block.kind, block.count())).collect()
}

/// What the script wrote.
fn displacement(nodes: usize, load: f64) -> Vec<f64> {
    (0..nodes).map(|n| n as f64).flat_map(|n| [0.1 * n, -0.05 * n, 0.01 * n * n]).map(|v| load * v).collect()
}

fn close(found: &[f64], expected: &[f64]) -> bool {
    found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12)
}

fn refused(text: &str) -> String {
    let error = parse_xdmf(text, Path::new("run.xdmf")).expect_err("refused").to_string();
    assert!(error.starts_with("run.xdmf: "), "{error}");
    error
}

/// Puts a state of a run into a database.
fn assembled(run: &Run, step: usize) -> Result<Vec<f32>, String> {
    let mut assembly = Assembly::new(wanted());
    assembly
        .add(Path::new("run.xdmf"), run, &run.steps[step], at_rest("a"))
        .map_err(|error| error.to_string())?;
    let (database, _) =
        assembly.finish("part".into(), vec![]).map_err(|diagnostic| diagnostic.to_string())?;
    Ok(database.snapshot(0).to_vec())
}

#[test]
fn a_series_of_meshio_with_mixed_cells() {
    let run = results::read(&data("series.xdmf")).unwrap();
    assert_eq!(cells(&run), [(12, 1), (10, 2)]);
    assert_eq!(run.points[8], [0.5, 0.5, 2.0]);
    assert_eq!(run.steps.iter().map(|step| step.time).collect::<Vec<_>>(), [Some(0.5), Some(1.0)]);
    for (step, load) in [(0, 0.5), (1, 1.0)] {
        assert!(close(&quantity(&run, step, "u").values, &displacement(9, load)));
        assert_eq!(quantity(&run, step, "stress").components.len(), 9);
        let snapshot = assembled(&run, step).unwrap();
        let von_mises: Vec<f32> = snapshot.chunks_exact(5).map(|node| node[4]).collect();
        let expected: Vec<f32> = (0..9).map(|node| load as f32 * node as f32).collect();
        assert_eq!(von_mises, expected);
        assert!((snapshot[5 * 8] - (0.5 + 0.8 * load as f32)).abs() < 1e-6, "x of the last node");
    }
}

#[test]
fn a_compressed_grid_of_meshio() {
    let run = results::read(&data("gzip.xdmf")).unwrap();
    assert_eq!(cells(&run), [(24, 1)]);
    assert_eq!((run.points.len(), run.steps.len(), run.steps[0].time), (10, 1, None));
    assert!(close(&quantity(&run, 0, "displacement").values, &displacement(10, 2.0)));
    assert_eq!(quantity(&run, 0, "von_mises").values[9], 18.0);
}

/// One collection a function, chunks that the last one overhangs, shuffled, the layout of newer HDF5.
#[test]
fn functions_in_collections_of_their_own_are_one_series() {
    let run = results::read(&data("fenics.xdmf")).unwrap();
    assert_eq!(cells(&run), [(12, 1)]);
    assert_eq!(run.steps.iter().map(|step| step.time).collect::<Vec<_>>(), [Some(0.5), Some(1.0)]);
    assert!(close(&quantity(&run, 1, "u").values, &displacement(8, 1.0)));
    assert_eq!(quantity(&run, 1, "stress").values[9 * 7], 7.0);
    let text = fs::read_to_string(data("fenics.xdmf")).unwrap();
    let path = data("fenics.xdmf");
    let other = text.replacen("<Time Value=\"1.0\" />", "<Time Value=\"2.0\" />", 1);
    let error = parse_xdmf(&other, &path).unwrap_err().to_string();
    assert!(error.contains("Grid stress, step 2: expected the time of the first collection"), "{error}");
    let last = text.rfind("<Grid Name=\"stress\" GridType=\"Uniform\">").unwrap();
    let end = last + text[last..].find("</Grid>").unwrap() + "</Grid>".len();
    let error = parse_xdmf(&[&text[..last], &text[end..]].concat(), &path).unwrap_err().to_string();
    assert!(error.contains("Grid stress: expected 2 grids, as in the first collection, found 1"), "{error}");
}

const POINTS: &str = "0 0 0 1 0 0 0 1 0 0 0 1";

fn grid(inner: &str) -> String {
    format!(
        "<Xdmf Version=\"3.0\"><Domain><Grid Name=\"a\">\
         <Geometry GeometryType=\"XYZ\"><DataItem Dimensions=\"4 3\" Format=\"XML\">{POINTS}</DataItem></Geometry>\
         <Topology TopologyType=\"Tetrahedron\"><DataItem Dimensions=\"1 4\" NumberType=\"Int\" Format=\"XML\">0 1 2 3</DataItem>\
         </Topology>{inner}</Grid></Domain></Xdmf>"
    )
}

fn attribute(name: &str, kind: &str, dimensions: &str, values: &str) -> String {
    format!(
        "<Attribute Name=\"{name}\" AttributeType=\"{kind}\" Center=\"Node\"><DataItem Dimensions=\"{dimensions}\" \
         Format=\"XML\">{values}</DataItem></Attribute>"
    )
}

#[test]
fn numbers_in_the_text_and_in_binary_files() {
    let dir = tempfile::tempdir().unwrap();
    let values: Vec<f64> = (0..12).map(f64::from).collect();
    let big: Vec<u8> = values.iter().flat_map(|value| (*value as f32).to_be_bytes()).collect();
    fs::write(dir.path().join("u.bin"), [&[0; 7][..], &big].concat()).unwrap();
    let little: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    fs::write(dir.path().join("v.bin"), little).unwrap();
    let binary = |name: &str, options: &str, file: &str| {
        format!(
            "<Attribute Name=\"{name}\"><DataItem Dimensions=\"4 3\" Format=\"Binary\" {options}>{file}</DataItem></Attribute>"
        )
    };
    let items = [
        attribute("s", "Scalar", "4", "1 2.5 -3e1 4"),
        binary("u", "Endian=\"Big\" Seek=\"7\"", "u.bin"),
        binary("v", "DataType=\"Float\" Precision=\"8\"", " v.bin "),
        "<Attribute Name=\"w\"><DataItem Reference=\"XML\"> /Xdmf/Domain/Grid/Attribute[@Name=\"v\"]/DataItem \
         </DataItem></Attribute>"
            .to_owned(),
        "<Attribute Name=\"e\" Center=\"Cell\"><DataItem Dimensions=\"1\" Format=\"XML\">1</DataItem></Attribute>"
            .to_owned(),
    ];
    let path = dir.path().join("run.xmf");
    fs::write(&path, grid(&items.concat())).unwrap();
    let run = results::read(&path).unwrap();
    assert_eq!(quantity(&run, 0, "s").values, [1.0, 2.5, -30.0, 4.0]);
    assert!(["u", "v", "w"].iter().all(|name| quantity(&run, 0, name).values == values));
    assert_eq!(run.steps[0].quantities.len(), 4, "values of cells are passed over");
    fs::write(dir.path().join("v.bin"), [0; 95]).unwrap();
    let error = results::read(&path).unwrap_err().to_string();
    assert!(
        error.contains("v.bin: data: expected 12 numbers of 8 bytes from byte 0, found 95 bytes"),
        "{error}"
    );
}

#[test]
fn cells_of_all_kinds() {
    let mesh = |name: &str, nodes: usize, numbers: &str, count: usize| {
        let points: String = (0..nodes).map(|n| format!("{n} 0 0 ")).collect();
        let text = format!(
            "<Xdmf Version=\"3.0\"><Domain><Grid><Geometry><DataItem Dimensions=\"{nodes} 3\" Format=\"XML\">{points}</DataItem>\
             </Geometry><Topology Type=\"{name}\"><DataItem Dimensions=\"{count}\" Format=\"XML\">{numbers}</DataItem></Topology>\
             </Grid></Domain></Xdmf>"
        );
        parse_xdmf(&text, Path::new("run.xdmf"))
    };
    let kinds = [
        ("Tetrahedron", 4, 10, 4),
        ("Tetrahedron_10", 10, 24, 10),
        ("Hexahedron", 8, 12, 8),
        ("Hex_20", 20, 25, 20),
        ("HEXAHEDRON_27", 27, 25, 20),
        ("Wedge", 6, 13, 6),
        ("Wedge_15", 15, 26, 15),
    ];
    for (name, nodes, kind, kept) in kinds {
        let numbers: String = (0..nodes).map(|n| format!("{n} ")).collect();
        let run = mesh(name, nodes, &numbers, nodes).unwrap();
        assert_eq!(cells(&run), [(kind, 1)], "{name}");
        assert_eq!(run.blocks[0].nodes, (0..kept).collect::<Vec<u32>>());
    }
    // A point and two lines, one of them quadratic, between the solids.
    let run = mesh("Mixed", 6, "6 0 1 2 3 1 1 0 2 2 0 1 34 0 1 2 8 0 1 2 3 4 5 6 1 2 3 4", 28).unwrap();
    assert_eq!(cells(&run), [(10, 2), (13, 1)]);
    let error = |name: &str, numbers: &str, count| mesh(name, 6, numbers, count).unwrap_err().to_string();
    assert!(error("Pyramid", "0 1 2 3 4", 5).contains("found `Pyramid`"));
    assert!(error("Mixed", "7 0 1 2 3 4", 6).contains("cell 0: expected tetrahedra"));
    assert!(error("Mixed", "6 0 1 2 3 9 0 1", 8).contains("cell 1: expected all its nodes"));
    assert!(error("Tetrahedron", "0 1 2 6", 4).contains("cell 0: expected nodes 0 to 5, found 6"));
    assert!(error("Tetrahedron", "0 1 2 3 4", 5).contains("cells of 4 nodes, found 5 numbers"));
}

#[test]
fn times_of_a_list() {
    let single = grid(&attribute("u", "Scalar", "4", "0 0 0 0"));
    let inner = &single[single.find("<Grid").unwrap()..single.find("</Domain>").unwrap()];
    let series = |time: &str| {
        format!(
            "<Xdmf><Domain><Grid GridType=\"Collection\" CollectionType=\"Temporal\">{time}{inner}{inner}</Grid></Domain></Xdmf>"
        )
    };
    let times = |kind: &str, count: usize, values: &str| {
        let time = format!(
            "<Time TimeType=\"{kind}\"><DataItem Dimensions=\"{count}\" Format=\"XML\">{values}</DataItem></Time>"
        );
        let run = parse_xdmf(&series(&time), Path::new("run.xdmf")).unwrap();
        run.steps.iter().map(|step| step.time.unwrap()).collect::<Vec<_>>()
    };
    assert_eq!(times("List", 2, "0.25 1"), [0.25, 1.0]);
    assert_eq!(times("HyperSlab", 3, "1 0.5 2"), [1.0, 1.5]);
    let moved = series("").replacen(POINTS, "0 0 0 2 0 0 0 1 0 0 0 1", 1);
    assert!(
        refused(&moved).contains("step 2: expected the undeformed mesh of the first grid"),
        "{}",
        refused(&moved)
    );
}

#[test]
fn what_is_no_series_of_states_is_refused_by_name() {
    let good = grid(&attribute("u", "Vector", "4 3", POINTS));
    assert!(parse_xdmf(&good, Path::new("run.xdmf")).is_ok());
    let says = |text: &str, part: &str| assert!(refused(text).contains(part), "{}", refused(text));
    says(&good[..good.len() - 7], "the end of Xdmf (a file that is cut short");
    says("<VTKFile/>", "root element: expected Xdmf");
    says("no XML at all", "root element: expected Xdmf");
    says("<Xdmf><Domain/></Xdmf>", "Domain: expected a Grid, found none");
    says(&good.replace("<Grid", "<Grid GridType=\"Collection\" CollectionType=\"Spatial\""), "Merge Blocks");
    says(&good.replace("4 3", "5 3"), "Geometry: expected 15 numbers, found `12 numbers`");
    says(
        &good.replace("Dimensions=\"4 3\"", "Dimensions=\"4 x\""),
        "expected Dimensions, such as 8 3, found `4 x`",
    );
    let huge = good.replace("Dimensions=\"4 3\"", "Dimensions=\"9223372036854775808 3\"");
    says(&huge, "expected Dimensions, such as 8 3, found `9223372036854775808 3`");
    says(
        &good.replace("Dimensions=\"4 3\"", "Dimensions=\"99999999999\""),
        "which is what the files can hold",
    );
    says(
        &grid(&attribute("u", "Vector", "5", "1 2 3 4 5")),
        "step 1, Attribute u: expected values at 4 nodes",
    );
    says(
        &good.replace("<Attribute", "<Attribute ItemType=\"FiniteElementFunction\""),
        "in place of write_checkpoint",
    );
    says(&good.replace("XYZ", "VXVYVZ"), "expected GeometryType XYZ or XY, found `VXVYVZ`");
    says(
        &good.replace("<Topology", "<Topology Reference=\"/Xdmf/Nowhere\""),
        "/Xdmf/Nowhere, which names none",
    );
    says(
        &good.replace("<DataItem", "<DataItem ItemType=\"HyperSlab\""),
        "ItemType Uniform), found `HyperSlab`",
    );
    says(
        &grid("<Attribute Name=\"u\" Reference=\"/Xdmf/Domain/Grid/Attribute\"/>"),
        "references that lead nowhere",
    );
    let missing = good.replacen("Format=\"XML\">0 0 0", "Format=\"HDF\">no.h5:/u", 1);
    assert!(
        parse_xdmf(&missing, Path::new("run.xdmf")).unwrap_err().to_string().contains("cannot read no.h5")
    );
    let tensor = "1 2 3 4 5 6 ".repeat(4);
    let tensor = attribute("S", "Tensor6", "4 6", &tensor);
    let run =
        parse_xdmf(&grid(&[attribute("u", "Vector", "4 3", POINTS), tensor].concat()), Path::new("run.xdmf"));
    let error = assembled(&run.unwrap(), 0).unwrap_err();
    assert!(
        error.contains("quantity S: expected the von Mises stress or a tensor of 9 components"),
        "{error}"
    );
}

/// A short text that names one item many times over, and elements that refer to all others.
#[test]
fn references_do_not_multiply_what_is_read() {
    let again = "<Attribute Name=\"v\"><DataItem Reference=\"/Xdmf//Attribute[1]/DataItem\"/></Attribute>";
    let long = attribute("u", "Scalar", "40000", &"1 ".repeat(40_000));
    says_too_many(&grid(&[long, again.repeat(40)].concat()));
    let deep = format!("<Grid><include xpointer=\"{}Grid\"/></Grid>", "//*/".repeat(20));
    let text = format!(
        "<Xdmf><Domain><Grid CollectionType=\"Temporal\" GridType=\"Collection\">{}</Grid></Domain></Xdmf>",
        deep.repeat(400)
    );
    assert!(refused(&text).contains("expected a path such as"), "{}", refused(&text));
}

fn says_too_many(text: &str) {
    assert!(refused(text).contains("more numbers, which is what the files can hold"), "{}", refused(text));
}

fn with_h5(name: &str, bytes: &[u8]) -> Result<Run, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    fs::copy(data(name), &path).unwrap();
    fs::write(path.with_extension("h5"), bytes).unwrap();
    results::read(&path).map_err(|error| error.to_string())
}

#[test]
fn damaged_hdf5_is_refused_with_its_name() {
    for name in ["series.xdmf", "gzip.xdmf", "fenics.xdmf"] {
        let good = fs::read(data(name).with_extension("h5")).unwrap();
        assert!(with_h5(name, &good).is_ok());
        for share in 0..8 {
            let error = with_h5(name, &good[..good.len() * share / 8]).unwrap_err();
            assert!(error.contains(".h5: file: expected "), "{error}");
        }
        assert!(with_h5(name, b"<Xdmf/>").unwrap_err().contains("expected HDF5"));
    }
}

/// A data set that says it has more numbers than its file can hold is refused before memory is asked for.
#[test]
fn counts_beyond_the_file_are_refused() {
    let mut file = fs::read(data("gzip.h5")).unwrap();
    let words = |values: [u64; 2]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let rows = 1_u64 << 36;
    let (old, new) = (words([10, 3]), words([rows, 3]));
    let places: Vec<usize> = (0..file.len() - 16).filter(|at| file[*at..at + 16] == old).collect();
    assert!(!places.is_empty());
    places.iter().for_each(|at| file[*at..at + 16].copy_from_slice(&new));
    let error = with_h5("gzip.xdmf", &file).unwrap_err();
    assert!(error.contains("expected 30 numbers, as Geometry says"), "{error}");
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("gzip.h5"), file).unwrap();
    let text = fs::read_to_string(data("gzip.xdmf")).unwrap().replace("\"10 3\"", &format!("\"{rows} 3\""));
    let error = parse_xdmf(&text, &dir.path().join("run.xdmf")).unwrap_err().to_string();
    assert!(error.contains("which is what the files can hold"), "{error}");
}

proptest! {
    #[test]
    fn damaged_files_are_read_or_refused(at in 0_usize..7000, bytes in prop::collection::vec(any::<u8>(), 0..20)) {
        let damage = |mut file: Vec<u8>| {
            let at = at % file.len();
            file.splice(at..(at + bytes.len()).min(file.len()), bytes.iter().copied());
            file
        };
        let text = damage(fs::read(data("series.xdmf")).unwrap());
        let runs = [
            parse_xdmf(&String::from_utf8_lossy(&text), &data("series.xdmf")).map_err(|error| error.to_string()),
            with_h5("series.xdmf", &damage(fs::read(data("series.h5")).unwrap())),
            with_h5("fenics.xdmf", &damage(fs::read(data("fenics.h5")).unwrap())),
        ];
        for run in runs.iter().flatten() {
            let nodes = run.points.len();
            prop_assert!(run.blocks.iter().all(|block| block.nodes.iter().all(|node| (*node as usize) < nodes)));
            let sized = |q: &Quantity| q.values.len() == nodes * q.components.len();
            prop_assert!(run.steps.iter().all(|step| step.quantities.iter().all(sized)));
        }
    }
}
