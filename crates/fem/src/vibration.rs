//! Small vibrations about a state: the lowest eigenpairs of tangent and mass.

use crate::algebra::{Vec3, dot};
use crate::linear::LinearError;
use crate::mass::{Mass, gather, product, scatter};
use crate::newton::NewtonError;
use crate::problem::Problem;
use crate::solver::Solver;
use crate::state::State;
use crate::system::{Ahead, face};
use faer::Mat;
use std::sync::Arc;
use thiserror::Error;

/// Vectors of the Krylov space per wanted vibration, and further ones.
const VECTORS: [usize; 2] = [4, 12];

/// Vibration about a state.
#[derive(Clone, Debug, PartialEq)]
pub struct Vibration {
    /// Circular frequency, rad/s.
    pub rate_rad_s: f64,
    /// Shape at the nodes (mm), normalised to a modal mass of 1 t.
    pub shape_mm: Vec<Vec3>,
    /// Change of the contact force per amplitude, N.
    pub reaction_n: f64,
}

/// Why a state has no vibrations.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs)] // the messages say what the values are
pub enum VibrationError {
    /// The state is invalid.
    #[error(transparent)]
    State(#[from] NewtonError),
    /// The tangent cannot be factorised.
    #[error(transparent)]
    Linear(#[from] LinearError),
    /// The state is at or beyond a limit point.
    #[error(
        "the state at {pressure_mpa} MPa is not stable: its tangent is not positive definite; choose a lower pressure"
    )]
    Unstable { pressure_mpa: f64 },
    /// The body has no mass, or the small eigenproblem failed.
    #[error("no vibrations were found: expected a density above 0 and more unknowns than vibrations")]
    None,
}

/// Consistent mass of a problem.
pub struct BodyMass {
    problem: Arc<Problem>,
    mass: Mass,
}

impl BodyMass {
    /// Assembles the mass.
    pub fn new(problem: Arc<Problem>) -> Self {
        Self { mass: Mass::new(&problem), problem }
    }

    /// `M v` at the nodes (t mm) of a vector that is 0 at held nodes.
    pub fn times(&self, nodal: &[Vec3]) -> Vec<Vec3> {
        scatter(&self.problem, &self.mass.times(&self.problem, &gather(&self.problem, nodal)))
    }

    /// Force of a unit acceleration on each node (t), as in the static states.
    pub fn node_mass_t(&self) -> &[f64] {
        &self.problem.node_mass_t
    }
}

impl Solver {
    /// The `count` slowest vibrations about a solved state, by increasing frequency, undamped and without friction. By Lanczos' method;
    /// cost: one factorisation and `4 count + 12` solves.
    pub fn vibrations(&mut self, state: &State, count: usize) -> Result<Vec<Vibration>, VibrationError> {
        let problem = Arc::clone(self.problem());
        let mass = Mass::new(&problem);
        let tangent = self.tangent_at(state)?;
        if !tangent.positive_definite() {
            return Err(VibrationError::Unstable { pressure_mpa: state.load.pressure_mpa });
        }
        let unknowns = problem.pattern.unknowns();
        let steps = (VECTORS[0] * count + VECTORS[1]).min(unknowns);
        // The start has a part of every vibration.
        let mut next: Vec<f64> = (0..unknowns).map(|k| (k * 7919 % 1009) as f64 - 504.0).collect();
        let (mut basis, mut weighted): (Vec<Vec<f64>>, Vec<Vec<f64>>) = (Vec::new(), Vec::new());
        let mut projected = Mat::<f64>::zeros(steps, steps);
        for step in 0..steps {
            for _ in 0..2 {
                for (v, w) in basis.iter().zip(&weighted) {
                    let part = product(w, &next);
                    next.iter_mut().zip(v).for_each(|(x, v)| *x -= part * v);
                }
            }
            let product_of_next = mass.times(&problem, &next);
            let size = product(&next, &product_of_next).sqrt();
            if !size.is_normal() {
                return Err(VibrationError::None);
            }
            basis.push(next.iter().map(|x| x / size).collect());
            weighted.push(product_of_next.iter().map(|x| x / size).collect());
            next.clone_from(&weighted[step]);
            tangent.solve(&mut next);
            for (row, w) in weighted.iter().enumerate() {
                projected[(row, step)] = product(w, &next);
                projected[(step, row)] = projected[(row, step)];
            }
        }
        // Symmetric and positive: its singular vectors are its eigenvectors.
        let svd = projected.thin_svd().map_err(|_| VibrationError::None)?;
        let vibration = |k: usize| {
            let square = svd.S().column_vector()[k];
            let mut shape = vec![0.0; unknowns];
            for (j, v) in basis.iter().enumerate() {
                shape.iter_mut().zip(v).for_each(|(x, v)| *x += svd.U()[(j, k)] * v);
            }
            let shape_mm = scatter(&problem, &shape);
            let reaction_n = reaction(&problem, state, &shape_mm);
            Vibration { rate_rad_s: square.recip().sqrt(), shape_mm, reaction_n }
        };
        Ok((0..count.min(steps)).map(vibration).collect())
    }
}

/// Change of the contact force per amplitude of a shape, N.
fn reaction(problem: &Problem, state: &State, shape_mm: &[Vec3]) -> f64 {
    let Some(face) = face(problem, state.load.obstacle) else { return 0.0 };
    let x = problem.positions(&state.displacement_mm);
    let of_node = |(n, stiffness): (&u32, &f64)| {
        let n = *n as usize;
        face.touch(x[n]).map_or(0.0, |touch| -stiffness * dot(touch.tangent()[1], shape_mm[n]))
    };
    problem.contact_nodes.iter().zip(&problem.contact_stiffness_n_per_mm).map(of_node).sum()
}

/// Assembles and factorises the tangent of a state.
impl Solver {
    fn tangent_at(&mut self, state: &State) -> Result<&mut crate::tangent::Tangent, VibrationError> {
        let problem = Arc::clone(self.problem());
        let newton = self.newton();
        newton
            .system
            .assemble(&problem, state, &state.load, Ahead::default(), true)
            .map_err(NewtonError::from)?;
        newton.tangent.factorise(&problem, &newton.system)?;
        Ok(&mut newton.tangent)
    }
}
