//! `actuator.toml`: geometry, materials, loads, supports and the obstacle of one actuator, typed and checked.
//!
//! `models/pneunet/actuator.toml` explains every key. The mesh script reads the same file.

mod check;

use crate::config::{ContactSettings, Load, NewtonSettings, ProblemConfig};
use crate::contact::obstacle::{Footprint, Obstacle};
use crate::element::cavity::CavityLoad;
use crate::material::{Elastomer, SheetMaterial};
use crate::mesh::Mesh;
use crate::mesh::load::read_mesh;
use formats::{Diagnostic, FormatError};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The whole file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Actuator {
    /// Layout version, 1.
    pub layout: u32,
    /// Name of files and topics.
    pub name: String,
    /// Elastomer slab.
    pub base: Base,
    /// Block of chambers.
    pub body: Body,
    /// Cavities.
    pub chambers: Chambers,
    /// Cuts between chambers.
    pub slots: Slots,
    /// Tunnels between cavities.
    pub channels: Channels,
    /// The elastomer of base and body.
    pub elastomer: Elastomer,
    /// The strain-limiting sheet.
    pub sheet: SheetMaterial,
    /// Gravity and how pressure acts.
    pub loads: Loads,
    /// What is held.
    pub support: Support,
    /// What can be touched.
    pub obstacle: ObstacleBody,
    /// Penalties.
    pub contact: ContactSettings,
    /// Newton iteration.
    pub newton: NewtonSettings,
    /// The mesh.
    pub mesh: MeshSettings,
}

/// Elastomer slab with the sheet inside (mm).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Base {
    /// Along x, from 0.
    pub length_mm: f64,
    /// Along z, from 0.
    pub width_mm: f64,
    /// Thickness below the sheet.
    pub lower_mm: f64,
    /// Thickness above the sheet.
    pub upper_mm: f64,
}

/// Block of chambers, sunk into a pocket of the base (mm).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// x of its left end.
    pub start_mm: f64,
    /// Along x.
    pub length_mm: f64,
    /// Along z.
    pub width_mm: f64,
    /// y of its top.
    pub top_mm: f64,
    /// Depth of the pocket; its floor is the cavity's floor.
    pub pocket_mm: f64,
}

/// Cavities, repeated along x (mm).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Chambers {
    /// How many.
    pub count: usize,
    /// x at which the first begins.
    pub first_mm: f64,
    /// Along x.
    pub length_mm: f64,
    /// From one to the next.
    pub pitch_mm: f64,
    /// Along z.
    pub width_mm: f64,
    /// y of their top.
    pub top_mm: f64,
}

/// Cuts from the top, midway between neighbouring cavities (mm).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slots {
    /// Along x.
    pub width_mm: f64,
    /// y of their floor.
    pub floor_mm: f64,
}

/// Tunnels along the floor that join neighbouring cavities (mm).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Channels {
    /// Along z.
    pub width_mm: f64,
    /// y of their top.
    pub top_mm: f64,
}

/// Gravity and how pressure acts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Loads {
    /// Acceleration in the actuator frame (mm/s2).
    pub gravity_mm_s2: [f64; 3],
    /// How cavity pressure reaches the nodes.
    pub cavity_load: CavityLoad,
}

/// The face that is held; the mesh script names it `fixed`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Support {
    /// Which face.
    pub fixed: Fixed,
}

/// Faces that can be held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fixed {
    /// Left end of the body above the base.
    BodyStart,
    /// Left end of the base.
    BaseStart,
}

/// A rigid, frictionless body below the base, its near face in the plane `y = -gap`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObstacleBody {
    /// Plate or block.
    pub kind: ObstacleKind,
    /// Lower and upper x (mm).
    pub x_mm: [f64; 2],
    /// Lower and upper z (mm).
    pub z_mm: [f64; 2],
}

/// Kinds of obstacle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObstacleKind {
    /// A plate.
    Plate,
    /// A block that is gripped.
    Block,
}

/// The mesh file and the figures the mesh script needs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshSettings {
    /// `.msh` or `.vtu`, relative to `actuator.toml`.
    pub file: PathBuf,
    /// Nodes it must have; 0 for any.
    pub nodes: usize,
    /// Every edge is divided into `round(length / seed)` parts (mm).
    pub seed_mm: f64,
    /// Largest element (mm).
    pub size_mm: f64,
    /// gmsh's own optimiser works on elements of a lower quality.
    pub optimise_below: f64,
    /// Passes of the Netgen optimiser.
    pub netgen_passes: u32,
    /// gmsh's seed.
    pub random_seed: u32,
}

impl Actuator {
    /// Reads and checks the file.
    ///
    /// # Errors
    /// Not readable, not TOML of this shape, or everything that is wrong with its values at once.
    pub fn read(path: &Path) -> Result<Self, FormatError> {
        let text = std::fs::read_to_string(path).map_err(|e| FormatError::read(path, e))?;
        let actuator =
            Self::parse(&text).map_err(|problems| FormatError::Content { path: path.into(), problems })?;
        Ok(actuator)
    }

    /// [`Actuator::read`] from memory.
    ///
    /// # Errors
    /// Everything that is wrong; never empty.
    pub fn parse(text: &str) -> Result<Self, Vec<Diagnostic>> {
        let actuator: Self = toml::from_str(text).map_err(|e| {
            vec![Diagnostic::new(
                "content",
                "the keys of models/pneunet/actuator.toml",
                e.to_string().trim_end(),
            )]
        })?;
        let problems = actuator.problems();
        if problems.is_empty() { Ok(actuator) } else { Err(problems) }
    }

    /// Reads the mesh that the file at `actuator_path` names and checks it.
    ///
    /// # Errors
    /// Not readable, not a mesh, or everything that is wrong with it.
    pub fn read_mesh(&self, actuator_path: &Path) -> Result<Mesh, FormatError> {
        let path = actuator_path.parent().unwrap_or(Path::new(".")).join(&self.mesh.file);
        let mesh = read_mesh(&path, self)?;
        let (found, expected) = (mesh.nodes_mm.len(), self.mesh.nodes);
        if expected != 0 && found != expected {
            let problem =
                Diagnostic::new("nodes", format!("{expected} (mesh.nodes in actuator.toml)"), found);
            return Err(FormatError::one(&path, problem));
        }
        Ok(mesh)
    }

    /// Everything the solver needs besides the mesh.
    #[must_use]
    pub fn problem_config(&self) -> ProblemConfig {
        let footprint = Footprint { x_mm: self.obstacle.x_mm, z_mm: self.obstacle.z_mm };
        ProblemConfig {
            elastomers: vec![self.elastomer],
            sheet: Some(self.sheet),
            cavity_load: self.loads.cavity_load,
            contact: self.contact,
            plate: footprint,
            block: footprint,
            newton: self.newton,
        }
    }

    /// The loads of a state; without a gap nothing can be touched.
    #[must_use]
    pub fn load(&self, pressure_mpa: f64, gap_mm: Option<f64>) -> Load {
        let obstacle = match (gap_mm, self.obstacle.kind) {
            (None, _) => Obstacle::None,
            (Some(gap_mm), ObstacleKind::Plate) => Obstacle::Plate { gap_mm },
            (Some(gap_mm), ObstacleKind::Block) => Obstacle::Block { gap_mm },
        };
        Load { pressure_mpa, obstacle, gravity_mm_s2: self.loads.gravity_mm_s2 }
    }

    /// y of the base's top (mm).
    #[must_use]
    pub fn base_top_mm(&self) -> f64 {
        self.base.lower_mm + self.base.upper_mm
    }

    /// y of the cavities' floor (mm).
    #[must_use]
    pub fn cavity_floor_mm(&self) -> f64 {
        self.base_top_mm() - self.body.pocket_mm
    }
}
