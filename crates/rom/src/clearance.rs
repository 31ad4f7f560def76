//! When a model with parameters touches: the onset pressure solved from the free model itself.
//!
//! The free model's lowest node lies at depth `D(P, q)` below the base (`q` the parameters). The obstacle at `gap` is touched
//! from `P_c` on, `D(P_c, q) = gap`. Only the few nodes that can be the lowest are looked at. Newton's method within a
//! bracket; an answer has a residual of at most [`TOLERANCE_MM`]. Derivatives follow from the implicit function:
//! `dP_c/dgap = 1 / D_P`, `dP_c/dq = -D_q / D_P`.

use crate::evaluation::Evaluation;
use crate::inputs::{GAP, Inputs, MAX_INPUTS, PRESSURE};
use crate::model::{Clearance, RegimeModel};
use crate::regime::{Onset, OnsetAt, OnsetTable};

/// Largest residual `|D(P_c, q) - gap|` of an onset pressure, mm.
pub const TOLERANCE_MM: f64 = 1e-9;
/// Steps of the search; every third one halves the bracket.
const STEPS: usize = 150;
/// Pressures of a table.
const TABLE_STEPS: usize = 240;
/// The slope at rest is a difference over this share of the largest pressure.
const REST_SHARE: f64 = 1e-3;

/// Depth of the lowest node and its derivative by every input.
#[derive(Clone, Copy, Debug)]
struct Depth {
    mm: f64,
    gradient: [f64; MAX_INPUTS],
}

impl Clearance {
    fn depth(&self, free: &RegimeModel, inputs: &Inputs, room: &mut Evaluation) -> Depth {
        let surrogate = &free.groups[self.group].surrogate;
        let modes = surrogate.outputs;
        for values in room.gradients.iter_mut().chain([&mut room.coefficients]) {
            values.resize(modes, 0.0);
        }
        let mut rows = room.gradients.iter_mut();
        let gradient = std::array::from_fn(|_| rows.next().map(Vec::as_mut_slice).unwrap_or_default());
        let x = free.inputs.scale(inputs);
        surrogate.evaluate(&x, &mut room.scratch, &mut room.coefficients, gradient);
        let row = |node: usize| &self.modes[node * modes..(node + 1) * modes];
        let dot = |node: usize, a: &[f64]| row(node).iter().zip(a).map(|(phi, a)| phi * a).sum::<f64>();
        let height = |node: usize| self.mean_mm[node] + dot(node, &room.coefficients);
        let heights = (0..self.mean_mm.len()).map(|node| (height(node), node));
        let (height, node) = heights.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::NAN, 0));
        let mut gradient = [0.0; MAX_INPUTS];
        for (axis, row) in free.inputs.axes.iter().zip(&room.gradients) {
            gradient[axis.input] = -dot(node, row) / (axis.max - axis.min);
        }
        Depth { mm: -height, gradient }
    }

    /// Depth of the lowest node at a state's pressure and parameters, mm.
    pub(crate) fn depth_mm(&self, free: &RegimeModel, inputs: &Inputs, room: &mut Evaluation) -> f64 {
        self.depth(free, inputs, room).mm
    }

    /// The onset at a state. `table` is the one at these parameters, where it is at hand: it saves the ends of the search.
    /// No allocation when `room` is of the model's evaluator; at most 150 evaluations of the free model's height, 2 or 3
    /// with a table.
    pub(crate) fn onset(
        &self,
        free: &RegimeModel,
        inputs: &Inputs,
        table: Option<&OnsetTable>,
        room: &mut Evaluation,
    ) -> OnsetAt {
        let gap_mm = inputs.gap_mm();
        let mut depth = |p: f64| self.depth(free, &inputs.with(PRESSURE, p), room);
        let sag_mm = table.map_or_else(|| depth(0.0).mm, OnsetTable::sag_mm);
        if gap_mm <= sag_mm {
            return self.below_sag(depth(0.0), depth(REST_SHARE * self.max_pressure_mpa), gap_mm);
        }
        let reach_mm = table.map_or_else(|| depth(self.max_pressure_mpa).mm, OnsetTable::reach_mm);
        if gap_mm > reach_mm || !gap_mm.is_finite() || !sag_mm.is_finite() || !reach_mm.is_finite() {
            let last = depth(self.max_pressure_mpa);
            let by_gap = 1.0 / last.gradient[PRESSURE];
            let pressure_mpa = self.max_pressure_mpa + by_gap * (gap_mm - last.mm);
            return OnsetAt { onset: Onset::Never, pressure_mpa, gradient: implicit(&last) };
        }
        let (mut low, mut high) = (0.0, self.max_pressure_mpa);
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

    /// Where gravity alone touches: how far the pressure would have to fall, continued from the slope at rest.
    fn below_sag(&self, rest: Depth, near: Depth, gap_mm: f64) -> OnsetAt {
        let step_mpa = REST_SHARE * self.max_pressure_mpa;
        let slope = step_mpa / (near.mm - rest.mm);
        let x = gap_mm - rest.mm;
        let bent = self.bend_per_mm * x;
        let along = if bent == 0.0 { x } else { bent.exp_m1() / self.bend_per_mm };
        let by_x = slope * bent.exp();
        let mut gradient = [0.0; MAX_INPUTS];
        for (input, by) in gradient.iter_mut().enumerate().filter(|(input, _)| *input != PRESSURE) {
            let by_slope = -slope * slope * (near.gradient[input] - rest.gradient[input]) / step_mpa;
            *by = by_slope * along - by_x * rest.gradient[input];
        }
        gradient[GAP] = by_x;
        OnsetAt { onset: Onset::Always, pressure_mpa: slope * along, gradient }
    }

    /// The onset table at fixed parameters; none when the free model moves down at no pressure there.
    pub(crate) fn table(
        &self,
        free: &RegimeModel,
        inputs: &Inputs,
        room: &mut Evaluation,
    ) -> Option<OnsetTable> {
        let (mut gaps, mut pressures): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        for step in 0..=TABLE_STEPS {
            let pressure = self.max_pressure_mpa * step as f64 / TABLE_STEPS as f64;
            let depth = self.depth(free, &inputs.with(PRESSURE, pressure), room).mm;
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
