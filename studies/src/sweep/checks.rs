//! Checks of a model over many random states: what must hold wherever it answers.

use crate::jumps::jumps;
use anyhow::Context;
use rom::evaluator::Evaluator;
use rom::hull::DomainStatus;
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::Model;
use rom::snapshots::RegimeKind;
use serde::Serialize;
use train::draws::Draws;

/// Step between two states that are compared, as a fraction of an input's range.
const STEP: f64 = 2e-3;
/// Draws per required state: enough for a training range of 1 % of its box.
const TRIES: usize = 100;
/// Violations that are listed.
const LISTED: usize = 10;

/// Result of a sweep.
#[derive(Debug, Clone, Serialize)]
pub struct Sweep {
    /// Random states inside the contact training range.
    pub states: usize,
    /// States whose force is negative or NaN, falls with pressure, or rises with the gap; the first ones.
    pub violations: Vec<String>,
    /// How many violations there are.
    pub violation_count: usize,
    /// Smallest half-width of the force over all states, N.
    pub smallest_force_halfwidth_n: f64,
    /// Gaps at which both sides of the onset were compared.
    pub onset_gaps: usize,
    /// Largest jump of a coordinate at the onset, mm.
    pub largest_jump_mm: f64,
    /// Largest jump of the force at the onset, N.
    pub largest_jump_n: f64,
    /// Largest jump of the stress at the onset, over the largest stress of the state.
    pub largest_stress_jump: f64,
    /// Largest condition number of the interpolants.
    pub condition: f64,
}

impl Sweep {
    /// Sweeps over `states` random states inside the contact training range and over `gaps` gaps along the onset.
    ///
    /// # Errors
    /// The model has no contact regime, or too few draws are inside its training range.
    pub fn new(model: &Model, states: usize, gaps: usize, seed: u64) -> anyhow::Result<Self> {
        let interpolants = model.header.regimes.iter().flat_map(|regime| regime.interpolants());
        let onset = model.header.onset.as_ref();
        let contact = model.regime(RegimeKind::Contact).context("the model has no contact regime")?;
        let range = match (contact.inputs.range(GAP), onset) {
            // All samples share a gap: at others the regime says nothing.
            (Some([low, high]), _) if low == high => [low, high],
            (_, onset) => onset.map_or([0.0; 2], |onset| [onset.sag_mm(), onset.reach_mm()]),
        };
        let jumps = jumps(model, range, gaps)?;
        let mut sweep = Self {
            states,
            violations: Vec::new(),
            violation_count: 0,
            smallest_force_halfwidth_n: f64::INFINITY,
            onset_gaps: gaps,
            largest_jump_mm: jumps.length_mm,
            largest_jump_n: jumps.force_n,
            largest_stress_jump: jumps.stress_share,
            condition: interpolants.map(|one| one.condition).fold(0.0, f64::max),
        };
        sweep.check_forces(model, seed)?;
        Ok(sweep)
    }

    fn check_forces(&mut self, model: &Model, seed: u64) -> anyhow::Result<()> {
        let regime = model.regime(RegimeKind::Contact).context("the model has no contact regime")?;
        let step = |input| regime.inputs.range(input).map_or(0.0, |[low, high]| STEP * (high - low));
        let steps = [step(PRESSURE), step(GAP)];
        let evaluator = Evaluator::new(&model.header)?;
        let mut evaluation = evaluator.evaluation();
        // Force and half-width of a contact state inside the training range.
        let mut force = |at: Inputs| {
            evaluator.evaluate(at, &mut evaluation);
            let inside =
                evaluation.regime == RegimeKind::Contact && evaluation.domain == DomainStatus::Inside;
            inside.then_some((evaluation.contact_force_n, evaluation.halfwidths.force_n))
        };
        let mut draws = Draws::new(model, RegimeKind::Contact, seed)?;
        let mut found = 0;
        for at in (0..self.states * TRIES).filter_map(|_| draws.draw(|state| state)).take(self.states) {
            found += 1;
            let (p, gap) = (at.pressure_mpa(), at.gap_mm());
            let Some((here_n, halfwidth_n)) = force(at) else { continue };
            self.smallest_force_halfwidth_n = self.smallest_force_halfwidth_n.min(halfwidth_n);
            if !(here_n >= 0.0 && here_n.is_finite()) {
                self.note(at, format!("force {here_n} N"));
            }
            if let Some((more_n, _)) = force(Inputs::new(p + steps[0], gap)).filter(|(n, _)| *n < here_n) {
                self.note(at, format!("force falls with pressure: {here_n} N, then {more_n} N"));
            }
            if let Some((more_n, _)) = force(Inputs::new(p, gap + steps[1])).filter(|(n, _)| *n > here_n) {
                self.note(at, format!("force rises with the gap: {here_n} N, then {more_n} N"));
            }
        }
        anyhow::ensure!(found == self.states, "only {found} draws are inside the contact training range");
        Ok(())
    }

    fn note(&mut self, at: Inputs, what: String) {
        self.violation_count += 1;
        if self.violations.len() < LISTED {
            self.violations.push(format!("{} MPa, gap {} mm: {what}", at.pressure_mpa(), at.gap_mm()));
        }
    }
}
