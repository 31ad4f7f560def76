//! Plans of experiments: a hold is a state that is kept while readings are taken. Of all holds on a grid of pressures and of the given
//! gaps those are chosen whose readings together shrink the unknowns' joint uncertainty most (D-optimal, on the model's gradients at the
//! priors). A gap that is estimated is taken to be off by the same amount at every place of the plate.

use super::SensorModel;
use crate::config::ActuatorSpec;
use estimate::{ExpectedFit, InputRole, Setup, Symmetric};
use rom::evaluator::Evaluator;
use rom::hull::DomainStatus;
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::{ModelError, ModelHeader};
use serde::Serialize;
use std::collections::BTreeMap;

/// Pressures of the grid.
const STEPS: usize = 21;

/// What is varied, and what is to be told apart.
pub struct Experiment<'a> {
    pub spec: &'a ActuatorSpec,
    pub header: &'a ModelHeader,
    /// Unknowns, inputs and measured values of held states.
    pub setup: Setup,
    pub sensors: SensorModel,
    /// Lowest and highest pressure; those of the model when left out.
    pub pressure_mpa: Option<[f64; 2]>,
    /// Places of the plate; if empty, the gap of the setup.
    pub gaps_mm: &'a [f64],
    /// Holds to choose, and readings at each.
    pub holds: usize,
    pub readings: usize,
}

/// Standard deviations that a choice of sensors reaches.
#[derive(Debug, Serialize)]
pub struct ExperimentPlan {
    pub sensors: Vec<String>,
    pub holds: Vec<Hold>,
    /// True if every unknown is identifiable.
    pub identifiable: bool,
    pub estimates: BTreeMap<String, ExpectedSigma>,
    pub rank: usize,
    pub condition: f64,
    /// Pairs of unknowns.
    pub correlations: Vec<(String, String, f64)>,
}

#[derive(Debug, Clone, Copy, Serialize)]
pub struct Hold {
    pub pressure_mpa: f64,
    pub gap_mm: f64,
}

#[derive(Debug, Serialize)]
pub struct ExpectedSigma {
    pub prior_sigma: f64,
    pub sigma: f64,
    pub identifiable: bool,
}

/// Why there is no plan.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    #[error(
        "--gap: expected the gaps at which readings can be taken, for the scene measures the gap; found none"
    )]
    NoGap,
    #[error(
        "no pressure from {low} to {high} MPa at gaps {gaps_mm:?} mm lies among the model's samples; `softtwin inspect` prints their range"
    )]
    Outside { low: f64, high: f64, gaps_mm: Vec<f64> },
    #[error("the model's gradients give no covariance at these states; choose other pressures or gaps")]
    NoCovariance,
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl Experiment<'_> {
    /// A plan for each choice of sensors, fewest sensors first.
    ///
    /// # Errors
    /// [`ExperimentError`].
    pub fn plans(mut self) -> Result<Vec<ExperimentPlan>, ExperimentError> {
        let holds = self.candidates()?;
        self.sensor_sets().into_iter().map(|blocks| self.plan(&holds, blocks)).collect()
    }

    /// States of the grid that lie among the model's samples, with all their inputs.
    fn candidates(&self) -> Result<Vec<Inputs>, ExperimentError> {
        let evaluator = Evaluator::new(self.header)?;
        let mut evaluation = evaluator.evaluation();
        let mut base = Inputs::new(f64::NAN, f64::NAN);
        for (input, role) in self.setup.inputs.iter().enumerate() {
            base = match *role {
                InputRole::Given(value) => base.with(input, value),
                InputRole::Estimated(unknown) => base.with(input, self.setup.unknowns[unknown].prior),
                InputRole::Measured { .. } => base,
            };
        }
        let [low, high] = self.pressure_mpa.unwrap_or(self.header.inputs[PRESSURE].range);
        let gaps_mm = if self.gaps_mm.is_empty() { vec![base.gap_mm()] } else { self.gaps_mm.to_vec() };
        if gaps_mm.iter().any(|gap| gap.is_nan()) {
            return Err(ExperimentError::NoGap);
        }
        let pressure_at = |step: usize| low + (high - low) * step as f64 / (STEPS - 1) as f64;
        let grid = gaps_mm.iter().flat_map(|gap| {
            (0..STEPS).map(move |step| base.with(PRESSURE, pressure_at(step)).with(GAP, *gap))
        });
        let inside = grid.filter(|inputs| {
            evaluator.evaluate(*inputs, &mut evaluation);
            evaluation.domain != DomainStatus::Outside
        });
        let holds: Vec<Inputs> = inside.collect();
        if holds.is_empty() {
            return Err(ExperimentError::Outside { low, high, gaps_mm });
        }
        Ok(holds)
    }

    fn plan(&mut self, candidates: &[Inputs], blocks: u32) -> Result<ExperimentPlan, ExperimentError> {
        let mut tell = |inputs: &Inputs| {
            let (setup, sensors) = (&self.setup, &mut self.sensors);
            let sharing = self.readings * self.holds;
            let information =
                estimate::information(setup, inputs.values(), self.readings, sharing, blocks, sensors);
            Some((*inputs, information?))
        };
        let (holds, information): (Vec<Inputs>, Vec<Symmetric>) =
            candidates.iter().filter_map(&mut tell).unzip();
        let chosen = estimate::choose(&self.setup, &information, self.holds);
        let Some(fit) = estimate::expected_fit(&self.setup, &information, &chosen) else {
            return Err(ExperimentError::NoCovariance);
        };
        let hold = |index: &usize| Hold {
            pressure_mpa: holds[*index].pressure_mpa(),
            gap_mm: holds[*index].gap_mm(),
        };
        Ok(ExperimentPlan {
            sensors: self.sensor_names(blocks),
            holds: chosen.iter().map(hold).collect(),
            identifiable: fit.estimates.iter().all(|estimate| estimate.identifiable),
            estimates: self.estimates(&fit),
            rank: fit.rank,
            condition: fit.condition,
            correlations: self.correlations(&fit),
        })
    }

    /// The load cell, the markers, the observables, all combinations: fewest first. By the bits of the setup's blocks.
    fn sensor_sets(&self) -> Vec<u32> {
        let bits = |blocks: std::ops::Range<usize>| blocks.fold(0, |bits, block| bits | 1 << block);
        let markers = self.spec.markers.len();
        let kinds = [1, bits(1..1 + markers), bits(1 + markers..1 + markers + self.spec.observables.len())];
        let kinds: Vec<u32> = kinds.into_iter().filter(|kind| *kind != 0).collect();
        let mut sets: Vec<u32> = (1..1_usize << kinds.len())
            .map(|chosen| {
                (0..kinds.len()).filter(|at| chosen >> at & 1 == 1).fold(0, |set, at| set | kinds[at])
            })
            .collect();
        sets.sort_by_key(|set| kinds.iter().filter(|kind| set & **kind != 0).count());
        sets
    }

    fn sensor_names(&self, blocks: u32) -> Vec<String> {
        let markers = self.spec.markers.iter().map(|marker| marker.name.clone());
        let all = std::iter::once("measured_force_n".to_owned())
            .chain(markers)
            .chain(self.spec.observables.keys().cloned());
        all.enumerate().filter(|(block, _)| blocks & (1 << block) != 0).map(|(_, name)| name).collect()
    }

    fn estimates(&self, fit: &ExpectedFit) -> BTreeMap<String, ExpectedSigma> {
        let both = self.setup.unknowns.iter().zip(&fit.estimates);
        let one = |(unknown, estimate): (&estimate::Unknown, &estimate::Estimate)| {
            let (sigma, identifiable) = (estimate.sigma, estimate.identifiable);
            (unknown.name.clone(), ExpectedSigma { prior_sigma: unknown.sigma, sigma, identifiable })
        };
        both.map(one).collect()
    }

    fn correlations(&self, fit: &ExpectedFit) -> Vec<(String, String, f64)> {
        let unknowns = &self.setup.unknowns;
        let pairs = (0..unknowns.len()).flat_map(|a| (a + 1..unknowns.len()).map(move |b| (a, b)));
        pairs
            .map(|(a, b)| (unknowns[a].name.clone(), unknowns[b].name.clone(), fit.correlation(a, b)))
            .collect()
    }
}
