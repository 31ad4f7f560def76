//! The model file: one file with everything a twin needs, readable in parts, refused when damaged.
//!
//! ```text
//! 0      magic "SOFTTWIN"                         8 bytes
//! 8      version, u32 little-endian               4
//! 12     zero                                     4
//! 16     header length h, u64 little-endian       8
//! 24     blake3 of the header                    32
//! 56     zero                                     8
//! 64     header: block table and model header     h   (codec.rs), from version 4 on what further.rs adds
//!        zeros up to a multiple of 64
//! d      blocks, each from a multiple of 64, little-endian, zeros between
//! end-32 blake3 of everything before             32
//! ```
//! Offsets in the block table count from `d`. Header and blocks carry their own blake3, so that a reader who needs
//! one block checks that block and no more.

use super::further::Further;
use super::header::{BlockData, BlockKind, Model, ModelHeader};
use super::selection::{ModelError, Selection};
use super::{codec, version2};
use crate::halfwidths::HalfWidths;
use serde::{Deserialize, Serialize};
use std::io::{Read, Seek, SeekFrom};
use thiserror::Error;

/// First bytes of a model file.
pub const MAGIC: [u8; 8] = *b"SOFTTWIN";
/// The newest version: parameters that move the undeformed mesh. Models without are written as [`FIXED_VERSION`].
pub const VERSION: u32 = 5;
/// Parameters, interpolants with derivatives. Models without are written as [`PLAIN_VERSION`].
pub const FIXED_VERSION: u32 = 4;
/// Pressure and gap, local half-widths.
pub const PLAIN_VERSION: u32 = 3;
/// The oldest version that it reads: pressure and gap. Models are made again in seconds, so older layouts are refused.
const OLDEST_VERSION: u32 = 2;
const ALIGN: usize = 64;
const TRAILER: u64 = 32;

/// What people mistake for a model.
fn kind(found: &[u8]) -> &'static str {
    match found {
        [0x89, b'M', b'C', b'A', b'P', ..] => " (a recording: see softtwin plot recording, softtwin replay)",
        _ => "",
    }
}

/// Why a model file was refused.
#[derive(Debug, Error)]
pub enum ModelFileError {
    /// Not one of ours.
    #[error("not a model file: expected it to begin with {:?}, found {:?}{}", MAGIC.escape_ascii().to_string(), found.escape_ascii().to_string(), kind(found))]
    Foreign {
        /// First bytes.
        found: Vec<u8>,
    },
    /// Written by an older or a newer program.
    #[error(
        "the model file has version {found}, expected {OLDEST_VERSION} to {VERSION}; {}",
        if *.found > VERSION { "update this program" } else { "train the model again: `softtwin train`" }
    )]
    Version {
        /// Version in the file.
        found: u32,
    },
    /// Shorter than it says.
    #[error("the model file is truncated: {what} needs {expected} bytes, found {found}; copy it again")]
    Truncated {
        /// Which part.
        what: String,
        /// Bytes needed.
        expected: u64,
        /// Bytes there are.
        found: u64,
    },
    /// A checksum does not match.
    #[error("the model file is damaged: {what} has blake3 {found}, expected {expected}; copy it again")]
    Damaged {
        /// Which part.
        what: String,
        /// Checksum in the file.
        expected: String,
        /// Checksum of the content.
        found: String,
    },
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

/// Where a block lies and what it holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BlockEntry {
    /// What it is.
    pub kind: BlockKind,
    /// Whether its values are f32; u32 otherwise.
    pub is_f32: bool,
    /// First byte, counted from the first block.
    pub offset: u64,
    /// Values, 4 bytes each.
    pub values: u64,
    /// blake3 of its bytes.
    pub hash: [u8; 32],
}

#[derive(Debug, Serialize, Deserialize)]
struct FileHeader<H> {
    blocks: Vec<BlockEntry>,
    model: H,
}

impl Model {
    /// What identifies the model's predictions, whatever its half-widths: a hash of the file without them.
    ///
    /// # Errors
    /// [`ModelFileError`], as [`Model::to_bytes`].
    pub fn prediction_hash(&self) -> Result<[u8; 32], ModelFileError> {
        let mut bare = self.clone();
        for regime in &mut bare.header.regimes {
            regime.halfwidths = HalfWidths { coverage: regime.halfwidths.coverage, ..HalfWidths::default() };
            regime.local_halfwidths = None;
        }
        Ok(*blake3::hash(&bare.to_bytes()?).as_bytes())
    }

    /// The whole file as bytes. Cost `O(bytes)`.
    ///
    /// # Errors
    /// [`ModelFileError::Header`] when the header contradicts itself or is too large to be read back.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ModelFileError> {
        self.header.check().map_err(ModelFileError::Header)?;
        let (mut table, mut data) = (Vec::new(), Vec::new());
        for (kind, block) in &self.blocks {
            data.resize(data.len().next_multiple_of(ALIGN), 0);
            let bytes = block.to_le_bytes();
            table.push(BlockEntry {
                kind: *kind,
                is_f32: matches!(block, BlockData::F32(_)),
                offset: data.len() as u64,
                values: block.len() as u64,
                hash: *blake3::hash(&bytes).as_bytes(),
            });
            data.extend(bytes);
        }
        let header = FileHeader { blocks: table, model: &self.header };
        let moving = header.blocks.iter().any(|block| matches!(block.kind, BlockKind::UndeformedBy { .. }));
        let further = Further::of(&self.header);
        let (version, header) = match further.is_empty() {
            true => (PLAIN_VERSION, codec::encode(&header)),
            false if moving => (VERSION, codec::encode(&(header, further))),
            false => (FIXED_VERSION, codec::encode(&(header, further))),
        };
        let header = header.map_err(ModelFileError::Header)?;
        let mut out = Vec::with_capacity(2 * ALIGN + header.len() + data.len() + TRAILER as usize);
        out.extend(MAGIC);
        out.extend(version.to_le_bytes());
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

    /// The whole model from bytes, every checksum verified.
    ///
    /// # Errors
    /// [`ModelFileError`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModelFileError> {
        let mut reader = ModelReader::open(std::io::Cursor::new(bytes))?;
        let body = &bytes[..bytes.len() - TRAILER as usize]; // `open` saw that the trailer fits
        verify("the file", &bytes[body.len()..], body)?;
        reader.load(&Selection::default())
    }
}

impl BlockData {
    /// Number of values.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::U32(values) => values.len(),
        }
    }

    /// True when there is no value.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn to_le_bytes(&self) -> Vec<u8> {
        match self {
            Self::F32(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::U32(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }
}

/// A model file opened but not loaded: the header is read and checked, blocks are read when asked for.
#[derive(Debug)]
pub struct ModelReader<R> {
    reader: R,
    header: FileHeader<ModelHeader>,
    data_start: u64,
}

impl<R: Read + Seek> ModelReader<R> {
    /// Reads and checks preamble and header. Never allocates more than the file is long.
    ///
    /// # Errors
    /// [`ModelFileError`].
    pub fn open(mut reader: R) -> Result<Self, ModelFileError> {
        let length = reader.seek(SeekFrom::End(0))?;
        reader.seek(SeekFrom::Start(0))?;
        let mut preamble = [0; ALIGN];
        let available = (ALIGN as u64).min(length) as usize;
        reader.read_exact(&mut preamble[..available])?;
        if available < MAGIC.len() || preamble[..8] != MAGIC {
            return Err(ModelFileError::Foreign { found: preamble[..available.min(8)].to_vec() });
        }
        fits("the preamble", ALIGN as u64 + TRAILER, length)?;
        let version = u32::from_le_bytes([preamble[8], preamble[9], preamble[10], preamble[11]]);
        if !(OLDEST_VERSION..=VERSION).contains(&version) {
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
        let header = decode(version, &bytes).map_err(ModelFileError::Header)?;
        header.model.check().map_err(ModelFileError::Header)?;
        let data_start = (ALIGN as u64 + header_bytes).next_multiple_of(ALIGN as u64);
        for block in &header.blocks {
            belongs(block.kind, header.model.fields.len()).map_err(ModelFileError::Header)?;
            let needed = block
                .values
                .saturating_mul(4)
                .saturating_add(block.offset)
                .saturating_add(data_start + TRAILER);
            fits(&format!("block {:?}", block.kind), needed, length)?;
        }
        Ok(Self { reader, header, data_start })
    }

    /// The model's header.
    pub fn header(&self) -> &ModelHeader {
        &self.header.model
    }

    /// Which blocks there are and where.
    pub fn blocks(&self) -> &[BlockEntry] {
        &self.header.blocks
    }

    /// Reads one block and verifies its checksum.
    ///
    /// # Errors
    /// [`ModelFileError`].
    pub fn read_block(&mut self, entry: &BlockEntry) -> Result<BlockData, ModelFileError> {
        self.reader.seek(SeekFrom::Start(self.data_start + entry.offset))?;
        let mut bytes = vec![0; entry.values as usize * 4]; // within the file's length: checked by `open`
        self.reader.read_exact(&mut bytes)?;
        verify(&format!("block {:?}", entry.kind), &entry.hash, &bytes)?;
        let words = bytes.chunks_exact(4).map(|b| [b[0], b[1], b[2], b[3]]);
        Ok(match entry.is_f32 {
            true => BlockData::F32(words.map(f32::from_le_bytes).collect()),
            false => BlockData::U32(words.map(u32::from_le_bytes).collect()),
        })
    }

    /// Loads what a selection needs: its fields (and the coordinates a derived magnitude needs), undeformed mesh,
    /// surface. Nodes are picked when the predictor is made.
    ///
    /// # Errors
    /// [`ModelFileError`].
    pub fn load(&mut self, selection: &Selection) -> Result<Model, ModelFileError> {
        let header = self.header.model.clone();
        let mut fields = header.resolve_fields(selection.fields.as_deref())?;
        header.resolve_nodes(&selection.nodes)?;
        let derived: Vec<usize> =
            fields.iter().filter_map(|f| header.fields[*f].magnitude_of).flatten().collect();
        fields.extend(derived);
        let needed = |kind: &BlockKind| match kind {
            BlockKind::Mean { field, .. } | BlockKind::Modes { field, .. } => {
                fields.contains(&(*field as usize))
            }
            BlockKind::Undeformed(_) | BlockKind::UndeformedBy { .. } | BlockKind::Surface => true,
        };
        let entries: Vec<BlockEntry> =
            self.header.blocks.iter().filter(|b| needed(&b.kind)).cloned().collect();
        let mut blocks = Vec::with_capacity(entries.len());
        for entry in entries {
            blocks.push((entry.kind, self.read_block(&entry)?));
        }
        Ok(Model { header, blocks })
    }
}

fn decode(version: u32, bytes: &[u8]) -> Result<FileHeader<ModelHeader>, String> {
    if version >= FIXED_VERSION {
        let (mut header, further): (FileHeader<ModelHeader>, Further) = codec::decode(bytes)?;
        further.add_to(&mut header.model)?;
        return Ok(header);
    }
    if version == PLAIN_VERSION {
        return codec::decode(bytes);
    }
    let FileHeader { blocks, model } = codec::decode::<FileHeader<version2::Header>>(bytes)?;
    Ok(FileHeader { blocks, model: model.into() })
}

/// A block of a field that is not there would be passed over, and so would its damage.
fn belongs(kind: BlockKind, fields: usize) -> Result<(), String> {
    match kind {
        BlockKind::Mean { field, .. } | BlockKind::Modes { field, .. } if field as usize >= fields => {
            Err(format!("block {kind:?}: expected one of the {fields} fields, counted from 0"))
        }
        _ => Ok(()),
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
