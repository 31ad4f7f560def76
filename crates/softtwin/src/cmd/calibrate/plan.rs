//! `softtwin calibrate --plan`: a hold is a state that is kept while readings are taken. Of all holds on a grid of pressures and of the
//! given gaps those are chosen whose readings together shrink the unknowns' joint uncertainty most (D-optimal, on the model's gradients at
//! the priors). A gap that is estimated is taken to be off by the same amount at every place of the plate.

use crate::report;
use crate::unknowns::Unknowns;
use anyhow::bail;
use estimate::{ExpectedFit, InputRole, Symmetric};
use rom::evaluator::Evaluator;
use rom::hull::DomainStatus;
use rom::inputs::{GAP, Inputs, PRESSURE};
use serde::Serialize;
use std::collections::BTreeMap;

/// Pressures of the grid.
const STEPS: usize = 21;

/// What an experiment may vary.
#[derive(clap::Args)]
#[command(next_help_heading = "Plan of an experiment")]
pub struct PlanArgs {
    /// Before measuring: which holds and sensors would tell the unknowns apart, with the standard deviations to expect.
    #[arg(long, conflicts_with_all = ["recording", "log", "topic", "out", "memory", "force", "picture"])]
    pub plan: bool,
    /// Lowest and highest pressure; default: the range of the model.
    #[arg(long = "pressure", requires = "plan", num_args = 2, value_names = ["LOW", "HIGH"], value_parser = crate::range::pressure_mpa)]
    pressure_mpa: Option<Vec<f64>>,
    /// Places of the plate; default: the prior of the gap, or the scene's gap.
    #[arg(long = "gap", requires = "plan", num_args = 1.., value_name = "MM", value_parser = crate::range::gap_mm)]
    gap_mm: Vec<f64>,
    /// Holds to choose (1 to 20).
    #[arg(long, requires = "plan", value_name = "N", default_value_t = 4, value_parser = crate::range::count(1, 20))]
    holds: usize,
    /// Readings at each hold (1 to 1000000).
    #[arg(long, requires = "plan", value_name = "N", default_value_t = 200, value_parser = crate::range::count(1, 1_000_000))]
    readings: usize,
}

/// What the command found: a plan for each choice of sensors, fewest sensors first.
#[derive(Serialize)]
struct Plans {
    readings_per_hold: usize,
    unknowns: usize,
    /// Position of the first plan that identifies everything.
    recommended: Option<usize>,
    plans: Vec<Plan>,
}

/// Standard deviations that a choice of sensors reaches.
#[derive(Debug, Serialize)]
struct Plan {
    sensors: Vec<String>,
    holds: Vec<Hold>,
    /// True if every unknown is identifiable.
    identifiable: bool,
    estimates: BTreeMap<String, Predicted>,
    rank: usize,
    condition: f64,
    /// Pairs of unknowns.
    correlations: Vec<(String, String, f64)>,
}

#[derive(Debug, Clone, Copy, Serialize)]
struct Hold {
    pressure_mpa: f64,
    gap_mm: f64,
}

#[derive(Debug, Serialize)]
struct Predicted {
    prior_sigma: f64,
    sigma: f64,
    identifiable: bool,
}

impl PlanArgs {
    /// Chooses, then prints one plan for each set of sensors.
    pub fn run(self, mut of: Unknowns, json: bool) -> anyhow::Result<()> {
        // The plan is one of held states.
        of.setup = of.setup.at_rest();
        let holds = self.candidates(&of)?;
        let plans = sensor_sets(&of).into_iter().map(|blocks| self.plan(&mut of, &holds, blocks));
        let plans: Vec<Plan> = plans.collect::<anyhow::Result<_>>()?;
        let recommended = plans.iter().position(|plan| plan.identifiable);
        let found =
            Plans { readings_per_hold: self.readings, unknowns: of.setup.unknowns.len(), recommended, plans };
        report::print(&found, json)
    }

    /// States of the grid that lie among the model's samples, with all their inputs.
    fn candidates(&self, of: &Unknowns) -> anyhow::Result<Vec<Inputs>> {
        let evaluator = Evaluator::new(&of.header)?;
        let mut evaluation = evaluator.evaluation();
        let mut base = Inputs::new(f64::NAN, f64::NAN);
        for (input, role) in of.setup.inputs.iter().enumerate() {
            base = match *role {
                InputRole::Given(value) => base.with(input, value),
                InputRole::Estimated(unknown) => base.with(input, of.setup.unknowns[unknown].prior),
                InputRole::Measured { .. } => base,
            };
        }
        let [low, high] = match self.pressure_mpa.as_deref() {
            Some([low, high]) => [*low, *high],
            _ => of.header.inputs[PRESSURE].range,
        };
        let gaps_mm = if self.gap_mm.is_empty() { vec![base.gap_mm()] } else { self.gap_mm.clone() };
        if gaps_mm.iter().any(|gap| gap.is_nan()) {
            bail!(
                "--gap: expected the gaps at which readings can be taken, for the scene measures the gap; found none"
            );
        }
        let at = |step: usize| low + (high - low) * step as f64 / (STEPS - 1) as f64;
        let grid = gaps_mm
            .iter()
            .flat_map(|gap| (0..STEPS).map(move |step| base.with(PRESSURE, at(step)).with(GAP, *gap)));
        let inside = grid.filter(|inputs| {
            evaluator.evaluate(*inputs, &mut evaluation);
            evaluation.domain != DomainStatus::Outside
        });
        let holds: Vec<Inputs> = inside.collect();
        if holds.is_empty() {
            bail!(
                "no pressure from {low} to {high} MPa at gaps {gaps_mm:?} mm lies among the model's samples; \
                 `softtwin inspect` prints their range"
            );
        }
        Ok(holds)
    }

    fn plan(&self, of: &mut Unknowns, candidates: &[Inputs], blocks: u32) -> anyhow::Result<Plan> {
        let mut tell = |inputs: &Inputs| {
            let (setup, sensors) = (&of.setup, &mut of.sensors);
            let sharing = self.readings * self.holds;
            let information =
                estimate::information(setup, inputs.values(), self.readings, sharing, blocks, sensors);
            Some((*inputs, information?))
        };
        let (holds, information): (Vec<Inputs>, Vec<Symmetric>) =
            candidates.iter().filter_map(&mut tell).unzip();
        let chosen = estimate::choose(&of.setup, &information, self.holds);
        let Some(fit) = estimate::expected_fit(&of.setup, &information, &chosen) else {
            bail!("the model's gradients give no covariance at these states; choose other pressures or gaps");
        };
        let hold = |at: &usize| Hold { pressure_mpa: holds[*at].pressure_mpa(), gap_mm: holds[*at].gap_mm() };
        Ok(Plan {
            sensors: names(of, blocks),
            holds: chosen.iter().map(hold).collect(),
            identifiable: fit.estimates.iter().all(|estimate| estimate.identifiable),
            estimates: estimates(of, &fit),
            rank: fit.rank,
            condition: fit.condition,
            correlations: correlations(of, &fit),
        })
    }
}

/// The load cell, the markers, the observables, all combinations: fewest first. By the bits of the setup's blocks.
fn sensor_sets(of: &Unknowns) -> Vec<u32> {
    let bits = |blocks: std::ops::Range<usize>| blocks.fold(0, |bits, block| bits | 1 << block);
    let markers = of.spec.markers.len();
    let kinds = [1, bits(1..1 + markers), bits(1 + markers..1 + markers + of.spec.observables.len())];
    let kinds: Vec<u32> = kinds.into_iter().filter(|kind| *kind != 0).collect();
    let mut sets: Vec<u32> = (1..1_usize << kinds.len())
        .map(|chosen| (0..kinds.len()).filter(|at| chosen >> at & 1 == 1).fold(0, |set, at| set | kinds[at]))
        .collect();
    sets.sort_by_key(|set| kinds.iter().filter(|kind| set & **kind != 0).count());
    sets
}

fn names(of: &Unknowns, blocks: u32) -> Vec<String> {
    let markers = of.spec.markers.iter().map(|marker| marker.name.clone());
    let all = std::iter::once("measured_force_n".to_owned())
        .chain(markers)
        .chain(of.spec.observables.keys().cloned());
    all.enumerate().filter(|(block, _)| blocks & (1 << block) != 0).map(|(_, name)| name).collect()
}

fn estimates(of: &Unknowns, fit: &ExpectedFit) -> BTreeMap<String, Predicted> {
    let both = of.setup.unknowns.iter().zip(&fit.estimates);
    let one = |(unknown, estimate): (&estimate::Unknown, &estimate::Estimate)| {
        let (sigma, identifiable) = (estimate.sigma, estimate.identifiable);
        (unknown.name.clone(), Predicted { prior_sigma: unknown.sigma, sigma, identifiable })
    };
    both.map(one).collect()
}

fn correlations(of: &Unknowns, fit: &ExpectedFit) -> Vec<(String, String, f64)> {
    let unknowns = &of.setup.unknowns;
    let pairs = (0..unknowns.len()).flat_map(|a| (a + 1..unknowns.len()).map(move |b| (a, b)));
    pairs.map(|(a, b)| (unknowns[a].name.clone(), unknowns[b].name.clone(), fit.correlation(a, b))).collect()
}
