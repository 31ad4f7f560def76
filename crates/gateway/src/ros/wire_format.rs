//! The wire of `rmw_zenoh`, after its design document (docs/design.md there): CDR, the encoding of messages; the attachment of a message;
//! keys, which contain type and hash; tokens, by which nodes and endpoints appear in the graph of ROS.

use super::config::Ros2;
use crate::link::{Link, network};
use std::time::{SystemTime, UNIX_EPOCH};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;

// ---- CDR: little-endian, numbers aligned to their size after the head ----

/// The head: plain CDR, little-endian.
const HEAD: [u8; 4] = [0, 1, 0, 0];

/// A message under construction.
pub struct Cdr(Vec<u8>);

impl Cdr {
    pub fn new() -> Self {
        Self(HEAD.to_vec())
    }

    fn align(&mut self, size: usize) {
        self.0.resize(HEAD.len() + (self.0.len() - HEAD.len()).next_multiple_of(size), 0);
    }

    pub fn byte(mut self, value: u8) -> Self {
        self.0.push(value);
        self
    }

    pub fn word(mut self, value: u32) -> Self {
        self.align(4);
        self.0.extend(value.to_le_bytes());
        self
    }

    pub fn strings(self, values: &[impl AsRef<str>]) -> Self {
        let message = self.word(values.len() as u32);
        values.iter().fold(message, |message, value| message.string(value.as_ref()))
    }

    pub fn floats(mut self, values: &[f32]) -> Self {
        self.align(4);
        self.0.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        self
    }

    /// Adds double-precision numbers; no padding for an empty list.
    pub fn doubles(mut self, values: &[f64]) -> Self {
        if values.is_empty() {
            return self;
        }
        self.align(8);
        self.0.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        self
    }

    pub fn string(self, value: &str) -> Self {
        let mut message = self.word(value.len() as u32 + 1);
        message.0.extend(value.as_bytes());
        message.byte(0)
    }

    pub fn bytes(self, value: &[u8]) -> Self {
        let mut message = self.word(value.len() as u32);
        message.0.extend(value);
        message
    }

    /// Adds a `std_msgs/Header`: time (ns since 1970) and frame.
    pub fn header(self, time_ns: u64, frame: &str) -> Self {
        let seconds = time_ns / 1_000_000_000;
        self.word(seconds as u32).word((time_ns % 1_000_000_000) as u32).string(frame)
    }

    pub fn finish(self) -> Vec<u8> {
        self.0
    }
}

/// Reads a message value by value; `None` at its end, or if a string is not UTF-8.
pub struct CdrReader<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> CdrReader<'a> {
    /// The beginning of a message; `None` for another head.
    pub fn new(bytes: &'a [u8]) -> Option<Self> {
        Some(Self { body: bytes.strip_prefix(&HEAD)?, at: 0 })
    }

    /// The next `length` bytes at a multiple of `alignment`.
    fn take(&mut self, length: usize, alignment: usize) -> Option<&'a [u8]> {
        let begin = self.at.checked_next_multiple_of(alignment)?;
        let end = begin.checked_add(length)?;
        let found = self.body.get(begin..end)?;
        self.at = end;
        Some(found)
    }

    pub fn word(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.take(4, 4)?.try_into().ok()?))
    }

    /// A sequence of at most `most` strings.
    pub fn strings(&mut self, most: usize) -> Option<Vec<&'a str>> {
        let count = self.word()? as usize;
        if count > most {
            return None;
        }
        (0..count).map(|_| self.string()).collect()
    }

    /// A sequence of at most `most` double-precision numbers.
    pub fn doubles(&mut self, most: usize) -> Option<Vec<f64>> {
        let count = self.word()? as usize;
        if count > most {
            return None;
        }
        (0..count).map(|_| self.double()).collect()
    }

    pub fn double(&mut self) -> Option<f64> {
        Some(f64::from_le_bytes(self.take(8, 8)?.try_into().ok()?))
    }

    /// A string, without its terminating zero.
    pub fn string(&mut self) -> Option<&'a str> {
        let length = self.word()? as usize;
        let bytes = self.take(length, 1)?;
        std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes)).ok()
    }
}

// ---- the attachment: number and time as little-endian i64, length of the sender's id, the id ----

pub type Gid = [u8; 16];

/// Number, time (ns since 1970) and sender of a message.
pub fn attachment_of(number: i64, time_ns: i64, gid: Gid) -> Vec<u8> {
    [&number.to_le_bytes()[..], &time_ns.to_le_bytes(), &[gid.len() as u8], &gid].concat()
}

/// Number and sender; `None` if the bytes are not an attachment.
pub fn parse_attachment(bytes: &[u8]) -> Option<(i64, Gid)> {
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

/// The time, ns since 1970.
pub fn now_since_1970_ns() -> i64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(now.as_nanos()).unwrap_or(i64::MAX)
}

// ---- types ----

/// A type of ROS 2 in keys and tokens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MessageType {
    /// Such as `geometry_msgs::msg::dds_::WrenchStamped_`.
    pub name: &'static str,
    /// `RIHS01_` and the hash of the type's description, the same in all releases since Iron.
    pub hash: &'static str,
}

impl MessageType {
    /// Checks that a key of the other side ends in this type's hash.
    pub fn check_hash(self, key: &str) -> Result<(), String> {
        if key.ends_with(self.hash) {
            return Ok(());
        }
        Err(format!("{key}: expected type hash {}; build the other side with ROS 2 Iron or later", self.hash))
    }
}

pub const WRENCH: MessageType = MessageType {
    name: "geometry_msgs::msg::dds_::WrenchStamped_",
    hash: "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
};
pub const POINTS: MessageType = MessageType {
    name: "sensor_msgs::msg::dds_::PointCloud2_",
    hash: "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
};
pub const MARKER: MessageType = MessageType {
    name: "visualization_msgs::msg::dds_::Marker_",
    hash: "RIHS01_45b13ccf791f225962bf74e746f9644518855d783a6f42ba0cc14fde2b4f3ce0",
};
pub const PRESSURE: MessageType = MessageType {
    name: "sensor_msgs::msg::dds_::FluidPressure_",
    hash: "RIHS01_22dfb2b145a0bd5a31a1ac3882a1b32148b51d9b2f3bab250290d66f3595bc32",
};
pub const JOINTS: MessageType = MessageType {
    name: "sensor_msgs::msg::dds_::JointState_",
    hash: "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
};
pub const COMMANDS: MessageType = MessageType {
    name: "std_msgs::msg::dds_::Float64MultiArray_",
    hash: "RIHS01_1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f",
};
pub const DIAGNOSTICS: MessageType = MessageType {
    name: "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    hash: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
};
pub const TRIGGER: MessageType = MessageType {
    name: "std_srvs::srv::dds_::Trigger_",
    hash: "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
};
pub const WHAT_IF: MessageType = MessageType {
    name: "softtwin_interfaces::srv::dds_::WhatIf_",
    hash: "RIHS01_9f2ac41aea00462ce74df4a6e79b64f152cb2f5a016da59b01275b0881aff29c",
};
pub const FIND_PRESSURE: MessageType = MessageType {
    name: "softtwin_interfaces::srv::dds_::FindPressure_",
    hash: "RIHS01_02039dd0399fb01b07e8dc294ae3685b5ea0a0704c03a5bcf02707eb91d25eb0",
};
pub const FIND_GAP: MessageType = MessageType {
    name: "softtwin_interfaces::srv::dds_::FindGap_",
    hash: "RIHS01_67eb9215946c75657692c55fb03354a965e0a6d2839b1253e1cbd4f0bf6efa05",
};

// ---- keys and tokens ----

/// QoS of all endpoints in tokens: reliable, volatile, keep the last 10 (the default of ROS).
const QOS: &str = "::,10:,:,:,,";

/// Kind of an endpoint in tokens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Entity {
    Publisher,
    Subscription,
    Service,
}

impl Entity {
    fn code(self) -> &'static str {
        match self {
            Self::Publisher => "MP",
            Self::Subscription => "MS",
            Self::Service => "SS",
        }
    }
}

pub struct Names<'a> {
    ros: &'a Ros2,
    session_id: String,
}

impl Names<'_> {
    pub fn new<'a>(ros: &'a Ros2, link: &Link) -> Names<'a> {
        Names { ros, session_id: link.session.zid().to_string() }
    }

    /// Key of a topic or service.
    pub fn key(&self, topic: &str, kind: MessageType, hash: &str) -> String {
        format!("{}/{topic}/{}/{hash}", self.ros.domain_id, kind.name)
    }

    /// The token of the node.
    pub fn node(&self) -> String {
        self.entity(0, "NN")
    }

    fn entity(&self, number: usize, code: &str) -> String {
        let (domain, session, node) = (self.ros.domain_id, &self.session_id, &self.ros.node);
        format!("@ros2_lv/{domain}/{session}/0/{number}/{code}/%/%/{node}")
    }

    /// The token of an endpoint; `number` is its own within the node.
    pub fn endpoint(&self, number: usize, entity: Entity, topic: &str, kind: MessageType) -> String {
        let mangled = topic.replace('/', "%");
        format!("{}/%{mangled}/{}/{}/{QOS}", self.entity(number, entity.code()), kind.name, kind.hash)
    }
}

/// Makes an entity appear in the graph while the result exists.
pub fn token(link: &Link, key: String) -> anyhow::Result<LivelinessToken> {
    network(link.session.liveliness().declare_token(key).wait())
}
