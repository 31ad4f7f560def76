//! Content of `actuator.toml`.

use crate::config::{ContactSettings, Load, NewtonSettings, ProblemConfig};
use crate::contact::{Obstacle, Round, RoundShape};
use crate::dynamics::Dynamics;
use crate::element::cavity::CavityLoad;
use crate::material::{Elastomer, Film, SheetMaterial};
use formats::database::ObstacleKind;
use rom::snapshots::Footprint;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The whole file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Actuator {
    /// Layout version, 1.
    pub layout: u32,
    /// Name of files and topics.
    pub name: String,
    /// Base; without it the shape is that of the mesh file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base: Option<Base>,
    /// Block of chambers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body: Option<BodySpec>,
    /// Size, number and pitch of the cavities in the block.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chambers: Option<Chambers>,
    /// Cuts between chambers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slots: Option<Slots>,
    /// Tunnels between cavities.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channels: Option<Channels>,
    /// The elastomer of every volume without an entry in `materials`.
    pub elastomer: Elastomer,
    /// Materials of named volumes.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub materials: BTreeMap<String, Elastomer>,
    /// The strain-limiting sheet.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sheet: Option<SheetMaterial>,
    /// Membranes on the surfaces `film.NAME`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub films: BTreeMap<String, Film>,
    /// Pressures of the cavities `cavity.NAME` (MPa), in addition to that of `cavity`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub pressure_mpa: BTreeMap<String, f64>,
    /// Gravity and how pressure acts.
    pub loads: Loads,
    /// The surface that is held.
    pub support: Support,
    /// The rigid body below the base; without it there is a plate without end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub obstacle: Option<ObstacleBody>,
    /// Penalties by which contact is enforced. A body that touches nothing leaves them out.
    #[serde(default)]
    pub contact: ContactSettings,
    /// Newton iteration. The defaults suit every actuator that has been solved so far, so most files leave it out.
    #[serde(default)]
    pub newton: NewtonSettings,
    /// The mesh file and, of a mesh of boxes, how it was made.
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
pub struct BodySpec {
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

/// Cavities, repeated along x (mm). All y count from the underside of the base.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Chambers {
    /// Number of cavities.
    pub count: usize,
    /// x of the first cavity's begin.
    pub first_mm: f64,
    /// Along x.
    pub length_mm: f64,
    /// From one cavity to the next, along x.
    pub pitch_mm: f64,
    /// Along z.
    pub width_mm: f64,
    /// y of their top.
    pub top_mm: f64,
    /// Along x, one for each cavity instead of `length_mm`; the walls between them are those of `pitch_mm` and `length_mm`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lengths_mm: Vec<f64>,
    /// y of their tops, one for each cavity instead of `top_mm`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tops_mm: Vec<f64>,
    /// Name of the cavity of a second row, that of the first one mirrored at the middle of the base with body, slots and channels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opposite: Option<String>,
}

impl Chambers {
    /// x of the begin and the end of a cavity (mm).
    pub fn along_mm(&self, i: usize) -> [f64; 2] {
        if self.lengths_mm.is_empty() {
            let start = self.first_mm + i as f64 * self.pitch_mm;
            return [start, start + self.length_mm];
        }
        let before: f64 = self.lengths_mm.iter().take(i).map(|length| length + self.wall_mm()).sum();
        let start = self.first_mm + before;
        [start, start + self.lengths_mm.get(i).copied().unwrap_or(f64::NAN)]
    }

    /// y of the top of a cavity (mm).
    pub fn cavity_top_mm(&self, i: usize) -> f64 {
        self.tops_mm.get(i).copied().unwrap_or(self.top_mm)
    }

    /// Lowest and highest top of a cavity (mm).
    pub fn tops_range_mm(&self) -> [f64; 2] {
        let tops = (0..self.count).map(|i| self.cavity_top_mm(i));
        tops.fold([f64::INFINITY, 0.0], |[low, high], top| [top.min(low), top.max(high)])
    }

    /// x of the end of the last cavity (mm).
    pub fn end_mm(&self) -> f64 {
        self.along_mm(self.count.saturating_sub(1))[1]
    }

    /// Distance between neighbouring cavities (mm).
    pub fn wall_mm(&self) -> f64 {
        self.pitch_mm - self.length_mm
    }
}

/// Cuts from the top, midway between neighbouring cavities (mm).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slots {
    /// Along x.
    pub width_mm: f64,
    /// y of their floor.
    pub floor_mm: f64,
    /// Depth of the cuts from both sides of the body, from the base up: with them the outline is that of a bellows.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub side_mm: f64,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
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

/// The face that is held.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Support {
    /// A face of the boxes ([`Fixed`]), which the mesh script names `fixed`; or a named surface of the mesh file.
    pub fixed: String,
}

/// Faces of the boxes that can be held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fixed {
    /// Left end of the body above the base, and of an opposite one, `body-start`.
    BodyStart,
    /// Left end of the base, and of a body that begins there, `base-start`.
    BaseStart,
    /// Right end of the body above the base, and of an opposite one, `body-end`.
    BodyEnd,
    /// Right end of the base, and of a body that ends there, `base-end`.
    BaseEnd,
    /// Top of the body, `body-top`.
    BodyTop,
    /// Side of the base at z = 0, `base-front`.
    BaseFront,
    /// Side of the base at its width, `base-back`.
    BaseBack,
}

impl Fixed {
    /// All with their names.
    pub(crate) const NAMES: [(&str, Self); 7] = [
        ("body-start", Self::BodyStart),
        ("base-start", Self::BaseStart),
        ("body-end", Self::BodyEnd),
        ("base-end", Self::BaseEnd),
        ("body-top", Self::BodyTop),
        ("base-front", Self::BaseFront),
        ("base-back", Self::BaseBack),
    ];

    pub(crate) fn named(name: &str) -> Option<Self> {
        Self::NAMES.into_iter().find(|(known, _)| *known == name).map(|(_, face)| face)
    }
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

    fn form(self) -> Option<RoundShape> {
        match self {
            Self::Plate | Self::Block => None,
            Self::Sphere => Some(RoundShape::Sphere),
            Self::Cylinder => Some(RoundShape::Cylinder),
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
    /// `.msh`, `.inp` or `.vtu`, relative to `actuator.toml`.
    pub file: PathBuf,
    /// Name in the mesh file of a surface or volume that has another one in `actuator.toml`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub names: BTreeMap<String, String>,
    /// Required number of nodes; 0 for any. This and the following belong to a mesh of boxes.
    #[serde(default)]
    pub nodes: usize,
    /// Every edge is divided into `round(length / seed)` parts (mm).
    #[serde(default)]
    pub seed_mm: f64,
    /// Largest element (mm).
    #[serde(default)]
    pub size_mm: f64,
    /// gmsh's own optimiser works on elements of a lower quality.
    #[serde(default)]
    pub optimise_below: f64,
    /// Passes of the Netgen optimiser.
    #[serde(default)]
    pub netgen_passes: u32,
    /// gmsh's seed.
    #[serde(default)]
    pub random_seed: u32,
}

/// The boxes of an actuator.
#[derive(Clone, Copy, Debug)]
pub struct Shape<'a> {
    /// The slab that the block stands on.
    pub base: &'a Base,
    /// Block of chambers.
    pub body: &'a BodySpec,
    /// Size, number and pitch of the cavities.
    pub chambers: &'a Chambers,
    /// Cuts between chambers, if any.
    pub slots: Option<&'a Slots>,
    /// Tunnels between cavities, if any.
    pub channels: Option<&'a Channels>,
    /// The face that is held.
    pub fixed: Fixed,
    /// True with a sheet between the lower and the upper part of the base.
    pub sheet: bool,
}

impl Actuator {
    /// The boxes; `None` if the mesh file has the shape.
    pub fn shape(&self) -> Option<Shape<'_>> {
        Some(Shape {
            base: self.base.as_ref()?,
            body: self.body.as_ref()?,
            chambers: self.chambers.as_ref()?,
            slots: self.slots.as_ref(),
            channels: self.channels.as_ref(),
            fixed: Fixed::named(&self.support.fixed)?,
            sheet: self.sheet.is_some(),
        })
    }

    /// Configuration of the solver.
    pub fn problem_config(&self) -> ProblemConfig {
        let obstacle = self.obstacle.as_ref();
        let footprint = obstacle.map_or(Footprint::PLATE, |o| Footprint { x_mm: o.x_mm, z_mm: o.z_mm });
        let round = obstacle.and_then(|o| {
            let (form, (radius_mm, centre_mm)) = o.kind.form().zip(o.radius_mm.zip(o.centre_mm))?;
            Some(Round { form, radius_mm, centre_mm })
        });
        ProblemConfig {
            elastomers: std::iter::once(self.elastomer).chain(self.materials.values().copied()).collect(),
            sheet: self.sheet,
            films: self.films.values().cloned().collect(),
            cavities_mpa: self.pressure_mpa.values().copied().collect(),
            cavity_load: self.loads.cavity_load,
            contact: self.contact,
            plate: footprint,
            round,
            block: footprint,
            newton: self.newton,
        }
    }

    /// Loads of a state; without a gap there is no obstacle.
    pub fn load(&self, pressure_mpa: f64, gap_mm: Option<f64>) -> Load {
        let obstacle = match (gap_mm, self.obstacle_kind()) {
            (None, _) => Obstacle::None,
            (Some(gap_mm), ObstacleKind::Plate) => Obstacle::Plate { gap_mm },
            (Some(gap_mm), ObstacleKind::Block) => Obstacle::Block { gap_mm },
        };
        Load { pressure_mpa, obstacle, gravity_mm_s2: self.loads.gravity_mm_s2, ..Load::default() }
    }

    /// Kind of obstacle in the names of the database's regimes.
    pub fn obstacle_kind(&self) -> ObstacleKind {
        self.obstacle.as_ref().map_or(ObstacleKind::Plate, |obstacle| obstacle.kind.class())
    }

    /// Smallest wall of a chamber (mm); `None` without boxes.
    pub fn thinnest_wall_mm(&self) -> Option<f64> {
        self.shape().map(|shape| shape.thinnest_wall_mm())
    }
}

impl Shape<'_> {
    /// y of the base's top above its underside (mm).
    pub fn base_top_mm(&self) -> f64 {
        self.base.lower_mm + self.base.upper_mm
    }

    /// y of the base's underside in the mesh (mm): the lowest point of the actuator is at 0, that of a second row too.
    pub fn base_mm(&self) -> f64 {
        self.chambers.opposite.as_ref().map_or(0.0, |_| self.body.top_mm - self.base_top_mm())
    }

    /// Largest distance from the held face along x (mm).
    pub fn free_mm(&self) -> f64 {
        match self.fixed {
            Fixed::BodyStart => self.base.length_mm - self.body.start_mm,
            Fixed::BodyEnd => self.body.start_mm + self.body.length_mm,
            Fixed::BaseStart | Fixed::BaseEnd | Fixed::BodyTop | Fixed::BaseFront | Fixed::BaseBack => {
                self.base.length_mm
            }
        }
    }

    /// Thickness of the thinnest wall of a chamber: towards a slot or the next one, outwards, at the top (mm).
    pub fn thinnest_wall_mm(&self) -> f64 {
        let (body, chambers) = (self.body, self.chambers);
        let (end, between) = (chambers.end_mm(), chambers.wall_mm());
        let inner = match (chambers.count, self.slots) {
            (1, _) => f64::INFINITY,
            (_, Some(slots)) => 0.5 * (between - slots.width_mm),
            (_, None) => between,
        };
        let walls = [
            inner,
            chambers.first_mm - body.start_mm,
            body.start_mm + body.length_mm - end,
            0.5 * (body.width_mm - chambers.width_mm),
            body.top_mm - chambers.tops_range_mm()[1],
        ];
        walls.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// y of the cavities' floor above the base's underside (mm).
    pub fn cavity_floor_mm(&self) -> f64 {
        self.base_top_mm() - self.body.pocket_mm
    }
}
