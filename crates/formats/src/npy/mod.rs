//! NumPy's `.npy`: written as little-endian f32 in C order; read with any real numbers, byte order and axis order, format versions 1 to 3.
//!
//! The header is a Python literal of one form, which `header.rs` parses without recursion. The array is allocated only if the file's
//! length agrees with the header.

mod header;

use crate::error::{Diagnostic, FormatError};
use crate::file;
use header::{Element, Header};
use std::fs::File;
use std::io::{self, BufWriter, Read, Write};
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
    out.write_all(&header::compose(shape))?;
    let mut bytes = Vec::with_capacity(CHUNK * 4);
    for chunk in data.chunks(CHUNK) {
        bytes.clear();
        bytes.extend(chunk.iter().flat_map(|v| v.to_le_bytes()));
        out.write_all(&bytes)?;
    }
    Ok(())
}
