//! Everything that reads bytes from outside, each as one function from bytes to nothing: no panic, no hang, no large
//! allocation, whatever the bytes. The fuzz targets of `fuzz/` and the property test `inputs` run the same bodies.

pub mod packed;
pub mod wrapped;

use recording::message::{EncodeJson, channel, decode_reading};
use recording::{RecordingReader, Writer};
use rom::rng::Rng;
use runtime::config::{Scene, Settings};
use runtime::source::{
    ByteOrder, Encoding, InputNames, LineBuffer, RegisterAt, SensorTrace, Table, parse_cells,
};
use std::io::Cursor;
use std::path::Path;
use wire::{KeyExpr, Payload, Selector, SensorSample, Topic};

/// One entrance for bytes from outside.
#[derive(Debug, Clone, Copy)]
pub struct Entrance {
    /// Name of the fuzz target and of the folder with its found cases.
    pub name: &'static str,
    /// Takes the bytes.
    pub body: fn(&[u8]),
    /// A good input, to be damaged.
    pub seed: fn() -> Vec<u8>,
}

/// All entrances.
pub const ENTRANCES: [Entrance; 21] = [
    Entrance { name: "model", body: model, seed: || crate::stage::model_bytes().to_vec() },
    Entrance { name: "npy", body: npy, seed: npy_seed },
    Entrance {
        name: "trace",
        body: trace,
        seed: || b"t_s,pressure_mpa,gap_mm\n0,0,40\n0.005,1e-3,40\n".to_vec(),
    },
    Entrance { name: "recording", body: recording, seed: recording_seed },
    Entrance { name: "config", body: config, seed: config_seed },
    Entrance { name: "modbus", body: modbus, seed: || vec![4, 0, 12, 34, 56, 78] },
    Entrance {
        name: "lines",
        body: lines,
        seed: || b"0.03,40\n{\"pressure\": 0.03, \"gap\": 40}\n# note\n".to_vec(),
    },
    Entrance { name: "frd", body: frd, seed: || FRD.to_vec() },
    Entrance { name: "vtu", body: vtu, seed: || VTU.to_vec() },
    Entrance { name: "pvd", body: pvd, seed: || PVD.to_vec() },
    Entrance { name: "inp", body: inp, seed: || INP.to_vec() },
    Entrance { name: "dat", body: dat, seed: || DAT.to_vec() },
    Entrance { name: "msh", body: msh, seed: || MSH.to_vec() },
    Entrance { name: "npz", body: npz, seed: packed::good_archive },
    Entrance { name: "npz_arrays", body: packed::npz_arrays, seed: packed::npz_seed },
    Entrance { name: "vtu_arrays", body: packed::vtu_arrays, seed: packed::vtu_seed },
    Entrance { name: "model_header", body: wrapped::model_header, seed: wrapped::header_seed },
    Entrance { name: "chunk", body: wrapped::chunk, seed: wrapped::chunk_seed },
    Entrance {
        name: "selector",
        body: selector,
        seed: || b"softtwin/finger/pressure?gap_mm=30;force_n=0.3&field=tip".to_vec(),
    },
    Entrance {
        name: "websocket",
        body: websocket,
        seed: || br#"{"type":"predict","model":0,"inputs":{"pressure_mpa":0.05,"gap_mm":30}}"#.to_vec(),
    },
    Entrance { name: "key", body: key, seed: || b"softtwin/*/state\0softtwin/**/field/$*top".to_vec() },
];

/// Largest damaged input, in bytes.
pub const MAX_INPUT: usize = 1 << 20;

/// One to four damages: bits, bytes, cuts, repetitions, numbers at their limits, or noise from the start.
pub fn damage(seed: &[u8], random: &mut Rng) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..1 + random.below(4) {
        let at = random.below(bytes.len().max(1));
        match random.below(8) {
            0 if !bytes.is_empty() => bytes[at] ^= 1 << random.below(8),
            1 if !bytes.is_empty() => bytes[at] = random.next_u64() as u8,
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..(at + random.below(16)).min(bytes.len()))),
            4 => {
                let piece: Vec<u8> = bytes[at..(at + random.below(32)).min(bytes.len())].to_vec();
                let to = random.below(bytes.len() + 1);
                bytes.splice(to..to, piece);
            }
            5 => {
                let value = [u64::MAX, 1 << 63, 1 << 40, 1 << 31, u64::from(u32::MAX), 0][random.below(6)];
                for (offset, byte) in value.to_le_bytes().into_iter().enumerate() {
                    if let Some(place) = bytes.get_mut(at + offset) {
                        *place = byte;
                    }
                }
            }
            6 => bytes.insert(at, random.next_u64() as u8),
            _ => bytes = (0..random.below(300)).map(|_| random.next_u64() as u8).collect(),
        }
    }
    bytes.truncate(MAX_INPUT);
    bytes
}

/// A model file, read whole and read block by block.
pub fn model(bytes: &[u8]) {
    let whole = rom::model::Model::from_bytes(bytes);
    if let Ok(mut reader) = rom::model::ModelReader::open(Cursor::new(bytes)) {
        let entries = reader.blocks().to_vec();
        for entry in &entries {
            // A block that cannot be read means that the whole file could not be either.
            assert!(reader.read_blocks(std::slice::from_ref(entry)).is_ok() || whole.is_err());
        }
    }
}

/// For readers that take files.
fn in_folder(use_it: impl FnOnce(&Path)) {
    thread_local! {
        // In memory where there is such a place: a disk would be most of the time of millions of inputs.
        static FOLDER: tempfile::TempDir = tempfile::tempdir_in("/dev/shm")
            .or_else(|_| tempfile::tempdir())
            .expect("a temporary folder");
    }
    FOLDER.with(|folder| use_it(folder.path()));
}

/// A `.npy` array; the reader takes files.
pub fn npy(bytes: &[u8]) {
    in_folder(|folder| {
        let path = folder.join("input.npy");
        std::fs::write(&path, bytes).expect("writable");
        if let Ok(array) = formats::npy::read_f32(&path) {
            assert!(array.data.len() <= bytes.len(), "more values than bytes");
        }
    });
}

/// A `.npz` archive of results.
pub fn npz(bytes: &[u8]) {
    let Ok(run) = formats::results::parse_npz(bytes) else { return };
    let nodes = run.points.len();
    assert!(run.blocks.iter().flat_map(|block| &block.nodes).all(|node| (*node as usize) < nodes));
}

/// Points, a tetrahedron and its displacement, as `.npy` files.
fn npz_arrays_seed() -> [Vec<u8>; 3] {
    let arrays: [(&[usize], &[f32]); 3] = [
        (&[4, 3], &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        (&[1, 4], &[0.0, 1.0, 2.0, 3.0]),
        (&[1, 4, 3], &[0.1; 12]),
    ];
    arrays.map(|(shape, data)| {
        let mut bytes = Vec::new();
        formats::npy::write_f32_to(&mut bytes, shape, data).expect("memory");
        bytes
    })
}

/// A gmsh mesh.
pub fn msh(bytes: &[u8]) {
    let Ok(mesh) = formats::msh::parse(bytes) else { return };
    assert!(mesh.tets.as_flattened().iter().all(|node| (*node as usize) < mesh.points_mm.len()));
}

/// A question as `softtwin get` and the gateway take it.
pub fn selector(bytes: &[u8]) {
    if let Ok(selector) = Selector::parse(&String::from_utf8_lossy(bytes)) {
        std::hint::black_box(selector.questions("finger"));
    }
}

/// Message from the web viewer to `softtwin view`.
pub fn websocket(bytes: &[u8]) {
    std::hint::black_box(viewer::is_request(&String::from_utf8_lossy(bytes)));
}

fn npy_seed() -> Vec<u8> {
    let mut bytes = Vec::new();
    formats::npy::write_f32_to(&mut bytes, &[3, 2], &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]).expect("memory");
    bytes
}

/// A trace in CSV, also as one of a measured input.
pub fn trace(bytes: &[u8]) {
    for names in [InputNames::default(), InputNames::new(["gap_mm"])] {
        if let Ok(trace) = SensorTrace::parse_named(String::from_utf8_lossy(bytes), &names) {
            assert!(
                trace.rows.windows(2).all(|pair| pair[0].t_trace_s <= pair[1].t_trace_s),
                "rows out of order"
            );
        }
    }
}

/// A recording, its readings too.
pub fn recording(bytes: &[u8]) {
    let Ok(mut reader) = RecordingReader::new(bytes) else { return };
    while let Ok(Some(item)) = reader.next_item() {
        if let recording::Item::Message(message) = item
            && let Ok(reading) = decode_reading(&message.data)
        {
            std::hint::black_box(reading);
        }
    }
}

fn recording_seed() -> Vec<u8> {
    let mut writer = Writer::new(Vec::new()).expect("memory");
    let channel =
        writer.channel(&channel(SensorSample::LAYOUT, "softtwin/finger/sensor")).expect("a channel");
    let mut bytes = Vec::new();
    for seq in 0..4 {
        SensorSample { seq, pressure_mpa: 0.01, ..SensorSample::default() }.view().encode(&mut bytes);
        writer.message(channel, seq as u32, seq, seq, &bytes).expect("memory");
    }
    writer.finish().expect("memory")
}

/// Scene and settings.
pub fn config(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    if let Ok(scene) = toml::from_str::<Scene>(&text) {
        std::hint::black_box(scene.problems());
    }
    if let Ok(settings) = toml::from_str::<Settings>(&text) {
        std::hint::black_box(settings.problems());
    }
}

fn config_seed() -> Vec<u8> {
    br#"name = "x"
[[actuator]]
name = "finger"
model = "m.twin"
gap_mm = 40.0
[actuator.sensors.gauge]
kind = "modbus"
tcp = "gauge:502"
values.pressure_mpa = { from = { register = 2, encoding = "f32", byte_order = "cdab" }, unit = "kPa", filter = { median = 5 } }
[[actuator.output]]
nodes = { box = { min = [0, 0, 0], max = [1, 1, 1] } }
name = "tip"
"#
    .to_vec()
}

/// Registers as a device may send them: encoding and order (2 bytes), then the registers.
pub fn modbus(bytes: &[u8]) {
    let Some(([encoding, order], registers)) = bytes.split_first_chunk::<2>() else { return };
    let encodings = [Encoding::U16, Encoding::I16, Encoding::U32, Encoding::I32, Encoding::F32];
    let at = RegisterAt {
        unit_id: 1,
        register: 0,
        table: Table::Input,
        encoding: encodings[usize::from(*encoding) % encodings.len()],
        byte_order: if order % 2 == 0 { ByteOrder::Abcd } else { ByteOrder::Dcba },
    };
    let registers: Vec<u16> =
        registers.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect();
    let found = at.raw(&registers);
    assert_eq!(found.is_some(), registers.len() == usize::from(at.count()));
    if let Some(raw) = found.filter(|raw| raw.is_finite()) {
        assert_eq!(at.encode(raw).as_ref(), Some(&registers), "{at:?}: {raw}");
    }
}

/// Lines of text from a sensor, in pieces.
pub fn lines(bytes: &[u8]) {
    let mut buffer = LineBuffer::default();
    for piece in bytes.chunks(7) {
        buffer.split(piece, |line| drop(std::hint::black_box(parse_cells(line, false))));
    }
}

/// Key expression and name, parted by a zero: a name matches itself.
pub fn key(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let (left, right) = text.split_once('\0').unwrap_or((&text, "softtwin/finger/state"));
    std::hint::black_box(Topic::parse(left));
    if let Ok(key) = KeyExpr::new(left) {
        std::hint::black_box(key.matches(right));
        assert!(key.matches(left) || left.contains('*'), "{left}");
    }
}

/// Results of CalculiX.
pub fn frd(bytes: &[u8]) {
    if let Ok(run) = formats::results::parse_frd(bytes) {
        is_whole(&run);
    }
}

/// Cells name nodes that are there, quantities have a value for each.
fn is_whole(run: &formats::results::Run) {
    let nodes = run.points.len();
    assert!(run.blocks.iter().flat_map(|block| &block.nodes).all(|node| (*node as usize) < nodes));
    for quantity in run.steps.iter().flat_map(|step| &step.quantities) {
        assert_eq!(quantity.values.len(), nodes * quantity.components.len());
    }
    std::hint::black_box(formats::cells::surface(&run.points, &run.blocks));
}

/// A VTU file with quantities at its nodes.
pub fn vtu(bytes: &[u8]) {
    let Ok(content) = formats::vtu::parse_content(bytes) else { return };
    let nodes = content.points.len();
    assert!(content.blocks.iter().flat_map(|block| &block.nodes).all(|node| (*node as usize) < nodes));
    for quantity in &content.point_data {
        assert_eq!(quantity.values.len(), nodes * quantity.components);
    }
    std::hint::black_box(formats::cells::surface(&content.points, &content.blocks));
}

/// ParaView's list of files.
pub fn pvd(bytes: &[u8]) {
    let _ = std::hint::black_box(formats::results::parse_pvd(&String::from_utf8_lossy(bytes)));
}

/// An Abaqus input file.
pub fn inp(bytes: &[u8]) {
    let Ok(mesh) = formats::abaqus::parse(&String::from_utf8_lossy(bytes)) else { return };
    std::hint::black_box(formats::cells::surface(&mesh.points, &mesh.blocks));
}

/// Total forces that CalculiX prints.
pub fn dat(bytes: &[u8]) {
    let Ok(totals) = formats::results::parse_dat(&String::from_utf8_lossy(bytes)) else { return };
    assert!(totals.iter().all(|total| total.time.is_finite() && total.force.iter().all(|f| f.is_finite())));
}

const DAT: &[u8] =
    b"\n total force (fx,fy,fz) for set PLATE and time  0.1000000E+01\n\n   3.0E-01 -4.0E-01  0.0E+00\n";
const FRD: &[u8] = b"    2C                             4                                     1\n\
 -1         1 0.00000E+00 0.00000E+00 0.00000E+00\n -1         2 1.00000E+00 0.00000E+00 0.00000E+00\n\
 -1         3 0.00000E+00 1.00000E+00 0.00000E+00\n -1         4 0.00000E+00 0.00000E+00 1.00000E+00\n -3\n\
    3C                             1                                     1\n -1         1    3    0    1\n\
 -2         1         2         3         4\n -3\n    1PSTEP                         1           1           1\n\
  100CL  101 1.000000000           4                     0    1           1\n -4  DISP        4    1\n\
 -5  D1          1    2    1    0\n -5  D2          1    2    2    0\n -5  D3          1    2    3    0\n\
 -1         1 0.00000E+00 0.00000E+00 0.00000E+00\n -1         2 1.00000E-01-1.00000E-01 0.00000E+00\n\
 -1         3 0.00000E+00 0.00000E+00 0.00000E+00\n -1         4 0.00000E+00 0.00000E+00 0.00000E+00\n -3\n 9999\n";

const VTU: &[u8] = b"<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\"><UnstructuredGrid>\
<Piece NumberOfPoints=\"4\" NumberOfCells=\"1\"><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\">0 0 0 1 0 0 0 1 0 0 0 1\
</DataArray></Points><Cells><DataArray type=\"Int32\" Name=\"connectivity\">0 1 2 3</DataArray><DataArray type=\"Int32\" \
Name=\"offsets\">4</DataArray><DataArray type=\"UInt8\" Name=\"types\">10</DataArray></Cells><PointData><DataArray type=\"Float64\" \
Name=\"u\" NumberOfComponents=\"3\">0 0 0 .1 0 0 0 .1 0 0 0 .1</DataArray></PointData></Piece></UnstructuredGrid></VTKFile>";

const PVD: &[u8] = b"<VTKFile type=\"Collection\"><Collection><DataSet timestep=\"0\" file=\"a.vtu\"/>\
<DataSet timestep=\"0.5\" file=\"b.vtu\"/></Collection></VTKFile>";

const INP: &[u8] = b"*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n*ELEMENT, TYPE=C3D4\n1,1,2,3,4\n*NSET, NSET=A, GENERATE\n1,4,1\n";

const MSH: &[u8] = b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n2 7 \"plate\"\n$EndPhysicalNames\n$Entities\n0 0 1 1\n\
1 0 0 0 1 1 1 1 7 0\n1 0 0 0 1 1 1 0 0\n$EndEntities\n$Nodes\n1 10 1 10\n3 1 0 10\n1\n2\n3\n4\n5\n6\n7\n8\n9\n10\n0 0 0\n1 0 0\n\
0 1 0\n0 0 1\n.5 0 0\n.5 .5 0\n0 .5 0\n0 0 .5\n0 .5 .5\n.5 0 .5\n$EndNodes\n$Elements\n2 2 1 2\n2 1 9 1\n1 1 2 3 5 6 7\n\
3 1 11 1\n2 1 2 3 4 5 6 7 8 9 10\n$EndElements\n";
