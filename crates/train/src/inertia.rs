//! Reduced inertia of a trained model: M-orthonormal coordinates of its training states, and linear modes.
//!
//! Coordinates `Psi` are the POD of the deformed shapes in the metric of the mass matrix `M`, extended by the linear modes. Modal coefficients
//! `c` of a regime with coordinate modes `Phi` then have the coordinates `Psi' M (mean - x_0) + (Psi' M Phi) c`.

use crate::error::TrainError;
use faer::Mat;
use rom::inertia::data::{InertiaModel, MotionWidths, RegimeInertia, StoredLoad, StoredMode};
use rom::inertia::manifold::{MAX_COORDINATES, MAX_LINEAR_MODES};
use rom::inputs::PARAMETERS;
use rom::memory::PronyTerm;
use rom::model::{Model, RegimeModel};
use rom::snapshots::{Database, RegimeKind, Split};

/// Vector at each node, all x, then all y, then all z.
pub type Nodal = Vec<f64>;

/// Fraction of the mass-weighted size of the shapes below which further coordinates are left out.
const SMALLEST: f64 = 2e-5;
/// Part of a linear mode outside the coordinates from which it becomes a coordinate.
const OUTSIDE: f64 = 1e-3;

/// Mass of a body, as the finite elements provide it.
pub struct Mass<'a> {
    /// Names of the model's inputs that are inertial loads (`loads.gravity_mm_s2.1`), that of landing first, and the force of a unit of
    /// each on the nodes, t.
    pub loads: Vec<(&'a str, Nodal)>,
    /// Mass matrix times a vector.
    pub times: &'a dyn Fn(&[f64]) -> Nodal,
    /// Damping proportional to the stiffness, s.
    pub damping_s: f64,
    /// Length of the inner steps, ns.
    pub step_ns: u64,
    /// Relaxation of the elastomer.
    pub prony: Vec<PronyTerm>,
}

/// Result of a reduction.
pub struct Reduced {
    /// For the record [`BlockKind::Inertia`], without half-widths of the motion.
    pub inertia: InertiaModel,
    /// Parts of the linear modes outside the regime's modes, by regime and mode, relative to their size.
    pub outside: Vec<(RegimeKind, f64)>,
}

/// Reduces a mass to a model and the database that it was trained on. Cost: one product with the mass per training state.
///
/// # Errors
/// [`TrainError::Database`] if a load is no input, coordinates are missing or nodes differ.
pub fn reduce(model: &Model, database: &Database, mass: &Mass<'_>) -> Result<Reduced, TrainError> {
    let wrong = |what: String| TrainError::Database(vec![what]);
    let inputs = &model.header.inputs;
    let input = |name: &str| {
        let position =
            inputs.iter().position(|input| input.name == name).filter(|position| *position >= PARAMETERS);
        position
            .ok_or_else(|| wrong(format!("inertia: no parameter {name} varies between the cases; sample it")))
    };
    let places = mass.loads.iter().map(|(name, _)| input(name)).collect::<Result<Vec<usize>, _>>()?;
    let axes = [0, 1, 2].map(|axis| database.coordinate(axis));
    let [Some(x), Some(y), Some(z)] = axes else {
        return Err(wrong("inertia: expected the coordinates x, y and z as fields".into()));
    };
    let nodes = database.node_count;
    if let Some((_, unit)) = mass.loads.iter().find(|(_, unit)| unit.len() != 3 * nodes) {
        let found = unit.len() / 3;
        return Err(wrong(format!(
            "inertia: expected a mesh of {nodes} nodes, as the database, found {found}"
        )));
    }
    let fields = [x, y, z];
    let states: Vec<Nodal> = database
        .of_split(Split::Train)
        .map(|case| fields.iter().flat_map(|f| database.field(case, *f)).map(f64::from).collect())
        .collect();
    let count = states.len() as f64;
    let centre: Nodal =
        (0..3 * nodes).map(|i| states.iter().map(|state| state[i]).sum::<f64>() / count).collect();
    let (shapes, weighted) = coordinates(&states, &centre, database, mass)
        .ok_or_else(|| wrong("inertia: the training states do not differ".into()))?;
    let stored = |(input, (_, unit)): (&usize, &(&str, Nodal))| StoredLoad {
        input: *input as u32,
        unit: shapes.iter().map(|psi| dot(psi, unit)).collect(),
    };
    let loads = places.iter().zip(&mass.loads).map(stored).collect();
    let (mut regimes, mut outside) = (Vec::new(), Vec::new());
    for regime in &model.header.regimes {
        let modes = CoordinateModes::new(model, regime, fields).map_err(wrong)?;
        let off: Nodal = modes.mean.iter().zip(&centre).map(|(mean, centre)| mean - centre).collect();
        let by_coefficient =
            weighted.iter().flat_map(|psi| (0..regime.coefficient_count()).map(|k| modes.product(k, psi)));
        let by_coefficient = by_coefficient.collect();
        let of_regime = database.vibrations.iter().filter(|vibration| vibration.regime == regime.kind);
        let mut stored = Vec::new();
        for vibration in of_regime.take(MAX_LINEAR_MODES) {
            let coefficients: Vec<f64> =
                (0..regime.coefficient_count()).map(|k| modes.product(k, &vibration.shape_mm)).collect();
            let size = dot(&vibration.shape_mm, &vibration.shape_mm);
            let inside: f64 = coefficients.iter().map(|c| c * c).sum();
            outside.push((regime.kind, (1.0 - inside / size).max(0.0).sqrt()));
            stored.push(StoredMode {
                rate_rad_s: vibration.rate_rad_s,
                shape: weighted.iter().map(|psi| dot(psi, &vibration.shape_mm)).collect(),
                heights_mm: heights(model, regime, &coefficients),
                coefficients,
                reaction_n: vibration.reaction_n,
            });
        }
        regimes.push(RegimeInertia {
            kind: regime.kind,
            mean: weighted.iter().map(|psi| dot(psi, &off)).collect(),
            by_coefficient,
            modes: stored,
        });
    }
    let (damping_s, step_ns) = (mass.damping_s, mass.step_ns);
    let widths = MotionWidths::default();
    let prony = mass.prony.clone();
    let inertia = InertiaModel { loads, step_ns, damping_s, regimes, widths, prony };
    inertia.check(&model.header).map_err(wrong)?;
    Ok(Reduced { inertia, outside })
}

/// M-orthonormal modes of the states about a centre, then of the linear modes; and their products with the mass.
fn coordinates(
    states: &[Nodal],
    centre: &Nodal,
    database: &Database,
    mass: &Mass<'_>,
) -> Option<(Vec<Nodal>, Vec<Nodal>)> {
    let off: Vec<Nodal> =
        states.iter().map(|state| state.iter().zip(centre).map(|(x, c)| x - c).collect()).collect();
    let weighted: Vec<Nodal> = off.iter().map(|d| (mass.times)(d)).collect();
    let gram = Mat::from_fn(off.len(), off.len(), |i, j| dot(&off[i], &weighted[j]));
    // Symmetric and not negative: its singular vectors are its eigenvectors.
    let svd = gram.thin_svd().ok()?;
    let squares: Vec<f64> = svd.S().column_vector().iter().copied().collect();
    let most = MAX_COORDINATES.saturating_sub(database.vibrations.len());
    let enough = |square: &&f64| **square > SMALLEST * SMALLEST * squares[0] && **square > 0.0;
    let count = squares.iter().take_while(enough).count().min(most);
    let combined = |directions: &[Nodal], k: usize| -> Nodal {
        let factor = 1.0 / squares[k].sqrt();
        (0..centre.len())
            .map(|i| factor * directions.iter().enumerate().map(|(j, d)| svd.U()[(j, k)] * d[i]).sum::<f64>())
            .collect()
    };
    let mut shapes: Vec<Nodal> = (0..count).map(|k| combined(&off, k)).collect();
    let mut products: Vec<Nodal> = (0..count).map(|k| combined(&weighted, k)).collect();
    for vibration in &database.vibrations {
        let mut rest = vibration.shape_mm.clone();
        for _ in 0..2 {
            for (psi, weighted) in shapes.iter().zip(&products) {
                let part = dot(weighted, &rest);
                rest.iter_mut().zip(psi).for_each(|(r, psi)| *r -= part * psi);
            }
        }
        let product = (mass.times)(&rest);
        let size = dot(&rest, &product).sqrt();
        if size > OUTSIDE {
            shapes.push(rest.iter().map(|r| r / size).collect());
            products.push(product.iter().map(|p| p / size).collect());
        }
    }
    (count > 0).then_some((shapes, products))
}

/// Coordinate modes of a regime, as the model stores them.
struct CoordinateModes<'a> {
    mean: Nodal,
    /// Mode of each coefficient along each axis; none along axes of other groups.
    modes: Vec<[Option<(&'a rom::kernel::Modes, usize)>; 3]>,
    nodes: usize,
}

impl<'a> CoordinateModes<'a> {
    fn new(model: &'a Model, regime: &RegimeModel, fields: [usize; 3]) -> Result<Self, String> {
        let nodes = model.header.node_count;
        let (mut mean, mut modes) = (Vec::new(), vec![[None; 3]; regime.coefficient_count()]);
        for (axis, field) in fields.into_iter().enumerate() {
            let field = model.header.coordinate_field(axis as u8).unwrap_or(field);
            let group = regime.group_of(field).ok_or("inertia: a coordinate has no group")?;
            let values = model.mean(regime.kind, field as u32).ok_or("inertia: a coordinate has no mean")?;
            mean.extend(values.iter().map(|v| f64::from(*v)));
            let all = model.modes(regime.kind, field as u32).map_err(|error| error.to_string())?;
            for (mode, at) in group.coefficients.clone().enumerate() {
                modes[at][axis] = Some((all, mode));
            }
        }
        Ok(Self { mean, modes, nodes })
    }

    /// Product of a coefficient's mode with a vector.
    fn product(&self, coefficient: usize, v: &[f64]) -> f64 {
        let axes = self.modes[coefficient].iter().zip(v.chunks_exact(self.nodes));
        let along = axes.filter_map(|(modes, v)| modes.map(|(modes, mode)| (modes, mode, v)));
        along
            .map(|(modes, mode, v)| {
                v.iter().enumerate().map(|(node, v)| modes.value(mode, node) * v).sum::<f64>()
            })
            .sum()
    }
}

/// Heights of a linear mode at the nodes of the clearance, mm.
fn heights(model: &Model, regime: &RegimeModel, coefficients: &[f64]) -> Vec<f64> {
    let Some(clearance) = model.header.clearance.as_ref().filter(|_| regime.kind == RegimeKind::Free) else {
        return Vec::new();
    };
    let of_group = &coefficients[regime.groups[clearance.group].coefficients.clone()];
    clearance.modes.chunks_exact(of_group.len()).map(|row| dot(row, of_group)).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
