//! Bytes of a `DataArray`: base64, length headers and zlib blocks, each bounded by what the file can hold.

use flate2::bufread::ZlibDecoder;
use std::io::Read;

/// How a file writes its arrays (attributes of `VTKFile`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Coding {
    /// Most significant byte first.
    pub big_endian: bool,
    /// Lengths take 8 bytes instead of 4.
    pub long_header: bool,
    /// Arrays are zlib blocks.
    pub zlib: bool,
}

/// An element type of VTK's arrays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Element {
    Float(usize),
    Int(usize),
    UInt(usize),
}

impl Element {
    pub fn named(name: &str) -> Option<Self> {
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

    pub fn size(self) -> usize {
        match self {
            Self::Float(n) | Self::Int(n) | Self::UInt(n) => n,
        }
    }

    /// The value of one element; integers above 2^53 lose digits, which no index in memory reaches.
    fn value(self, bytes: &[u8], big_endian: bool) -> f64 {
        let mut wide = [0_u8; 8];
        for (i, byte) in bytes.iter().enumerate() {
            wide[if big_endian { bytes.len() - 1 - i } else { i }] = *byte;
        }
        let word = u64::from_le_bytes(wide);
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

/// Decodes at most `expected` elements of an encoded block; an error is what was found instead.
pub(super) fn elements(
    block: &[u8],
    element: Element,
    coding: Coding,
    expected: usize,
) -> Result<Vec<f64>, String> {
    let wanted = expected.checked_mul(element.size()).ok_or("a size beyond any memory")?;
    let raw = if coding.zlib { inflate(block, coding, wanted)? } else { plain(block, coding, wanted)? };
    Ok(raw.chunks_exact(element.size()).map(|bytes| element.value(bytes, coding.big_endian)).collect())
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
    let mut out = Vec::new(); // grows with what is really there, whatever the header promises
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
    let element = Element::UInt(if coding.long_header { 8 } else { 4 });
    let (head, rest) = bytes.split_at_checked(element.size()).ok_or("no room for a length header")?;
    let mut wide = [0_u8; 8];
    for (i, byte) in head.iter().enumerate() {
        wide[if coding.big_endian { head.len() - 1 - i } else { i }] = *byte;
    }
    let value = usize::try_from(u64::from_le_bytes(wide)).map_err(|_| "a size beyond any memory")?;
    Ok((value, rest))
}

/// Base64 (RFC 4648), blanks skipped. A padded group may stand in the middle, because VTK encodes the header of
/// compressed data apart from the data. Stops at the first byte that is neither; the caller checks lengths.
pub(super) fn base64(text: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(text.len() / 4 * 3);
    let (mut word, mut digits, mut padding) = (0_u32, 0, 0);
    for byte in text.iter().filter(|b| !b.is_ascii_whitespace()) {
        let digit = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            b'=' => {
                padding += 1;
                0
            }
            _ => break,
        };
        word = word << 6 | u32::from(digit);
        digits += 1;
        if digits == 4 {
            let bytes = word.to_be_bytes();
            out.extend_from_slice(&bytes[1..4 - padding.min(2)]);
            (word, digits, padding) = (0, 0, 0);
        }
    }
    out
}
