//! The only place that names bincode: a header to bytes and back, fixed-width little-endian, bounded.
//!
//! A test below holds the bytes of a known value: an encoding that changed by accident is found there, not in
//! users' files.

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Largest header that is written or read, in bytes: node sets and weights of thousands of cases fit a hundred times.
pub(crate) const MAX_HEADER_BYTES: usize = 256 << 20;

/// Headers up to this size may claim a quarter of the memory that the largest may: a text is allocated as long as it claims to be.
const USUAL_HEADER_BYTES: usize = 2 << 20;
const USUAL_CLAIM_BYTES: usize = MAX_HEADER_BYTES / 4;

fn config<const LIMIT: usize>() -> impl bincode::config::Config {
    bincode::config::standard().with_fixed_int_encoding().with_little_endian().with_limit::<LIMIT>()
}

/// Encodes a value.
pub(crate) fn encode(value: &impl Serialize) -> Result<Vec<u8>, String> {
    bincode::serde::encode_to_vec(value, config::<MAX_HEADER_BYTES>()).map_err(|e| e.to_string())
}

/// Decodes a value that must fill the bytes exactly. Claimed lengths beyond the limit are refused before allocation.
pub(crate) fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let decoded = if bytes.len() <= USUAL_HEADER_BYTES {
        bincode::serde::decode_from_slice(bytes, config::<USUAL_CLAIM_BYTES>())
    } else {
        bincode::serde::decode_from_slice(bytes, config::<MAX_HEADER_BYTES>())
    };
    let (value, used) = decoded.map_err(|e| e.to_string())?;
    if used == bytes.len() { Ok(value) } else { Err(format!("{} bytes left over", bytes.len() - used)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::header::OutputField;
    use crate::snapshots::{FieldKind, FieldSpec};

    /// Bytes of a known value, written out by hand: lengths and indices u64, variants u32, options one byte, all
    /// little-endian.
    #[test]
    fn the_encoding_is_the_one_in_users_files() {
        let spec = FieldSpec { name: "y".into(), unit: "mm".into(), kind: FieldKind::Coordinate(1) };
        let field = OutputField { spec, magnitude_of: Some([0, 1, 258]) };
        let golden: Vec<u8> = [
            &[1, 0, 0, 0, 0, 0, 0, 0, b'y'][..],
            &[2, 0, 0, 0, 0, 0, 0, 0, b'm', b'm'],
            &[0, 0, 0, 0, 1],
            &[1],
            &[0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 2, 1, 0, 0, 0, 0, 0, 0],
        ]
        .concat();
        assert_eq!(encode(&field).expect("encodes"), golden);
        assert_eq!(decode::<OutputField>(&golden).expect("decodes"), field);
    }

    #[test]
    fn claims_beyond_the_limit_and_left_over_bytes_are_refused() {
        assert!(decode::<Vec<u64>>(&u64::MAX.to_le_bytes()).is_err());
        assert!(decode::<Vec<u64>>(&(1_u64 << 40).to_le_bytes()).is_err());
        let claim = |bytes: u64| decode::<String>(&bytes.to_le_bytes()).expect_err("no text behind it");
        assert_ne!(claim(144 << 20), claim(16 << 20), "refused before it is allocated");
        assert!(decode::<u32>(&[1, 0, 0, 0, 9]).is_err_and(|e| e.contains("1 bytes left over")));
    }
}
