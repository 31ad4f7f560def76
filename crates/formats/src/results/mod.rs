//! Finished simulations of other programs, one file or folder each, and the database that is made of them.
//!
//! | ending | content | reader |
//! | --- | --- | --- |
//! | `.frd` | CalculiX, text; the last state of a job that failed is left out | `frd.rs` |
//! | `.dat` beside it | total forces of node sets | `dat.rs` |
//! | `.vtu` | VTK, one step | `vtk.rs` |
//! | `.pvd` | ParaView's list of `.vtu` files, one step each | `vtk.rs` |
//! | `.xdmf` | XDMF with its numbers inside, in binary files or in HDF5; a state each grid of a series | `xdmf` |
//! | `.inp` | an Abaqus mesh; the results stand in a `.csv`, a report `.rpt` or a `.npz` of the same name | `nodal.rs`, `rpt.rs` |
//! | `.cdb` | an Ansys mesh; the results stand in a `.csv`, or as listings in a `.txt` or `.lis`, of the same name | `nodal.rs` |
//! | `.xplt` | FEBio's plot file, binary, compressed or not | `xplt` |
//! | `.npz` | the same arrays as in a folder | `stacks.rs` |
//! | a folder | NumPy arrays: `points.npy`, `tetra10.npy`, `displacement.npy` (steps x nodes x 3), ... | `stacks.rs` |

mod assemble;
mod dat;
mod frd;
mod groups;
mod listing;
mod middles;
mod nodal;
mod rpt;
mod run;
mod stacks;
mod vtk;
mod xdmf;
mod xplt;

pub use assemble::{Assembly, Chosen, Wanted};
pub use dat::parse as parse_dat;
pub use frd::parse as parse_frd;
pub use listing::parse as parse_listing;
pub use rpt::parse as parse_rpt;
pub use run::{Quantity, Run, Step, Total};
pub use stacks::parse_archive as parse_npz;
pub use vtk::parse_list as parse_pvd;
pub use xdmf::parse as parse_xdmf;
pub use xplt::parse as parse_xplt;

use crate::error::{Diagnostic, FormatError};
use std::path::Path;

/// Formats of which the reader is another program.
const ELSEWHERE: [(&str, &str); 7] = [
    ("h5", "the .xdmf beside it says what its data sets are; name that one"),
    ("vtk", "meshio convert run.vtk run.vtu"),
    ("case", "open the EnSight case in ParaView and save its data as .pvd"),
    ("odb", "write mesh (.inp) and fields (.csv) from Abaqus' Python: docs/import.md shows the lines"),
    ("rpt", "name the .inp of the same job; the report is read beside it"),
    (
        "rst",
        "write the mesh with CDWRITE (.cdb) and nodal results with PRNSOL (.txt beside it): docs/import.md",
    ),
    ("dat", "name the .frd of the same job; the .dat is read beside it"),
];

/// Reads one finished simulation, by the ending of its name.
///
/// # Errors
/// Another ending, with what to do, or what the reader of the format refuses.
pub fn read(path: &Path) -> Result<Run, FormatError> {
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    match ending.as_deref() {
        _ if path.is_dir() => stacks::read(path),
        Some("frd") => frd::read(path),
        Some("vtu") => vtk::read(path),
        Some("pvd") => vtk::read_series(path),
        Some("xdmf" | "xmf") => xdmf::read(path),
        Some("inp") => nodal::read(path),
        Some("cdb") => nodal::read_archive(path),
        Some("xplt") => xplt::read(path),
        Some("npz") => stacks::read_archive(path),
        other => {
            let remedy = ELSEWHERE.iter().find(|(ending, _)| Some(*ending) == other);
            let expected = remedy.map_or_else(
                || {
                    "results as .frd, .vtu, .pvd, .xdmf, .xplt, .inp or .cdb with tables, .npz, or a folder of .npy"
                        .to_owned()
                },
                |(_, remedy)| format!("a format that is read here; convert it: {remedy}"),
            );
            let found = other.map_or_else(|| "no ending".into(), |ending| format!(".{ending}"));
            Err(FormatError::one(path, Diagnostic::new("file name", expected, found)))
        }
    }
}
