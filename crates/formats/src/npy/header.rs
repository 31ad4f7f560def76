//! Header: `{'descr': '<f4', 'fortran_order': False, 'shape': (146, 25022, 5), }`.

use crate::error::{Diagnostic, FormatError};
use std::io::{ErrorKind, Read};
use std::path::Path;

const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// Longest header; NumPy's headers of plain arrays are shorter.
const MAX_TEXT: usize = 10_000;
const MAX_AXES: usize = 32;

/// Type of the stored numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Element {
    F32,
    F64,
    /// Read only: index arrays, whose every value (of I64: below 2^53) an f64 holds exactly.
    I32,
    I64,
}

impl Element {
    pub(crate) const fn bytes(self) -> usize {
        match self {
            Self::F32 | Self::I32 => 4,
            Self::F64 | Self::I64 => 8,
        }
    }

    const fn descr(self) -> &'static str {
        match self {
            Self::F32 => "<f4",
            Self::F64 => "<f8",
            Self::I32 => "<i4",
            Self::I64 => "<i8",
        }
    }
}

/// Header that agrees with the file's length.
pub(crate) struct Header {
    pub(crate) element: Element,
    pub(crate) shape: Vec<usize>,
    pub(crate) elements: usize,
}

/// Error of reading a header: a header cut short is an error in the content, any other an I/O error.
fn read_exact(input: &mut impl Read, path: &Path, bytes: &mut [u8]) -> Result<(), FormatError> {
    input.read_exact(bytes).map_err(|error| match error.kind() {
        ErrorKind::UnexpectedEof => {
            let found = "the end of the file";
            FormatError::one(path, Diagnostic::new("header", "a complete .npy header", found))
        }
        _ => FormatError::read(path, error),
    })
}

impl Header {
    /// Reads the header of a file of `file_bytes` bytes and leaves `input` at the first value.
    pub(crate) fn read(input: &mut impl Read, path: &Path, file_bytes: u64) -> Result<Self, FormatError> {
        let (prefix, text) = read_text(input, path)?;
        let wrong = |diagnostic| FormatError::one(path, diagnostic);
        let (element, shape) = parse(&text).map_err(wrong)?;
        let values = shape.iter().try_fold(1_u64, |n, axis| n.checked_mul(*axis as u64));
        let stated = values
            .and_then(|n| n.checked_mul(element.bytes() as u64))
            .and_then(|n| n.checked_add((prefix + text.len()) as u64));
        if stated != Some(file_bytes) {
            let expected =
                stated.map_or("a size below 2^64".into(), |n| format!("{n} bytes for shape {shape:?}"));
            return Err(wrong(Diagnostic::new("file length", expected, format!("{file_bytes} bytes"))));
        }
        Ok(Self { element, elements: shape.iter().product(), shape })
    }
}

/// Reads magic number, version and literal: `(bytes before the literal, literal)`.
fn read_text(input: &mut impl Read, path: &Path) -> Result<(usize, String), FormatError> {
    let wrong = |place, expected: &str, found: String| {
        Err(FormatError::one(path, Diagnostic::new(place, expected, found)))
    };
    let mut start = [0_u8; 8];
    read_exact(input, path, &mut start)?;
    if start[..6] != *MAGIC {
        return wrong("first bytes", "\\x93NUMPY (a .npy file)", format!("{:02x?}", &start[..6]));
    }
    let width = match start[6] {
        1 => 2,
        2 | 3 => 4,
        other => return wrong("format version", "1, 2 or 3", other.to_string()),
    };
    let mut length = [0_u8; 4];
    read_exact(input, path, &mut length[..width])?;
    let length = u32::from_le_bytes(length) as usize;
    if length > MAX_TEXT {
        return wrong("header length", &format!("at most {MAX_TEXT}"), length.to_string());
    }
    let mut bytes = vec![0_u8; length];
    read_exact(input, path, &mut bytes)?;
    match String::from_utf8(bytes) {
        Ok(text) => Ok((8 + width, text)),
        Err(_) => wrong("header", "text", "bytes that are no text".into()),
    }
}

/// Type and shape in the literal.
fn parse(text: &str) -> Result<(Element, Vec<usize>), Diagnostic> {
    let inner = text.trim().strip_prefix('{').and_then(|t| t.strip_suffix('}'));
    let mut rest = inner.ok_or_else(|| Diagnostic::new("header", "{'descr': ..., }", text.trim()))?.trim();
    let (mut element, mut c_order, mut shape) = (None, false, None);
    while !rest.is_empty() {
        let (key, after) =
            rest.split_once(':').ok_or_else(|| Diagnostic::new("header", "'key': value", rest))?;
        let after = after.trim_start();
        let end = if after.starts_with('(') { after.find(')').map(|i| i + 1) } else { after.find(',') };
        let (value, after) = after.split_at(end.unwrap_or(after.len()));
        match key.trim().trim_matches(['\'', '"']) {
            "descr" => element = Some(parse_element(value)?),
            "fortran_order" => c_order = parse_order(value)?,
            "shape" => shape = Some(parse_shape(value)?),
            other => return Err(Diagnostic::new("header", "keys descr, fortran_order, shape", other)),
        }
        rest = after.trim_start().strip_prefix(',').unwrap_or(after).trim();
    }
    match (element, c_order, shape) {
        (Some(element), true, Some(shape)) => Ok((element, shape)),
        _ => Err(Diagnostic::new("header", "keys descr, fortran_order, shape", text.trim())),
    }
}

fn parse_element(value: &str) -> Result<Element, Diagnostic> {
    match value.trim().trim_matches(['\'', '"']) {
        "<f4" => Ok(Element::F32),
        "<f8" => Ok(Element::F64),
        "<i4" => Ok(Element::I32),
        "<i8" => Ok(Element::I64),
        other => Err(Diagnostic::new("descr", "'<f4', '<f8', '<i4' or '<i8' (little-endian)", other)),
    }
}

fn parse_order(value: &str) -> Result<bool, Diagnostic> {
    match value.trim() {
        "False" => Ok(true),
        other => Err(Diagnostic::new("fortran_order", "False (save it with numpy.ascontiguousarray)", other)),
    }
}

fn parse_shape(value: &str) -> Result<Vec<usize>, Diagnostic> {
    let bad = || Diagnostic::new("shape", "a tuple of at most 32 integers", value);
    let inner = value.trim().strip_prefix('(').and_then(|t| t.strip_suffix(')')).ok_or_else(bad)?;
    let axes = inner.split(',').map(str::trim).filter(|axis| !axis.is_empty());
    let shape = axes.map(|axis| axis.parse().map_err(|_| bad())).collect::<Result<Vec<usize>, _>>()?;
    if shape.len() > MAX_AXES { Err(bad()) } else { Ok(shape) }
}

/// Header as NumPy writes it: version 1, padded so that the values start at a multiple of 64 bytes.
pub(crate) fn compose(element: Element, shape: &[usize]) -> Vec<u8> {
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
