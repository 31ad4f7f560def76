//! Protocol buffers as far as viewers' messages need them: an encoder, and descriptors from a short text.

use std::collections::BTreeMap;

/// A message in the making. Values that are zero or empty are left out, as the format says.
#[derive(Debug, Clone, Default)]
pub struct Proto(Vec<u8>);

impl Proto {
    /// Adds a whole number.
    pub fn integer(mut self, field: u32, value: u64) -> Self {
        if value != 0 {
            self.key(field, 0);
            self.varint(value);
        }
        self
    }

    /// Adds a `double`.
    pub fn double(mut self, field: u32, value: f64) -> Self {
        if value != 0.0 {
            self.key(field, 1);
            self.0.extend(value.to_le_bytes());
        }
        self
    }

    /// Adds a `fixed32`.
    pub fn fixed32(mut self, field: u32, value: u32) -> Self {
        if value != 0 {
            self.key(field, 5);
            self.0.extend(value.to_le_bytes());
        }
        self
    }

    /// Adds a list of `fixed32`, packed.
    pub fn packed(mut self, field: u32, values: &[u32]) -> Self {
        if !values.is_empty() {
            self.key(field, 2);
            self.varint(4 * values.len() as u64);
            self.0.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        }
        self
    }

    /// Adds a text or bytes.
    pub fn bytes(mut self, field: u32, value: impl AsRef<[u8]>) -> Self {
        if !value.as_ref().is_empty() {
            self.part(field, value.as_ref());
        }
        self
    }

    /// Adds a message; an empty one too.
    pub fn message(mut self, field: u32, message: Self) -> Self {
        self.part(field, &message.0);
        self
    }

    /// Adds messages in their order.
    pub fn messages(mut self, field: u32, messages: impl IntoIterator<Item = Self>) -> Self {
        for message in messages {
            self.part(field, &message.0);
        }
        self
    }

    /// The encoded message.
    pub fn finish(self) -> Vec<u8> {
        self.0
    }

    fn part(&mut self, field: u32, bytes: &[u8]) {
        self.key(field, 2);
        self.varint(bytes.len() as u64);
        self.0.extend(bytes);
    }

    fn key(&mut self, field: u32, wire_type: u32) {
        self.varint(u64::from(field << 3 | wire_type));
    }

    fn varint(&mut self, mut value: u64) {
        while value > 0x7f {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }
}

/// A serialised `FileDescriptorSet` of the messages of `package` in `text`, with Google's `Timestamp` and `Duration` before them.
///
/// Each line is a message: its name, then `field:type` with field numbers from 1. A type is `double`, `fixed32`, `int64`, `int32`, `bool`,
/// `string`, `bytes`, the name of a message of the text, `Timestamp`, `Duration`, or `A|B|C` for an enumeration; `[]` behind it: repeated.
pub fn descriptors(package: &str, text: &str) -> Vec<u8> {
    let times = [("timestamp", "Timestamp"), ("duration", "Duration")];
    let google = times.map(|(file, name)| {
        let message = message(&format!("{name} seconds:int64 nanos:int32"), &BTreeMap::new());
        file_descriptor(&format!("google/protobuf/{file}.proto"), "google.protobuf", &[], [message])
    });
    let mut types: BTreeMap<&str, String> =
        times.into_iter().map(|(_, name)| (name, format!(".google.protobuf.{name}"))).collect();
    let lines = || text.lines().filter(|line| !line.trim().is_empty());
    types.extend(
        lines()
            .filter_map(|line| line.split_whitespace().next())
            .map(|name| (name, format!(".{package}.{name}"))),
    );
    let imports = times.map(|(file, _)| format!("google/protobuf/{file}.proto"));
    let own = file_descriptor(
        &format!("{package}.proto"),
        package,
        &imports,
        lines().map(|line| message(line, &types)),
    );
    Proto::default().messages(1, google).message(1, own).finish()
}

/// `FileDescriptorProto`.
fn file_descriptor(
    name: &str,
    package: &str,
    imports: &[String],
    messages: impl IntoIterator<Item = Proto>,
) -> Proto {
    let file = Proto::default().bytes(1, name).bytes(2, package);
    let file = imports.iter().fold(file, |file, import| file.bytes(3, import));
    file.messages(4, messages).bytes(12, "proto3")
}

/// `DescriptorProto` of one line.
fn message(line: &str, types: &BTreeMap<&str, String>) -> Proto {
    const SCALARS: [(&str, u64); 7] = [
        ("double", 1),
        ("int64", 3),
        ("int32", 5),
        ("fixed32", 7),
        ("bool", 8),
        ("string", 9),
        ("bytes", 12),
    ];
    let mut words = line.split_whitespace();
    let name = words.next().unwrap_or_default();
    let (mut message, mut enumerations) = (Proto::default().bytes(1, name), Vec::new());
    for (number, (field, kind)) in (1..).zip(words.filter_map(|word| word.split_once(':'))) {
        let single = kind.trim_end_matches("[]");
        let label = if single == kind { 1 } else { 3 };
        let described = Proto::default().bytes(1, field).integer(3, number).integer(4, label);
        let described = if let Some((_, scalar)) = SCALARS.iter().find(|(scalar, _)| *scalar == single) {
            described.integer(5, *scalar)
        } else if let Some(full) = types.get(single) {
            described.integer(5, 11).bytes(6, full)
        } else {
            let values = (0..).zip(single.split('|'));
            let values = values.map(|(number, value)| Proto::default().bytes(1, value).integer(2, number));
            enumerations.push(Proto::default().bytes(1, "Type").messages(2, values));
            let package =
                types.values().find_map(|full| full.strip_suffix(&format!(".{name}"))).unwrap_or_default();
            described.integer(5, 14).bytes(6, format!("{package}.{name}.Type"))
        };
        message = message.message(2, described);
    }
    message.messages(4, enumerations)
}
