//! Inputs inside a checksummed file or a folder; checksums are recomputed so that the reader reaches the input.

use formats::database::{self, ObstacleKind};
use std::fs;
use std::path::Path;

/// Bytes before the header of a model file, and those of a checksum.
const PREAMBLE: usize = 64;
const HASH: usize = 32;

/// The header of a model file, behind good checksums and before the blocks of a good model.
pub fn model_header(header: &[u8]) {
    behind_checksums(crate::stage::model_bytes(), header);
}

/// The header of a good model.
pub fn header_seed() -> Vec<u8> {
    header_of(crate::stage::model_bytes())
}

fn behind_checksums(good: &[u8], header: &[u8]) {
    let mut file = good[..PREAMBLE].to_vec();
    file[16..24].copy_from_slice(&(header.len() as u64).to_le_bytes());
    file[24..56].copy_from_slice(blake3::hash(header).as_bytes());
    file.extend(header);
    file.resize(file.len().next_multiple_of(PREAMBLE), 0);
    file.extend(&good[(PREAMBLE + header_of(good).len()).next_multiple_of(PREAMBLE)..good.len() - HASH]);
    let seal = *blake3::hash(&file).as_bytes();
    file.extend(seal);
    super::model(&file);
}

fn header_of(good: &[u8]) -> Vec<u8> {
    let length = u64::from_le_bytes(good[16..24].try_into().expect("eight bytes"));
    good[PREAMBLE..PREAMBLE + length as usize].to_vec()
}

/// The records of a chunk of a recording; the chunk says that it has no checksum.
pub fn chunk(records: &[u8]) {
    let mut body = [0; 16].to_vec();
    body.extend((records.len() as u64).to_le_bytes());
    body.extend(0_u32.to_le_bytes()); // no checksum
    body.extend(0_u32.to_le_bytes()); // no compression
    body.extend((records.len() as u64).to_le_bytes());
    body.extend(records);
    let mut file = recording::MAGIC.to_vec();
    record(&mut file, 0x01, &[0; 8]);
    record(&mut file, 0x06, &body);
    super::recording(&file);
}

/// A schema, a channel and a reading.
pub fn chunk_seed() -> Vec<u8> {
    let text = |text: &str| [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
    let mut records = Vec::new();
    let schema =
        [&1_u16.to_le_bytes()[..], &text("softtwin.SensorSample"), &text("jsonschema"), &text("{}")].concat();
    record(&mut records, 0x03, &schema);
    let topic = text("softtwin/finger/sensor");
    let channel = [&[1, 0, 1, 0][..], &topic, &text("json"), &0_u32.to_le_bytes()].concat();
    record(&mut records, 0x04, &channel);
    let message =
        [&[1, 0][..], &[0; 20], br#"{"seq":1,"pressure_mpa":0.01,"gap_mm":40,"markers_mm":[1,2,3]}"#]
            .concat();
    record(&mut records, 0x05, &message);
    records
}

fn record(out: &mut Vec<u8>, opcode: u8, body: &[u8]) {
    out.push(opcode);
    out.extend((body.len() as u64).to_le_bytes());
    out.extend(body);
}

/// The files of one quantity in the exchange of Ansys' reduced-order models.
const EXCHANGE: [&str; 4] = ["settings.json", "doe.csv", "points.bin", "snapshots/file0.bin"];

/// A folder of that exchange: its files one behind the other, each after its length (two bytes).
pub fn exchange(bytes: &[u8]) {
    super::in_folder(|folder| {
        let quantity = folder.join("displacement");
        fs::create_dir_all(quantity.join("snapshots")).expect("writable");
        let mut rest = bytes;
        for name in EXCHANGE {
            let (length, behind) = rest.split_at(rest.len().min(2));
            let wanted = length.iter().rev().fold(0, |sum, byte| sum << 8 | usize::from(*byte));
            let (content, behind) = behind.split_at(behind.len().min(wanted));
            fs::write(quantity.join(name), content).expect("writable");
            rest = behind;
        }
        read_exchange(folder);
    });
}

fn read_exchange(folder: &Path) {
    if let Ok(found) = database::read(folder, ObstacleKind::Plate) {
        assert_eq!(found.snapshots.len(), found.cases.len() * found.node_count * found.fields.len());
    }
}

/// One state of four nodes.
pub fn exchange_seed() -> Vec<u8> {
    let numbers = |values: &[f64]| -> Vec<u8> {
        (values.len() as u64)
            .to_le_bytes()
            .into_iter()
            .chain(values.iter().flat_map(|v| v.to_le_bytes()))
            .collect()
    };
    let parts = [
        br#"{"name":"displacement","unit":"m","deformation":true,"dimensionality":[3],"ids":[1,-1,4]}"#
            .to_vec(),
        b"displacement,pressure[kPa],gap[mm],contact_force[N],split\nfile0.bin,50,40,0.25,test\n".to_vec(),
        numbers(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        numbers(&[1e-3; 12]),
    ];
    parts
        .iter()
        .flat_map(|part| (part.len() as u16).to_le_bytes().into_iter().chain(part.iter().copied()))
        .collect()
}
