//! NumPy's `.npy`: written as little-endian f32 in C order; read with any real numbers, byte order and axis order, format versions 1 to 3.
//!
//! The header is a Python literal of one form, which `header.rs` parses without recursion. The array is allocated only if the file's
//! length agrees with the header.

use crate::error::{Diagnostic, FormatError};
use crate::file;
use std::fs::File;
use std::io;
use std::io::{BufWriter, ErrorKind, Read, Write};
use std::path::Path;

/// Elements per read; fits into the cache.
const CHUNK: usize = 1 << 14;

/// Array in C order, the last index fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Array<T> {
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// `shape[0] x shape[1] x ...` values.
    pub data: Vec<T>,
}

/// Reads an array of real numbers as f32. `O(elements)`; at most one array and one chunk in memory, of Fortran order two arrays.
///
/// # Errors
/// I/O error; a file that is not `.npy`, another type, a shape that does not match the file's length.
pub fn read_f32(path: &Path) -> Result<Array<f32>, FormatError> {
    read(path, |v| v as f32, |v| v)
}

/// Reads an array of real numbers as f64. See [`read_f32`].
///
/// # Errors
/// As [`read_f32`].
pub fn read_f64(path: &Path) -> Result<Array<f64>, FormatError> {
    read(path, |v| v, f64::from)
}

fn read<T: Copy>(path: &Path, wide: fn(f64) -> T, narrow: fn(f32) -> T) -> Result<Array<T>, FormatError> {
    let (mut file, bytes) = file::open(path, file::MAX_DATA_BYTES)?;
    read_from(&mut file, path, bytes, wide, narrow)
}

/// As [`read_f64`], from memory; `name` stands for the file in messages.
pub(crate) fn parse_f64(mut bytes: &[u8], name: &Path) -> Result<Array<f64>, FormatError> {
    let length = bytes.len() as u64;
    read_from(&mut bytes, name, length, |v| v, f64::from)
}

fn read_from<T: Copy>(
    file: &mut impl Read,
    path: &Path,
    bytes: u64,
    wide: fn(f64) -> T,
    narrow: fn(f32) -> T,
) -> Result<Array<T>, FormatError> {
    let header = Header::read(file, path, bytes)?;
    let mut data = Vec::with_capacity(header.elements);
    let mut buffer = vec![0_u8; CHUNK * header.element.bytes];
    let mut left = header.elements;
    while left > 0 {
        let part = &mut buffer[..left.min(CHUNK) * header.element.bytes];
        file.read_exact(part).map_err(|e| FormatError::read(path, e))?;
        if header.element == Element::F32 {
            data.extend(part.as_chunks().0.iter().map(|b| narrow(f32::from_le_bytes(*b))));
        } else {
            data.extend(part.chunks_exact(header.element.bytes).map(|b| wide(header.element.value(b))));
        }
        left -= left.min(CHUNK);
    }
    if header.fortran_order {
        data = in_c_order(&data, &header.shape);
    }
    Ok(Array { shape: header.shape, data })
}

/// Values of an array whose first index varies fastest, with the last index fastest.
fn in_c_order<T: Copy>(data: &[T], shape: &[usize]) -> Vec<T> {
    let strides: Vec<usize> =
        shape.iter().scan(1, |stride, axis| Some(std::mem::replace(stride, *stride * axis))).collect();
    let (mut index, mut at) = (vec![0; shape.len()], 0);
    let next = |_| {
        let value = data[at];
        for axis in (0..shape.len()).rev() {
            index[axis] += 1;
            at += strides[axis];
            if index[axis] < shape[axis] {
                break;
            }
            at -= strides[axis] * shape[axis];
            index[axis] = 0;
        }
        value
    };
    (0..data.len()).map(next).collect()
}

/// Writes an f32 array.
///
/// # Errors
/// I/O error; a shape whose product is not `data.len()`.
pub fn write_f32(path: &Path, shape: &[usize], data: &[f32]) -> Result<(), FormatError> {
    let count: usize = shape.iter().product();
    if count != data.len() {
        return Err(FormatError::one(path, Diagnostic::new("array", format!("{count} values"), data.len())));
    }
    let io = |e| FormatError::write(path, e);
    let mut out = BufWriter::new(File::create(path).map_err(io)?);
    write_f32_to(&mut out, shape, data).and_then(|()| out.flush()).map_err(io)
}

/// Writes the header of an f32 array and its values; with empty `data` the header alone.
///
/// # Errors
/// I/O error of the writer.
pub fn write_f32_to(out: &mut (impl Write + ?Sized), shape: &[usize], data: &[f32]) -> io::Result<()> {
    out.write_all(&compose(shape))?;
    let mut bytes = Vec::with_capacity(CHUNK * 4);
    for chunk in data.chunks(CHUNK) {
        bytes.clear();
        bytes.extend(chunk.iter().flat_map(|v| v.to_le_bytes()));
        out.write_all(&bytes)?;
    }
    Ok(())
}

// ---- header: `{'descr': '<f4', 'fortran_order': False, 'shape': (146, 25022, 5), }` ----

const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// Longest header; NumPy's headers of plain arrays are shorter.
const MAX_TEXT: usize = 10_000;
const MAX_AXES: usize = 32;

/// Type of the stored numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Element {
    /// `f`, `i`, `u` or `b` (one byte, 0 or 1).
    pub(crate) kind: u8,
    pub(crate) bytes: usize,
    pub(crate) big_endian: bool,
}

impl Element {
    pub(crate) const F32: Self = Self { kind: b'f', bytes: 4, big_endian: false };

    /// Value of [`Self::bytes`] bytes; of 64-bit integers, exact below 2^53.
    pub(crate) fn value(self, bytes: &[u8]) -> f64 {
        let mut word = [0_u8; 8];
        for (index, to) in word.iter_mut().enumerate().take(self.bytes) {
            *to = bytes[if self.big_endian { self.bytes - 1 - index } else { index }];
        }
        let bits = u64::from_le_bytes(word);
        let unused = 64 - 8 * self.bytes as u32;
        match (self.kind, self.bytes) {
            (b'f', 2) => half(bits as u16),
            (b'f', 4) => f32::from_bits(bits as u32).into(),
            (b'f', _) => f64::from_bits(bits),
            (b'i', _) => ((bits << unused) as i64 >> unused) as f64,
            _ => bits as f64,
        }
    }
}

/// Number of 16 bits: 1 sign, 5 exponent, 10 fraction.
fn half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let fraction = f64::from(bits & 0x3ff) / 1024.0;
    sign * match (bits >> 10) & 0x1f {
        0 => fraction * 2.0_f64.powi(-14),
        0x1f if fraction == 0.0 => f64::INFINITY,
        0x1f => f64::NAN,
        exponent => (1.0 + fraction) * 2.0_f64.powi(i32::from(exponent) - 15),
    }
}

/// Header that agrees with the file's length.
pub(crate) struct Header {
    pub(crate) element: Element,
    pub(crate) shape: Vec<usize>,
    /// The first index varies fastest in the file.
    pub(crate) fortran_order: bool,
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
        let (element, fortran_order, shape) = parse(&text).map_err(wrong)?;
        let values = shape.iter().try_fold(1_u64, |n, axis| n.checked_mul(*axis as u64));
        let stated = values
            .and_then(|n| n.checked_mul(element.bytes as u64))
            .and_then(|n| n.checked_add((prefix + text.len()) as u64));
        if stated != Some(file_bytes) {
            let expected =
                stated.map_or("a size below 2^64".into(), |n| format!("{n} bytes for shape {shape:?}"));
            return Err(wrong(Diagnostic::new("file length", expected, format!("{file_bytes} bytes"))));
        }
        Ok(Self { element, fortran_order, elements: shape.iter().product(), shape })
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

/// Type, order and shape in the literal.
fn parse(text: &str) -> Result<(Element, bool, Vec<usize>), Diagnostic> {
    let inner = text.trim().strip_prefix('{').and_then(|t| t.strip_suffix('}'));
    let mut rest = inner.ok_or_else(|| Diagnostic::new("header", "{'descr': ..., }", text.trim()))?.trim();
    let (mut element, mut order, mut shape) = (None, None, None);
    while !rest.is_empty() {
        let (key, after) =
            rest.split_once(':').ok_or_else(|| Diagnostic::new("header", "'key': value", rest))?;
        let after = after.trim_start();
        let end = if after.starts_with('(') { after.find(')').map(|i| i + 1) } else { after.find(',') };
        let (value, after) = after.split_at(end.unwrap_or(after.len()));
        match key.trim().trim_matches(['\'', '"']) {
            "descr" => element = Some(parse_element(value)?),
            "fortran_order" => order = Some(parse_order(value)?),
            "shape" => shape = Some(parse_shape(value)?),
            other => return Err(Diagnostic::new("header", "keys descr, fortran_order, shape", other)),
        }
        rest = after.trim_start().strip_prefix(',').unwrap_or(after).trim();
    }
    match (element, order, shape) {
        (Some(element), Some(order), Some(shape)) => Ok((element, order, shape)),
        _ => Err(Diagnostic::new("header", "keys descr, fortran_order, shape", text.trim())),
    }
}

fn parse_element(value: &str) -> Result<Element, Diagnostic> {
    let text = value.trim().trim_matches(['\'', '"']);
    let wrong = || Diagnostic::new("descr", "numbers of 1 to 8 bytes, as '<f4', '>f8', '<u4' or '<i8'", text);
    let &[order, kind, digit] = text.as_bytes() else { return Err(wrong()) };
    let bytes = usize::from(digit.wrapping_sub(b'0'));
    let sizes: &[usize] = match kind {
        b'f' => &[2, 4, 8],
        b'i' | b'u' => &[1, 2, 4, 8],
        b'b' => &[1],
        _ => &[],
    };
    if !sizes.contains(&bytes) || !matches!(order, b'<' | b'>' | b'|') {
        return Err(wrong());
    }
    Ok(Element { kind, bytes, big_endian: order == b'>' })
}

fn parse_order(value: &str) -> Result<bool, Diagnostic> {
    match value.trim() {
        "False" => Ok(false),
        "True" => Ok(true),
        other => Err(Diagnostic::new("fortran_order", "True or False", other)),
    }
}

fn parse_shape(value: &str) -> Result<Vec<usize>, Diagnostic> {
    let bad = || Diagnostic::new("shape", "a tuple of at most 32 integers", value);
    let inner = value.trim().strip_prefix('(').and_then(|t| t.strip_suffix(')')).ok_or_else(bad)?;
    let axes = inner.split(',').map(str::trim).filter(|axis| !axis.is_empty());
    let shape = axes.map(|axis| axis.parse().map_err(|_| bad())).collect::<Result<Vec<usize>, _>>()?;
    if shape.len() > MAX_AXES { Err(bad()) } else { Ok(shape) }
}

/// Header of an f32 array as NumPy writes it: version 1, padded so that the values start at a multiple of 64 bytes.
pub(crate) fn compose(shape: &[usize]) -> Vec<u8> {
    let axes: Vec<String> = shape.iter().map(usize::to_string).collect();
    let tuple = if axes.len() == 1 { format!("({},)", axes[0]) } else { format!("({})", axes.join(", ")) };
    let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {tuple}, }}");
    let total = (10 + text.len() + 1).next_multiple_of(64);
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    bytes.extend(((total - 10) as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.resize(total - 1, b' ');
    bytes.push(b'\n');
    bytes
}
