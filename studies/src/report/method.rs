//! Ways to turn an input into fields: the twin's own kernel, with its modes in f32 and i16, and plain f64 sums beside it.

use rom::evaluation::Evaluation;
use rom::evaluator::Evaluator;
use rom::inputs::Inputs;
use rom::kernel::Modes;
use rom::kernel::Precision;
use rom::model::{BlockKind, Model, RegimeModel, Selection};
use rom::model_state::ModelState;
use rom::reconstructor::Basis;
use rom::snapshots::{FieldKind, RegimeKind};

/// A way to evaluate and reconstruct states, which is timed and compared.
pub trait ReconstructionMethod {
    /// Evaluates and reconstructs one state; returns the contact force in N.
    fn answer(&mut self, input: Inputs) -> anyhow::Result<f64>;
    /// The last state, field-major.
    fn value(&self, index: usize) -> f64;
    /// Nodes per field.
    fn rows(&self) -> usize;
    /// Bytes of means and modes in use, both regimes together.
    fn bytes(&self) -> usize;
}

/// The twin's reconstruction kernel.
pub struct Kernel(ModelState);

impl Kernel {
    pub fn new(model: &Model, selection: &Selection, precision: Option<Precision>) -> anyhow::Result<Self> {
        Ok(Self(ModelState::with_precision(model, selection, precision)?))
    }
}

impl ReconstructionMethod for Kernel {
    fn answer(&mut self, input: Inputs) -> anyhow::Result<f64> {
        self.0.update(input)?;
        Ok(self.0.evaluation().contact_force_n)
    }

    fn value(&self, index: usize) -> f64 {
        f64::from(self.0.fields()[index])
    }

    fn rows(&self) -> usize {
        self.0.reconstructor().rows()
    }

    fn bytes(&self) -> usize {
        self.0.reconstructor().bases().map(Basis::bytes).sum()
    }
}

/// One field of one regime in f64.
enum Field {
    /// Mean and modes, and which coefficients they take.
    Sum { mean: Vec<f64>, modes: Vec<f64>, first: usize, stress: bool },
    /// Distance from the undeformed position, by the coordinates' places among the fields.
    Distance { axes: [usize; 3], rest: [Vec<f64>; 3] },
}

/// All in f64: mean plus mode after mode, in pieces that stay in the first cache. What the kernel is measured against.
pub struct Double {
    evaluator: Evaluator,
    evaluation: Evaluation,
    regimes: Vec<(RegimeKind, Vec<Field>)>,
    out: Vec<f64>,
    rows: usize,
}

/// Rows of a piece: a mean, a mode and the output of this number of rows fit a 32 kB cache.
const PIECE: usize = 1024;

impl Double {
    pub fn new(model: &Model, selection: &Selection) -> anyhow::Result<Self> {
        let nodes = model.header.resolve_nodes(&selection.nodes)?;
        let all: Vec<u32> = (0..model.header.node_count as u32).collect();
        let nodes = nodes.unwrap_or(all);
        let evaluator = Evaluator::new(&model.header)?;
        let regimes =
            model.header.regimes.iter().map(|regime| (regime.kind, fields(model, regime, &nodes))).collect();
        let (evaluation, rows) = (evaluator.evaluation(), nodes.len());
        let out = vec![0.0; rows * model.header.fields.len()];
        Ok(Self { evaluator, evaluation, regimes, out, rows })
    }
}

fn fields(model: &Model, regime: &RegimeModel, nodes: &[u32]) -> Vec<Field> {
    let pick = |values: &[f32]| nodes.iter().map(|n| f64::from(values[*n as usize])).collect::<Vec<f64>>();
    let block = |kind| model.f32_block(kind).unwrap_or_default();
    let field = |(f, spec): (usize, &rom::model::OutputField)| match spec.magnitude_of {
        Some(axes) => {
            Field::Distance { axes, rest: [0, 1, 2].map(|axis| pick(block(BlockKind::Undeformed(axis)))) }
        }
        None => {
            let group = regime.groups.iter().find(|g| g.fields.contains(&f));
            let (kind, field) = (regime.kind, f as u32);
            let modes = model.modes(kind, field);
            let count = group.map_or(0, |group| group.coefficients.len());
            let of_mode = |modes: &'_ Modes, mode| {
                nodes.iter().map(|node| modes.value(mode, *node as usize)).collect::<Vec<f64>>()
            };
            Field::Sum {
                mean: pick(model.mean(kind, field).unwrap_or_default()),
                modes: modes.iter().flat_map(|m| (0..count).flat_map(|k| of_mode(m, k))).collect(),
                first: group.map_or(0, |g| g.coefficients.start),
                stress: spec.spec.kind == FieldKind::Stress,
            }
        }
    };
    model.header.fields.iter().enumerate().map(field).collect()
}

impl ReconstructionMethod for Double {
    fn answer(&mut self, input: Inputs) -> anyhow::Result<f64> {
        self.evaluator.evaluate(input, &mut self.evaluation);
        let regime = self.regimes.iter().find(|r| r.0 == self.evaluation.regime);
        let fields = regime.map_or(&[][..], |r| r.1.as_slice());
        let rows = self.rows;
        for (f, field) in fields.iter().enumerate() {
            let Field::Sum { mean, modes, first, stress } = field else { continue };
            let out = &mut self.out[f * rows..(f + 1) * rows];
            let coefficients = &self.evaluation.coefficients[*first..];
            for (piece, out) in out.chunks_mut(PIECE).enumerate() {
                let (start, length) = (piece * PIECE, out.len());
                out.copy_from_slice(&mean[start..start + length]);
                for (mode, a) in modes.chunks_exact(rows).zip(coefficients) {
                    out.iter_mut().zip(&mode[start..start + length]).for_each(|(y, phi)| *y += a * phi);
                }
                if *stress {
                    out.iter_mut().for_each(|s| *s = s.max(0.0));
                }
            }
        }
        for (f, field) in fields.iter().enumerate() {
            let Field::Distance { axes, rest } = field else { continue };
            let [xs, ys, zs] = rest;
            for (i, ((x, y), z)) in xs.iter().zip(ys).zip(zs).enumerate() {
                let off = |k: usize, rest: &f64| (self.out[axes[k] * rows + i] - rest).powi(2);
                self.out[f * rows + i] = (off(0, x) + off(1, y) + off(2, z)).sqrt();
            }
        }
        Ok(self.evaluation.contact_force_n)
    }

    fn value(&self, index: usize) -> f64 {
        self.out[index]
    }

    fn rows(&self) -> usize {
        self.rows
    }

    fn bytes(&self) -> usize {
        let one = |field: &Field| match field {
            Field::Sum { mean, modes, .. } => mean.len() + modes.len(),
            Field::Distance { rest, .. } => rest.iter().map(Vec::len).sum(),
        };
        8 * self.regimes.iter().flat_map(|r| r.1.iter().map(one)).sum::<usize>()
    }
}
