//! Inputs inside compressed or checksummed archives; compression and checksums are recomputed so that the reader reaches the input.

use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::io::{Cursor, Write};

/// Arrays of a VTU file: name, type, components, and whether they belong to points, nodes or cells.
const HEAD: &str = r#"<VTKFile type="UnstructuredGrid" byte_order="LittleEndian" header_type="UInt32" compressor="vtkZLibDataCompressor"><UnstructuredGrid>
<Piece NumberOfPoints="4" NumberOfCells="1"><Points><DataArray type="Float32" NumberOfComponents="3" format="appended" offset="@0"/></Points>
<Cells><DataArray type="Int32" Name="connectivity" format="appended" offset="@1"/><DataArray type="Int32" Name="offsets" format="appended" offset="@2"/>
<DataArray type="UInt8" Name="types" format="appended" offset="@3"/></Cells><PointData><DataArray type="Float64" Name="u" NumberOfComponents="3"
format="appended" offset="@4"/></PointData></Piece></UnstructuredGrid><AppendedData encoding="raw">_"#;
const TAIL: &[u8] = b"</AppendedData></VTKFile>";
/// Arrays of [`HEAD`].
const ARRAYS: usize = 5;

/// The arrays of a VTU file of one cell, one behind the other, each after its length (two bytes): deflated as VTK does.
pub fn vtu_arrays(bytes: &[u8]) {
    let (mut head, mut data, mut rest) = (HEAD.to_owned(), Vec::new(), bytes);
    for at in 0..ARRAYS {
        let (content, behind) = next_part(rest);
        rest = behind;
        head = head.replace(&format!("@{at}"), &data.len().to_string());
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(content).expect("memory");
        let deflated = encoder.finish().expect("memory");
        for number in [1, content.len(), 0, deflated.len()] {
            data.extend((number as u32).to_le_bytes());
        }
        data.extend(deflated);
    }
    super::vtu(&[head.as_bytes(), &data, TAIL].concat());
}

/// A tetrahedron with a displacement.
pub fn vtu_seed() -> Vec<u8> {
    let points = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let parts = [
        points.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>(),
        [0_i32, 1, 2, 3].iter().flat_map(|node| node.to_le_bytes()).collect(),
        4_i32.to_le_bytes().to_vec(),
        vec![10],
        [0.1_f64; 12].iter().flat_map(|value| value.to_le_bytes()).collect(),
    ];
    parts.iter().flat_map(|part| [&(part.len() as u16).to_le_bytes()[..], part].concat()).collect()
}

/// The next part and what is behind it.
fn next_part(bytes: &[u8]) -> (&[u8], &[u8]) {
    let (length, behind) = bytes.split_at(bytes.len().min(2));
    let wanted = length.iter().rev().fold(0, |sum, byte| sum << 8 | usize::from(*byte));
    behind.split_at(behind.len().min(wanted))
}

/// The arrays of a `.npz` archive, one behind the other as above, with good checksums of the archive.
pub fn npz_arrays(bytes: &[u8]) {
    let mut rest = bytes;
    let arrays = NAMES.map(|name| {
        let (content, behind) = next_part(rest);
        rest = behind;
        (name, content.to_vec())
    });
    super::npz(&archive(&arrays));
}

const NAMES: [&str; 3] = ["points", "tetra", "displacement"];

/// The same archive's arrays, whole.
pub fn npz_seed() -> Vec<u8> {
    let part = |array: Vec<u8>| [&(array.len() as u16).to_le_bytes()[..], &array].concat();
    super::npz_arrays_seed().into_iter().flat_map(part).collect()
}

fn archive(arrays: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in arrays {
        let stored =
            zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
        archive.start_file(format!("{name}.npy"), stored).expect("memory");
        archive.write_all(content).expect("memory");
    }
    archive.finish().expect("memory").into_inner()
}

/// An archive of good arrays.
pub fn good_archive() -> Vec<u8> {
    let arrays: Vec<(&str, Vec<u8>)> = NAMES.into_iter().zip(super::npz_arrays_seed()).collect();
    archive(&arrays)
}
