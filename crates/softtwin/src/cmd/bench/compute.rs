//! Kernel and prediction in this process.

use super::measure::{Evictor, Series, gbps};
use crate::progress::Progress;
use anyhow::Context;
use rom::evaluation::Input;
use rom::interpolant::Quantity;
use rom::kernel::{Basis, Precision};
use rom::model::{BlockKind, Model};
use rom::predict::{Nodes, Predictor, Selection};
use rom::regime::RegimeSwitch;
use serde::Serialize;

/// Nodes of the small set.
const TIP_NODES: usize = 500;
/// Different states to predict.
const INPUTS: u32 = 64;
/// Eviction takes milliseconds, so there are fewer evicted samples than warm ones.
const EVICTED_SHARE: usize = 10;

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

/// Both precisions.
#[derive(Debug, Clone, Serialize)]
pub struct Kernels {
    /// 4 bytes an entry.
    pub f32: Kernel,
    /// 2 bytes a mode's entry.
    pub i16: Kernel,
}

/// Everything measured in this process.
#[derive(Debug, Clone, Serialize)]
pub struct Compute {
    /// Instruction set of the kernel.
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
    /// Input to full field in memory, f32, median.
    pub predict_us_p50: f64,
    /// Coefficients, force, gradients, bars; no field: median.
    pub state_only_us_p50: f64,
    /// Input to the fields of a set of `tip_nodes` nodes, median.
    pub tip_us_p50: f64,
    /// Nodes of that set.
    pub tip_nodes: usize,
}

/// One basis under test and its series.
struct Subject<'a> {
    basis: &'a Basis,
    warm: Series,
    evicted: Series,
    read: Series,
    evicted_read: Series,
}

impl<'a> Subject<'a> {
    fn new(basis: &'a Basis, samples: usize) -> Self {
        let name = format!("kernel {:?}", basis.precision()).to_lowercase();
        let series = |what: &str| Series::new(format!("{name}, {what}"), samples);
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
    let mut full = Predictor::new(model, &all)?;
    let small = Predictor::with_precision(model, &all, Precision::I16)?;
    let mut tip = Predictor::new(model, &tip)?;
    let mut evaluation = full.evaluation();
    full.evaluate(inputs[0], &mut RegimeSwitch::default(), &mut evaluation);
    let basis =
        |predictor: &Predictor| predictor.basis(evaluation.basis).cloned().context("the model has no regime");
    let (wide, narrow) = (basis(&full)?, basis(&small)?);

    progress.step("kernel and prediction");
    let subjects = [Subject::new(&wide, samples), Subject::new(&narrow, samples)];
    let subjects = kernels(subjects, &evaluation.coefficients, samples, progress)?;
    progress.step("prediction");
    let predictions = predictions(&inputs, &mut full, &mut tip, samples)?;
    let [f32, i16] = [subjects[0].result(), subjects[1].result()];
    let compute = Compute {
        isa: wide.isa().to_string(),
        nodes: full.rows(),
        fields: full.field_count(),
        entries: full.entries(),
        coefficients: evaluation.coefficients.len(),
        read_gbps: f32.read_gbps,
        kernel: Kernels { f32, i16 },
        predict_us_p50: predictions[0].p50(),
        state_only_us_p50: predictions[1].p50(),
        tip_us_p50: predictions[2].p50(),
        tip_nodes: tip.rows(),
    };
    let kernels = subjects.into_iter().flat_map(|s| [s.warm, s.evicted]);
    Ok((compute, kernels.chain(predictions).collect()))
}

/// Warm and evicted, both precisions in turn.
fn kernels<'a, const N: usize>(
    mut subjects: [Subject<'a>; N],
    coefficients: &[f64],
    samples: usize,
    progress: &mut Progress,
) -> anyhow::Result<[Subject<'a>; N]> {
    let mut out = vec![0.0; subjects[0].basis.output_len()];
    for _ in 0..samples {
        for subject in &mut subjects {
            let basis = subject.basis;
            basis.read_once(); // brings the basis into the cache
            subject.read.time(|| basis.read_once());
            basis.reconstruct(coefficients, &mut out)?;
            subject.warm.time(|| basis.reconstruct(coefficients, &mut out));
        }
    }
    progress.step("kernel with the caches evicted");
    let mut evictor = Evictor::new();
    for _ in 0..(samples / EVICTED_SHARE).clamp(10, 200) {
        for subject in &mut subjects {
            let basis = subject.basis;
            evictor.evict();
            subject.evicted.time(|| basis.reconstruct(coefficients, &mut out));
            evictor.evict();
            subject.evicted_read.time(|| basis.read_once());
        }
    }
    Ok(subjects)
}

/// Full field, state only, tip set: in turn, over inputs that vary.
fn predictions(
    inputs: &[Input],
    full: &mut Predictor,
    tip: &mut Predictor,
    samples: usize,
) -> anyhow::Result<[Series; 3]> {
    let mut switch = RegimeSwitch::default();
    let mut series = ["predict", "state only", "tip"].map(|name| Series::new(name, samples));
    let [predict, state, tip_series] = &mut series;
    let (mut evaluation, mut tip_evaluation) = (full.evaluation(), tip.evaluation());
    let (mut out, mut tip_out) = (vec![0.0; full.entries()], vec![0.0; tip.entries()]);
    for sample in 0..samples {
        let input = inputs[sample % inputs.len()];
        predict.time(|| {
            full.evaluate(input, &mut switch, &mut evaluation);
            full.reconstruct_into(&evaluation, &mut out)
        });
        full.reconstruct_into(&evaluation, &mut out)?;
    }
    // In loops of their own: a twin of these small sets alone keeps them in the first caches.
    for sample in 0..samples {
        let input = inputs[sample % inputs.len()];
        state.time(|| tip.evaluate(input, &mut switch, &mut tip_evaluation));
    }
    for sample in 0..samples {
        let input = inputs[sample % inputs.len()];
        tip_series.time(|| {
            tip.evaluate(input, &mut switch, &mut tip_evaluation);
            tip.reconstruct_into(&tip_evaluation, &mut tip_out)
        });
        tip.reconstruct_into(&tip_evaluation, &mut tip_out)?;
    }
    Ok(series)
}

/// States of the last regime (contact, where there is one), inside its sampled ranges, the pressure rising.
pub fn inputs(model: &Model) -> anyhow::Result<Vec<Input>> {
    let regime = model.header.regimes.last().context("the model has no regime")?;
    let range = |quantity| regime.inputs.axes.iter().find(|axis| axis.quantity == quantity);
    let pressure = range(Quantity::PressureMpa).context("the model takes no pressure")?;
    let gap_mm = match (range(Quantity::GapMm), regime.inputs.constant_gap_mm) {
        (Some(gap), _) => gap.min + 0.2 * (gap.max - gap.min),
        (None, Some(gap)) => gap,
        (None, None) => f64::INFINITY,
    };
    let at = |share: f64| pressure.min + share * (pressure.max - pressure.min);
    let input = |i| Input { pressure_mpa: at(0.6 + 0.3 * f64::from(i) / f64::from(INPUTS)), gap_mm };
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
