//! Payloads: plain `#[repr(C)]` data, little-endian on every machine we run on, checked at compile time.
//!
//! Rules of the layouts: fields in decreasing alignment or with explicit padding, no implicit holes, `f64` for physical
//! quantities, NaN for "not known", [`VERSION`] in the type name (`softtwin.<Type>.v<VERSION>`), so that programs of
//! different layouts refuse each other.

mod command;
mod field;
mod grasp;
mod health;
mod query;
mod sensor;
mod state;

pub use command::Command;
pub use field::{FIELD_SLOTS, FieldHeader};
pub use grasp::{FINGERS_MAX, Grasp, grasp_status};
pub use health::{Health, OUTCOME_SLOTS};
pub use query::{Answer, Query, query_kind};
pub use sensor::SensorSample;
pub use state::{COEFFICIENTS_MAX, GROUPS_MAX, State};

/// Version of all layouts in this module. Raise it with any change of size, offset or meaning, and raise the type names.
pub const VERSION: u32 = 2;

/// Bits of `flags` in [`FieldHeader`] and [`State`].
pub mod flags {
    /// No usable reading within the deadline: the values are the last good ones, see `age_ns`.
    pub const STALE: u32 = 1 << 0;
    /// The last reading was refused (see `outcome`): the values are the last good ones.
    pub const HELD: u32 = 1 << 1;
    /// Near the edge of the sampled states.
    pub const NEAR_EDGE: u32 = 1 << 2;
    /// Outside the sampled states: an extrapolation.
    pub const OUTSIDE_DOMAIN: u32 = 1 << 3;
    /// A measured contact force came with the reading.
    pub const FORCE_MEASURED: u32 = 1 << 4;
    /// The measured force has been outside the predicted one's error bar for longer than configured.
    pub const FORCE_MISMATCH: u32 = 1 << 5;
    /// The reading waited longer than the configured limit before its field was sent.
    pub const LATE: u32 = 1 << 6;
    /// No reading has come yet since the twin started.
    pub const NO_DATA: u32 = 1 << 7;
    /// The model has more coefficients than a state can carry: only the first are in it.
    pub const COEFFICIENTS_CUT: u32 = 1 << 8;
    /// The interpolated force was negative and was lifted to 0.
    pub const FORCE_CLAMPED: u32 = 1 << 9;
    /// The regime still says contact although the pressure is just below the onset (hysteresis).
    pub const REGIME_HELD: u32 = 1 << 10;

    /// All flags with their names, for people.
    pub const NAMES: &[(u32, &str)] = &[
        (STALE, "stale"),
        (HELD, "held"),
        (NEAR_EDGE, "near-edge"),
        (OUTSIDE_DOMAIN, "outside-domain"),
        (FORCE_MEASURED, "force-measured"),
        (FORCE_MISMATCH, "force-mismatch"),
        (LATE, "late"),
        (NO_DATA, "no-data"),
        (COEFFICIENTS_CUT, "coefficients-cut"),
        (FORCE_CLAMPED, "force-clamped"),
        (REGIME_HELD, "regime-held"),
    ];

    /// The names of the set bits.
    pub fn names(flags: u32) -> impl Iterator<Item = &'static str> {
        NAMES.iter().filter(move |(bit, _)| flags & bit != 0).map(|(_, name)| *name)
    }
}

/// Numbers of `regime`.
pub mod regime {
    /// No reading yet.
    pub const UNKNOWN: u32 = 0;
    /// The actuator does not touch the plate; the model takes P.
    pub const FREE: u32 = 1;
    /// The actuator touches the plate; the model takes (P, gap).
    pub const CONTACT: u32 = 2;

    /// The text for people.
    pub fn as_str(regime: u32) -> &'static str {
        match regime {
            FREE => "free",
            CONTACT => "contact",
            _ => "unknown",
        }
    }
}

/// Numbers of the entries of [`FieldHeader::field_ids`].
pub mod field_id {
    /// No field in this slot.
    pub const NONE: u8 = 0;
    /// Deformed x coordinate, mm.
    pub const X: u8 = 1;
    /// Deformed y coordinate, mm.
    pub const Y: u8 = 2;
    /// Deformed z coordinate, mm.
    pub const Z: u8 = 3;
    /// Displacement magnitude, mm.
    pub const DISPLACEMENT: u8 = 4;
    /// Von Mises stress, MPa.
    pub const VON_MISES: u8 = 5;

    /// Numbers from here on are `OTHER + position in the model` for fields without a number of their own.
    pub const OTHER: u8 = 128;

    /// The name, as in the model and in scene files.
    pub fn as_str(id: u8) -> &'static str {
        match id {
            X => "x",
            Y => "y",
            Z => "z",
            DISPLACEMENT => "displacement",
            VON_MISES => "von_mises",
            OTHER.. => "other",
            _ => "none",
        }
    }

    /// The number of a name.
    pub fn from_name(name: &str) -> Option<u8> {
        [X, Y, Z, DISPLACEMENT, VON_MISES].into_iter().find(|id| as_str(*id) == name)
    }
}

/// Hexadecimal digits, for hashes.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Packs a name into a zero-padded 32-byte field (longer names are refused where names are made, see [`crate::Topic`]).
pub fn pack_name(name: &str) -> [u8; 32] {
    let mut packed = [0; 32];
    for (to, from) in packed.iter_mut().take(31).zip(name.bytes()) {
        *to = from;
    }
    packed
}

/// Reads a zero-padded name; bytes that are not UTF-8 are shown as the replacement character.
pub fn unpack_name(packed: &[u8; 32]) -> String {
    let text: Vec<u8> = packed.iter().copied().take_while(|byte| *byte != 0).collect();
    String::from_utf8_lossy(&text).into_owned()
}

/// A payload that says how it lies in memory, for programs in other languages and for the page that documents it.
pub trait Described {
    /// Name of the type on the wire, with its layout version.
    fn type_name() -> &'static str;
    /// Size in bytes; the alignment is 8.
    const SIZE: usize;
    /// Fields with their offsets, in order.
    const FIELDS: &'static [(&'static str, usize)];
}

/// Checks sizes and offsets at compile time and makes them readable: `layout!(Type, size, { field: offset, ... })`.
macro_rules! layout {
    ($type:ty, $size:literal, { $($field:ident: $offset:literal),+ $(,)? }) => {
        const _: () = {
            assert!(std::mem::size_of::<$type>() == $size);
            assert!(std::mem::align_of::<$type>() == 8);
            $(assert!(std::mem::offset_of!($type, $field) == $offset);)+
        };

        impl $crate::layout::Described for $type {
            fn type_name() -> &'static str {
                // SAFETY: asks the type for its name, which the derive of `ZeroCopySend` gives.
                unsafe { <$type as iceoryx2::prelude::ZeroCopySend>::type_name() }
            }
            const SIZE: usize = $size;
            const FIELDS: &'static [(&'static str, usize)] = &[$((stringify!($field), $offset)),+];
        }
    };
}
use layout;
