//! Payloads: plain `#[repr(C)]` data, little-endian on every machine we run on, checked at compile time.
//!
//! Each payload is defined once, with `payload!`: the structure, its checks, its default and the table [`Layout`] follow
//! from the definition; the JSON form, `docs/wire.md`, the C header and the Python module are made from the table.
//!
//! Rules: no implicit padding, reserved values are zero, quantities are `f64` with their unit in the name, NaN stands for
//! "not known". The layout version is part of the type name, so programs of different layouts refuse each other.

/// The layout version as a literal, for type names.
macro_rules! layout_version {
    () => {
        1
    };
}

mod codes;
mod payload;
mod requests;
mod topics;

pub use codes::{
    Code, Codes, InputValue, Outcome, QueryStatus, domain_status, estimate_alarm, estimate_status, field_id,
    flags, grasp_status, input_source, query_kind, regime, target_kind, value_bits, valve_interlock,
    valve_limit, valve_reason,
};
pub use payload::{Field, Layout, Number, Payload, Scalar, Show, View};
pub use requests::{Answer, Command, Query, Setpoint, TARGET_VALUES_MAX, Target, Valve};
pub use topics::{
    AGES_MAX, Ages, COEFFICIENTS_MAX, Estimate, FIELD_SLOTS, FINGERS_MAX, FieldHeader, GROUPS_MAX, Grasp,
    Health, MARKERS_MAX, Marker, OUTCOME_SLOTS, SensorSample, State, UNKNOWNS_MAX,
};

/// Version of all layouts. Raised with any change of size, offset or meaning; it is part of every type name.
pub const LAYOUT_VERSION: u32 = layout_version!();

/// Every payload.
pub const PAYLOADS: [&Layout; 12] = [
    SensorSample::LAYOUT,
    FieldHeader::LAYOUT,
    State::LAYOUT,
    Health::LAYOUT,
    Grasp::LAYOUT,
    Command::LAYOUT,
    Estimate::LAYOUT,
    Setpoint::LAYOUT,
    Target::LAYOUT,
    Valve::LAYOUT,
    Query::LAYOUT,
    Answer::LAYOUT,
];

/// Most model inputs.
pub const INPUTS_MAX: usize = 8;
/// Most observables of a model.
pub const OBSERVABLES_MAX: usize = 8;
/// Largest number of model inputs other than pressure and gap.
pub const PARAMETERS_MAX: usize = INPUTS_MAX - 2;

/// Hexadecimal digits, for hashes.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Packs a name into a zero-padded 32-byte value (longer names are refused where names are made, see [`crate::Topic`]).
pub fn pack_name(name: &str) -> [u8; 32] {
    let mut packed = [0; 32];
    for (to, from) in packed.iter_mut().take(31).zip(name.bytes()) {
        *to = from;
    }
    packed
}

/// The name in a slot of several, 32 bytes each, zero-padded; empty where there is no such slot.
pub fn slot(names: &[u8], index: usize) -> String {
    names.as_chunks::<32>().0.get(index).map_or_else(String::new, |name| unpack_name(name))
}

/// Sets the name in a slot of several. Of a name of more than 31 bytes the end is kept, which says more.
pub fn set_slot(names: &mut [u8], index: usize, name: &str) {
    let mut begin = name.len().saturating_sub(31);
    while !name.is_char_boundary(begin) {
        begin += 1;
    }
    if let Some(slot) = names.as_chunks_mut::<32>().0.get_mut(index) {
        *slot = pack_name(&name[begin..]);
    }
}

/// The name as readings and payloads carry it: of a name of more than 31 bytes the end.
pub fn pack_slot(name: &str) -> [u8; 32] {
    let mut packed = [0; 32];
    set_slot(&mut packed, 0, name);
    packed
}

/// Reads a zero-padded name; bytes that are not UTF-8 are shown as the replacement character.
pub fn unpack_name(packed: &[u8]) -> String {
    let text: Vec<u8> = packed.iter().copied().take_while(|byte| *byte != 0).collect();
    String::from_utf8_lossy(&text).into_owned()
}
