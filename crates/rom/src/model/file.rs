//! The model file: one file with everything a twin needs, readable in parts, refused when damaged.
//!
//! ```text
//! 0      magic "SOFTTWIN"                         8 bytes
//! 8      version, u32 little-endian               4
//! 12     zero                                     4
//! 16     header length h, u64 little-endian       8
//! 24     blake3 of the header                    32
//! 56     zero                                     8
//! 64     header: block table and model header     h   (codec.rs)
//!        zeros up to a multiple of 64
//! d      blocks, each from a multiple of 64, little-endian, zeros between
//! end-32 blake3 of everything before             32
//! ```
//! Offsets in the block table count from `d`. Header and blocks carry their own blake3, so that a reader who needs
//! one block checks that block and no more. Modes are stored in kernel order and read straight into place.

use super::codec;
use super::header::{BlockData, BlockKind, Model, ModelHeader, PressureLimit};
use super::selection::ModelError;
use crate::difference::FieldDifference;
use crate::halfwidths::HalfWidths;
use crate::kernel::{Modes, Shape};
use crate::learned::LearnedMap;
use crate::snapshots::RegimeKind;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::io::{Read, Seek, SeekFrom};
use std::sync::Arc;
use thiserror::Error;

/// First bytes of a model file.
pub const MAGIC: [u8; 8] = *b"SOFTTWIN";
/// Version of the layout.
pub const VERSION: u32 = 2;
/// Largest model file: 4 GiB.
pub const MAX_MODEL_BYTES: u64 = 4 << 30;
const ALIGN: usize = 64;
const TRAILER: u64 = 32;

/// Description of files that are not models but likely to be passed.
fn kind(found: &[u8]) -> &'static str {
    match found {
        [0x89, b'M', b'C', b'A', b'P', ..] => " (a recording: see softtwin draw, softtwin replay)",
        _ => "",
    }
}

/// Why a model file was refused.
#[derive(Debug, Error)]
#[allow(missing_docs)] // the messages say what the values are
pub enum ModelFileError {
    /// Not one of ours.
    #[error("not a model file: expected it to begin with {:?}, found {:?}{}", MAGIC.escape_ascii().to_string(), found.escape_ascii().to_string(), kind(found))]
    Foreign { found: Vec<u8> },
    /// Another version of the layout.
    #[error(
        "the model file has version {found}, expected {VERSION}; train the model again: `softtwin train`"
    )]
    Version { found: u32 },
    /// Shorter than it says.
    #[error("the model file is truncated: {what} needs {expected} bytes, found {found}; copy it again")]
    Truncated { what: String, expected: u64, found: u64 },
    /// Something that could be read for ever.
    #[error("expected a model file, found a folder, device or pipe")]
    NoFile,
    /// Longer than any model.
    #[error("expected a model file of at most {MAX_MODEL_BYTES} bytes, found {found}")]
    TooLarge { found: u64 },
    /// A checksum does not match.
    #[error("the model file is damaged: {what} has blake3 {found}, expected {expected}; copy it again")]
    Damaged { what: String, expected: String, found: String },
    /// The header cannot be understood although its checksum matches, or contradicts itself.
    #[error("the model file's header is not valid: {0}")]
    Header(String),
    /// The selection does not fit the model.
    #[error(transparent)]
    Selection(#[from] ModelError),
    /// The bytes could not be read.
    #[error("reading the model: {0}")]
    Io(#[from] std::io::Error),
}

/// Place and content of a block.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlockEntry {
    /// What the block holds.
    pub kind: BlockKind,
    /// How its numbers are stored.
    pub encoding: Encoding,
    /// First byte, counted from the first block.
    pub offset: u64,
    /// Length in bytes.
    pub bytes: u64,
    /// blake3 of its bytes.
    pub hash: [u8; 32],
}

/// Number format of a block.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Encoding {
    /// 32-bit floats.
    F32,
    /// 32-bit unsigned integers.
    U32,
    /// Modes in kernel order.
    Modes {
        /// Bits of each mode.
        bits: Vec<u8>,
        /// Step of each mode; 1 for f32.
        steps: Vec<f64>,
    },
    /// A record, encoded as the header is.
    Record,
}

#[derive(Debug, Serialize, Deserialize)]
struct FileHeader<H> {
    blocks: Vec<BlockEntry>,
    model: H,
}

impl Model {
    /// Identifies the model's predictions: hash of the file without half-widths, observables and limit of the pressure.
    ///
    /// # Errors
    /// [`ModelFileError`], as [`Model::to_bytes`].
    pub fn prediction_hash(&self) -> Result<[u8; 32], ModelFileError> {
        let mut bare = self.clone();
        for regime in &mut bare.header.regimes {
            regime.halfwidths = HalfWidths { coverage: regime.halfwidths.coverage, ..HalfWidths::default() };
            regime.local_halfwidths = None;
        }
        bare.header.limit = None;
        bare.blocks.retain(|(kind, _)| *kind != BlockKind::Observables);
        Ok(*blake3::hash(&bare.to_bytes()?).as_bytes())
    }

    /// The value of a record; `None` if the model has none.
    ///
    /// # Errors
    /// [`ModelFileError::Header`] when its bytes are not those of the type.
    pub fn record<T: DeserializeOwned>(&self, kind: BlockKind) -> Result<Option<T>, ModelFileError> {
        let bytes = self.blocks.iter().find_map(|(k, data)| match data {
            BlockData::Record(bytes) if *k == kind => Some(bytes),
            _ => None,
        });
        let refused = |reason| ModelFileError::Header(format!("block {kind:?}: {reason}"));
        bytes.map(|bytes| codec::decode(bytes)).transpose().map_err(refused)
    }

    /// Puts a record into the model in place of one of its kind.
    ///
    /// # Errors
    /// [`ModelFileError::Header`] when it is too large.
    pub fn set_record(&mut self, kind: BlockKind, value: &impl Serialize) -> Result<(), ModelFileError> {
        let bytes = codec::encode(value).map_err(ModelFileError::Header)?;
        self.blocks.retain(|(k, _)| *k != kind);
        self.blocks.push((kind, BlockData::Record(bytes)));
        Ok(())
    }

    /// The whole file as bytes. Cost `O(bytes)`.
    ///
    /// # Errors
    /// [`ModelFileError::Header`] when the header contradicts itself or is too large to be read back.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ModelFileError> {
        self.header.check().map_err(ModelFileError::Header)?;
        let (mut table, mut data) = (Vec::new(), Vec::new());
        let regimes = self.header.regimes.iter();
        let differences: Vec<(RegimeKind, &FieldDifference)> =
            regimes.filter_map(|regime| Some((regime.kind, regime.difference.as_ref()?))).collect();
        let mut further = Vec::new();
        if !differences.is_empty() {
            let bytes = codec::encode(&differences).map_err(ModelFileError::Header)?;
            further.push((BlockKind::Difference, BlockData::Record(bytes)));
        }
        if let Some(limit) = &self.header.limit {
            let bytes = codec::encode(limit).map_err(ModelFileError::Header)?;
            further.push((BlockKind::Limit, BlockData::Record(bytes)));
        }
        if let Some(learned) = &self.header.learned {
            let bytes = codec::encode(&**learned).map_err(ModelFileError::Header)?;
            further.push((BlockKind::Learned, BlockData::Record(bytes)));
        }
        for (kind, block) in self.blocks.iter().chain(&further) {
            data.resize(data.len().next_multiple_of(ALIGN), 0);
            let (encoding, bytes) = block.encoded();
            table.push(BlockEntry {
                kind: *kind,
                encoding,
                offset: data.len() as u64,
                bytes: bytes.len() as u64,
                hash: *blake3::hash(&bytes).as_bytes(),
            });
            data.extend_from_slice(&bytes);
        }
        let header = FileHeader { blocks: table, model: &self.header };
        let header = codec::encode(&header).map_err(ModelFileError::Header)?;
        let mut out = Vec::with_capacity(2 * ALIGN + header.len() + data.len() + TRAILER as usize);
        out.extend(MAGIC);
        out.extend(VERSION.to_le_bytes());
        out.extend([0; 4]);
        out.extend((header.len() as u64).to_le_bytes());
        out.extend(blake3::hash(&header).as_bytes());
        out.resize(ALIGN, 0);
        out.extend(&header);
        out.resize(out.len().next_multiple_of(ALIGN), 0);
        out.extend(&data);
        let trailer = *blake3::hash(&out).as_bytes();
        out.extend(trailer);
        Ok(out)
    }
}

impl BlockData {
    /// Bytes in a file.
    pub fn byte_count(&self) -> usize {
        match self {
            Self::F32(values) => 4 * values.len(),
            Self::U32(values) => 4 * values.len(),
            Self::Modes(modes) => modes.bytes().len(),
            Self::Record(bytes) => bytes.len(),
        }
    }

    fn encoded(&self) -> (Encoding, Cow<'_, [u8]>) {
        match self {
            Self::F32(values) => {
                (Encoding::F32, values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>().into())
            }
            Self::U32(values) => {
                (Encoding::U32, values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>().into())
            }
            Self::Modes(modes) => {
                let (bits, steps) = (modes.bits().to_vec(), modes.steps().to_vec());
                (Encoding::Modes { bits, steps }, modes.bytes().into())
            }
            Self::Record(bytes) => (Encoding::Record, bytes.as_slice().into()),
        }
    }
}

/// A model file opened but not loaded: the header is read and checked, blocks are read when asked for.
#[derive(Debug)]
pub struct ModelReader<R> {
    reader: R,
    header: FileHeader<ModelHeader>,
    data_start: u64,
    hash: [u8; TRAILER as usize],
}

impl<'a> ModelReader<std::io::Cursor<&'a [u8]>> {
    /// Reader of a file in memory, its checksum verified.
    pub(crate) fn of_bytes(bytes: &'a [u8]) -> Result<Self, ModelFileError> {
        let reader = Self::open(std::io::Cursor::new(bytes))?;
        let content = &bytes[..bytes.len() - TRAILER as usize]; // `open` saw that the trailer fits
        verify("the file", &bytes[content.len()..], content)?;
        Ok(reader)
    }
}

impl<R: Read + Seek> ModelReader<R> {
    /// Reads and checks preamble and header. Never allocates more than the file is long, which is at most [`MAX_MODEL_BYTES`].
    pub fn open(mut reader: R) -> Result<Self, ModelFileError> {
        let length = reader.seek(SeekFrom::End(0))?;
        if length > MAX_MODEL_BYTES {
            return Err(ModelFileError::TooLarge { found: length });
        }
        reader.seek(SeekFrom::Start(0))?;
        let mut preamble = [0; ALIGN];
        let available = (ALIGN as u64).min(length) as usize;
        reader.read_exact(&mut preamble[..available])?;
        if available < MAGIC.len() || preamble[..8] != MAGIC {
            return Err(ModelFileError::Foreign { found: preamble[..available.min(8)].to_vec() });
        }
        fits("the preamble", ALIGN as u64 + TRAILER, length)?;
        let version = u32::from_le_bytes([preamble[8], preamble[9], preamble[10], preamble[11]]);
        if version != VERSION {
            return Err(ModelFileError::Version { found: version });
        }
        let mut word = [0; 8];
        word.copy_from_slice(&preamble[16..24]);
        let header_bytes = u64::from_le_bytes(word);
        let end = (ALIGN as u64 + TRAILER).saturating_add(header_bytes);
        fits("the header", end, length)?;
        if header_bytes > codec::MAX_HEADER_BYTES as u64 {
            return Err(ModelFileError::Header(format!(
                "{header_bytes} bytes, at most {}",
                codec::MAX_HEADER_BYTES
            )));
        }
        let mut bytes = vec![0; header_bytes as usize];
        reader.read_exact(&mut bytes)?;
        verify("the header", &preamble[24..56], &bytes)?;
        let header: FileHeader<ModelHeader> = codec::decode(&bytes).map_err(ModelFileError::Header)?;
        header.model.check().map_err(ModelFileError::Header)?;
        let data_start = (ALIGN as u64 + header_bytes).next_multiple_of(ALIGN as u64);
        let all = header.blocks.iter().fold(0, |all: u64, block| all.saturating_add(block.bytes));
        fits("all blocks", all.saturating_add(data_start + TRAILER), length)?;
        for block in &header.blocks {
            block.check(&header.model).map_err(ModelFileError::Header)?;
            let needed = block.bytes.saturating_add(block.offset).saturating_add(data_start + TRAILER);
            fits(&format!("block {:?}", block.kind), needed, length)?;
        }
        let mut hash = [0; TRAILER as usize];
        reader.seek(SeekFrom::Start(length - TRAILER))?; // `fits` saw that the trailer fits
        reader.read_exact(&mut hash)?;
        let mut opened = Self { reader, header, data_start, hash };
        opened.read_differences()?;
        opened.read_limit()?;
        opened.read_learned()?;
        Ok(opened)
    }

    /// Puts the limit of the pressure into the header.
    fn read_limit(&mut self) -> Result<(), ModelFileError> {
        if let Some(limit) = self.read_record::<PressureLimit>(BlockKind::Limit)? {
            let is_sound = limit.pressure_mpa.is_finite() && limit.stretch >= 1.0;
            let problem = "the limit of the pressure is no number, or no stretch is possible";
            self.header.model.limit =
                Some(Some(limit).filter(|_| is_sound).ok_or_else(|| ModelFileError::Header(problem.into()))?);
        }
        Ok(())
    }

    /// Puts the map of a model of measurements into the header.
    fn read_learned(&mut self) -> Result<(), ModelFileError> {
        self.header.model.learned = self.read_record::<LearnedMap>(BlockKind::Learned)?.map(Arc::new);
        self.header.model.check().map_err(ModelFileError::Header)
    }

    /// A record that is part of the header in memory.
    fn read_record<T: DeserializeOwned>(&mut self, kind: BlockKind) -> Result<Option<T>, ModelFileError> {
        let entry = self.header.blocks.iter().find(|block| block.kind == kind);
        let Some(entry) = entry.cloned() else { return Ok(None) };
        let mut bytes = vec![0; entry.bytes as usize]; // within the file's length: checked by `open`
        self.fill(&entry, &mut bytes)?;
        codec::decode(&bytes).map(Some).map_err(ModelFileError::Header)
    }

    /// Puts the measured differences into the header, so that every part of the file that is loaded has them.
    fn read_differences(&mut self) -> Result<(), ModelFileError> {
        let found = self.read_record::<Vec<(RegimeKind, FieldDifference)>>(BlockKind::Difference)?;
        let Some(found) = found else { return Ok(()) };
        for (kind, difference) in found {
            let mut regimes = self.header.model.regimes.iter_mut();
            let regime = regimes.find(|regime| regime.kind == kind).ok_or_else(|| {
                ModelFileError::Header(format!(
                    "a measured difference of the {} regime, which the model does not have",
                    kind.name()
                ))
            })?;
            regime.difference = Some(difference);
        }
        self.header.model.check().map_err(ModelFileError::Header)
    }

    /// The hash at the file's end, whose first half is in the headers of its fields.
    pub fn hash(&self) -> [u8; 32] {
        self.hash
    }

    /// The model's header.
    pub fn header(&self) -> &ModelHeader {
        &self.header.model
    }

    /// Table of blocks.
    pub fn blocks(&self) -> &[BlockEntry] {
        &self.header.blocks
    }

    /// Reads blocks and verifies their checksums; modes go into one piece of memory.
    pub fn read_blocks(
        &mut self,
        entries: &[BlockEntry],
    ) -> Result<Vec<(BlockKind, BlockData)>, ModelFileError> {
        let nodes = self.header.model.node_count;
        let mut read: Vec<Option<(BlockKind, BlockData)>> = entries.iter().map(|_| None).collect();
        let (mut shapes, mut of_modes) = (Vec::new(), Vec::new());
        for (index, entry) in entries.iter().enumerate() {
            if let Encoding::Modes { bits, steps } = &entry.encoding {
                shapes.push(Shape { nodes, bits, steps });
                of_modes.push(index);
                continue;
            }
            let mut bytes = vec![0; entry.bytes as usize]; // within the file's length: checked by `open`
            self.fill(entry, &mut bytes)?;
            if entry.encoding == Encoding::Record {
                read[index] = Some((entry.kind, BlockData::Record(bytes)));
                continue;
            }
            let words = bytes.chunks_exact(4).map(|b| [b[0], b[1], b[2], b[3]]);
            let data = match entry.encoding {
                Encoding::U32 => BlockData::U32(words.map(u32::from_le_bytes).collect()),
                _ => BlockData::F32(words.map(f32::from_le_bytes).collect()),
            };
            read[index] = Some((entry.kind, data));
        }
        let modes = Modes::filled(&shapes, |shape, bytes| self.fill(&entries[of_modes[shape]], bytes))?;
        for (index, modes) in of_modes.into_iter().zip(modes) {
            let kind = entries[index].kind;
            if let Some(found) = modes.not_finite() {
                return Err(ModelFileError::Header(format!("block {kind:?}: {found:?}")));
            }
            read[index] = Some((kind, BlockData::Modes(modes)));
        }
        Ok(read.into_iter().flatten().collect())
    }

    fn fill(&mut self, entry: &BlockEntry, bytes: &mut [u8]) -> Result<(), ModelFileError> {
        self.reader.seek(SeekFrom::Start(self.data_start + entry.offset))?;
        self.reader.read_exact(bytes)?;
        verify(&format!("block {:?}", entry.kind), &entry.hash, bytes)
    }
}

impl BlockEntry {
    /// Refuses a block that the model has no use for, or whose bytes are not those of its encoding.
    fn check(&self, model: &ModelHeader) -> Result<(), String> {
        let fields = model.fields.len();
        if let BlockKind::Mean { field, .. } | BlockKind::Modes { field, .. } | BlockKind::HalfWidth { field } =
            self.kind
            && field as usize >= fields
        {
            return Err(format!(
                "block {:?}: expected one of the {fields} fields, counted from 0",
                self.kind
            ));
        }
        let fits = match &self.encoding {
            Encoding::F32 | Encoding::U32 => self.bytes.is_multiple_of(4),
            Encoding::Record => self.bytes <= codec::MAX_HEADER_BYTES as u64,
            Encoding::Modes { bits, steps } => {
                let shape = Shape { nodes: model.node_count, bits, steps };
                self.bytes == shape.bytes() as u64 && shape.is_sound()
            }
        };
        let is_modes = matches!(self.encoding, Encoding::Modes { .. });
        let is_record = self.encoding == Encoding::Record;
        if fits
            && is_modes == matches!(self.kind, BlockKind::Modes { .. })
            && is_record == self.kind.is_record()
        {
            return Ok(());
        }
        Err(format!("block {:?}: {} bytes are not those of its encoding", self.kind, self.bytes))
    }
}

fn fits(what: &str, expected: u64, found: u64) -> Result<(), ModelFileError> {
    if expected <= found {
        return Ok(());
    }
    Err(ModelFileError::Truncated { what: what.to_owned(), expected, found })
}

fn verify(what: &str, expected: &[u8], content: &[u8]) -> Result<(), ModelFileError> {
    let found = blake3::hash(content);
    if found.as_bytes() == expected {
        return Ok(());
    }
    let hex = |bytes: &[u8]| bytes.iter().take(8).map(|b| format!("{b:02x}")).collect::<String>();
    Err(ModelFileError::Damaged {
        what: what.to_owned(),
        expected: hex(expected),
        found: hex(found.as_bytes()),
    })
}
