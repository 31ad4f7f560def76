//! Checkpoints: one file per solved state, written atomically, so that a killed run keeps its solved states.

use crate::config::Load;
use crate::solver::SolveReport;
use crate::state::State;
use formats::{Diagnostic, FormatError, file};
use std::path::{Path, PathBuf};

/// First bytes of a checkpoint.
const MAGIC: [u8; 8] = *b"STWNFEM2";
const HASH: usize = 32;
/// Numbers before the arrays: loads, results, report.
const HEAD: usize = 5 + 3 + 6;

/// Solved state with the values for the database.
#[derive(Clone, Debug, PartialEq)]
pub struct Solved {
    /// State, from which others are solved.
    pub state: State,
    /// Mean von Mises stress at the nodes (MPa).
    pub von_mises_mpa: Vec<f32>,
    /// Force on the obstacle (N).
    pub contact_force_n: f64,
    /// Volume of the cavity (mm3).
    pub cavity_volume_mm3: f64,
    /// Distance at which an obstacle just clears the state (mm).
    pub clearance_mm: f64,
    /// Cost and residual.
    pub report: SolveReport,
}

/// Checkpoints of one problem in one folder.
#[derive(Clone, Debug)]
pub struct Store {
    folder: PathBuf,
    /// blake3 of mesh and configuration: checkpoints of other problems are ignored.
    problem: [u8; HASH],
}

/// Lengths of a problem's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Nodes of the mesh that the checkpoints belong to.
    pub nodes: usize,
    /// Tetrahedra of that mesh.
    pub tets: usize,
    /// Sheet triangles.
    pub sheet: usize,
}

impl Store {
    /// Checkpoints in `folder`, which is created if absent, for the problem with that hash.
    ///
    /// # Errors
    /// The operating system's.
    pub fn new(folder: &Path, problem: [u8; HASH]) -> Result<Self, FormatError> {
        file::create_folder(folder)?;
        Ok(Self { folder: folder.into(), problem })
    }

    /// Checkpoints in the same folder of the variant with that mark.
    pub(crate) fn marked(&self, mark: Option<[u8; HASH]>) -> Self {
        let Some(mark) = mark else { return self.clone() };
        let problem = *blake3::hash(&[self.problem, mark].concat()).as_bytes();
        Self { folder: self.folder.clone(), problem }
    }

    /// File with another ending next to a state's checkpoint.
    pub(crate) fn beside(&self, load: &Load, ending: &str) -> PathBuf {
        self.path(load).with_extension(ending)
    }

    /// File of a state, named by its loads, so that lists may be renamed and extended.
    fn path(&self, load: &Load) -> PathBuf {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.problem);
        for value in given_values(load).into_iter().chain(load.injected_mm3) {
            hasher.update(&value.to_le_bytes());
        }
        self.folder.join(format!("{}.state", &hasher.finalize().to_hex()[..24]))
    }

    /// Writes a state atomically.
    pub fn save(&self, solved: &Solved) -> Result<(), FormatError> {
        file::replace(&self.path(&solved.state.load), &self.encode(solved))
    }

    /// Stored state with these loads. A damaged file counts as absent.
    pub fn load(&self, load: &Load, sizes: Sizes) -> Option<Solved> {
        let bytes = file::read_bytes(&self.path(load), file::MAX_DATA_BYTES).ok()?;
        self.decode(&bytes, load, sizes).ok()
    }

    fn encode(&self, solved: &Solved) -> Vec<u8> {
        let state = &solved.state;
        let SolveReport { factorisations, steps, cuts, residual_n, residual, seconds } = solved.report;
        let mut values = load_values(&state.load).to_vec();
        values.extend([solved.contact_force_n, solved.cavity_volume_mm3, solved.clearance_mm]);
        values.extend([factorisations, steps, cuts].map(|n| n as f64));
        values.extend([residual_n, residual, seconds]);
        values.extend(state.displacement_mm.as_flattened());
        values.extend(&state.element_pressure_mpa);
        values.extend(state.sheet_resultants_n_per_mm.as_flattened().as_flattened());
        let mut bytes = MAGIC.to_vec();
        bytes.extend(self.problem);
        values.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        solved.von_mises_mpa.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        let hash = blake3::hash(&bytes);
        bytes.extend(hash.as_bytes());
        bytes
    }

    fn decode(&self, bytes: &[u8], load: &Load, sizes: Sizes) -> Result<Solved, Diagnostic> {
        let wrong = |found: &str| Diagnostic::new("checkpoint", "a whole state of this problem", found);
        let (body, hash) = bytes.split_last_chunk::<HASH>().ok_or_else(|| wrong("too few bytes"))?;
        if blake3::hash(body).as_bytes() != hash {
            return Err(wrong("a wrong checksum"));
        }
        let content = body
            .strip_prefix(&MAGIC)
            .and_then(|rest| rest.strip_prefix(&self.problem))
            .ok_or_else(|| wrong("another problem"))?;
        let counts = [HEAD, sizes.nodes * 3, sizes.tets, sizes.sheet * 9];
        let doubles = counts.iter().sum::<usize>() * 8;
        if content.len() != doubles + sizes.nodes * 4 {
            return Err(wrong("another length"));
        }
        let (head, stress) = content.split_at(doubles);
        let values: Vec<f64> = head.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        let (head, rest) = values.split_at(HEAD);
        let (&loads, head) = head.split_first_chunk().ok_or_else(|| wrong("another length"))?;
        let &[contact_force_n, cavity_volume_mm3, clearance_mm, ref report @ ..] = head else {
            return Err(wrong("another length"));
        };
        let &[factorisations, steps, cuts, residual_n, residual, seconds] = report else {
            return Err(wrong("another length"));
        };
        let [factorisations, steps, cuts] = [factorisations, steps, cuts].map(|n| n as usize);
        let of_head = Load { pressure_mpa: loads[0], ..*load };
        if loads != load_values(&of_head) || given_values(&of_head) != given_values(load) {
            return Err(wrong("other loads"));
        }
        let (displacement, rest) = rest.split_at(counts[1]);
        let (pressure, sheet) = rest.split_at(counts[2]);
        Ok(Solved {
            state: State {
                displacement_mm: displacement.as_chunks().0.to_vec(),
                element_pressure_mpa: pressure.to_vec(),
                sheet_resultants_n_per_mm: sheet.as_chunks::<3>().0.as_chunks::<3>().0.to_vec(),
                load: of_head,
            },
            von_mises_mpa: stress.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
            contact_force_n,
            cavity_volume_mm3,
            clearance_mm,
            report: SolveReport { factorisations, steps, cuts, residual_n, residual, seconds },
        })
    }
}

/// [`load_values`] that are given: -1 in place of a pressure that is a result.
fn given_values(load: &Load) -> [f64; 5] {
    let [pressure, rest @ ..] = load_values(load);
    let [gap, x, y, z] = rest;
    [if load.injected_mm3.is_some() { -1.0 } else { pressure }, gap, x, y, z]
}

/// Pressure, gap (-1 when free) and gravity.
fn load_values(load: &Load) -> [f64; 5] {
    let [x, y, z] = load.gravity_mm_s2;
    [load.pressure_mpa, load.obstacle.gap_mm().unwrap_or(-1.0), x, y, z]
}
