//! The header: `{'descr': '<f4', 'fortran_order': False, 'shape': (146, 25022, 5), }`.

use crate::error::{Diagnostic, FormatError};
use std::io::{self, Read};
use std::path::Path;

const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// NumPy itself never writes longer headers for plain arrays.
const MAX_TEXT: usize = 10_000;
const MAX_AXES: usize = 32;

/// Type of the stored numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    F32,
    F64,
    /// Read only: index arrays, whose every value an f64 holds exactly.
    I32,
}

impl Element {
    pub const fn bytes(self) -> usize {
        match self {
            Self::F32 | Self::I32 => 4,
            Self::F64 => 8,
        }
    }

    const fn descr(self) -> &'static str {
        match self {
            Self::F32 => "<f4",
            Self::F64 => "<f8",
            Self::I32 => "<i4",
        }
    }
}

/// A header that has been checked against the file's length.
pub struct Header {
    pub element: Element,
    pub shape: Vec<usize>,
    pub elements: usize,
}

/// An error without the path of its file.
pub enum Refusal {
    Io(io::Error),
    Content(Diagnostic),
}

impl Refusal {
    pub fn at(self, path: &Path) -> FormatError {
        match self {
            Self::Io(e) => FormatError::read(path, e),
            Self::Content(diagnostic) => FormatError::one(path, diagnostic),
        }
    }

    fn new(place: &str, expected: impl std::fmt::Display, found: impl std::fmt::Display) -> Self {
        Self::Content(Diagnostic::new(place, expected, found))
    }
}

impl From<io::Error> for Refusal {
    fn from(e: io::Error) -> Self {
        match e.kind() {
            io::ErrorKind::UnexpectedEof => {
                Self::new("header", "a complete .npy header", "the end of the file")
            }
            _ => Self::Io(e),
        }
    }
}

impl Header {
    /// Reads the header of a file of `file_bytes` bytes and leaves `input` at the first value.
    pub fn read(input: &mut impl Read, file_bytes: u64) -> Result<Self, Refusal> {
        let (prefix, text) = read_text(input)?;
        let (element, shape) = parse(&text)?;
        let values = shape.iter().try_fold(1_u64, |n, axis| n.checked_mul(*axis as u64));
        let promised = values
            .and_then(|n| n.checked_mul(element.bytes() as u64))
            .and_then(|n| n.checked_add((prefix + text.len()) as u64));
        if promised != Some(file_bytes) {
            let expected =
                promised.map_or("a size below 2^64".into(), |n| format!("{n} bytes for shape {shape:?}"));
            return Err(Refusal::new("file length", expected, format!("{file_bytes} bytes")));
        }
        Ok(Self { element, elements: shape.iter().product(), shape })
    }
}

/// Magic, version and text: `(bytes before the text, text)`.
fn read_text(input: &mut impl Read) -> Result<(usize, String), Refusal> {
    let mut start = [0_u8; 8];
    input.read_exact(&mut start)?;
    if start[..6] != *MAGIC {
        return Err(Refusal::new("first bytes", "\\x93NUMPY (a .npy file)", format!("{:02x?}", &start[..6])));
    }
    let (prefix, length) = match start[6] {
        1 => {
            let mut bytes = [0_u8; 2];
            input.read_exact(&mut bytes)?;
            (10, u16::from_le_bytes(bytes) as usize)
        }
        2 | 3 => {
            let mut bytes = [0_u8; 4];
            input.read_exact(&mut bytes)?;
            (12, u32::from_le_bytes(bytes) as usize)
        }
        other => return Err(Refusal::new("format version", "1, 2 or 3", other)),
    };
    if length > MAX_TEXT {
        return Err(Refusal::new("header length", format!("at most {MAX_TEXT}"), length));
    }
    let mut bytes = vec![0_u8; length];
    input.read_exact(&mut bytes)?;
    let text =
        String::from_utf8(bytes).map_err(|_| Refusal::new("header", "text", "bytes that are no text"))?;
    Ok((prefix, text))
}

/// Type and shape from the text of the header.
fn parse(text: &str) -> Result<(Element, Vec<usize>), Refusal> {
    let inner = text.trim().strip_prefix('{').and_then(|t| t.strip_suffix('}'));
    let mut rest = inner.ok_or_else(|| Refusal::new("header", "{'descr': ..., }", text.trim()))?.trim();
    let (mut element, mut c_order, mut shape) = (None, false, None);
    while !rest.is_empty() {
        let (key, after) =
            rest.split_once(':').ok_or_else(|| Refusal::new("header", "'key': value", rest))?;
        let after = after.trim_start();
        let end = if after.starts_with('(') { after.find(')').map(|i| i + 1) } else { after.find(',') };
        let (value, after) = after.split_at(end.unwrap_or(after.len()));
        match key.trim().trim_matches(['\'', '"']) {
            "descr" => element = Some(parse_element(value)?),
            "fortran_order" => c_order = parse_order(value)?,
            "shape" => shape = Some(parse_shape(value)?),
            other => return Err(Refusal::new("header", "keys descr, fortran_order, shape", other)),
        }
        rest = after.trim_start().strip_prefix(',').unwrap_or(after).trim();
    }
    match (element, c_order, shape) {
        (Some(element), true, Some(shape)) => Ok((element, shape)),
        _ => Err(Refusal::new("header", "keys descr, fortran_order, shape", text.trim())),
    }
}

fn parse_element(value: &str) -> Result<Element, Refusal> {
    match value.trim().trim_matches(['\'', '"']) {
        "<f4" => Ok(Element::F32),
        "<f8" => Ok(Element::F64),
        "<i4" => Ok(Element::I32),
        other => Err(Refusal::new("descr", "'<f4', '<f8' or '<i4' (little-endian)", other)),
    }
}

fn parse_order(value: &str) -> Result<bool, Refusal> {
    match value.trim() {
        "False" => Ok(true),
        other => Err(Refusal::new("fortran_order", "False (save it with numpy.ascontiguousarray)", other)),
    }
}

fn parse_shape(value: &str) -> Result<Vec<usize>, Refusal> {
    let bad = || Refusal::new("shape", "a tuple of at most 32 whole numbers", value);
    let inner = value.trim().strip_prefix('(').and_then(|t| t.strip_suffix(')')).ok_or_else(bad)?;
    let axes = inner.split(',').map(str::trim).filter(|axis| !axis.is_empty());
    let shape = axes.map(|axis| axis.parse().map_err(|_| bad())).collect::<Result<Vec<usize>, _>>()?;
    if shape.len() > MAX_AXES { Err(bad()) } else { Ok(shape) }
}

/// The header NumPy would write: version 1, padded so that the values start at a multiple of 64 bytes.
pub fn compose(element: Element, shape: &[usize]) -> Vec<u8> {
    let axes: Vec<String> = shape.iter().map(usize::to_string).collect();
    let tuple = if axes.len() == 1 { format!("({},)", axes[0]) } else { format!("({})", axes.join(", ")) };
    let text = format!("{{'descr': '{}', 'fortran_order': False, 'shape': {tuple}, }}", element.descr());
    let total = (10 + text.len() + 1).next_multiple_of(64);
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    bytes.extend(((total - 10) as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.resize(total - 1, b' ');
    bytes.push(b'\n');
    bytes
}
