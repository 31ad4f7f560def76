//! Configuration of a problem and loads of a state.

use serde::{Deserialize, Serialize};

use crate::contact::{Obstacle, Round};
use crate::dynamics::Dynamics;
use crate::element::cavity::CavityLoad;
use crate::material::{Elastomer, Film, Hyperelastic, SheetMaterial, VolumeChange};
use rom::memory::ATMOSPHERE_MPA;
use rom::snapshots::Footprint;

/// Gravity along -y (mm/s2), the actuator's usual attitude.
pub const GRAVITY_DOWN_MM_S2: [f64; 3] = [0.0, -9810.0, 0.0];

/// Gravity along the finger (mm/s2), the gripper's attitude.
pub const GRAVITY_ALONG_MM_S2: [f64; 3] = [9810.0, 0.0, 0.0];

/// Largest pressure, far above that of elastomer actuators; a larger value has another unit.
pub(crate) const MAX_MPA: f64 = 10.0;

/// Penalties of the contacts; a key that is left out has its default.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ContactSettings {
    /// Chamber walls: pressure per overlap (MPa/mm).
    pub slot_penalty_mpa_per_mm: f64,
    /// Chamber walls: overlap over which the penalty is rounded (mm).
    pub slot_smoothing_mm: f64,
    /// Plate or block: pressure per overlap (MPa/mm), given to the surface nodes by their areas.
    pub obstacle_penalty_mpa_per_mm: f64,
    /// Plate or block: overlap over which the penalty is rounded (mm).
    pub obstacle_smoothing_mm: f64,
}

impl Default for ContactSettings {
    fn default() -> Self {
        Self {
            slot_penalty_mpa_per_mm: 1.38,
            slot_smoothing_mm: 0.002,
            obstacle_penalty_mpa_per_mm: 6.63,
            obstacle_smoothing_mm: 0.015,
        }
    }
}

/// Limits and tolerances of the Newton iteration; a key that is left out has its default.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NewtonSettings {
    /// Iterations after which a step is given up.
    pub max_iterations: usize,
    /// Largest predicted displacement of one load step (mm): longer steps are shortened before they are taken.
    pub step_length_mm: f64,
    /// Largest nodal displacement of one iteration (mm).
    pub displacement_cap_mm: f64,
    /// Largest remaining nodal correction of a converged state (mm), estimated from the last two.
    pub correction_tolerance_mm: f64,
    /// Largest obstacle force of a converged state that the last solve did not predict (N).
    pub force_tolerance_n: f64,
    /// Smallest fraction of a load path in one step; below it the path is given up.
    pub smallest_step: f64,
}

impl Default for NewtonSettings {
    fn default() -> Self {
        Self {
            max_iterations: 14,
            step_length_mm: 8.0,
            displacement_cap_mm: 12.0,
            correction_tolerance_mm: 1.0e-5,
            force_tolerance_n: 1.0e-6,
            smallest_step: 1.0 / 256.0,
        }
    }
}

/// Materials, supports and settings that go with a mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProblemConfig {
    /// Elastomers, indexed by the mesh's `tet_material`.
    pub elastomers: Vec<Elastomer>,
    /// The strain-limiting sheet; required when the mesh has sheet triangles.
    pub sheet: Option<SheetMaterial>,
    /// Membranes, in the order of the mesh's `films`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub films: Vec<Film>,
    /// Pressures of the mesh's `cavities` (MPa): of each cavity other than that of the load's pressure.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cavities_mpa: Vec<f64>,
    /// How cavity pressure reaches the nodes.
    pub cavity_load: CavityLoad,
    /// Penalties of the contacts.
    pub contact: ContactSettings,
    /// Extent of the rigid plate or of the round body.
    pub plate: Footprint,
    /// The round body, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub round: Option<Round>,
    /// Extent of the rigid block's near face.
    pub block: Footprint,
    /// Newton iteration.
    pub newton: NewtonSettings,
}

impl Default for ProblemConfig {
    /// The reference actuator: Gent elastomer, paper sheet, the paper's plate and the gripper's block.
    fn default() -> Self {
        Self {
            elastomers: vec![Elastomer {
                law: Hyperelastic::Gent { mu_mpa: 0.8, jm: 6.0 },
                bulk_mpa: 2000.0,
                density_t_per_mm3: 1.0e-9,
                volume_change: VolumeChange::Mean,
                stretch_range: None,
                shear_interval_mpa: None,
            }],
            sheet: Some(SheetMaterial {
                youngs_mpa: 6500.0,
                poisson: 0.2,
                thickness_mm: 0.1,
                bending_penalty: 5.0,
            }),
            films: Vec::new(),
            cavities_mpa: Vec::new(),
            cavity_load: CavityLoad::FlatFacets,
            contact: ContactSettings::default(),
            plate: Footprint::PLATE,
            round: None,
            block: Footprint::BLOCK,
            newton: NewtonSettings::default(),
        }
    }
}

/// The loads of a state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Load {
    /// Cavity pressure (MPa).
    pub pressure_mpa: f64,
    /// Injected volume: that of the cavity minus that of the undeformed one (mm3). If given, the pressure is a result.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub injected_mm3: Option<f64>,
    /// Volume of the supply that the cavity is connected to (mm3). If given, `injected_mm3` is that of gas at atmospheric pressure, added
    /// to cavity and supply (`(P + P_a) (V + V_d) = P_a (V_0 + V_d + n)` at constant temperature).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dead_mm3: Option<f64>,
    /// Obstacle below the base.
    pub obstacle: Obstacle,
    /// Gravitational acceleration (mm/s2).
    pub gravity_mm_s2: [f64; 3],
    /// Pressures of further cavities minus those of the configuration's `cavities_mpa` (MPa).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub cavities_change_mpa: [f64; 6],
}

/// Volume of a milligram of air at 20 degrees Celsius and atmospheric pressure (mm3): R = 287.05 J/(kg K).
pub const MM3_PER_MG: f64 = 287.05e-3 * 293.15 / ATMOSPHERE_MPA;

/// Gas in a cavity of the volume `cavity_mm3` (mm3 at atmospheric pressure), with that of its supply.
pub(crate) fn amount_mm3(pressure_mpa: f64, cavity_mm3: f64, dead_mm3: f64) -> f64 {
    (1.0 + pressure_mpa / ATMOSPHERE_MPA) * (cavity_mm3 + dead_mm3)
}

/// Most cavities in addition to that of the load's pressure: a model has at most eight inputs.
pub const MAX_CAVITIES: usize = 6;

fn is_zero(changes: &[f64; MAX_CAVITIES]) -> bool {
    *changes == [0.0; MAX_CAVITIES]
}

/// Pressures of all cavities (MPa), that of `pressure_mpa` first; 0 for those that are absent.
pub(crate) fn pressures_mpa(config: &ProblemConfig, load: &Load) -> [f64; 1 + MAX_CAVITIES] {
    let mut pressures = [0.0; 1 + MAX_CAVITIES];
    pressures[0] = load.pressure_mpa;
    let further = config.cavities_mpa.iter().zip(&load.cavities_change_mpa);
    pressures[1..].iter_mut().zip(further).for_each(|(p, (base, change))| *p = base + change);
    pressures
}

/// Debug form of a configuration without the fields of absent parts (round obstacle, range of stretches, films, further cavities), and
/// without motion, of which static states are independent; part of a checkpoint's fingerprint.
pub(crate) fn flat(debug: &str) -> String {
    let motion = format!(", dynamics: {:?}", Dynamics::default());
    [
        ", films: []",
        ", cavities_mpa: []",
        ", round: None",
        ", radius_mm: None",
        ", centre_mm: None",
        ", stretch_range: None",
        ", shear_interval_mpa: None",
        &motion,
    ]
    .iter()
    .fold(debug.into(), |text: String, none| text.replace(none, ""))
}
