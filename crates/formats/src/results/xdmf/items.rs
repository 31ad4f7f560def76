//! Data items of XDMF: numbers in the text, in a plain binary file or in a data set of an HDF5 file.

use super::tree::Tree;
use crate::error::{Diagnostic, FormatError};
use crate::file;
use crate::vtu::codec::Element;
use hdf5_reader::{ByteOrder, Datatype, Hdf5File, OpenOptions};
use std::collections::{HashMap, HashSet};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// References to a data item that refers to another, and so on.
const MAX_REFERENCES: usize = 8;
/// Bytes that one compressed byte expands to at most (zlib).
const EXPANSION: u64 = 1032;
/// Values that one byte of a text or of a binary file may stand for, with those that are referred to several times.
const REPEATED: u64 = 8;

/// Numbers with their dimensions.
pub(super) struct Array {
    pub(super) shape: Vec<usize>,
    pub(super) values: Vec<f64>,
}

/// Reads data items and keeps the files that they are in open.
pub(super) struct Items<'a> {
    tree: &'a Tree<'a>,
    path: &'a Path,
    files: HashMap<PathBuf, Hdf5File>,
    /// Plain binary files whose values are counted in `left`.
    binaries: HashSet<PathBuf>,
    /// Values that may still be read; what is in the text and in the files allows no more.
    left: u64,
}

impl<'a> Items<'a> {
    pub(super) fn new(tree: &'a Tree<'a>, path: &'a Path, bytes: usize) -> Self {
        Self { tree, path, files: HashMap::new(), binaries: HashSet::new(), left: bytes as u64 * REPEATED }
    }

    /// The data item within an element, or within the one that it refers to.
    pub(super) fn of(&mut self, element: u32) -> Result<Array, FormatError> {
        let place = self.tree.place(element);
        let wrong = |expected: &str, found: &str| {
            FormatError::one(self.path, Diagnostic::new(&place, expected, found))
        };
        let mut at = element;
        for _ in 0..MAX_REFERENCES {
            if let Some(referred) = self.tree.referred(at).map_err(|d| FormatError::one(self.path, d))? {
                at = referred;
            } else if self.tree.name(at) == b"DataItem" {
                return self.read(at, &place);
            } else {
                let mut items = self.tree.named(at, "DataItem");
                at = items.next().ok_or_else(|| wrong("a DataItem", "none"))?;
                if items.next().is_some() {
                    return Err(wrong("one DataItem", "several"));
                }
            }
        }
        Err(wrong("a DataItem", "references that lead nowhere"))
    }

    fn read(&mut self, at: u32, place: &str) -> Result<Array, FormatError> {
        let path = self.path;
        let wrong = |expected: &str, found: &str| {
            let found: String = found.chars().take(80).collect();
            FormatError::one(path, Diagnostic::new(place, expected, format!("`{found}`")))
        };
        let attribute = |name: &str| self.tree.attribute(at, name).unwrap_or_default();
        let kind = attribute("ItemType");
        if !matches!(kind.as_str(), "" | "Uniform") {
            return Err(wrong("a DataItem that holds its numbers (ItemType Uniform)", &kind));
        }
        let dimensions = attribute("Dimensions");
        let shape: Option<Vec<usize>> = dimensions.split_whitespace().map(|word| word.parse().ok()).collect();
        let count = shape.iter().flatten().try_fold(1_usize, |product, next| product.checked_mul(*next));
        let (Some(shape), Some(count)) = (shape.filter(|shape| !shape.is_empty()), count) else {
            return Err(wrong("Dimensions, such as 8 3", &dimensions));
        };
        let format = attribute("Format");
        let text = self.tree.text(at);
        let values = match format.as_str() {
            "XML" | "" => {
                self.take(count, place)?;
                numbers(text, count).map_err(|found| wrong(&format!("{count} numbers"), &found))?
            }
            "Binary" => {
                let element =
                    element(&attribute("NumberType"), &attribute("DataType"), &attribute("Precision"));
                let element =
                    element.ok_or_else(|| wrong("Float, Int or UInt of 1 to 8 bytes", "another"))?;
                let compression = attribute("Compression");
                if !matches!(compression.as_str(), "" | "Raw") {
                    return Err(wrong("binary data without compression", &compression));
                }
                let big_endian = attribute("Endian").eq_ignore_ascii_case("big");
                let seek = attribute("Seek").parse().unwrap_or(0);
                self.binary(text, seek, count, element, big_endian)?
            }
            "HDF" | "HDF5" => {
                let expected = "FILE.h5:/DATASET";
                let (name, dataset) = text.rsplit_once(':').ok_or_else(|| wrong(expected, text))?;
                self.dataset(name, dataset, count, place)?
            }
            other => return Err(wrong("Format XML, Binary or HDF", other)),
        };
        Ok(Array { shape, values })
    }

    /// Takes values off those that may be read: a short text can refer to a large item many times.
    fn take(&mut self, count: usize, place: &str) -> Result<(), FormatError> {
        match self.left.checked_sub(count as u64) {
            Some(left) => self.left = left,
            None => {
                let expected =
                    format!("at most {} more numbers, which is what the files can hold", self.left);
                return Err(FormatError::one(self.path, Diagnostic::new(place, expected, count)));
            }
        }
        Ok(())
    }

    fn binary(
        &mut self,
        name: &str,
        seek: u64,
        count: usize,
        element: Element,
        big_endian: bool,
    ) -> Result<Vec<f64>, FormatError> {
        let path = self.path.with_file_name("").join(name);
        let (mut file, length) = file::open(&path, file::MAX_DATA_BYTES)?;
        let wanted = count
            .checked_mul(element.size())
            .filter(|wanted| length.checked_sub(seek).is_some_and(|left| *wanted as u64 <= left));
        let Some(wanted) = wanted else {
            let expected = format!("{count} numbers of {} bytes from byte {seek}", element.size());
            return Err(FormatError::one(
                &path,
                Diagnostic::new("data", expected, format!("{length} bytes")),
            ));
        };
        if self.binaries.insert(path.clone()) {
            self.left = self.left.saturating_add(length.saturating_mul(REPEATED));
        }
        self.take(count, name)?;
        let mut bytes = vec![0; wanted];
        let read = file.seek(SeekFrom::Start(seek)).and_then(|_| file.read_exact(&mut bytes));
        read.map_err(|error| FormatError::read(&path, error))?;
        Ok(element.values(&bytes, big_endian))
    }

    fn dataset(
        &mut self,
        name: &str,
        dataset: &str,
        count: usize,
        place: &str,
    ) -> Result<Vec<f64>, FormatError> {
        let path = self.path.with_file_name("").join(name.trim());
        let wrong = |expected: &str, found: &dyn std::fmt::Display| {
            FormatError::one(&path, Diagnostic::new(format!("data set {dataset}"), expected, found))
        };
        if !self.files.contains_key(&path) {
            let (opened, length) = open(&path)?;
            self.left = self.left.saturating_add(length.saturating_mul(EXPANSION));
            self.files.insert(path.clone(), opened);
        }
        let readable = "a data set of HDF5 that can be read (was the file closed by its program?)";
        let found = self.files[&path].dataset(dataset).map_err(|error| wrong(readable, &error))?;
        let there = found.num_elements().map_err(|error| wrong(readable, &error))?;
        if there != count as u64 {
            let expected = format!("{count} numbers, as {} says", place);
            return Err(wrong(&expected, &format!("{:?}", found.shape())));
        }
        let (element, order) = match found.dtype() {
            Datatype::FloatingPoint { size, byte_order } => (sized("Float", *size), *byte_order),
            Datatype::FixedPoint { size, signed: true, byte_order } => (sized("Int", *size), *byte_order),
            Datatype::FixedPoint { size, byte_order, .. } => (sized("UInt", *size), *byte_order),
            _ => (None, ByteOrder::LittleEndian),
        };
        let element =
            element.ok_or_else(|| wrong("floating or whole numbers of 1 to 8 bytes", &"another type"))?;
        self.take(count, place)?;
        let bytes = self.files[&path].dataset(dataset).and_then(|found| found.read_raw_bytes());
        let bytes = bytes.map_err(|error| wrong(readable, &error))?;
        Ok(element.values(&bytes, order == ByteOrder::BigEndian))
    }
}

/// Opens an HDF5 file; no array of it may be larger than its bytes can expand to.
fn open(path: &Path) -> Result<(Hdf5File, u64), FormatError> {
    let (opened, length) = file::open(path, file::MAX_DATA_BYTES)?;
    let limit = length.saturating_mul(EXPANSION).min(file::MAX_DATA_BYTES) as usize;
    let storage = hdf5_reader::FileStorage::from_file(opened).map_err(|error| damaged(path, &error))?;
    let options = OpenOptions::default()
        .with_chunk_cache_bytes(0)
        .with_max_chunk_bytes(limit)
        .with_max_read_bytes(limit)
        .with_max_object_header_bytes(length as usize);
    let file = Hdf5File::from_storage_with_options(Arc::new(storage), options);
    let file = file.map_err(|error| damaged(path, &error))?;
    let written = file.superblock().eof_address;
    if written > length {
        let expected = format!("{written} bytes (a file that is cut short: was the copy stopped?)");
        return Err(FormatError::one(path, Diagnostic::new("file", expected, format!("{length} bytes"))));
    }
    Ok((file, length))
}

fn damaged(path: &Path, error: &dyn std::fmt::Display) -> FormatError {
    FormatError::one(path, Diagnostic::new("file", "HDF5 that its program closed", error))
}

fn element(number_type: &str, data_type: &str, precision: &str) -> Option<Element> {
    let kind = if data_type.is_empty() { number_type } else { data_type };
    let bytes: u8 = if precision.is_empty() { 4 } else { precision.parse().ok()? };
    match kind {
        "" => sized("Float", bytes),
        "Char" => sized("Int", 1),
        "UChar" => sized("UInt", 1),
        _ => sized(kind, bytes),
    }
}

fn sized(kind: &str, bytes: u8) -> Option<Element> {
    Element::named(&format!("{kind}{}", u16::from(bytes) * 8))
}

fn numbers(text: &str, count: usize) -> Result<Vec<f64>, String> {
    let values: Result<Vec<f64>, &str> =
        text.split_ascii_whitespace().map(|word| word.parse().map_err(|_| word)).collect();
    let values = values.map_err(str::to_owned)?;
    if values.len() == count { Ok(values) } else { Err(format!("{} numbers", values.len())) }
}
