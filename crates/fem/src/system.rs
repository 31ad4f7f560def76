//! Assembly: residual forces and tangent of a state under a load.
//!
//! Two residuals are formed in one pass. `condensed` takes the element pressures and sheet resultants that follow
//! from the displacements, and is the right-hand side of the Newton equation after those unknowns are eliminated;
//! `mixed` takes the carried ones, and measures equilibrium.

use crate::algebra::{Mat3, Vec3, axpy, outer, scale, skew};
use crate::config::{Load, MAX_CAVITIES, pressures_mpa};
use crate::contact::Turning;
use crate::contact::{Face, Obstacle};
use crate::element::bending;
use crate::element::cavity::face_terms;
use crate::element::membrane::{self, Plane};
use crate::element::tet10::{Invalid, PointTensors, TetTerms};
use crate::linear::CONSTRAINED;
use crate::problem::{Problem, add_gravity};
use crate::state::State;
use formats::mesh_file::Tri6;

/// State outside the limits of the elastomer, with the element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct InvalidState {
    /// Violated limit.
    pub(crate) reason: Invalid,
    pub(crate) element: usize,
}

/// Viscous part of the stress within a step.
#[derive(Clone, Debug)]
pub(crate) struct Overstress {
    /// Factor of the isochoric energy.
    pub(crate) factor: f64,
    /// Given stress of each element (MPa).
    pub(crate) stress_mpa: Vec<PointTensors>,
}

/// Residuals, tangent and terms for the update of the stress unknowns.
#[derive(Clone, Debug)]
pub(crate) struct System {
    /// Lower triangle of the tangent, in the pattern's order.
    pub(crate) tangent: Vec<f64>,
    /// Residual force (N) at each node with stresses from the displacements.
    pub(crate) condensed: Vec<Vec3>,
    /// Residual force (N) at each node with the carried stresses.
    pub(crate) mixed: Vec<Vec3>,
    /// Part of both residuals from the contacts.
    pub(crate) contact: Vec<Vec3>,
    /// Viscous part of the elastomer's stress; `None` in static states.
    pub(crate) overstress: Option<Overstress>,
    /// `dV/du` of each element (mm2).
    pub(crate) volume_gradient: Vec<[Vec3; 10]>,
    /// Volume change of each element (mm3).
    pub(crate) volume_change: Vec<f64>,
    /// Enclosed volumes of the cavities (mm3), that of `pressure_mpa` first.
    pub(crate) cavity_volumes_mm3: [f64; 1 + MAX_CAVITIES],
    /// Total force of the base on the obstacle (N).
    pub(crate) contact_force_n: f64,
    /// Tangent parts from the rotating normals of touching slots.
    pub(crate) turning: Vec<Turning>,
    terms: TetTerms,
}

impl System {
    /// Workspace for a problem.
    pub(crate) fn new(problem: &Problem) -> Self {
        let (nodes, tets) = (problem.mesh.nodes_mm.len(), problem.mesh.tets.len());
        Self {
            tangent: vec![0.0; problem.pattern.stored()],
            condensed: vec![[0.0; 3]; nodes],
            mixed: vec![[0.0; 3]; nodes],
            contact: vec![[0.0; 3]; nodes],
            overstress: None,
            volume_gradient: vec![[[0.0; 3]; 10]; tets],
            volume_change: vec![0.0; tets],
            cavity_volumes_mm3: [0.0; 1 + MAX_CAVITIES],
            contact_force_n: 0.0,
            turning: Vec::new(),
            terms: TetTerms::default(),
        }
    }

    /// Assembles at `state` under `load` (the state's own load is not used).
    ///
    /// `ahead` predicts the step to other loads with the tangent of `load`.
    ///
    /// # Errors
    /// [`InvalidState`] names the element that collapsed or passed its material's limit.
    pub(crate) fn assemble(
        &mut self,
        problem: &Problem,
        state: &State,
        load: &Load,
        ahead: Ahead,
        with_tangent: bool,
    ) -> Result<(), InvalidState> {
        let x = problem.positions(&state.displacement_mm);
        self.assemble_body(problem, state, &x, load, ahead.pressure_mpa, with_tangent)?;
        self.assemble_contact(problem, load.obstacle, ahead.advance_mm, &x, with_tangent.then_some(1.0));
        for ((c, m), s) in self.condensed.iter_mut().zip(&mut self.mixed).zip(&self.contact) {
            axpy(1.0, *s, c);
            axpy(1.0, *s, m);
        }
        Ok(())
    }

    /// Assembles all but the contacts, at deformed positions `x` of `state`.
    pub(crate) fn assemble_body(
        &mut self,
        problem: &Problem,
        state: &State,
        x: &[Vec3],
        load: &Load,
        ahead_mpa: f64,
        with_tangent: bool,
    ) -> Result<(), InvalidState> {
        self.condensed.fill([0.0; 3]);
        if with_tangent {
            self.tangent.fill(0.0);
        }
        add_gravity(problem, load.gravity_mm_s2, &mut self.condensed);
        self.mixed.copy_from_slice(&self.condensed);
        self.add_tets(problem, state, with_tangent)?;
        self.add_membrane(problem, state, x, with_tangent);
        // The remaining forces follow from the displacements alone and are the same in both residuals.
        let mut shared = vec![[0.0; 3]; x.len()];
        self.add_bending(problem, x, &mut shared, with_tangent);
        self.add_cavities(problem, load, ahead_mpa, x, &mut shared, with_tangent);
        for ((c, m), s) in self.condensed.iter_mut().zip(&mut self.mixed).zip(&shared) {
            axpy(1.0, *s, c);
            axpy(1.0, *s, m);
        }
        Ok(())
    }

    /// Assembles the forces of the contacts and adds their tangent, multiplied by `weight`.
    pub(crate) fn assemble_contact(
        &mut self,
        problem: &Problem,
        obstacle: Obstacle,
        advance_mm: f64,
        x: &[Vec3],
        weight: Option<f64>,
    ) {
        let mut forces = std::mem::take(&mut self.contact);
        forces.fill([0.0; 3]);
        self.add_slots(problem, x, &mut forces, weight);
        self.add_obstacle(problem, obstacle, advance_mm, x, &mut forces, weight);
        self.contact = forces;
    }

    fn add_tets(&mut self, problem: &Problem, state: &State, with_tangent: bool) -> Result<(), InvalidState> {
        for (e, tet) in problem.mesh.tets.iter().enumerate() {
            let u = tet.map(|n| state.displacement_mm[n as usize]);
            let material = problem.elastomer(e);
            let geometry = &problem.tets[e];
            let carried = state.element_pressure_mpa[e];
            let stiffened = self.overstress.as_ref().map(|over| material.stiffened(over.factor));
            self.terms
                .evaluate(geometry, &u, carried, stiffened.as_ref().unwrap_or(material), with_tangent)
                .map_err(|reason| InvalidState { reason, element: e })?;
            if let Some(over) = &self.overstress {
                self.terms.add_stress(geometry, &u, &over.stress_mpa[e], with_tangent);
            }
            let bulk = material.element_bulk_mpa() / geometry.volume_mm3();
            let follows = bulk * self.terms.volume_change;
            self.volume_change[e] = self.terms.volume_change;
            self.volume_gradient[e] = self.terms.volume_gradient;
            for (a, n) in tet.iter().enumerate() {
                let (force, gradient) = (self.terms.force[a], self.terms.volume_gradient[a]);
                let (c, m) = (&mut self.condensed[*n as usize], &mut self.mixed[*n as usize]);
                axpy(-1.0, force, c);
                axpy(-follows, gradient, c);
                axpy(-1.0, force, m);
                axpy(-carried, gradient, m);
            }
            if with_tangent {
                self.scatter_tet(problem, e, bulk);
            }
        }
        Ok(())
    }

    /// Adds the element's tangent with the condensed pressure `bulk b b^T`.
    fn scatter_tet(&mut self, problem: &Problem, e: usize, bulk: f64) {
        let tet = &problem.mesh.tets[e];
        let free = tet.map(|n| problem.free[n as usize]);
        let b = &self.terms.volume_gradient;
        let mut pair = 0;
        for i in 0..10 {
            for j in 0..=i {
                let block = &mut self.terms.tangent[pair];
                for (r, row) in block.iter_mut().enumerate() {
                    axpy(bulk * b[i][r], b[j], row);
                }
                let rank = problem.tet_ranks[e][pair];
                problem.pattern.add(&mut self.tangent, free[i], free[j], rank, block);
                pair += 1;
            }
        }
    }

    fn add_membrane(&mut self, problem: &Problem, state: &State, x: &[Vec3], with_tangent: bool) {
        let sheet = &problem.sheet;
        for (t, nodes) in sheet.triangles.iter().enumerate() {
            let (geometry, law) = (&sheet.membrane[t], sheet.law(t));
            let corners = nodes.map(|n| x[n as usize]);
            let carried = &state.sheet_resultants_n_per_mm[t];
            let follows: [Plane; 3] =
                std::array::from_fn(|q| law.resultant(membrane::strain(geometry, q, &corners)));
            let (condensed, mixed) =
                (membrane::force(geometry, &corners, &follows), membrane::force(geometry, &corners, carried));
            for (a, n) in nodes.iter().enumerate() {
                axpy(-1.0, condensed[a], &mut self.condensed[*n as usize]);
                axpy(-1.0, mixed[a], &mut self.mixed[*n as usize]);
            }
            if with_tangent {
                let blocks = membrane::tangent(geometry, &corners, carried, law);
                self.scatter_face(problem, nodes, &sheet.ranks[t], &blocks);
            }
        }
    }

    fn scatter_face(&mut self, problem: &Problem, nodes: &[u32; 6], ranks: &[u32; 21], blocks: &[Mat3; 21]) {
        let free = nodes.map(|n| problem.free[n as usize]);
        let mut pair = 0;
        for a in 0..6 {
            for b in 0..=a {
                problem.pattern.add(&mut self.tangent, free[a], free[b], ranks[pair], &blocks[pair]);
                pair += 1;
            }
        }
    }

    fn add_bending(&mut self, problem: &Problem, x: &[Vec3], residual: &mut [Vec3], with_tangent: bool) {
        let sheet = &problem.sheet;
        let mut force = vec![[0.0; 3]; x.len()];
        bending::add_force(&sheet.bending, x, &mut force);
        for (r, f) in residual.iter_mut().zip(&force) {
            axpy(-1.0, *f, r);
        }
        if with_tangent {
            for (entry, rank) in sheet.bending.iter().zip(&sheet.bending_ranks) {
                let v = entry.value;
                let block = [[v, 0.0, 0.0], [0.0, v, 0.0], [0.0, 0.0, v]];
                let (a, b) = (problem.free[entry.row as usize], problem.free[entry.col as usize]);
                problem.pattern.add(&mut self.tangent, a, b, *rank, &block);
            }
        }
    }

    fn add_cavities(
        &mut self,
        problem: &Problem,
        load: &Load,
        ahead_mpa: f64,
        x: &[Vec3],
        residual: &mut [Vec3],
        with_tangent: bool,
    ) {
        let first = (problem.cavity.as_slice(), problem.cavity_ranks.as_slice());
        let further =
            problem.cavities.iter().map(|cavity| (cavity.faces.as_slice(), cavity.ranks.as_slice()));
        let pressures_mpa = pressures_mpa(&problem.config, load);
        let ahead_mpa = std::iter::once(ahead_mpa).chain(std::iter::repeat(0.0));
        let all = std::iter::once(first).chain(further).zip(pressures_mpa).zip(ahead_mpa);
        for (k, ((walls, pressure_mpa), ahead_mpa)) in all.enumerate() {
            let tangent_mpa = with_tangent.then_some(pressure_mpa);
            self.cavity_volumes_mm3[k] =
                self.add_walls(problem, walls, pressure_mpa + ahead_mpa, tangent_mpa, x, residual);
        }
    }

    /// Adds the load of `pressure_mpa` in a cavity, and the tangent at `tangent_mpa`; returns the cavity's volume (mm3).
    fn add_walls(
        &mut self,
        problem: &Problem,
        (faces, ranks): (&[Tri6], &[[u32; 21]]),
        pressure_mpa: f64,
        tangent_mpa: Option<f64>,
        x: &[Vec3],
        residual: &mut [Vec3],
    ) -> f64 {
        let mut volume_mm3 = 0.0;
        for (nodes, ranks) in faces.iter().zip(ranks) {
            let terms = face_terms(&nodes.map(|n| x[n as usize]), problem.config.cavity_load);
            volume_mm3 += terms.volume_mm3;
            for (n, gradient) in nodes.iter().zip(&terms.gradient) {
                axpy(pressure_mpa, *gradient, &mut residual[*n as usize]);
            }
            if let Some(pressure_mpa) = tangent_mpa.filter(|pressure_mpa| *pressure_mpa != 0.0) {
                let mut blocks = [[[0.0; 3]; 3]; 21];
                let mut pair = 0;
                for a in 0..6 {
                    for b in 0..=a {
                        blocks[pair] = skew(scale(pressure_mpa, terms.hessian[a][b]));
                        pair += 1;
                    }
                }
                self.scatter_face(problem, nodes, ranks, &blocks);
            }
        }
        volume_mm3
    }

    fn add_slots(&mut self, problem: &Problem, x: &[Vec3], residual: &mut [Vec3], weight: Option<f64>) {
        let settings = &problem.config.contact;
        self.turning.clear();
        for walls in &problem.slots {
            if let Some(weight) = weight {
                let penalty = weight * settings.slot_penalty_mpa_per_mm;
                self.turning.extend(walls.turning(x, settings.slot_smoothing_mm, penalty));
            }
            for contact in walls.contacts(x, settings.slot_smoothing_mm) {
                let stiffness = settings.slot_penalty_mpa_per_mm * contact.pair.area_mm2;
                let force = stiffness * contact.penalty.force;
                for (n, c) in contact.pair.nodes.iter().zip(contact.pair.coefficients) {
                    axpy(-force * c, contact.normal, &mut residual[*n as usize]);
                }
                if let Some(weight) = weight {
                    let free = contact.pair.nodes.map(|n| problem.free[n as usize]);
                    let normal =
                        outer(weight * stiffness * contact.penalty.stiffness, contact.normal, contact.normal);
                    for a in 0..12 {
                        for b in 0..=a {
                            let both = contact.pair.coefficients[a] * contact.pair.coefficients[b];
                            let block = normal.map(|row| scale(both, row));
                            let rank = problem.pattern.rank(free[a], free[b]);
                            problem.pattern.add(&mut self.tangent, free[a], free[b], rank, &block);
                        }
                    }
                }
            }
        }
    }

    fn add_obstacle(
        &mut self,
        problem: &Problem,
        obstacle: Obstacle,
        advance_mm: f64,
        x: &[Vec3],
        residual: &mut [Vec3],
        weight: Option<f64>,
    ) {
        self.contact_force_n = 0.0;
        let Some(face) = face(problem, obstacle) else { return };
        for (n, stiffness) in problem.contact_nodes.iter().zip(&problem.contact_stiffness_n_per_mm) {
            let Some(touch) = face.touch(x[*n as usize]) else { continue };
            let tangent = touch.tangent();
            // The approach of the obstacle equals an approach of the node.
            let mut force = touch.force();
            axpy(advance_mm, tangent.map(|row| row[1]), &mut force);
            axpy(*stiffness, force, &mut residual[*n as usize]);
            self.contact_force_n += stiffness * touch.vertical();
            let free = problem.free[*n as usize];
            if let Some(weight) = weight.filter(|_| free != CONSTRAINED) {
                let block = tangent.map(|row| scale(weight * *stiffness, row));
                problem.pattern.add(&mut self.tangent, free, free, 0, &block);
            }
        }
    }
}

/// Difference between the loads of a step and those of the tangent that predicts it.
///
/// The tangent belongs to the start equilibrium; with the end pressure it would be inconsistent, for thin walls near-singular.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ahead {
    /// Further pressure (MPa).
    pub pressure_mpa: f64,
    /// Motion of the obstacle towards the base (mm); the force on touching nodes is its stiffness times this.
    pub advance_mm: f64,
}

/// The rigid surface that a load places below the base.
pub(crate) fn face(problem: &Problem, obstacle: Obstacle) -> Option<Face> {
    let smoothing_mm = problem.config.contact.obstacle_smoothing_mm;
    let footprint = match obstacle {
        Obstacle::None => return None,
        Obstacle::Plate { .. } => problem.config.plate,
        Obstacle::Block { .. } => problem.config.block,
    };
    let round = problem.config.round.filter(|_| matches!(obstacle, Obstacle::Plate { .. }));
    obstacle.gap_mm().map(|gap_mm| Face { footprint, round, gap_mm, smoothing_mm })
}
