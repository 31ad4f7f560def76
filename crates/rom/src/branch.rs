//! Injected volume of a cavity whose pressure is known, for a model over volumes: the branch of stable states is followed.
//!
//! ```text
//! P(V)  ^      _b          rest-a, c-d: branches, on which P rises with V
//!       |   a_/ \     _d    P above P(a): jump to the next branch that reaches P(a)
//!       |   / \_c\___/      P below P(c): jump back to the one before that reaches P(c)
//!       +-------------> V   between P(c) and P(a) the branch depends on the past
//! ```
//!
//! `P(V)` is tabulated once, with slopes; its extrema are the limits. A fold of less than [`SHALLOW`] of the range of pressures is an error
//! of interpolation and is levelled.

use crate::contract::{Output, contracted};
use crate::cubic::Cubic;
use crate::evaluation::Evaluation;
use crate::evaluator::{Evaluator, Query};
use crate::inputs::{Inputs, PARAMETERS, PRESSURE};
use crate::model::{Model, ModelError, ModelHeader};
use crate::probe::{MeshPoint, field_at};
use crate::snapshots::{FieldKind, FieldSpec};

/// Name of the input.
pub const VOLUME: &str = "volume_mm3";
/// Intervals of the table.
const INTERVALS: usize = 512;
/// Depth of the smallest fold, as a fraction of the range of pressures.
const SHALLOW: f64 = 1e-3;
/// Height above the lowest pressure at which an actuator that passed its last limit counts as at rest again, as a fraction of the range of
/// pressures.
const AT_REST: f64 = 0.01;
/// Longest time between two readings over which the branch stays known, s.
const MAX_GAP_S: f64 = 1.0;

/// State of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BranchSample {
    /// Injected volume, mm3.
    pub volume_mm3: f64,
    /// Pressure there, MPa.
    pub pressure_mpa: f64,
    /// Its derivative, MPa/mm3.
    pub slope: f64,
}

/// States of rising pressure.
#[derive(Clone, Debug, PartialEq)]
struct Branch {
    /// Samples by rising volume; the pressure never falls.
    samples: Vec<BranchSample>,
    /// The table, not a limit, ends the branch at its begin and at its end.
    is_open: [bool; 2],
}

/// Where a past is on the branches.
#[derive(Clone, Copy, Debug, PartialEq)]
enum BranchPosition {
    On(usize),
    /// Above the last maximum, or below the first minimum, at the end of a branch: in a state that the table does not have.
    Behind {
        branch: usize,
        is_above: bool,
    },
}

/// Volume that belongs to a pressure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BranchState {
    /// Pressure, MPa.
    pub pressure_mpa: f64,
    /// Injected volume, mm3; that of the last limit if there is no state behind it.
    pub volume_mm3: f64,
    /// Number of the branch, from 0; it changes with a jump.
    pub branch: usize,
    /// The actuator passed the last limit and is in a state that the model does not have.
    pub is_behind: bool,
    /// The past does not determine the branch.
    pub is_unknown: bool,
}

impl BranchState {
    /// Adds pressure, flags and position in the training range to the evaluation at this volume.
    pub fn apply_to(&self, out: &mut Evaluation) {
        out.inputs = out.inputs.with(PRESSURE, self.pressure_mpa);
        (out.flags.snapped, out.flags.branch_unknown) = (self.branch > 0 || self.is_behind, self.is_unknown);
        if self.is_behind {
            out.set_distance(f64::INFINITY);
        }
    }
}

/// The branches of a model and the one that its state is on. Allocates nothing after its construction.
#[derive(Clone, Debug)]
pub struct Follower {
    /// Position of the volume in the model's inputs.
    input: usize,
    branches: Vec<Branch>,
    /// Pressure at or below which an actuator behind the last limit counts as at rest again.
    rest_mpa: f64,
    max_gap_s: f64,
    /// State taken for true, and those after the smallest and the largest past; `None` before the first reading.
    places: Option<[BranchPosition; 3]>,
    last_ns: u64,
}

/// Position of the field with the pressure in a model whose pressure is a result (inputs of volume).
pub fn pressure_field(header: &ModelHeader) -> Option<usize> {
    let is_pressure =
        |spec: &FieldSpec| spec.kind == FieldKind::Other && spec.name == "pressure" && spec.unit == "MPa";
    header.fields.iter().position(|field| is_pressure(&field.spec)).filter(|_| !header.needs().pressure)
}

/// Position of the volume in the inputs of a model whose pressure is a result.
pub fn volume_input(header: &ModelHeader) -> Option<usize> {
    pressure_field(header)?;
    header.parameter(VOLUME).ok()
}

impl Follower {
    /// Follower of a model over volumes; `None` for another model, and for one with further inputs, whose pressure does not determine the
    /// volume. The blocks of the field with the pressure must be loaded.
    ///
    /// # Errors
    /// [`ModelError`] for missing blocks.
    pub fn of(model: &Model) -> Result<Option<Self>, ModelError> {
        let header = &model.header;
        let (Some(field), Some(input), [regime]) =
            (pressure_field(header), volume_input(header), &header.regimes[..])
        else {
            return Ok(None);
        };
        if header.taken_inputs().any(|(index, _)| index != input) {
            return Ok(None);
        }
        let anywhere = MeshPoint { weights: vec![(0, 1.0)] };
        let (mean, group, weights) = field_at(model, regime, &anywhere, field)?;
        let (part, places) = contracted(header, &[vec![Output { parts: vec![(group, weights)] }]]);
        let (evaluator, place) = (Evaluator::new(&part)?.for_search(), places[0][0]);
        let mut evaluation = evaluator.evaluation();
        let [begin, end] = header.inputs[input].range;
        let sample = |k: usize| {
            let volume_mm3 = begin + (end - begin) * k as f64 / INTERVALS as f64;
            let inputs = Inputs::new(f64::NAN, f64::NAN).with(input, volume_mm3);
            evaluator.answer(inputs, Query::GRADIENTS, &mut evaluation);
            let slope = evaluation.coefficient_gradient(input)[place];
            BranchSample { volume_mm3, pressure_mpa: mean + evaluation.coefficients[place], slope }
        };
        let samples: Vec<BranchSample> = (0..=INTERVALS).map(sample).collect();
        let wrong = || ModelError::Inconsistent("its pressure rises with the volume nowhere".into());
        Self::new(input, &samples).map(Some).ok_or_else(wrong)
    }

    /// Follower along a table by increasing volume; `None` if no two samples have a rising pressure, or a value is not finite.
    pub fn new(input: usize, samples: &[BranchSample]) -> Option<Self> {
        let is_finite =
            |s: &BranchSample| s.volume_mm3.is_finite() && s.pressure_mpa.is_finite() && s.slope.is_finite();
        let pressures = samples.iter().map(|s| s.pressure_mpa);
        let range_mpa = pressures.fold([f64::MAX, f64::MIN], |[low, high], p| [low.min(p), high.max(p)]);
        if input < PARAMETERS || !samples.iter().all(is_finite) {
            return None;
        }
        let samples = with_limits(samples);
        let turns = turns(&samples, SHALLOW * (range_mpa[1] - range_mpa[0]));
        let branch = |pair: &[usize]| {
            let (begin, end) = (pair[0], pair[1]);
            let is_open = [begin == 0, end + 1 == samples.len()];
            let [lowest, highest] = [begin, end].map(|at| samples[at].pressure_mpa);
            let mut level_mpa = lowest;
            let level = |sample: &BranchSample| {
                level_mpa = level_mpa.max(sample.pressure_mpa).min(highest);
                let slope = if sample.pressure_mpa == level_mpa { sample.slope.max(0.0) } else { 0.0 };
                BranchSample { pressure_mpa: level_mpa, slope, ..*sample }
            };
            (highest > lowest)
                .then(|| Branch { samples: samples[begin..=end].iter().map(level).collect(), is_open })
        };
        let branches: Vec<Branch> = turns.windows(2).filter_map(branch).collect();
        let none = branches.is_empty();
        let rest_mpa = range_mpa[0] + AT_REST * (range_mpa[1] - range_mpa[0]);
        (!none).then_some(Self { input, branches, rest_mpa, max_gap_s: MAX_GAP_S, places: None, last_ns: 0 })
    }

    /// Bridges any time between two readings by a straight line.
    pub fn hold_never(&mut self) {
        self.max_gap_s = f64::INFINITY;
    }

    /// Forgets: the next reading begins on the first branch that reaches its pressure.
    pub fn restart(&mut self) {
        self.places = None;
    }

    /// True for inputs without a volume.
    pub fn is_for(&self, inputs: &Inputs) -> bool {
        inputs.values()[self.input].is_nan()
    }

    /// Moves to a reading of the time `t_ns`, before which the pressure went straight to that of its inputs (finite), and sets their volume.
    pub fn advance(&mut self, t_ns: u64, inputs: &mut Inputs) -> BranchState {
        let pressure_mpa = inputs.pressure_mpa();
        let is_gap = t_ns.saturating_sub(self.last_ns) as f64 * 1e-9 > self.max_gap_s;
        let pasts = [self.begin(pressure_mpa, false), self.begin(pressure_mpa, true)];
        let places = match self.places {
            None => [pasts[0], pasts[0], pasts[1]],
            Some([nominal, ..]) if is_gap => [self.moved(nominal, pressure_mpa), pasts[0], pasts[1]],
            Some(places) => places.map(|place| self.moved(place, pressure_mpa)),
        };
        (self.places, self.last_ns) = (Some(places), t_ns);
        let followed = self.followed(places, pressure_mpa);
        *inputs = inputs.with(self.input, followed.volume_mm3);
        followed
    }

    /// Position of an unknown past: on the first, or the last, branch that has the pressure.
    fn begin(&self, pressure_mpa: f64, is_last: bool) -> BranchPosition {
        let reaches = |branch: &Branch| {
            let [low, high] = branch.ends_mpa();
            (branch.is_open[0] || low <= pressure_mpa) && (branch.is_open[1] || pressure_mpa <= high)
        };
        let found = self.branches.iter().position(reaches);
        let found = if is_last { self.branches.iter().rposition(reaches) } else { found };
        found.map_or_else(|| self.moved(BranchPosition::On(0), pressure_mpa), BranchPosition::On)
    }

    /// Position after the pressure went straight to another value.
    fn moved(&self, from: BranchPosition, pressure_mpa: f64) -> BranchPosition {
        let ends = |branch: usize| self.branches[branch].ends_mpa();
        let mut branch = match from {
            BranchPosition::On(branch) => branch,
            BranchPosition::Behind { branch, is_above: false } if pressure_mpa >= ends(branch)[0] => branch,
            BranchPosition::Behind { is_above: true, .. } if pressure_mpa <= self.rest_mpa => 0,
            BranchPosition::Behind { .. } => return from,
        };
        loop {
            let Branch { is_open, .. } = &self.branches[branch];
            let [low, high] = ends(branch);
            let is_above = pressure_mpa > high;
            let next = if is_above && !is_open[1] {
                let reaches = |other: &usize| ends(*other)[1] >= high || self.branches[*other].is_open[1];
                (branch + 1..self.branches.len()).find(reaches)
            } else if pressure_mpa < low && !is_open[0] {
                let reaches = |other: &usize| ends(*other)[0] <= low || self.branches[*other].is_open[0];
                (0..branch).rev().find(reaches)
            } else {
                return BranchPosition::On(branch);
            };
            match next {
                Some(next) => branch = next,
                None => return BranchPosition::Behind { branch, is_above },
            }
        }
    }

    fn followed(&self, places: [BranchPosition; 3], pressure_mpa: f64) -> BranchState {
        let is_unknown = places[1..].iter().any(|place| *place != places[0]);
        let (branch, is_behind, at_mpa) = match places[0] {
            BranchPosition::On(branch) => (branch, false, pressure_mpa),
            BranchPosition::Behind { branch, is_above } => {
                (branch, true, self.branches[branch].ends_mpa()[usize::from(is_above)])
            }
        };
        BranchState {
            pressure_mpa,
            volume_mm3: self.branches[branch].volume_mm3(at_mpa),
            branch,
            is_behind,
            is_unknown,
        }
    }
}

impl Branch {
    fn last(&self) -> &BranchSample {
        &self.samples[self.samples.len() - 1]
    }

    fn ends_mpa(&self) -> [f64; 2] {
        [self.samples[0].pressure_mpa, self.last().pressure_mpa]
    }

    /// Volume at a pressure: inverse of the cubics between the samples, straight beyond the ends by at most the length of the branch.
    fn volume_mm3(&self, pressure_mpa: f64) -> f64 {
        let after = self.samples.partition_point(|s| s.pressure_mpa <= pressure_mpa);
        if after == 0 || after == self.samples.len() {
            let end = if after == 0 { &self.samples[0] } else { self.last() };
            let [low, high] = self.ends_mpa();
            let length = self.last().volume_mm3 - self.samples[0].volume_mm3;
            let slope = if end.slope > 0.0 { end.slope } else { (high - low) / length };
            return end.volume_mm3 + ((pressure_mpa - end.pressure_mpa) / slope).clamp(-length, length);
        }
        let pair = [self.samples[after - 1], self.samples[after]];
        let cubic = cubic(pair);
        cubic.x_at(cubic.root(|[found_mpa, _]| found_mpa - pressure_mpa))
    }
}

/// The samples with one more at each extremum between them.
fn with_limits(samples: &[BranchSample]) -> Vec<BranchSample> {
    let mut all = Vec::with_capacity(samples.len());
    for pair in samples.windows(2) {
        let pair = [pair[0], pair[1]];
        all.push(pair[0]);
        if pair[0].slope * pair[1].slope < 0.0 {
            let cubic = cubic(pair);
            let t = cubic.root(|[_, slope]| slope);
            all.push(BranchSample { volume_mm3: cubic.x_at(t), pressure_mpa: cubic.at(t)[0], slope: 0.0 });
        }
    }
    all.extend(samples.last());
    all
}

/// Indices of the ends and of the extrema, without folds that are not as deep as `depth_mpa`: the shallowest go first.
fn turns(samples: &[BranchSample], depth_mpa: f64) -> Vec<usize> {
    let rises = |sample: usize| samples[sample + 1].pressure_mpa > samples[sample].pressure_mpa;
    let inner = (1..samples.len().saturating_sub(1)).filter(|at| rises(*at) != rises(*at - 1));
    let mut turns: Vec<usize> = std::iter::once(0).chain(inner).collect();
    turns.extend(samples.len().checked_sub(1));
    while turns.len() > 2 {
        let depth =
            |turn: usize| (samples[turns[turn + 1]].pressure_mpa - samples[turns[turn]].pressure_mpa).abs();
        let shallowest = (0..turns.len() - 1).min_by(|a, b| depth(*a).total_cmp(&depth(*b)));
        let Some(at) = shallowest.filter(|at| depth(*at) < depth_mpa) else { break };
        // The ends of the table stay.
        let fold = (at.max(1))..(at + 2).min(turns.len() - 1);
        turns.drain(fold);
    }
    turns
}

/// Pressure over volume between two samples.
fn cubic(pair: [BranchSample; 2]) -> Cubic {
    Cubic {
        x: pair.map(|sample| sample.volume_mm3),
        y: pair.map(|sample| sample.pressure_mpa),
        slope: pair.map(|sample| sample.slope),
    }
}
