//! Inputs inside a checksummed file or a folder; checksums are recomputed so that the reader reaches the input.

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
