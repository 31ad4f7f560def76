//! gmsh's .msh, version 4.1, ASCII or binary: 10-node tetrahedra, named physical volumes and surfaces.

use crate::error::{Diagnostic, FormatError};
use crate::file;
use crate::mesh_file::MeshFile;
use std::collections::HashMap;
use std::path::Path;
use std::str::FromStr;

/// Nodes of gmsh's element types that a tetrahedral mesh may contain: points, lines, triangles, tetrahedra.
const NODES_OF: [(i64, usize); 7] = [(15, 1), (1, 2), (8, 3), (2, 3), (TRI6, 6), (4, 4), (TET10, 10)];
const TRI6: i64 = 9;
const TET10: i64 = 11;
/// Node order: gmsh exchanges the mid-sides of 23 and 13.
const TET_ORDER: [usize; 10] = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8];

/// Reads nodes, 10-node tetrahedra, and the elements of every named physical volume and surface.
///
/// # Errors
/// I/O error, or the first error in the content with its place.
pub fn read(path: &Path) -> Result<MeshFile, FormatError> {
    let bytes = file::read_bytes(path, file::MAX_DATA_BYTES)?;
    parse(&bytes).map_err(|diagnostic| FormatError::one(path, diagnostic))
}

/// [`read`] from memory. Cost and memory are linear in the number of bytes, for any counts in them.
///
/// # Errors
/// Error and its byte.
pub fn parse(bytes: &[u8]) -> Result<MeshFile, Diagnostic> {
    let mut file = Raw::default();
    let mut cursor = Cursor::new(bytes);
    let mut has_format = false;
    while let Some(section) = cursor.section()? {
        if section == "MeshFormat" {
            format(&mut cursor)?;
            has_format = true;
        } else if !has_format {
            return Err(Diagnostic::new("first section", "$MeshFormat", format!("${section}")));
        }
        match section.as_str() {
            "PhysicalNames" => file.physical_names(&mut cursor)?,
            "Entities" => file.entities(&mut cursor)?,
            "Nodes" => file.nodes(&mut cursor)?,
            "Elements" => file.elements(&mut cursor)?,
            _ => {}
        }
        cursor.end_of(&section)?;
    }
    if !has_format {
        return Err(Diagnostic::new("file", "a gmsh mesh that begins with $MeshFormat", "none"));
    }
    file.resolve()
}

fn format(cursor: &mut Cursor) -> Result<(), Diagnostic> {
    let version = cursor.word()?;
    if version != "4.1" {
        let expected = "version 4.1 (in gmsh: Mesh.MshFileVersion = 4.1)";
        return Err(Diagnostic::new("MeshFormat", expected, format!("`{version}`")));
    }
    let (binary, size) = (cursor.word()?, cursor.word()?);
    match (binary.as_str(), size.as_str()) {
        ("0", _) => Ok(()),
        ("1", "8") => cursor.binary(),
        _ => {
            Err(Diagnostic::new("MeshFormat", "file type 0 or 1, data size 8", format!("`{binary} {size}`")))
        }
    }
}

/// A triangle or tetrahedron by node tags, with the entity it belongs to.
type Element<const N: usize> = (i64, [u64; N]);

/// Content of the sections, before tags are resolved.
#[derive(Default)]
struct Raw {
    /// Names of physical surfaces and volumes, by dimension and tag.
    names: HashMap<(i64, i64), String>,
    /// Physical groups of each entity, by dimension and tag.
    groups: HashMap<(i64, i64), Vec<i64>>,
    index: HashMap<u64, u32>,
    points_mm: Vec<[f64; 3]>,
    tets: Vec<Element<10>>,
    triangles: Vec<Element<6>>,
    /// Number of first-order elements, for the error if there are no others.
    linear: usize,
}

impl Raw {
    /// Reads the section `PhysicalNames`, which is ASCII in binary files too.
    fn physical_names(&mut self, cursor: &mut Cursor) -> Result<(), Diagnostic> {
        let count: usize = cursor.text_number()?;
        for _ in 0..count {
            let dimension: i64 = cursor.text_number()?;
            let tag: i64 = cursor.text_number()?;
            let name = cursor.quoted()?;
            if dimension >= 2 {
                self.names.insert((dimension, tag), name);
            }
        }
        Ok(())
    }

    fn entities(&mut self, cursor: &mut Cursor) -> Result<(), Diagnostic> {
        let counts = [cursor.size()?, cursor.size()?, cursor.size()?, cursor.size()?];
        for (dimension, count) in (0_i64..).zip(counts) {
            for _ in 0..count {
                let tag = cursor.int()?;
                for _ in 0..if dimension == 0 { 3 } else { 6 } {
                    cursor.double()?;
                }
                let mut groups = Vec::new();
                for _ in 0..cursor.size()? {
                    groups.push(cursor.int()?);
                }
                if dimension > 0 {
                    for _ in 0..cursor.size()? {
                        cursor.int()?;
                    }
                }
                if dimension >= 2 {
                    self.groups.insert((dimension, tag), groups);
                }
            }
        }
        Ok(())
    }

    fn nodes(&mut self, cursor: &mut Cursor) -> Result<(), Diagnostic> {
        let (blocks, _) = (cursor.size()?, [cursor.size()?, cursor.size()?, cursor.size()?]);
        for _ in 0..blocks {
            let (dimension, _, parametric) = (cursor.int()?, cursor.int()?, cursor.int()?);
            let count = cursor.size()?;
            let mut tags = Vec::new();
            for _ in 0..count {
                tags.push(cursor.size()?);
            }
            for tag in tags {
                let place = cursor.place();
                let point = [cursor.double()?, cursor.double()?, cursor.double()?];
                for _ in 0..if parametric == 0 { 0 } else { dimension.clamp(0, 3) } {
                    cursor.double()?;
                }
                if point.iter().any(|v| !v.is_finite()) {
                    return Err(Diagnostic::new(
                        place,
                        "finite coordinates",
                        format!("{point:?} at node {tag}"),
                    ));
                }
                let index = u32::try_from(self.points_mm.len())
                    .map_err(|_| Diagnostic::new(&place, "fewer than 2^32 nodes", "more"))?;
                if self.index.insert(tag, index).is_some() {
                    return Err(Diagnostic::new(place, "each node once", format!("node {tag} again")));
                }
                self.points_mm.push(point);
            }
        }
        Ok(())
    }

    fn elements(&mut self, cursor: &mut Cursor) -> Result<(), Diagnostic> {
        let (blocks, _) = (cursor.size()?, [cursor.size()?, cursor.size()?, cursor.size()?]);
        for _ in 0..blocks {
            let place = cursor.place();
            let (_, entity, kind) = (cursor.int()?, cursor.int()?, cursor.int()?);
            let count = cursor.size()?;
            let Some((_, nodes)) = NODES_OF.iter().find(|(k, _)| *k == kind) else {
                let expected = "points, lines, triangles and tetrahedra";
                return Err(Diagnostic::new(place, expected, format!("gmsh element type {kind}")));
            };
            for _ in 0..count {
                cursor.size()?;
                let mut members = [0; 10];
                for member in &mut members[..*nodes] {
                    *member = cursor.size()?;
                }
                match kind {
                    TET10 => self.tets.push((entity, TET_ORDER.map(|i| members[i]))),
                    TRI6 => self.triangles.push((entity, std::array::from_fn(|i| members[i]))),
                    4 => self.linear += 1,
                    _ => {}
                }
            }
        }
        Ok(())
    }

    fn resolve(mut self) -> Result<MeshFile, Diagnostic> {
        if self.tets.is_empty() {
            let found = format!("none, but {} of first order", self.linear);
            return Err(Diagnostic::new("Elements", "10-node tetrahedra (in gmsh: set order 2)", found));
        }
        let mut mesh = MeshFile { points_mm: std::mem::take(&mut self.points_mm), ..MeshFile::default() };
        for (i, (_, tags)) in self.tets.iter().enumerate() {
            mesh.tets.push(indices(&self.index, tags, "tetrahedron", i)?);
        }
        for ((dimension, _), name) in &self.names {
            if *dimension == 2 {
                mesh.surfaces.entry(name.clone()).or_default();
            } else {
                mesh.volumes.entry(name.clone()).or_default();
            }
        }
        for (i, (entity, _)) in self.tets.iter().enumerate() {
            for name in self.names_of(3, *entity) {
                mesh.volumes.entry(name.clone()).or_default().push(i as u32);
            }
        }
        for (i, (entity, tags)) in self.triangles.iter().enumerate() {
            let triangle = indices(&self.index, tags, "triangle", i)?;
            for name in self.names_of(2, *entity) {
                mesh.surfaces.entry(name.clone()).or_default().push(triangle);
            }
        }
        Ok(mesh)
    }

    /// Names of the physical groups of an entity.
    fn names_of(&self, dimension: i64, entity: i64) -> impl Iterator<Item = &String> {
        // Groups may carry a sign for orientation, which the solver finds by itself.
        let groups = self.groups.get(&(dimension, entity)).into_iter().flatten();
        groups.filter_map(move |tag| self.names.get(&(dimension, tag.abs())))
    }
}

fn indices<const N: usize>(
    index: &HashMap<u64, u32>,
    tags: &[u64; N],
    what: &str,
    at: usize,
) -> Result<[u32; N], Diagnostic> {
    let mut nodes = [0; N];
    for (node, tag) in nodes.iter_mut().zip(tags) {
        *node = *index.get(tag).ok_or_else(|| {
            Diagnostic::new(format!("Elements, {what} {at}"), "tags of nodes in $Nodes", format!("{tag}"))
        })?;
    }
    Ok(nodes)
}

// ---- sequential reader of the numbers of a .msh file, ASCII or binary ----

/// Longest word: a number, a version or a section's name.
const LONGEST_WORD: usize = 64;

/// Position in the file.
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    binary: bool,
    big_endian: bool,
    section: String,
}

impl<'a> Cursor<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, binary: false, big_endian: false, section: String::new() }
    }

    pub(crate) fn place(&self) -> String {
        format!("{}, byte {}", self.section, self.at)
    }

    fn diagnostic(&self, expected: &str, found: impl std::fmt::Display) -> Diagnostic {
        Diagnostic::new(self.place(), expected, found)
    }

    /// Name of the next section; `None` at the end of the file.
    pub(crate) fn section(&mut self) -> Result<Option<String>, Diagnostic> {
        self.skip_blanks();
        if self.at == self.bytes.len() {
            return Ok(None);
        }
        let word = self.word()?;
        let name = word
            .strip_prefix('$')
            .ok_or_else(|| self.diagnostic("a section ($Name)", format!("`{word}`")))?;
        self.section = name.to_owned();
        self.skip_line_end();
        Ok(Some(name.to_owned()))
    }

    /// Skips the rest of the section and `$EndName`.
    pub(crate) fn end_of(&mut self, name: &str) -> Result<(), Diagnostic> {
        let end = format!("$End{name}");
        let rest = &self.bytes[self.at..];
        // `$` is rare in binary data, so looking only there keeps the scan linear.
        let found =
            rest.iter().enumerate().find(|(i, b)| **b == b'$' && rest[*i..].starts_with(end.as_bytes()));
        let (offset, _) = found.ok_or_else(|| self.diagnostic(&end, "the end of the file"))?;
        self.at += offset + end.len();
        Ok(())
    }

    /// Switches to binary numbers; the integer 1 that follows gives the byte order.
    pub(crate) fn binary(&mut self) -> Result<(), Diagnostic> {
        self.skip_line_end();
        let one: [u8; 4] = self.take("the integer 1")?;
        self.big_endian = one == 1_i32.to_be_bytes();
        if !self.big_endian && one != 1_i32.to_le_bytes() {
            return Err(self.diagnostic("the integer 1 in either byte order", format!("{one:?}")));
        }
        self.binary = true;
        Ok(())
    }

    /// Reads a signed tag, dimension or type.
    pub(crate) fn int(&mut self) -> Result<i64, Diagnostic> {
        self.number("an integer", |bytes| i32::from_le_bytes(bytes).into())
    }

    /// Reads a count or a node's tag.
    pub(crate) fn size(&mut self) -> Result<u64, Diagnostic> {
        self.number("a size", u64::from_le_bytes)
    }

    pub(crate) fn double(&mut self) -> Result<f64, Diagnostic> {
        self.number("a number", f64::from_le_bytes)
    }

    /// Reads a number in ASCII, or in binary from little-endian bytes.
    fn number<T: FromStr, const N: usize>(
        &mut self,
        expected: &str,
        value: impl Fn([u8; N]) -> T,
    ) -> Result<T, Diagnostic> {
        if !self.binary {
            return self.text_number();
        }
        let mut bytes = self.take(expected)?;
        if self.big_endian {
            bytes.reverse();
        }
        Ok(value(bytes))
    }

    /// Reads a number in ASCII, in binary files too.
    pub(crate) fn text_number<T: FromStr>(&mut self) -> Result<T, Diagnostic> {
        let word = self.word()?;
        word.parse().map_err(|_| self.diagnostic("a number", format!("`{word}`")))
    }

    /// Reads the next word.
    pub(crate) fn word(&mut self) -> Result<String, Diagnostic> {
        self.skip_blanks();
        let rest = &self.bytes[self.at..];
        let length = rest.iter().take(LONGEST_WORD).take_while(|b| b.is_ascii_graphic()).count();
        if length == 0 {
            let found = if rest.is_empty() { "the end of the file" } else { "bytes that are no text" };
            return Err(self.diagnostic("a word", found));
        }
        self.at += length;
        Ok(String::from_utf8_lossy(&rest[..length]).into_owned())
    }

    /// Reads a name in double quotes.
    pub(crate) fn quoted(&mut self) -> Result<String, Diagnostic> {
        self.skip_blanks();
        let rest = &self.bytes[self.at..];
        let inner =
            rest.strip_prefix(b"\"").ok_or_else(|| self.diagnostic("a name in double quotes", "none"))?;
        let length = inner.iter().position(|b| *b == b'"' || *b == b'\n').filter(|end| inner[*end] == b'"');
        let length = length.ok_or_else(|| self.diagnostic("a closing quote", "the end of the line"))?;
        self.at += length + 2;
        Ok(String::from_utf8_lossy(&inner[..length]).into_owned())
    }

    fn take<const N: usize>(&mut self, expected: &str) -> Result<[u8; N], Diagnostic> {
        let bytes = self.bytes[self.at..]
            .first_chunk()
            .ok_or_else(|| self.diagnostic(expected, "the end of the file"))?;
        self.at += N;
        Ok(*bytes)
    }

    fn skip_blanks(&mut self) {
        self.at += self.bytes[self.at..].iter().take_while(|b| b.is_ascii_whitespace()).count();
    }

    fn skip_line_end(&mut self) {
        let line = self.bytes[self.at..].iter().position(|b| *b == b'\n');
        self.at += line.map_or(0, |end| end + 1);
    }
}
