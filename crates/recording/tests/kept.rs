//! Recordings that earlier versions wrote, kept: each is read, message by message.
//!
//! `SOFTTWIN_KEEP=1 cargo test -p recording --test all kept::` writes the file of this layout version, which is then committed. The test
//! fails when the layout's version is raised without that.

use std::path::{Path, PathBuf};

use recording::message::{FieldMessage, Recorded, channel, decode, decode_field, decode_reading};
use recording::{ChannelId, Ending, Item, ReadItems, Series, Writer};
use wire::layout::{Layout, VERSION};
use wire::{Command, Estimate, FieldHeader, Grasp, Health, Payload, SensorSample, Setpoint, State, Valve};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data")
}

/// A payload whose numbers tell it from a default one: each byte has a value of its own, the same at every run.
fn filled<P: Payload>() -> P {
    let mut payload = P::default();
    let known = payload.bytes_mut().len();
    for (at, byte) in payload.bytes_mut().iter_mut().enumerate() {
        // Small enough that counts stay within their lists.
        *byte = if at % 8 == 0 { (at / 8 % 5) as u8 } else { 0 };
    }
    assert!(known > 0);
    payload
}

fn add<P: Payload>(writer: &mut Writer<Vec<u8>>, topic: &str, messages: &mut u64) {
    let id = writer.channel(&channel(P::LAYOUT, topic)).expect("a channel");
    for payload in [P::default(), filled::<P>()] {
        write(writer, id, &payload.view(), messages);
    }
}

/// Fields have values behind their header; these have none.
fn add_fields(writer: &mut Writer<Vec<u8>>, topic: &str, messages: &mut u64) {
    let id = writer.channel(&channel(FieldHeader::LAYOUT, topic)).expect("a channel");
    for header in [FieldHeader::default(), filled()] {
        write(writer, id, &FieldMessage::new(&header, &[]), messages);
    }
}

fn write(writer: &mut Writer<Vec<u8>>, id: ChannelId, message: &impl Recorded, messages: &mut u64) {
    let mut bytes = Vec::new();
    message.encode(&mut bytes);
    *messages += 1;
    writer.message(id, *messages as u32, *messages, *messages, &bytes).expect("memory");
}

/// One message of every payload at its default, one with numbers.
fn recording() -> Vec<u8> {
    let mut writer = Writer::new(Vec::new()).expect("memory");
    let mut count = 0;
    add::<SensorSample>(&mut writer, "softtwin/finger/sensor", &mut count);
    add::<State>(&mut writer, "softtwin/finger/state", &mut count);
    add_fields(&mut writer, "softtwin/finger/field", &mut count);
    add::<Health>(&mut writer, "softtwin/finger/health", &mut count);
    add::<Estimate>(&mut writer, "softtwin/finger/estimate", &mut count);
    add::<Command>(&mut writer, "softtwin/finger/command", &mut count);
    add::<Setpoint>(&mut writer, "softtwin/finger/setpoint", &mut count);
    add::<Valve>(&mut writer, "softtwin/finger/valve", &mut count);
    add::<Grasp>(&mut writer, "softtwin/scene/grasp", &mut count);
    writer.finish().expect("memory")
}

/// Reads a message of a kept file by the name of its schema.
fn read(schema: &str, data: &[u8]) -> Result<(), String> {
    let is = |layout: &Layout| layout.schema == schema;
    let text = |error: serde_json::Error| error.to_string();
    match () {
        () if is(SensorSample::LAYOUT) => decode_reading(data).map(drop).map_err(text),
        () if is(FieldHeader::LAYOUT) => decode_field(data).map(drop).map_err(text),
        () if is(State::LAYOUT) => decode::<State>(data).map(drop).map_err(text),
        () if is(Health::LAYOUT) => decode::<Health>(data).map(drop).map_err(text),
        () if is(Estimate::LAYOUT) => decode::<Estimate>(data).map(drop).map_err(text),
        () if is(Command::LAYOUT) => decode::<Command>(data).map(drop).map_err(text),
        () if is(Setpoint::LAYOUT) => decode::<Setpoint>(data).map(drop).map_err(text),
        () if is(Valve::LAYOUT) => decode::<Valve>(data).map(drop).map_err(text),
        () if is(Grasp::LAYOUT) => decode::<Grasp>(data).map(drop).map_err(text),
        () => Err("a schema that this version does not know".into()),
    }
}

#[test]
fn recordings_of_every_earlier_layout_are_read() {
    let current = folder().join(format!("layout-{VERSION}.mcap"));
    if std::env::var_os("SOFTTWIN_KEEP").is_some() {
        std::fs::write(&current, recording()).expect("written");
    }
    assert!(
        current.exists(),
        "{} is missing: SOFTTWIN_KEEP=1 cargo test -p recording --test all kept:: writes it; commit it",
        current.display()
    );
    let mut files = 0;
    for entry in std::fs::read_dir(folder()).expect("a folder").flatten() {
        let path = entry.path();
        let mut reader = Series::open(&path).expect("there").reader();
        let mut messages = 0;
        while let Some(item) = reader.next_item().expect("readable") {
            let Item::Message(message) = item else { continue };
            messages += 1;
            if let Err(error) = read(&message.channel.schema_name, &message.data) {
                panic!("{}: {}: {error}", path.display(), message.channel.schema_name);
            }
        }
        assert!(messages > 0, "{} is empty", path.display());
        assert_eq!(reader.ending(), Ending::Complete.to_string());
        files += 1;
    }
    assert!(files >= 2, "{files} kept files");
}
