//! Volume of chambers: `-1/3 sum of x . n dA` over the flat facets of their walls, `n` out of the solid.
//!
//! The walls are closed parts of the mesh's surface inside its outermost part. A facet's term is the determinant of its corners over 6, which is
//! linear in the x, the y and the z of the nodes. With coordinates affine in the modal coefficients (Eq. 6 of the paper) the volume is
//! `sum_ijk t_ijk a_i b_j c_k`, where `a`, `b`, `c` are the coefficients of x, y, z after a leading 1. These few numbers are kept.

use crate::body::VolumeForm;
use crate::model::{Model, ModelError, RegimeModel};
use crate::parts::connected;
use crate::probe::{self, MeshPoint};
use crate::snapshots::RegimeKind;
use crate::vector::{Vec3, cross, dot, norm, sub};

/// Most numbers of a form: a hundred times those of three coordinates with some ten modes.
const MAX_NUMBERS: usize = 200_000;

/// Walls of chambers: facets whose normals point out of the solid.
#[derive(Clone, Debug)]
pub(super) struct Walls(Vec<[u32; 3]>);

impl Walls {
    /// The walls of the chambers that the points lie on; of all without points.
    pub fn of(model: &Model, points: &[MeshPoint]) -> Result<Self, String> {
        let (Some(mesh), false) = (model.undeformed_mm(), model.facets().is_empty()) else {
            return Err("the model has no undeformed mesh with a surface".into());
        };
        let place = |node: u32| mesh.map(|axis| f64::from(axis[node as usize]));
        let parts: Vec<(f64, Self)> = connected(model.facets(), mesh[0].len())
            .into_iter()
            .map(Self)
            .map(|walls| (-walls.volume_mm3(place), walls))
            .collect();
        // Normals out of the solid enclose the outermost part positively, chambers negatively.
        let outermost =
            parts.iter().max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).map_or(0.0, |part| part.0);
        let turned = |facets: Vec<[u32; 3]>| {
            facets.into_iter().map(|[a, b, c]| if outermost < 0.0 { [a, c, b] } else { [a, b, c] })
        };
        let mut chambers: Vec<Self> = Vec::new();
        for (_, walls) in parts.into_iter().filter(|(volume, _)| volume * outermost < 0.0) {
            chambers.push(Self(turned(walls.0).collect()));
        }
        if chambers.is_empty() {
            return Err("the mesh's surface has no closed chamber inside".into());
        }
        if points.is_empty() {
            return Ok(Self(chambers.into_iter().flat_map(|chamber| chamber.0).collect()));
        }
        let mut chosen = Vec::new();
        for (index, point) in points.iter().enumerate() {
            let node = point.weights.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(node, _)| *node);
            let has = |chamber: &&Self| chamber.0.iter().flatten().any(|corner| Some(*corner) == node);
            let found = chambers.iter().position(|chamber| has(&chamber));
            chosen.push(found.ok_or_else(|| format!("point {index} lies on no wall of a closed chamber"))?);
        }
        chosen.sort_unstable();
        chosen.dedup();
        Ok(Self(chosen.into_iter().flat_map(|at| chambers[at].0.iter().copied()).collect()))
    }

    /// Enclosed volume, mm3.
    pub fn volume_mm3(&self, place: impl Fn(u32) -> Vec3) -> f64 {
        let below_facet = |facet: &[u32; 3]| {
            let [a, b, c] = facet.map(&place);
            -dot(a, cross(b, c)) / 6.0
        };
        self.0.iter().map(below_facet).sum()
    }

    /// Area, mm2: the largest change of the volume per displacement.
    pub fn area_mm2(&self, place: impl Fn(u32) -> Vec3) -> f64 {
        let facet_area = |facet: &[u32; 3]| {
            let [a, b, c] = facet.map(&place);
            norm(cross(sub(b, a), sub(c, a))) / 2.0
        };
        self.0.iter().map(facet_area).sum()
    }
}

/// The volume of the shapes of a regime.
fn form(model: &Model, regime: &RegimeModel, walls: &Walls) -> Result<VolumeForm, String> {
    let mut nodes: Vec<u32> = walls.0.iter().flatten().copied().collect();
    nodes.sort_unstable();
    nodes.dedup();
    let local = |node: u32| nodes.partition_point(|known| *known < node);
    let facets: Vec<[usize; 3]> = walls.0.iter().map(|facet| facet.map(local)).collect();
    // Mean and modes at the nodes, by axis.
    let mut axes = [(0, 0); 3];
    let mut columns: [Vec<Vec<f64>>; 3] = Default::default();
    for axis in 0..3_u8 {
        for node in &nodes {
            let point = MeshPoint { weights: vec![(*node, 1.0)] };
            let found = probe::coordinate(model, regime, &point, axis);
            let (mean, group, weights) = found.map_err(|error: ModelError| error.to_string())?;
            let own = &mut columns[usize::from(axis)];
            own.resize(weights.len() + 1, Vec::new());
            own.iter_mut().zip(std::iter::once(mean).chain(weights)).for_each(|(to, v)| to.push(v));
            let first = regime.groups.get(group).map_or(0, |group| group.coefficients.start);
            axes[usize::from(axis)] = (first, own.len() - 1);
        }
    }
    let [x, y, z] = &columns;
    if x.len() * y.len() * z.len() > MAX_NUMBERS {
        return Err(format!(
            "a volume takes at most {MAX_NUMBERS} numbers, found {} x {} x {} modes of the {} regime",
            x.len(),
            y.len(),
            z.len(),
            regime.kind.name()
        ));
    }
    let mut numbers = vec![0.0; x.len() * y.len() * z.len()];
    let mut factors = vec![0.0; nodes.len()];
    for (j, y) in y.iter().enumerate() {
        for (k, z) in z.iter().enumerate() {
            factors.fill(0.0);
            for [a, b, c] in &facets {
                for (p, q, r) in [(*a, *b, *c), (*b, *c, *a), (*c, *a, *b)] {
                    factors[p] -= (y[q] * z[r] - y[r] * z[q]) / 6.0;
                }
            }
            for (i, x) in x.iter().enumerate() {
                let index = (i * columns[1].len() + j) * columns[2].len() + k;
                numbers[index] = x.iter().zip(&factors).map(|(x, factor)| x * factor).sum();
            }
        }
    }
    let mesh = model.undeformed_mm().unwrap_or_default();
    let area_mm2 = walls.area_mm2(|node| mesh.map(|axis| f64::from(axis[node as usize])));
    Ok(VolumeForm { axes, numbers, area_mm2 })
}

/// Forms of the volumes of one regime.
pub(super) fn forms(model: &Model, kind: RegimeKind, walls: &[Walls]) -> Result<Vec<VolumeForm>, String> {
    let Some(regime) = model.regime(kind) else { return Ok(Vec::new()) };
    walls.iter().map(|walls| form(model, regime, walls)).collect()
}
