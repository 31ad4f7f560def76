//! Kernel and prediction in this process.

use super::measure::{Durations, Evictor, gbps};
use anyhow::Context;
use rom::evaluator::{Evaluator, Query};
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::kernel::Precision;
use rom::model::{BlockKind, Model, Nodes, Selection};
use rom::model_state::ModelState;
use rom::probe::{MeshPoint, ProbePosition, Probes};
use rom::reconstructor::{Basis, Reconstructor};
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

/// One reconstruction of all fields from coefficients.
#[derive(Debug, Clone, Serialize)]
pub struct Kernel {
    /// Modes in use, summed over the fields.
    pub modes: usize,
    /// Bytes read by a reconstruction.
    pub bytes: usize,
    /// Basis in cache, median.
    pub warm_us_p50: f64,
    /// Basis in memory only, median.
    pub evicted_us_p50: f64,
    /// Basis bytes over `warm_us_p50`.
    pub gbps: f64,
}

/// The kernel with the options of a scene.
#[derive(Debug, Clone, Serialize)]
pub struct Kernels {
    /// i16 modes within the default accepted error.
    pub default: Kernel,
    /// All modes in f32.
    pub f32: Kernel,
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
    /// The kernel alone.
    pub kernel: Kernels,
    /// Input to full field in memory median.
    pub predict_us_p50: f64,
    /// The same with readings that jump over the whole training range, median.
    pub jumping_us_p50: f64,
    /// Regime, force, gradients, half-widths; no coefficients, no field: median.
    pub state_only_us_p50: f64,
    /// The same with the position of one node and its derivatives with respect to every input (`rom::probe`): median.
    pub position_us_p50: f64,
    /// Input to the fields of a set of `tip_nodes` nodes, median.
    pub tip_us_p50: f64,
    /// Nodes of that set.
    pub tip_nodes: usize,
}

/// Sweeps measured in a row before the other basis, and those before that are not measured.
const AT_ONCE: usize = 20;
const UNTIL_WARM: usize = 5;

/// One basis under test and its series.
struct Subject<'a> {
    basis: &'a Basis,
    warm: Durations,
    evicted: Durations,
}

impl<'a> Subject<'a> {
    fn new(name: &str, basis: &'a Basis) -> Self {
        let series = |what: &str| Durations::new(format!("kernel {name}, {what}"));
        Self { basis, warm: series("warm"), evicted: series("evicted") }
    }

    fn result(&self) -> Kernel {
        let (modes, bytes, warm) = (self.basis.modes(), self.basis.bytes(), self.warm.p50());
        let evicted_us_p50 = self.evicted.p50();
        Kernel { modes, bytes, warm_us_p50: warm, evicted_us_p50, gbps: gbps(bytes, warm) }
    }
}

/// Measures; returns the figures and the distributions.
pub fn run(
    model: &Model,
    samples: usize,
    progress: &mut Progress,
) -> anyhow::Result<(Compute, Vec<Durations>)> {
    let inputs = inputs(model)?;
    let all = Selection::default();
    let tip = Selection { fields: None, nodes: Nodes::List(tip_nodes(model)) };
    let mut full = ModelState::new(model, &all)?;
    let wide = Reconstructor::with_precision(model, &all, Some(Precision::F32))?;
    let mut tip = ModelState::new(model, &tip)?;
    full.update(inputs[0])?;
    let regime = full.evaluation().regime;
    let coefficients = full.reconstructor().coefficients(full.evaluation())?;
    let basis = |fields: &Reconstructor| fields.basis(regime).cloned().context("the model has no regime");
    let (default, wide) = (basis(full.reconstructor())?, basis(&wide)?);

    progress.step("kernel and prediction");
    let mut subjects = [Subject::new("default", &default), Subject::new("f32", &wide)];
    kernels(&mut subjects, &coefficients, samples, progress)?;
    progress.step("prediction");
    let evaluator = Evaluator::new(&model.header)?;
    let predictions = predictions(&inputs, &evaluator, &mut full, &mut tip, samples)?;
    let jumping = jumping(model, &mut full, samples)?;
    let position = position(model, &inputs, samples)?;
    let [default_figures, f32] = subjects.each_ref().map(Subject::result);
    let compute = Compute {
        isa: default.isa().to_string(),
        nodes: default.nodes(),
        fields: default.fields(),
        entries: default.output_len(),
        coefficients: coefficients.len(),
        kernel: Kernels { default: default_figures, f32 },
        predict_us_p50: predictions[0].p50(),
        jumping_us_p50: jumping.p50(),
        state_only_us_p50: predictions[1].p50(),
        tip_us_p50: predictions[2].p50(),
        position_us_p50: position.p50(),
        tip_nodes: tip.reconstructor().rows(),
    };
    let kernels = subjects.into_iter().flat_map(|s| [s.warm, s.evicted]);
    let predictions = predictions.into_iter().chain([jumping, position]);
    Ok((compute, kernels.chain(predictions).collect()))
}

/// Warm and evicted, one basis after the other.
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
        }
    }
    progress.step("kernel with the caches evicted");
    let mut evictor = Evictor::default();
    for _ in 0..(samples / EVICTED_SHARE).clamp(10, 200) {
        for subject in subjects.iter_mut() {
            let basis = subject.basis;
            evictor.evict();
            subject.evicted.time(|| basis.reconstruct(coefficients, &mut out));
        }
    }
    Ok(())
}

/// Full field, state only, tip set, over inputs that vary.
fn predictions(
    inputs: &[Inputs],
    evaluator: &Evaluator,
    full: &mut ModelState,
    tip: &mut ModelState,
    samples: usize,
) -> anyhow::Result<[Durations; 3]> {
    let mut series = ["predict", "state only", "tip"].map(Durations::new);
    let [predict, state, tip_series] = &mut series;
    let mut evaluation = evaluator.evaluation();
    // Each in its own loop: a twin has one basis, and the sets that are small stay in the first caches.
    for sample in 0..samples {
        let input = inputs[sample % inputs.len()];
        full.update(input)?; // brings the basis into the cache
        predict.time(|| full.update(input));
    }
    for sample in 0..samples {
        let input = inputs[sample % inputs.len()];
        state.time(|| evaluator.answer(input, Query::STATE, &mut evaluation));
    }
    for sample in 0..samples {
        let input = inputs[sample % inputs.len()];
        tip_series.time(|| tip.update(input));
        tip.update(input)?;
    }
    Ok(series)
}

/// Full field over inputs from the whole training range of the last regime, of those that are in it.
fn jumping(model: &Model, state: &mut ModelState, samples: usize) -> anyhow::Result<Durations> {
    let regime = model.header.regimes.last().context("the model has no regime")?;
    let mut rng = Rng::new(JUMPING_SEED);
    let mut series = Durations::new("predict, jumping");
    // Without another regime every state is in the last one; otherwise it takes a part of the box of their ranges.
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
fn position(model: &Model, inputs: &[Inputs], samples: usize) -> anyhow::Result<Durations> {
    let node = *tip_nodes(model).last().context("the model has no nodes")?;
    let probes = Probes::new(model, &[MeshPoint::node(model, node)?])?;
    let (mut evaluation, mut at) = (probes.evaluation(), [ProbePosition::default()]);
    let mut series = Durations::new("position");
    for input in inputs.iter().cycle().take(samples) {
        series.time(|| probes.answer(*input, Query::GRADIENTS, &mut evaluation, &mut at));
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
