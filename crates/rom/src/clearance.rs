//! Onset pressure of a model with parameters, solved from the free model.
//!
//! The free model's lowest node lies at depth `D(P, q)` below the base (`q` the parameters). The obstacle at `gap` is touched
//! from `P_c` on, `D(P_c, q) = gap`. Only the nodes that can be the lowest are evaluated. Newton's method within a
//! bracket; the result has a residual of at most [`TOLERANCE_MM`]. Derivatives follow from the implicit function:
//! `dP_c/dgap = 1 / D_P`, `dP_c/dq = -D_q / D_P`.

use crate::evaluation::Evaluation;
use crate::inputs::{GAP, InputMap, Inputs, MAX_INPUTS, PRESSURE};
use crate::kernel::sums::{Scratch, Sums};
use crate::kernel::weigh::Weights;
use crate::model::{Clearance, RegimeModel};
use crate::regime::{LastOnset, Onset, OnsetAt, OnsetTable};

/// Largest residual `|D(P_c, q) - gap|` of an onset pressure, mm.
pub const TOLERANCE_MM: f64 = 1e-9;
/// Steps of the search; every third one halves the bracket.
const STEPS: usize = 150;
/// Newton steps from a guess before the bracket is evaluated.
const NEAR_STEPS: usize = 8;
/// A residual from which the last step of [`OnsetSolver::onset_near`] is taken along the tangent, mm: the remaining
/// error from the depth's curvature is below 1 % of it.
const TANGENT_MM: f64 = 0.02;
/// Pressures of a table.
const TABLE_STEPS: usize = 240;
/// Fraction of the largest pressure over which the slope at rest is a difference.
const REST_FRACTION: f64 = 1e-3;

/// Depth of the lowest node and its derivatives with respect to all inputs.
#[derive(Clone, Copy, Debug)]
struct Depth {
    mm: f64,
    gradient: [f64; MAX_INPUTS],
}

/// Solves for the onset of one model.
#[derive(Clone, Debug)]
pub struct OnsetSolver {
    clearance: Clearance,
    inputs: InputMap,
    modes: usize,
    /// The modes' heights in blocks of nodes.
    heights: Weights,
    sums: Sums,
}

impl OnsetSolver {
    /// Solver for a clearance and the free regime to which its modes belong.
    pub fn new(clearance: Clearance, free: &RegimeModel) -> Self {
        let surrogate = &free.groups[clearance.group].surrogate;
        let sums = Sums::new(&[surrogate]);
        let modes = surrogate.outputs;
        let nodes = clearance.mean_mm.len();
        let height = |mode: usize, _: usize, node: usize| clearance.modes[node * modes + mode];
        let heights = Weights::new([0, nodes, modes, 0], height);
        Self { inputs: free.inputs.clone(), modes, heights, sums, clearance }
    }

    /// Scratch memory of one evaluation.
    pub(crate) fn memory(&self) -> Scratch {
        let mut scratch = Scratch::of([&self.sums].into_iter());
        scratch.reserve_for(&self.heights);
        scratch
    }

    /// Evaluation with the capacity that the solver needs.
    pub fn scratch(&self) -> Evaluation {
        Evaluation::with_scratch(self.modes, self.memory())
    }

    /// The clearance, as the model stores it.
    pub fn into_clearance(self) -> Clearance {
        self.clearance
    }

    fn depth(&self, inputs: &Inputs, out: &mut Evaluation) -> Depth {
        out.gradients.iter_mut().for_each(|row| row.resize(self.modes, 0.0));
        let (node, height) = self.lowest(inputs, out, true);
        let modes = self.modes;
        let row = self.clearance.modes.get(node * modes..(node + 1) * modes).unwrap_or_default();
        let dot = |a: &[f64]| row.iter().zip(a).map(|(phi, a)| phi * a).sum::<f64>();
        let mut gradient = [0.0; MAX_INPUTS];
        for (axis, row) in self.inputs.axes.iter().zip(&out.gradients) {
            gradient[axis.input] = -dot(row) / (axis.max - axis.min);
        }
        Depth { mm: -height, gradient }
    }

    /// The lowest node and its height, mm; leaves the modes' coefficients, and their derivatives where asked for.
    fn lowest(&self, inputs: &Inputs, out: &mut Evaluation, with_gradient: bool) -> (usize, f64) {
        out.coefficients.resize(self.modes, 0.0);
        let gradient = with_gradient.then(|| out.gradients.each_mut().map(Vec::as_mut_slice));
        self.sums.evaluate(&self.inputs.scale(inputs), &mut out.scratch, &mut out.coefficients, gradient);
        let sums = out.scratch.weighted(&self.heights, &out.coefficients);
        let heights = self.clearance.mean_mm.iter().zip(sums.as_flattened()).map(|(mean, sum)| mean + sum);
        heights.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, f64::NAN))
    }

    /// Depth of the lowest node at a state's pressure and parameters, mm.
    pub fn depth_mm(&self, inputs: &Inputs, scratch: &mut Evaluation) -> f64 {
        -self.lowest(inputs, scratch, false).1
    }

    /// Height of the lowest node at a state's pressure and parameters, mm, with a further height per node.
    pub(crate) fn lowest_mm(
        &self,
        inputs: &Inputs,
        further_mm: impl Fn(usize) -> f64,
        out: &mut Evaluation,
    ) -> f64 {
        out.coefficients.resize(self.modes, 0.0);
        self.sums.evaluate(&self.inputs.scale(inputs), &mut out.scratch, &mut out.coefficients, None);
        let sums = out.scratch.weighted(&self.heights, &out.coefficients);
        let heights = self.clearance.mean_mm.iter().zip(sums.as_flattened()).enumerate();
        heights.map(|(node, (mean, sum))| mean + sum + further_mm(node)).fold(f64::INFINITY, f64::min)
    }

    /// Value of a parameter, sought from that of the inputs, at which the lowest node touches the obstacle. `None` if there is none within
    /// the range of the parameter and half of it beyond either end.
    pub(crate) fn touching(&self, parameter: usize, inputs: &Inputs, out: &mut Evaluation) -> Option<f64> {
        let axis = self.inputs.axes.iter().find(|axis| axis.input == parameter)?;
        let width = axis.max - axis.min;
        let mut value = inputs.values()[parameter];
        for _ in 0..STEPS {
            let here = self.depth(&inputs.with(parameter, value), out);
            let off_mm = here.mm - inputs.gap_mm();
            if off_mm.abs() <= 1e3 * TOLERANCE_MM {
                return Some(value);
            }
            value -= (off_mm / here.gradient[parameter]).clamp(-0.25 * width, 0.25 * width);
            if !(axis.min - 0.5 * width..=axis.max + 0.5 * width).contains(&value) {
                return None;
            }
        }
        None
    }

    /// Onset at a state. `table`: a known onset table, and whether it was made for the state's parameters. If so, it
    /// provides the ends of the search, otherwise only the first guess. No allocation if `scratch` is from the
    /// model's evaluator; at most 160 evaluations of the free model's height, 2 to 5 with a table.
    pub fn onset(
        &self,
        inputs: &Inputs,
        table: Option<(&OnsetTable, bool)>,
        scratch: &mut Evaluation,
    ) -> OnsetAt {
        let gap_mm = inputs.gap_mm();
        if gap_mm == f64::INFINITY {
            return OnsetAt::NEVER;
        }
        let mut depth = |p: f64| self.depth(&inputs.with(PRESSURE, p), scratch);
        if let Some((other, false)) = table
            && let Some(found) = self.onset_from_guess(other.pressure_and_slope(gap_mm).0, gap_mm, &mut depth)
        {
            return found;
        }
        let table = table.filter(|(_, own)| *own).map(|(table, _)| table);
        let sag_mm = table.map_or_else(|| depth(0.0).mm, OnsetTable::sag_mm);
        if gap_mm <= sag_mm {
            return self.below_sag(
                depth(0.0),
                depth(REST_FRACTION * self.clearance.max_pressure_mpa),
                gap_mm,
            );
        }
        let reach_mm = table.map_or_else(|| depth(self.clearance.max_pressure_mpa).mm, OnsetTable::reach_mm);
        if gap_mm > reach_mm || !gap_mm.is_finite() || !sag_mm.is_finite() || !reach_mm.is_finite() {
            let last = depth(self.clearance.max_pressure_mpa);
            let by_gap = 1.0 / last.gradient[PRESSURE];
            let pressure_mpa = self.clearance.max_pressure_mpa + by_gap * (gap_mm - last.mm);
            return OnsetAt { onset: Onset::Never, pressure_mpa, gradient: implicit(&last) };
        }
        let (mut low, mut high) = (0.0, self.clearance.max_pressure_mpa);
        let share = (gap_mm - sag_mm) / (reach_mm - sag_mm);
        let mut p = table.map_or(share * high, |table| table.pressure_and_slope(gap_mm).0);
        for step in 1..=STEPS {
            let here = depth(p);
            let off_mm = here.mm - gap_mm;
            if off_mm.abs() <= TOLERANCE_MM {
                return OnsetAt { onset: Onset::At(p), pressure_mpa: p, gradient: implicit(&here) };
            }
            if off_mm > 0.0 {
                high = p
            } else {
                low = p
            }
            let newton = p - off_mm / here.gradient[PRESSURE];
            p = if newton > low && newton < high && step % 3 != 0 { newton } else { 0.5 * (low + high) };
        }
        OnsetAt::UNKNOWN
    }

    /// Onset at a state near the last one: error of about 1e-4 mm after one evaluation of the free model's height, for states as
    /// close as successive readings. It ends with a step along the tangent that is not checked; [`Self::onset_from_guess`] ends where
    /// the height is the gap to rounding, and gives the same pressure whatever the guess.
    pub(crate) fn onset_near(
        &self,
        inputs: &Inputs,
        last: &LastOnset,
        scratch: &mut Evaluation,
    ) -> Option<OnsetAt> {
        let mut p = last.continued_mpa(inputs)?;
        for _ in 0..NEAR_STEPS {
            if p.is_nan() || p <= 0.0 || p >= self.clearance.max_pressure_mpa {
                return None;
            }
            let here = self.depth(&inputs.with(PRESSURE, p), scratch);
            let (off_mm, slope) = (here.mm - inputs.gap_mm(), here.gradient[PRESSURE]);
            if slope.is_nan() || slope <= 0.0 {
                return None;
            }
            p -= off_mm / slope;
            if off_mm.abs() <= TANGENT_MM {
                return Some(OnsetAt { onset: Onset::At(p), pressure_mpa: p, gradient: implicit(&here) });
            }
        }
        None
    }

    /// Exact onset by Newton's method from a guess; `None` outside the pressures of the free model or after [`NEAR_STEPS`] steps.
    fn onset_from_guess(
        &self,
        mut p: f64,
        gap_mm: f64,
        depth: &mut impl FnMut(f64) -> Depth,
    ) -> Option<OnsetAt> {
        for _ in 0..NEAR_STEPS {
            if p.is_nan() || p <= 0.0 || p >= self.clearance.max_pressure_mpa {
                return None;
            }
            let here = depth(p);
            let off_mm = here.mm - gap_mm;
            if off_mm.abs() <= TOLERANCE_MM {
                let onset = OnsetAt { onset: Onset::At(p), pressure_mpa: p, gradient: implicit(&here) };
                return (here.gradient[PRESSURE] > 0.0).then_some(onset);
            }
            p -= off_mm / here.gradient[PRESSURE];
        }
        None
    }

    /// Onset of a gap that gravity alone closes: the negative pressure that would open it, continued from the slope at rest.
    fn below_sag(&self, rest: Depth, near: Depth, gap_mm: f64) -> OnsetAt {
        let step_mpa = REST_FRACTION * self.clearance.max_pressure_mpa;
        let slope = step_mpa / (near.mm - rest.mm);
        let x = gap_mm - rest.mm;
        let bent = self.clearance.bend_per_mm * x;
        let along = if bent == 0.0 { x } else { bent.exp_m1() / self.clearance.bend_per_mm };
        let by_x = slope * bent.exp();
        let mut gradient = [0.0; MAX_INPUTS];
        for (input, by) in gradient.iter_mut().enumerate().filter(|(input, _)| *input != PRESSURE) {
            let by_slope = -slope * slope * (near.gradient[input] - rest.gradient[input]) / step_mpa;
            *by = by_slope * along - by_x * rest.gradient[input];
        }
        gradient[GAP] = by_x;
        OnsetAt { onset: Onset::Always, pressure_mpa: slope * along, gradient }
    }

    /// Onset table at fixed parameters; `None` if the free model moves down at no pressure.
    pub fn table(&self, inputs: &Inputs, scratch: &mut Evaluation) -> Option<OnsetTable> {
        let (mut gaps, mut pressures): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        for step in 0..=TABLE_STEPS {
            let pressure = self.clearance.max_pressure_mpa * step as f64 / TABLE_STEPS as f64;
            let depth = self.depth(&inputs.with(PRESSURE, pressure), scratch).mm;
            if depth.is_finite() && gaps.last().is_none_or(|deepest| depth > deepest + TOLERANCE_MM) {
                gaps.push(depth);
                pressures.push(pressure);
            }
        }
        (gaps.len() > 1).then(|| OnsetTable::new(gaps, pressures))
    }
}

/// Derivatives of the pressure at which the depth is the gap.
fn implicit(depth: &Depth) -> [f64; MAX_INPUTS] {
    let by_pressure = depth.gradient[PRESSURE];
    let mut gradient = depth.gradient.map(|by| -by / by_pressure);
    gradient[PRESSURE] = 0.0;
    gradient[GAP] = 1.0 / by_pressure;
    gradient
}
