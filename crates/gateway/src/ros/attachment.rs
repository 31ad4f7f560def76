//! Attachment of a message by the design document of `rmw_zenoh` ("Publishers", "Service Servers"): number and time as little-endian
//! i64, length of the sender's id, the id.

use std::time::{SystemTime, UNIX_EPOCH};

/// A sender's id.
pub type Gid = [u8; 16];

/// Number, time (ns since 1970) and sender of a message.
pub fn attachment(number: i64, time_ns: i64, gid: Gid) -> Vec<u8> {
    [&number.to_le_bytes()[..], &time_ns.to_le_bytes(), &[gid.len() as u8], &gid].concat()
}

/// Number and sender; `None` if the bytes are not an attachment.
pub fn parse(bytes: &[u8]) -> Option<(i64, Gid)> {
    let number = i64::from_le_bytes(bytes.get(..8)?.try_into().ok()?);
    let gid: Gid = bytes.get(17..33)?.try_into().ok()?;
    (usize::from(*bytes.get(16)?) == gid.len() && number >= 0).then_some((number, gid))
}

/// The id of an endpoint: two FNV-1a hashes of its token with different offsets.
pub fn gid(token: &str) -> Gid {
    let hash = |begin: u64| {
        token.bytes().fold(begin, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
    };
    let mut gid = [0; 16];
    gid[..8].copy_from_slice(&hash(0xcbf2_9ce4_8422_2325).to_le_bytes());
    gid[8..].copy_from_slice(&hash(0x8422_2325_cbf2_9ce4).to_le_bytes());
    gid
}

/// Name of an actuator or node set with `_` for every character that ROS does not allow.
pub fn plain(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

/// The time, ns since 1970.
pub fn now_since_1970_ns() -> i64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(now.as_nanos()).unwrap_or(i64::MAX)
}
