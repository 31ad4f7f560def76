//! Bytes of a `DataArray`: base64, length headers and zlib blocks, each bounded by what the file can hold.

use base64::Engine;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use flate2::bufread::ZlibDecoder;
use std::io::Read;

/// Base64 without padding, for the end of truncated data.
const PADDED_OR_NOT: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_allow_trailing_bits(true)
        .with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Encoding of a file's arrays (attributes of `VTKFile`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Coding {
    /// Most significant byte first.
    pub(crate) big_endian: bool,
    /// Lengths take 8 bytes instead of 4.
    pub(crate) long_header: bool,
    /// Arrays in zlib blocks.
    pub(crate) zlib: bool,
}

/// Element type of VTK's arrays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Element {
    Float(usize),
    Int(usize),
    UInt(usize),
}

impl Element {
    pub(crate) fn named(name: &str) -> Option<Self> {
        let (kind, bits): (fn(usize) -> Self, &str) = if let Some(bits) = name.strip_prefix("Float") {
            (Self::Float, bits)
        } else if let Some(bits) = name.strip_prefix("UInt") {
            (Self::UInt, bits)
        } else {
            (Self::Int, name.strip_prefix("Int")?)
        };
        let bytes = match bits {
            "8" => 1,
            "16" => 2,
            "32" => 4,
            "64" => 8,
            _ => return None,
        };
        let element = kind(bytes);
        (!matches!(element, Self::Float(1 | 2))).then_some(element)
    }

    pub(crate) fn size(self) -> usize {
        match self {
            Self::Float(n) | Self::Int(n) | Self::UInt(n) => n,
        }
    }

    /// Values of an array.
    pub(crate) fn values(self, bytes: &[u8], big_endian: bool) -> Vec<f64> {
        bytes.chunks_exact(self.size()).map(|element| self.value(element, big_endian)).collect()
    }

    /// Value of one element; integers above 2^53 lose digits.
    fn value(self, bytes: &[u8], big_endian: bool) -> f64 {
        let word = word(bytes, big_endian);
        match self {
            Self::Float(4) => f64::from(f32::from_bits(word as u32)),
            Self::Float(_) => f64::from_bits(word),
            Self::UInt(_) => word as f64,
            Self::Int(n) => {
                let unused = 64 - 8 * n as u32;
                ((word << unused) as i64 >> unused) as f64
            }
        }
    }
}

/// Decodes at most `expected` elements of an encoded block; an error describes the content found.
pub(super) fn elements(
    block: &[u8],
    element: Element,
    coding: Coding,
    expected: usize,
) -> Result<Vec<f64>, String> {
    let wanted = expected.checked_mul(element.size()).ok_or("a size beyond any memory")?;
    let raw = if coding.zlib { inflate(block, coding, wanted)? } else { plain(block, coding, wanted)? };
    Ok(element.values(&raw, coding.big_endian))
}

fn plain(block: &[u8], coding: Coding, wanted: usize) -> Result<Vec<u8>, String> {
    let (length, rest) = length(block, coding)?;
    if length != wanted {
        return Err(format!("{length} bytes"));
    }
    rest.get(..wanted).map(<[u8]>::to_vec).ok_or_else(|| format!("only {} of {wanted} bytes", rest.len()))
}

/// Blocks of zlib: their number, the size of each when inflated, that of the last, then every compressed size.
fn inflate(block: &[u8], coding: Coding, wanted: usize) -> Result<Vec<u8>, String> {
    let (count, rest) = length(block, coding)?;
    let (size, rest) = length(rest, coding)?;
    let (last, mut sizes) = length(rest, coding)?;
    let header = if coding.long_header { 8 } else { 4 };
    let mut data = count
        .checked_mul(header)
        .and_then(|bytes| sizes.get(bytes..))
        .ok_or_else(|| format!("{count} blocks announced in {} bytes", sizes.len()))?;
    let total = match (count, last) {
        (0, _) => Some(0),
        (_, 0) => count.checked_mul(size),
        _ => (count - 1).checked_mul(size).and_then(|bytes| bytes.checked_add(last)),
    };
    if total != Some(wanted) {
        return Err(total.map_or_else(|| "a size beyond any memory".into(), |bytes| format!("{bytes} bytes")));
    }
    let mut out = Vec::new(); // grows with the data, not with the header
    for index in 0..count {
        let (compressed, next) = length(sizes, coding)?;
        sizes = next;
        let part = data.get(..compressed).ok_or_else(|| format!("block {index} cut short"))?;
        data = &data[compressed..];
        let bound = (wanted - out.len()) as u64;
        ZlibDecoder::new(part)
            .take(bound)
            .read_to_end(&mut out)
            .map_err(|e| format!("block {index} that is no zlib stream ({e})"))?;
    }
    if out.len() == wanted { Ok(out) } else { Err(format!("only {} of {wanted} bytes", out.len())) }
}

fn length(bytes: &[u8], coding: Coding) -> Result<(usize, &[u8]), String> {
    let width = if coding.long_header { 8 } else { 4 };
    let (head, rest) = bytes.split_at_checked(width).ok_or("too few bytes for a length header")?;
    let value = usize::try_from(word(head, coding.big_endian)).map_err(|_| "a size beyond any memory")?;
    Ok((value, rest))
}

/// Integer of at most 8 bytes.
fn word(bytes: &[u8], big_endian: bool) -> u64 {
    let mut wide = [0_u8; 8];
    for (i, byte) in bytes.iter().enumerate() {
        wide[if big_endian { bytes.len() - 1 - i } else { i }] = *byte;
    }
    u64::from_le_bytes(wide)
}

/// Base64 without its white space. VTK encodes the length header of compressed data apart from the data, so padding may
/// occur in the middle: each padded part is decoded by itself. Ends at the first byte that is not base64; the caller
/// checks lengths.
pub(super) fn base64(text: &[u8]) -> Vec<u8> {
    let digits = |byte: &u8| byte.is_ascii_alphanumeric() || b"+/=".contains(byte);
    let text: Vec<u8> =
        text.iter().filter(|byte| !byte.is_ascii_whitespace()).copied().take_while(digits).collect();
    let mut out = Vec::with_capacity(text.len() / 4 * 3);
    for part in text.chunk_by(|before, after| *before != b'=' || *after == b'=') {
        if PADDED_OR_NOT.decode_vec(part, &mut out).is_err() {
            break;
        }
    }
    out
}
