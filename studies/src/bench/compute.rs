//! Kernel and prediction in this process.

use super::measure::{Evictor, Series, gbps};
use super::paced::{self, Paced};
use anyhow::Context;
use rom::evaluator::Evaluator;
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::kernel::{Basis, Precision};
use rom::model::{BlockKind, Model, ModelError, Nodes, Selection};
use rom::model_state::ModelState;
use rom::probe::{MeshPoint, ProbePosition, Probes};
use rom::reconstructor::{Reconstructor, Storage};
use rom::rng::Rng;
use serde::Serialize;
use softtwin::progress::Progress;
use std::time::Instant;

/// Nodes of the small set.
const TIP_NODES: usize = 500;
/// Different states to predict.
const INPUTS: u32 = 64;
/// Eviction takes milliseconds, so there are fewer evicted samples than warm ones.
const EVICTED_SHARE: usize = 10;
/// Times for readings that jump.
const JUMPING_SEED: u64 = 1;

/// The kernel with one precision.
#[derive(Debug, Clone, Serialize)]
pub struct Kernel {
    /// Bytes of the basis.
    pub bytes: usize,
    /// Basis in cache, median.
    pub warm_us_p50: f64,
    /// Basis in memory only, median.
    pub evicted_us_p50: f64,
    /// Basis bytes over `warm_us_p50`.
    pub gbps: f64,
    /// Reading these bytes and doing nothing else: median, warm.
    pub read_us_p50: f64,
    /// The same from memory.
    pub evicted_read_us_p50: f64,
    /// Basis bytes over `read_us_p50`.
    pub read_gbps: f64,
    /// `gbps / read_gbps`.
    pub share_of_read: f64,
}

/// The ways to store the basis.
#[derive(Debug, Clone, Serialize)]
pub struct Kernels {
    /// 4 bytes an entry.
    pub f32: Kernel,
    /// 2 bytes a mode's entry.
    pub i16: Kernel,
    /// Smallest basis with which the model's error grows by [`Storage::AS_GOOD_SHARE`] at most; `None` if there is none.
    pub budget: Option<Kernel>,
    /// Fractions of the last one's rows in f32, i16, i8, and left out.
    pub budget_widths: Option<[f64; 4]>,
    /// Parts of the regime's domain, each with such a basis; measured is the largest.
    pub budget_parts: usize,
    /// Bytes of all of them.
    pub budget_parts_bytes: usize,
}

/// Everything measured in this process.
#[derive(Debug, Clone, Serialize)]
pub struct Compute {
    /// Instruction set of the reconstruction kernel.
    pub isa: String,
    /// Nodes of the model.
    pub nodes: usize,
    /// Published fields.
    pub fields: usize,
    /// Values written by a full reconstruction.
    pub entries: usize,
    /// Coefficients of the regime measured.
    pub coefficients: usize,
    /// Single-core read bandwidth over the bytes of the f32 basis, warm, in this run.
    pub read_gbps: f64,
    /// The kernel alone.
    pub kernel: Kernels,
    /// The kernel at 1 kHz, with the basis within its budget (f32 where no basis keeps that).
    pub paced: Paced,
    /// Input to full field in memory, f32, median.
    pub predict_us_p50: f64,
    /// The same with the basis within its budget; `None` if there is none.
    pub predict_budget_us_p50: Option<f64>,
    /// The same with readings that jump over the whole training range, so that each part's basis is read.
    pub predict_budget_jumping_us_p50: Option<f64>,
    /// Regime, force, gradients, half-widths; no coefficients, no field: median.
    pub state_only_us_p50: f64,
    /// The same with the position of one node and its derivatives with respect to every input (`rom::probe`): median.
    pub position_us_p50: f64,
    /// Input to the fields of a set of `tip_nodes` nodes, median.
    pub tip_us_p50: f64,
    /// Nodes of that set.
    pub tip_nodes: usize,
}

/// Consecutive measured sweeps of one basis, and sweeps before them that are not measured.
const AT_ONCE: usize = 20;
const UNTIL_WARM: usize = 5;

/// One basis under test and its series.
struct Subject<'a> {
    basis: &'a Basis,
    warm: Series,
    evicted: Series,
    read: Series,
    evicted_read: Series,
}

impl<'a> Subject<'a> {
    fn new(name: &str, basis: &'a Basis) -> Self {
        let series = |what: &str| Series::new(format!("kernel {name}, {what}"));
        Self {
            basis,
            warm: series("warm"),
            evicted: series("evicted"),
            read: series("read"),
            evicted_read: series("evicted read"),
        }
    }

    fn result(&self) -> Kernel {
        let bytes = self.basis.bytes();
        let (warm, read) = (self.warm.p50(), self.read.p50());
        Kernel {
            bytes,
            warm_us_p50: warm,
            evicted_us_p50: self.evicted.p50(),
            gbps: gbps(bytes, warm),
            read_us_p50: read,
            evicted_read_us_p50: self.evicted_read.p50(),
            read_gbps: gbps(bytes, read),
            share_of_read: read / warm,
        }
    }
}

/// Measures; returns the figures and the distributions.
pub fn run(model: &Model, samples: usize, progress: &mut Progress) -> anyhow::Result<(Compute, Vec<Series>)> {
    let inputs = inputs(model)?;
    let all = Selection::default();
    let tip = Selection { fields: None, nodes: Nodes::List(tip_nodes(model)) };
    let mut full = ModelState::new(model, &all)?;
    let small = Reconstructor::with_precision(model, &all, Precision::I16)?;
    let mut tip = ModelState::new(model, &tip)?;
    full.update(inputs[0])?;
    let regime = full.evaluation().regime;
    let coefficients = full.reconstructor().coefficients(full.evaluation())?;
    let basis =
        |fields: &Reconstructor| fields.largest_basis(regime).cloned().context("the model has no regime");
    let (wide, narrow) = (basis(full.reconstructor())?, basis(&small)?);
    let mut within = match ModelState::with_precision(model, &all, Storage::AS_GOOD) {
        Ok(state) => Some(state),
        Err(ModelError::AcceptedError { .. }) => None,
        Err(error) => return Err(error.into()),
    };

    progress.step("kernel and prediction");
    let uniform = [Subject::new("f32", &wide), Subject::new("i16", &narrow)];
    let mut subjects: Vec<Subject<'_>> = uniform.into_iter().collect();
    let budget_basis = within.as_ref().map(|state| basis(state.reconstructor())).transpose()?;
    subjects.extend(budget_basis.as_ref().map(|basis| Subject::new("budget", basis)));
    kernels(&mut subjects, &coefficients, samples, progress)?;
    progress.step("kernel at 1 kHz");
    let (paced, at_pace) = paced::run(budget_basis.as_ref().unwrap_or(&wide), &coefficients, samples)?;
    progress.step("prediction");
    let evaluator = Evaluator::new(&model.header)?;
    let states = [Some(&mut full), within.as_mut()];
    let predictions = predictions(&inputs, &evaluator, states, &mut tip, samples)?;
    let jumping = within.as_mut().map(|state| jumping(model, state, samples)).transpose()?;
    let position = position(model, &inputs, samples)?;
    let [f32, i16] = [subjects[0].result(), subjects[1].result()];
    let budget = subjects.get(2).map(Subject::result);
    let budget_widths = budget_basis.as_ref().map(Basis::widths);
    let of_parts = || within.iter().flat_map(|state| state.reconstructor().bases(regime));
    let (budget_parts, budget_parts_bytes) = (of_parts().count(), of_parts().map(Basis::bytes).sum());
    let compute = Compute {
        isa: wide.isa().to_string(),
        nodes: wide.nodes(),
        fields: wide.fields(),
        entries: wide.output_len(),
        coefficients: full.evaluation().coefficients.len(),
        read_gbps: f32.read_gbps,
        kernel: Kernels { f32, i16, budget, budget_widths, budget_parts, budget_parts_bytes },
        paced,
        predict_us_p50: predictions[0].p50(),
        predict_budget_us_p50: budget_basis.is_some().then(|| predictions[1].p50()),
        predict_budget_jumping_us_p50: jumping.as_ref().map(Series::p50),
        state_only_us_p50: predictions[2].p50(),
        tip_us_p50: predictions[3].p50(),
        position_us_p50: position.p50(),
        tip_nodes: tip.reconstructor().rows(),
    };
    let kernels = subjects.into_iter().flat_map(|s| [s.warm, s.evicted]);
    let predictions = predictions.into_iter().chain(jumping).chain([position]);
    Ok((compute, kernels.chain([at_pace]).chain(predictions).collect()))
}

/// Warm and evicted, all of them in turn.
fn kernels(
    subjects: &mut [Subject<'_>],
    coefficients: &[f64],
    samples: usize,
    progress: &mut Progress,
) -> anyhow::Result<()> {
    let mut out = vec![0.0; subjects[0].basis.output_len()];
    // Some of each at once: after another basis it takes more than one sweep until the caches hold this one.
    for _ in 0..samples.div_ceil(AT_ONCE) {
        for subject in subjects.iter_mut() {
            let basis = subject.basis;
            for _ in 0..UNTIL_WARM {
                basis.reconstruct(coefficients, &mut out)?;
            }
            for _ in 0..AT_ONCE {
                subject.warm.time(|| basis.reconstruct(coefficients, &mut out));
            }
            for _ in 0..AT_ONCE {
                subject.read.time(|| basis.read_once());
            }
        }
    }
    progress.step("kernel with the caches evicted");
    let mut evictor = Evictor::default();
    for _ in 0..(samples / EVICTED_SHARE).clamp(10, 200) {
        for subject in subjects.iter_mut() {
            let basis = subject.basis;
            evictor.evict();
            subject.evicted.time(|| basis.reconstruct(coefficients, &mut out));
            evictor.evict();
            subject.evicted_read.time(|| basis.read_once());
        }
    }
    Ok(())
}

/// Full field with each basis in turn, state only, tip set, over inputs that vary.
fn predictions(
    inputs: &[Inputs],
    evaluator: &Evaluator,
    mut full: [Option<&mut ModelState>; 2],
    tip: &mut ModelState,
    samples: usize,
) -> anyhow::Result<[Series; 4]> {
    let mut series = ["predict", "predict within the budget", "state only", "tip"].map(Series::new);
    let [predict, within, state, tip_series] = &mut series;
    let mut evaluation = evaluator.evaluation();
    // Each in a separate loop: a twin has one basis, and small sets stay in the first caches.
    for (full, series) in full.iter_mut().zip([&mut *predict, &mut *within]) {
        let Some(full) = full else { continue };
        for sample in 0..samples {
            let input = inputs[sample % inputs.len()];
            full.update(input)?; // brings the basis into the cache
            series.time(|| full.update(input));
        }
    }
    for sample in 0..samples {
        let input = inputs[sample % inputs.len()];
        state.time(|| evaluator.state(input, &mut evaluation));
    }
    for sample in 0..samples {
        let input = inputs[sample % inputs.len()];
        tip_series.time(|| tip.update(input));
        tip.update(input)?;
    }
    Ok(series)
}

/// Full field over inputs all over the ranges of the last regime, of those that are in it.
fn jumping(model: &Model, state: &mut ModelState, samples: usize) -> anyhow::Result<Series> {
    let regime = model.header.regimes.last().context("the model has no regime")?;
    let mut rng = Rng::new(JUMPING_SEED);
    let mut series = Series::new("predict within the budget, jumping");
    // Where there is no other regime every state is in the last one; otherwise it takes a part of the box of their ranges.
    for _ in 0..4 * samples {
        let mut inputs = Inputs::new(f64::NAN, f64::INFINITY);
        for axis in &regime.inputs.axes {
            inputs = inputs.with(axis.input, axis.min + rng.uniform() * (axis.max - axis.min));
        }
        let begun = Instant::now();
        state.update(inputs)?;
        if state.evaluation().regime == regime.kind {
            series.push(u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX));
        }
    }
    Ok(series)
}

/// The position of one node of the tip, as a controller or a filter follows it.
fn position(model: &Model, inputs: &[Inputs], samples: usize) -> anyhow::Result<Series> {
    let node = *tip_nodes(model).last().context("the model has no nodes")?;
    let probes = Probes::new(model, &[MeshPoint::node(model, node)?])?;
    let (mut evaluation, mut at) = (probes.evaluation(), [ProbePosition::default()]);
    let mut series = Series::new("position");
    for input in inputs.iter().cycle().take(samples) {
        series.time(|| probes.evaluate(*input, &mut evaluation, &mut at));
    }
    Ok(series)
}

/// States of the last regime (contact, where there is one), inside its sampled ranges, the pressure rising.
pub fn inputs(model: &Model) -> anyhow::Result<Vec<Inputs>> {
    let regime = model.header.regimes.last().context("the model has no regime")?;
    let [low, high] = regime.inputs.range(PRESSURE).context("the model takes no pressure")?;
    let gap_mm = regime.inputs.range(GAP).map_or(f64::INFINITY, |[near, far]| near + 0.2 * (far - near));
    let at = |share: f64| low + share * (high - low);
    let input = |i| Inputs::new(at(0.6 + 0.3 * f64::from(i) / f64::from(INPUTS)), gap_mm);
    Ok((0..INPUTS).map(input).collect())
}

/// The nodes farthest along the actuator.
pub fn tip_nodes(model: &Model) -> Vec<u32> {
    let mut nodes: Vec<u32> = (0..model.header.node_count as u32).collect();
    if let Some(x) = model.f32_block(BlockKind::Undeformed(0)) {
        nodes.sort_by(|a, b| x[*a as usize].total_cmp(&x[*b as usize]));
    }
    let mut tip = nodes.split_off(nodes.len().saturating_sub(TIP_NODES));
    tip.sort_unstable();
    tip
}
