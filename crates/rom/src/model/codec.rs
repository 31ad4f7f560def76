//! The only place that names bincode: a header to bytes and back, fixed-width little-endian, bounded.
//!
//! `tests/golden.rs` holds the bytes of a known header: an encoding that changed by accident is found there, not in
//! users' files.

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Largest header that is written or read, in bytes: node sets and weights of thousands of cases fit a hundred times.
pub(crate) const MAX_HEADER_BYTES: usize = 256 << 20;

fn config() -> impl bincode::config::Config {
    bincode::config::standard()
        .with_fixed_int_encoding()
        .with_little_endian()
        .with_limit::<MAX_HEADER_BYTES>()
}

/// Encodes a value.
pub(crate) fn encode(value: &impl Serialize) -> Result<Vec<u8>, String> {
    bincode::serde::encode_to_vec(value, config()).map_err(|e| e.to_string())
}

/// Decodes a value that must fill the bytes exactly. Claimed lengths beyond the limit are refused before allocation.
pub(crate) fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let (value, used) = bincode::serde::decode_from_slice(bytes, config()).map_err(|e| e.to_string())?;
    if used == bytes.len() { Ok(value) } else { Err(format!("{} bytes left over", bytes.len() - used)) }
}
