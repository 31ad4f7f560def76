//! The VTU reader on every encoding VTK writes, and on damaged files.

use flate2::{Compression, write::ZlibEncoder};
use formats::vtu;
use proptest::prelude::*;
use std::io::Write;
use std::path::Path;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    Ascii,
    Inline,
    AppendedBase64,
    AppendedRaw,
}

#[derive(Clone, Copy, Debug)]
struct Style {
    place: Place,
    zlib: bool,
    long_header: bool,
    big_endian: bool,
}

/// One tetrahedron with its mid-sides, written in the given style by code independent of the reader.
fn one_tet(style: Style) -> Vec<u8> {
    let points: Vec<f64> = (0..30).map(|i| f64::from(i) * 0.25 - 1.0).collect();
    let order = |mut bytes: Vec<u8>| {
        if style.big_endian {
            bytes.reverse();
        }
        bytes
    };
    let arrays: [(&str, &str, Vec<u8>, String); 4] = [
        (
            "Points",
            "Float64",
            points.iter().flat_map(|v| order(v.to_le_bytes().to_vec())).collect(),
            text(&points),
        ),
        (
            "connectivity",
            "Int32",
            (0..10_i32).flat_map(|v| order(v.to_le_bytes().to_vec())).collect(),
            text(0..10),
        ),
        ("offsets", "Int64", order(10_i64.to_le_bytes().to_vec()), "10".into()),
        ("types", "UInt8", vec![24], "24".into()),
    ];
    let mut body = Vec::new();
    let mut appended = Vec::new();
    for (i, (name, kind, bytes, ascii)) in arrays.iter().enumerate() {
        if i == 0 {
            body.extend(b"<Points>");
        } else if i == 1 {
            body.extend(b"<Cells>");
        }
        let open = format!("<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"1\"");
        match style.place {
            Place::Ascii => body.extend(format!("{open} format=\"ascii\">\n{ascii}\n</DataArray>").bytes()),
            Place::Inline => {
                body.extend(
                    format!("{open} format=\"binary\">\n {}\n</DataArray>", base64(bytes, style)).bytes(),
                );
            }
            Place::AppendedBase64 | Place::AppendedRaw => {
                body.extend(format!("{open} format=\"appended\" offset=\"{}\"/>", appended.len()).bytes());
                if style.place == Place::AppendedRaw {
                    let (head, data) = block(bytes, style);
                    appended.extend([head, data].concat());
                } else {
                    appended.extend(base64(bytes, style).bytes());
                }
            }
        }
        if i == 0 {
            body.extend(b"</Points>");
        } else if i == 3 {
            body.extend(b"</Cells>");
        }
    }
    let mut file = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" byte_order=\"{}\"{}{}><UnstructuredGrid><Piece NumberOfPoints=\"10\" NumberOfCells=\"1\">",
        if style.big_endian { "BigEndian" } else { "LittleEndian" },
        if style.long_header { " header_type=\"UInt64\"" } else { "" },
        if style.zlib { " compressor=\"vtkZLibDataCompressor\"" } else { "" },
    )
    .into_bytes();
    file.extend(body);
    file.extend(b"</Piece></UnstructuredGrid>");
    if !appended.is_empty() {
        let encoding = if style.place == Place::AppendedRaw { "raw" } else { "base64" };
        file.extend(format!("<AppendedData encoding=\"{encoding}\">\n _").bytes());
        file.extend(appended);
        file.extend(b"</AppendedData>");
    }
    file.extend(b"</VTKFile>");
    file
}

fn text<T: ToString>(values: impl IntoIterator<Item = T>) -> String {
    values.into_iter().map(|v| v.to_string()).collect::<Vec<_>>().join(" ")
}

/// Length header and data, the latter in zlib blocks of 64 bytes where asked for.
fn block(bytes: &[u8], style: Style) -> (Vec<u8>, Vec<u8>) {
    let length = |n: usize| {
        let mut word =
            if style.long_header { n.to_le_bytes().to_vec() } else { (n as u32).to_le_bytes().to_vec() };
        if style.big_endian {
            word.reverse();
        }
        word
    };
    if !style.zlib {
        return (length(bytes.len()), bytes.to_vec());
    }
    let blocks: Vec<Vec<u8>> = bytes
        .chunks(64)
        .map(|chunk| {
            let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
            encoder.write_all(chunk).unwrap();
            encoder.finish().unwrap()
        })
        .collect();
    let mut head = [length(blocks.len()), length(64), length(bytes.len() % 64)].concat();
    blocks.iter().for_each(|b| head.extend(length(b.len())));
    (head, blocks.concat())
}

/// Compressed data and their header are two base64 streams, plain data and theirs are one, as VTK has it.
fn base64(bytes: &[u8], style: Style) -> String {
    let (head, data) = block(bytes, style);
    if style.zlib { encode(&head) + &encode(&data) } else { encode(&[head, data].concat()) }
}

fn encode(bytes: &[u8]) -> String {
    let table: Vec<char> = ('A'..='Z').chain('a'..='z').chain('0'..='9').chain(['+', '/']).collect();
    let mut out = String::new();
    for chunk in bytes.chunks(3) {
        let bits: String = chunk.iter().map(|b| format!("{b:08b}")).collect();
        let padded = format!("{bits:0<width$}", width = bits.len().div_ceil(6) * 6);
        for digit in padded.as_bytes().chunks(6) {
            let value = usize::from_str_radix(std::str::from_utf8(digit).unwrap(), 2).unwrap();
            out.push(table[value]);
        }
        out.push_str(&"=".repeat(3 - chunk.len()));
    }
    out
}

fn styles() -> Vec<Style> {
    let mut styles = Vec::new();
    for place in [Place::Ascii, Place::Inline, Place::AppendedBase64, Place::AppendedRaw] {
        for bits in 0..8 {
            let (zlib, long_header, big_endian) = (bits & 1 > 0, bits & 2 > 0, bits & 4 > 0);
            styles.push(Style { place, zlib, long_header, big_endian });
        }
    }
    styles
}

#[test]
fn every_encoding_gives_the_same_mesh() {
    for style in styles() {
        let mesh = vtu::parse(&one_tet(style)).unwrap_or_else(|e| panic!("{style:?}: {e:?}"));
        assert_eq!(mesh.tets, [[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]], "{style:?}");
        assert_eq!(mesh.points_mm.len(), 10, "{style:?}");
        assert_eq!(mesh.points_mm[9], [5.75, 6.0, 6.25], "{style:?}");
    }
}

#[test]
fn errors_contain_place_found_and_expected() {
    let good = String::from_utf8(one_tet(styles()[0])).unwrap();
    let cases = [
        (good.replace("UnstructuredGrid", "PolyData"), "VTKFile type"),
        (
            good.replace("byte_order", "compressor=\"vtkLZ4DataCompressor\" byte_order"),
            "vtkLZ4DataCompressor",
        ),
        (good.replace(">\n24\n<", ">\n12\n<"), "type 12 with 10 nodes"),
        (good.replace(">\n24\n<", ">\n21\n<"), "no solids"),
        (good.replace("0 1 2 3 4 5 6 7 8 9", "0 1 2 3 4 5 6 7 8 10"), "nodes 0 .. 10"),
        (good.replace("0 1 2 3 4 5 6 7 8 9", "0 1 2 3 4 5 6 7 8"), "9 numbers"),
        (good.replace("-0.75", "nan"), "node 0"),
        (good.replace("NumberOfCells=\"1\"", "NumberOfCells=\"-1\""), "NumberOfCells"),
        (good.replace("Name=\"types\"", "Name=\"kinds\""), "DataArray types"),
        (good.replace("\n10\n", "\n1e300\n"), "offsets"),
        ("<html></html>".into(), "root element"),
        (String::new(), "root element"),
    ];
    for (file, word) in cases {
        let problems = vtu::parse(file.as_bytes()).unwrap_err();
        assert!(problems.iter().any(|p| p.to_string().contains(word)), "{word}: {problems:?}");
    }
}

#[test]
fn a_small_file_that_announces_a_huge_array_is_refused() {
    for style in styles().into_iter().filter(|s| s.place != Place::AppendedRaw) {
        let file = String::from_utf8(one_tet(style)).unwrap();
        let file = file.replace("NumberOfPoints=\"10\"", "NumberOfPoints=\"4000000000\"");
        let problems = vtu::parse(file.as_bytes()).unwrap_err();
        assert!(problems[0].to_string().contains("Points"), "{style:?}: {problems:?}");
    }
}

#[test]
fn the_database_mesh_is_read() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/pneunet/database/mesh.vtu"));
    let mesh = vtu::read(path).unwrap();
    assert_eq!((mesh.points_mm.len(), mesh.tets.len()), (25_022, 13_855));
    let longest = mesh.points_mm.iter().map(|p| p[0]).fold(0.0, f64::max);
    assert!((longest - 115.0).abs() < 1e-3, "{longest}");
}

proptest! {
    #[test]
    fn damage_never_panics(style in 0..32_usize, cut in 0..4000_usize, flips in prop::collection::vec((0..4000_usize, 0..8), 0..6)) {
        let mut file = one_tet(styles()[style]);
        for (at, bit) in flips {
            let at = at % file.len();
            file[at] ^= 1_u8 << bit;
        }
        file.truncate(cut.max(1));
        if let Ok(mesh) = vtu::parse(&file) {
            let nodes = mesh.points_mm.len() as u32;
            prop_assert!(mesh.tets.iter().flatten().all(|n| *n < nodes));
        }
    }

    #[test]
    fn noise_is_refused(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        prop_assert!(vtu::parse(&bytes).is_err());
    }
}

/// Two tetrahedra with a common face in two groups, a triangle of each on the outside in further ones.
#[test]
fn groups_of_cells_name_volumes_and_surfaces_by_their_numbers() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
    let mut points: Vec<[f64; 3]> = corners.to_vec();
    let mut cell = |of: &[usize], edges: &[[usize; 2]]| -> Vec<usize> {
        let middles: Vec<usize> = edges
            .iter()
            .map(|[a, b]| {
                let at = [0, 1, 2].map(|k| 0.5 * (corners[of[*a]][k] + corners[of[*b]][k]));
                let known = points.iter().position(|p| *p == at);
                known.unwrap_or_else(|| {
                    points.push(at);
                    points.len() - 1
                })
            })
            .collect();
        [of, &middles].concat()
    };
    let edges = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];
    let cells = [
        cell(&[0, 1, 2, 3], &edges),
        cell(&[0, 2, 1, 4], &edges),
        cell(&[1, 2, 3], &edges[..3]),
        cell(&[0, 1, 4], &edges[..3]),
    ];
    let file = |name: &str, groups: &str, more: &str| {
        let offsets = cells.iter().scan(0, |sum, cell| {
            *sum += cell.len();
            Some(*sum)
        });
        format!(
            "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid><Piece NumberOfPoints=\"{}\" NumberOfCells=\"4\">\
             <Points><DataArray type=\"Float64\" NumberOfComponents=\"3\">{}</DataArray></Points><Cells>\
             <DataArray type=\"Int64\" Name=\"connectivity\">{}</DataArray><DataArray type=\"Int64\" Name=\"offsets\">{}</DataArray>\
             <DataArray type=\"UInt8\" Name=\"types\">24 24 22 22</DataArray></Cells><CellData>\
             <DataArray type=\"Int32\" Name=\"{name}\">{groups}</DataArray>{more}</CellData></Piece></UnstructuredGrid></VTKFile>",
            points.len(),
            text(points.iter().flatten()),
            text(cells.iter().flatten()),
            text(offsets),
        )
    };
    let other = "<DataArray type=\"Int32\" Name=\"other\">9 9 9 9</DataArray>";
    for (name, more) in [("group", other), ("gmsh:physical", other), ("body", "")] {
        let mesh = vtu::parse(file(name, "7 2 30 4", more).as_bytes()).unwrap();
        let volumes: Vec<(&str, &[u32])> =
            mesh.volumes.iter().map(|(k, v)| (k.as_str(), v.as_slice())).collect();
        assert_eq!(volumes, [("2", &[1][..]), ("7", &[0])], "{name}");
        let corners = |name: &str| mesh.surfaces[name].iter().map(|t| [t[0], t[1], t[2]]).collect::<Vec<_>>();
        assert_eq!(
            (mesh.surfaces.len(), corners("30"), corners("4")),
            (2, vec![[1, 2, 3]], vec![[0, 1, 4]]),
            "{name}"
        );
    }
    // Two arrays of other names: which of them groups is not known.
    let mesh = vtu::parse(file("body", "7 2 30 4", other).as_bytes()).unwrap();
    assert!(mesh.volumes.is_empty() && mesh.surfaces.is_empty());
    let short = vtu::parse(file("group", "7 2 30", "").as_bytes()).unwrap_err();
    assert!(short[0].to_string().contains("4 numbers"), "{short:?}");
}
