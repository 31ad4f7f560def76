//! FEBio's plot file (`.xplt`), versions 3.0 to 3.5 as FEBio 3 and 4 write them: a dictionary of quantities, the mesh, then states, each
//! compressed by itself or not.
//!
//! Numbers of sections, types and formats are those that FEBio Studio names for its reader. Quantities of elements (`stress`) become
//! quantities at the nodes: the mean over the elements around a node. A state that FEBio marks as not converged is left out, and so is
//! one that the file ends in.

mod blocks;
mod mesh;
mod state;

use super::run::Run;
use crate::error::{Diagnostic, FormatError};
use crate::file;
use blocks::Bytes;
use state::Dictionary;
use std::path::Path;

const ROOT: u32 = 0x0100_0000;
const HEADER: u32 = 0x0101_0000;
const VERSION: u32 = 0x0101_0001;
const COMPRESSION: u32 = 0x0101_0004;
const DICTIONARY: u32 = 0x0102_0000;
const MESH: u32 = 0x0104_0000;
const STATE: u32 = 0x0200_0000;
/// Versions of the format that are read, as its header has them.
const VERSIONS: std::ops::RangeInclusive<u32> = 0x30..=0x35;
/// What the header of a state takes, at most.
const STATE_HEADER_BYTES: u64 = 1 << 16;

/// Reads a file.
pub(super) fn read(path: &Path) -> Result<Run, FormatError> {
    let bytes = file::read_bytes(path, file::MAX_DATA_BYTES)?;
    parse(&bytes).map_err(|diagnostic| FormatError::one(path, diagnostic))
}

/// Reads the bytes of a file. Cost and memory are linear in them where they are not compressed; a compressed state may be as long
/// as mesh and dictionary allow.
///
/// # Errors
/// What is wrong first, by section, domain, step or quantity.
pub fn parse(bytes: &[u8]) -> Result<Run, Diagnostic> {
    let file = Bytes::open(bytes)?;
    let short = |place: &str| {
        Diagnostic::new(place, "a whole section (was the job stopped at its start?)", "the end of the file")
    };
    let (_, root, mut rest) =
        file.split().filter(|section| section.0 == ROOT).ok_or_else(|| short("header"))?;
    let (dictionary, compressed) = header(root)?;
    let (_, found, after) = rest.split().filter(|section| section.0 == MESH).ok_or_else(|| short("mesh"))?;
    let mesh = mesh::read(found)?;
    // Nodes, elements and faces take at least as many bytes of the mesh as a number for each of their nodes.
    let limit = found.data.len() as u64 * (dictionary.numbers + 1) + STATE_HEADER_BYTES;
    rest = after;
    let mut run = Run::default();
    let mut number = 0;
    while !rest.data.is_empty() {
        number += 1;
        let name = format!("step {number}");
        let Some((section, taken)) = section(rest, compressed, limit) else {
            run.left_out
                .push(format!("{name}: the file ends within it, or it is damaged (was the job stopped?)"));
            break;
        };
        rest = rest.like(&rest.data[taken..]);
        let section = file.like(&section);
        match section.split() {
            Some((STATE, state, _)) => match state::read(state, &dictionary, &mesh, &name)? {
                Ok(step) => run.steps.push(step),
                Err(reason) => run.left_out.push(reason),
            },
            Some((MESH, ..)) => {
                return Err(Diagnostic::new(name, "one mesh for all states (no remeshing)", "a second one"));
            }
            _ => return Err(Diagnostic::new(name, "a section of a state", "another one")),
        }
    }
    (run.points, run.blocks) = (mesh.points, mesh.blocks);
    Ok(run)
}

/// The dictionary, and whether states are compressed.
fn header(root: Bytes<'_>) -> Result<(Dictionary, bool), Diagnostic> {
    let header = root.block(HEADER)?.ok_or_else(|| Diagnostic::new("header", "a block of it", "none"))?;
    let value = |id| Ok(header.block(id)?.and_then(Bytes::first).unwrap_or(0));
    let version = value(VERSION)?;
    if !VERSIONS.contains(&version) {
        let expected = "version 3.0 to 3.5, as FEBio 3 and 4 write it (others: File > Export > VTK in FEBio Studio, then \
                        meshio convert to .vtu)";
        let found = format!("version {}.{}", version >> 4, version & 0xf);
        return Err(Diagnostic::new("header", expected, found));
    }
    let dictionary = root.block(DICTIONARY)?.map_or_else(|| Ok(Dictionary::default()), Dictionary::read)?;
    Ok((dictionary, value(COMPRESSION)? != 0))
}

/// The next section with its own number and size, and the bytes that it takes in the file.
fn section<'a>(rest: Bytes<'a>, compressed: bool, limit: u64) -> Option<(std::borrow::Cow<'a, [u8]>, usize)> {
    if compressed {
        let (section, taken) = rest.inflate(limit.min(file::MAX_DATA_BYTES))?;
        return Some((section.into(), taken));
    }
    let (_, data, _) = rest.split()?;
    let taken = data.data.len() + 8;
    Some((rest.data[..taken].into(), taken))
}
