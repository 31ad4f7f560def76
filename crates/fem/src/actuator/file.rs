//! Content of `actuator.toml`.

use crate::config::{ContactSettings, Load, NewtonSettings, ProblemConfig};
use crate::contact::obstacle::{Form, Obstacle, Round};
use crate::dynamics::Dynamics;
use crate::element::cavity::CavityLoad;
use crate::material::{Elastomer, SheetMaterial};
use formats::database::ObstacleKind;
use rom::snapshots::Footprint;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The whole file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Actuator {
    /// Layout version, 1.
    pub layout: u32,
    /// Name of files and topics.
    pub name: String,
    /// Base.
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
    /// Support.
    pub support: Support,
    /// Obstacle.
    pub obstacle: ObstacleBody,
    /// Penalties.
    pub contact: ContactSettings,
    /// Newton iteration.
    pub newton: NewtonSettings,
    /// The mesh.
    pub mesh: MeshSettings,
    /// Damping and relaxation in transients.
    #[serde(default)]
    pub dynamics: Dynamics,
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
    /// Number of cavities.
    pub count: usize,
    /// x of the first cavity's begin.
    pub first_mm: f64,
    /// Along x.
    pub length_mm: f64,
    /// Pitch.
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
    /// Held face.
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

/// Kinds of obstacles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObstacleShape {
    /// A plate below the actuator.
    Plate,
    /// The block that a finger grips.
    Block,
    /// A sphere instead of the plate.
    Sphere,
    /// A cylinder across the actuator, instead of the plate.
    Cylinder,
}

impl ObstacleShape {
    /// Kind of obstacle in the names of the database's regimes.
    #[must_use]
    pub fn class(self) -> ObstacleKind {
        if self == Self::Block { ObstacleKind::Block } else { ObstacleKind::Plate }
    }

    fn form(self) -> Option<Form> {
        match self {
            Self::Plate | Self::Block => None,
            Self::Sphere => Some(Form::Sphere),
            Self::Cylinder => Some(Form::Cylinder),
        }
    }
}

/// A rigid, frictionless body below the base, its near face or highest point in the plane `y = -gap`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObstacleBody {
    /// Plate, block, sphere or cylinder.
    pub kind: ObstacleShape,
    /// Radius of a sphere or cylinder (mm).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<f64>,
    /// x and z (mm) of the highest point of a sphere or cylinder; a cylinder lies along z.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub centre_mm: Option<[f64; 2]>,
    /// Lower and upper x (mm).
    pub x_mm: [f64; 2],
    /// Lower and upper z (mm).
    pub z_mm: [f64; 2],
}

/// Mesh file and parameters of the mesh script.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshSettings {
    /// `.msh` or `.vtu`, relative to `actuator.toml`.
    pub file: PathBuf,
    /// Required number of nodes; 0 for any.
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
    /// Configuration of the solver.
    #[must_use]
    pub fn problem_config(&self) -> ProblemConfig {
        let footprint = Footprint { x_mm: self.obstacle.x_mm, z_mm: self.obstacle.z_mm };
        let ObstacleBody { kind, radius_mm, centre_mm, .. } = self.obstacle;
        let round = kind.form().zip(radius_mm.zip(centre_mm));
        ProblemConfig {
            elastomers: vec![self.elastomer],
            sheet: Some(self.sheet),
            cavity_load: self.loads.cavity_load,
            contact: self.contact,
            plate: footprint,
            round: round.map(|(form, (radius_mm, centre_mm))| Round { form, radius_mm, centre_mm }),
            block: footprint,
            newton: self.newton,
        }
    }

    /// Loads of a state; without a gap there is no obstacle.
    #[must_use]
    pub fn load(&self, pressure_mpa: f64, gap_mm: Option<f64>) -> Load {
        let obstacle = match (gap_mm, self.obstacle.kind.class()) {
            (None, _) => Obstacle::None,
            (Some(gap_mm), ObstacleKind::Plate) => Obstacle::Plate { gap_mm },
            (Some(gap_mm), ObstacleKind::Block) => Obstacle::Block { gap_mm },
        };
        Load { pressure_mpa, injected_mm3: None, obstacle, gravity_mm_s2: self.loads.gravity_mm_s2 }
    }

    /// y of the base's top (mm).
    #[must_use]
    pub fn base_top_mm(&self) -> f64 {
        self.base.lower_mm + self.base.upper_mm
    }

    /// Thickness of the thinnest wall of a chamber: towards a slot, outwards, at the top (mm).
    #[must_use]
    pub fn thinnest_wall_mm(&self) -> f64 {
        let (body, chambers) = (&self.body, &self.chambers);
        let end = chambers.first_mm + (chambers.count - 1) as f64 * chambers.pitch_mm + chambers.length_mm;
        let slot = match chambers.count {
            1 => f64::INFINITY,
            _ => 0.5 * (chambers.pitch_mm - chambers.length_mm - self.slots.width_mm),
        };
        let walls = [
            slot,
            chambers.first_mm - body.start_mm,
            body.start_mm + body.length_mm - end,
            0.5 * (body.width_mm - chambers.width_mm),
            body.top_mm - chambers.top_mm,
        ];
        walls.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// y of the cavities' floor (mm).
    #[must_use]
    pub fn cavity_floor_mm(&self) -> f64 {
        self.base_top_mm() - self.body.pocket_mm
    }
}
