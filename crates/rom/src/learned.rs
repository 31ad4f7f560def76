//! A model of measurements: ridge maps of filtered inputs, with half-widths that grow with what training did not visit.
//!
//! ```text
//! c' = (u - c) / tau, tau of filling or emptying                       lags of the standardised inputs
//! x_k' = (tanh(d_k (1, u) + sum_j w_kj x_j) - x_k) / tau_k             neurons of a reservoir
//! y_polynomial = a (1, c, c_i c_j, c_i^3)                              up to its degree
//! y_kernel = a (1, c) + sum_k b_k g(|c - c_k| / (R sqrt(n)))           g(r) = (1 - r)^4 (4 r + 1) up to r = 1
//! y_reservoir = a (1, u) + b x
//! y = base + gate (sum share y_member - base)                          base: linear in the lagged inputs
//! gate = 1 up to the reach, 0 from three times the reach on            of the distance d from the rows of the training, inputs and lags
//! h^2 = noise + spread s^2 + distance d^2 + allowance^2                s: deviation of the members, gate included
//! h  += (1 - gate) error of the base + growth (d - reach)              NaN from the range of the output on
//! ```
//!
//! Lags are exact for inputs that are straight between readings. Neurons step by `step_ns` since the first reading; at a reading between two
//! steps they are brought forward without being kept, so that the state does not depend on how readings were cut.

use crate::halfwidths::HALFWIDTH_SIGMAS;
use crate::inputs::{Advance, Inputs, MAX_INPUTS};
use crate::line::Line;
use serde::{Deserialize, Serialize};

/// Most steps of the neurons between two readings; over a longer time the steps are longer.
const MAX_STEPS: u64 = 1000;
/// Steps in which neurons settle.
const SETTLING: usize = 300;
/// Most neurons of a reservoir.
pub const MAX_NEURONS: usize = 256;
/// Most outputs of a map: its sums are on the stack.
pub const MAX_OUTPUTS: usize = 256;
/// Distance, in units of the reach, from which on the base alone answers.
const BASE_ALONE: f64 = 3.0;
/// Square of the standard deviations in a half-width.
const SQUARED_SIGMAS: f64 = HALFWIDTH_SIGMAS * HALFWIDTH_SIGMAS;
/// Part of an unknown past below which it is forgotten.
const FADED: f64 = 1e-4;
/// Largest size of a standardised input that is a number.
const LARGEST: f64 = 1e12;

/// An input of the map.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapInput {
    /// Position in the model's inputs.
    pub input: u32,
    /// Mean over the training.
    pub mean: f64,
    /// Standard deviation over the training.
    pub deviation: f64,
    /// Largest minus smallest standardised value of the training.
    pub range: f64,
}

/// A filtered input: what the maps see.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lag {
    /// Which of the map's inputs.
    pub input: u32,
    /// Times of filling and emptying; `None`: the input itself.
    pub line: Option<Line>,
}

/// A map linear in lags: `weights` has one row of the outputs for the constant and for each lag.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LinearMap {
    /// Positions of the lags that it sees in [`LearnedMap::lags`].
    pub lags: Vec<u32>,
    /// `(1 + lags) x outputs`.
    pub weights: Vec<f64>,
}

/// A polynomial of lags: constant, linear terms, from degree 2 on products of two, from degree 3 on cubes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Polynomial {
    /// Share in the answer.
    pub share: f64,
    /// Positions of the lags that it sees in [`LearnedMap::lags`].
    pub lags: Vec<u32>,
    /// 1 to 3.
    pub degree: u32,
    /// `terms x outputs`.
    pub weights: Vec<f64>,
}

/// Kernel maps of the same lags around the same centres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Kernels {
    /// Positions of the lags that they see in [`LearnedMap::lags`].
    pub lags: Vec<u32>,
    /// `centres x lags`.
    pub centres: Vec<f64>,
    /// The maps.
    pub maps: Vec<KernelMap>,
}

/// A kernel map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct KernelMap {
    /// Share in the answer.
    pub share: f64,
    /// Distance over the root of the number of lags at which the kernel ends.
    pub radius: f64,
    /// `(1 + lags + centres) x outputs`.
    pub weights: Vec<f64>,
}

/// Neurons, and the map from them to the outputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reservoir {
    /// Share in the answer.
    pub share: f64,
    /// Time of each neuron, s.
    pub times_s: Vec<f64>,
    /// `neurons x (1 + inputs)`.
    pub drive: Vec<f64>,
    /// The sparse matrix of their connections: first entry of each neuron, and at the end the number of entries.
    pub starts: Vec<u32>,
    /// The feeding neuron of each entry.
    pub sources: Vec<u32>,
    /// The weight of each entry.
    pub strengths: Vec<f64>,
    /// `(1 + inputs + neurons) x outputs`.
    pub weights: Vec<f64>,
}

/// What training visited.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Support {
    /// Positions in [`LearnedMap::lags`] of the lags that the distance is over.
    pub lags: Vec<u32>,
    /// `rows x lags`.
    pub rows: Vec<f64>,
    /// Distance that parts of the training have from one another.
    pub reach: f64,
    /// Distance that counts as one training range.
    pub extent: f64,
}

/// Half-width of an output; squares are in its unit squared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OutputWidth {
    /// Constant part, squared.
    pub noise: f64,
    /// Factor on the members' variance.
    pub spread: f64,
    /// Factor on the squared distance.
    pub distance: f64,
    /// Allowance for a further run, squared.
    pub allowance: f64,
    /// Error of the base.
    pub base: f64,
    /// Growth per distance beyond the reach.
    pub growth: f64,
    /// Range of the training: a half-width that reaches it is none.
    pub range: f64,
    /// What an unknown past may change.
    pub past: f64,
}

/// Constants of an offset that follows measured values ([`OffsetFilter`]), by output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Drift {
    /// Variance at the beginning.
    pub start: f64,
    /// Growth of the variance per second.
    pub per_s: f64,
    /// Variance of a measured value times the time over which its errors agree, s.
    pub noise_s: f64,
}

/// The map of a model learned from measurements; in the file a record ([`crate::model::BlockKind::Learned`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearnedMap {
    /// The model's inputs, in its order, with mean and scale.
    pub inputs: Vec<MapInput>,
    /// Step of the neurons, ns.
    pub step_ns: u64,
    /// Longest time between two readings that is bridged by a straight line, s.
    pub max_gap_s: f64,
    /// Lags whose states the maps take in place of the inputs.
    pub lags: Vec<Lag>,
    /// What is answered far from the training rows.
    pub base: LinearMap,
    /// Members of this family, blended with those of the next two near the training rows.
    pub polynomials: Vec<Polynomial>,
    /// Kernel maps.
    pub kernels: Vec<Kernels>,
    /// Networks of fixed random weights that carry the past.
    pub reservoirs: Vec<Reservoir>,
    /// Rows of the training.
    pub support: Support,
    /// Half-widths by output.
    pub widths: Vec<OutputWidth>,
    /// Constants of the offset that follows measured values, by output.
    pub drifts: Vec<Drift>,
    /// Outputs that are coordinates of a marker, by marker.
    pub markers: Vec<Vec<u32>>,
}

/// State of the lags and neurons at an instant, with memory to answer in: allocates nothing after its construction.
#[derive(Clone, Debug, PartialEq)]
pub struct LearnedState {
    last: [f64; MAX_INPUTS],
    last_ns: Option<u64>,
    /// Time since the neurons' last step, ns.
    since_ns: u64,
    lags: Vec<f64>,
    /// Neurons at their last step.
    stepped: Vec<f64>,
    /// Neurons at the last reading.
    neurons: Vec<f64>,
    rates: Vec<f64>,
    /// Values of the members, by member and output.
    members: Vec<f64>,
    /// Part of an unknown past that has not faded.
    unknown: f64,
}

/// `value += factor row`.
fn add(value: &mut [f64], factor: f64, row: &[f64]) {
    value.iter_mut().zip(row).for_each(|(v, w)| *v += factor * w);
}

/// `(1 - r)^4 (4 r + 1)`, 0 from 1 on.
pub fn kernel(r: f64) -> f64 {
    let left = (1.0 - r).max(0.0);
    let square = left * left;
    square * square * (4.0 * r + 1.0)
}

impl LinearMap {
    fn add_to(&self, lags: &[f64], out: &mut [f64]) {
        let (constant, rows) = self.weights.split_at(out.len());
        add(out, 1.0, constant);
        self.lags
            .iter()
            .zip(rows.chunks_exact(out.len()))
            .for_each(|(lag, row)| add(out, lags[*lag as usize], row));
    }
}

/// Number of terms of a polynomial of `count` values.
pub fn polynomial_terms(count: usize, degree: u32) -> usize {
    let further = [count, count * (count + 1) / 2, count];
    1 + further[..degree.min(3) as usize].iter().sum::<usize>()
}

/// The terms of a polynomial, in the order of its weights.
pub fn polynomial(count: usize, degree: u32, value: impl Fn(usize) -> f64, mut term: impl FnMut(f64)) {
    term(1.0);
    (0..count).for_each(|i| term(value(i)));
    if degree >= 2 {
        (0..count).for_each(|i| (i..count).for_each(|j| term(value(i) * value(j))));
    }
    if degree >= 3 {
        (0..count).for_each(|i| term(value(i).powi(3)));
    }
}

impl Reservoir {
    /// Number of neurons.
    pub fn neurons(&self) -> usize {
        self.times_s.len()
    }

    /// Moves neurons under standardised inputs by their rates `1 - exp(-h / tau)`.
    pub fn step(&self, inputs: &[f64], rates: impl Fn(usize) -> f64, neurons: &mut [f64]) {
        let mut next = [0.0; MAX_NEURONS];
        for (k, (next, drive)) in next.iter_mut().zip(self.drive.chunks_exact(1 + inputs.len())).enumerate() {
            let driven: f64 = drive[0] + drive[1..].iter().zip(inputs).map(|(w, u)| w * u).sum::<f64>();
            let fed = self.starts[k] as usize..self.starts[k + 1] as usize;
            let fed = self.sources[fed.clone()].iter().zip(&self.strengths[fed]);
            let sum: f64 = fed.map(|(source, w)| w * neurons[*source as usize]).sum();
            *next = neurons[k] + rates(k) * ((driven + sum).tanh() - neurons[k]);
        }
        neurons.copy_from_slice(&next[..neurons.len()]);
    }
}

/// How far an answer of a learned map reaches.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LearnedReach {
    /// Distance beyond the training, in training ranges.
    pub distance: f64,
    /// Half-width of the widest marker; NaN without one.
    pub marker_half_width_mm: f64,
}

impl LearnedMap {
    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.widths.len()
    }

    /// True if the answers depend on earlier inputs.
    pub fn has_memory(&self) -> bool {
        !self.reservoirs.is_empty() || self.lags.iter().any(|lag| lag.line.is_some())
    }

    /// Slowest lag of the base, s: the time over which an unknown past fades.
    fn fading_s(&self) -> f64 {
        let times = self.base.lags.iter().filter_map(|lag| self.lags[*lag as usize].line);
        times.map(|line| line.fill_s.max(line.empty_s)).fold(0.0, f64::max)
    }

    /// Standardised inputs of a reading.
    pub fn scaled(&self, inputs: &Inputs) -> [f64; MAX_INPUTS] {
        let mut scaled = [0.0; MAX_INPUTS];
        for (scaled, input) in scaled.iter_mut().zip(&self.inputs) {
            *scaled = (inputs.values()[input.input as usize] - input.mean) / input.deviation;
        }
        scaled
    }

    /// True if all inputs of the map are numbers.
    pub fn takes(&self, inputs: &Inputs) -> bool {
        self.scaled(inputs).iter().all(|u| u.abs() <= LARGEST)
    }

    /// A state before the first reading.
    pub fn initial_state(&self) -> LearnedState {
        let times = || self.reservoirs.iter().flat_map(|reservoir| &reservoir.times_s);
        let step_s = 1e-9 * self.step_ns as f64;
        let kernels: usize = self.kernels.iter().map(|kernels| kernels.maps.len()).sum();
        let members = self.polynomials.len() + kernels + self.reservoirs.len();
        LearnedState {
            last: [0.0; MAX_INPUTS],
            last_ns: None,
            since_ns: 0,
            lags: vec![0.0; self.lags.len()],
            stepped: vec![0.0; times().count()],
            neurons: vec![0.0; times().count()],
            rates: times().map(|tau| -(-step_s / tau).exp_m1()).collect(),
            members: vec![0.0; members * self.outputs()],
            unknown: 0.0,
        }
    }

    /// Checks that the numbers fit one another and a model with this number of inputs and coefficients.
    ///
    /// # Errors
    /// A sentence on the first contradiction.
    pub fn check(&self, inputs: usize, coefficients: usize) -> Result<(), String> {
        let require =
            |sound: bool, what: &str| if sound { Ok(()) } else { Err(format!("learned map: {what}")) };
        let (outputs, count) = (self.outputs(), self.inputs.len());
        require(outputs == coefficients && (1..=MAX_OUTPUTS).contains(&outputs), "it has other outputs")?;
        require(
            (1..=MAX_INPUTS).contains(&count),
            &format!("expected 1 to {MAX_INPUTS} inputs, found {count}"),
        )?;
        let is_input = |input: &MapInput| {
            (input.input as usize) < inputs && input.deviation > 0.0 && input.mean.is_finite()
        };
        require(self.inputs.iter().all(is_input), "an input is missing or has no range")?;
        require(self.step_ns > 0 && self.max_gap_s > 0.0, "a time is not above 0 s")?;
        let positive = |line: Line| line.fill_s > 0.0 && line.empty_s > 0.0;
        let is_lag = |lag: &Lag| (lag.input as usize) < count && lag.line.is_none_or(positive);
        require(self.lags.iter().all(is_lag), "a lag is not valid")?;
        let known = |lags: &[u32]| lags.iter().all(|lag| (*lag as usize) < self.lags.len());
        let base = self.base.weights.len() == (1 + self.base.lags.len()) * outputs;
        require(known(&self.base.lags) && base, "the base is cut")?;
        for polynomial in &self.polynomials {
            let terms = polynomial_terms(polynomial.lags.len(), polynomial.degree);
            require(
                known(&polynomial.lags) && polynomial.weights.len() == terms * outputs,
                "a polynomial is cut",
            )?;
        }
        for kernels in &self.kernels {
            let (lags, centres) = (kernels.lags.len(), kernels.centres.len() / kernels.lags.len().max(1));
            require(
                lags > 0 && known(&kernels.lags) && kernels.centres.len() == centres * lags,
                "centres are cut",
            )?;
            let is_whole =
                |map: &KernelMap| map.radius > 0.0 && map.weights.len() == (1 + lags + centres) * outputs;
            require(kernels.maps.iter().all(is_whole), "a kernel map is cut")?;
        }
        for reservoir in &self.reservoirs {
            let n = reservoir.neurons();
            require(
                (1..=MAX_NEURONS).contains(&n) && reservoir.times_s.iter().all(|t| *t > 0.0),
                "a reservoir has no neurons",
            )?;
            let lengths = [
                reservoir.drive.len(),
                reservoir.starts.len(),
                reservoir.weights.len(),
                reservoir.strengths.len(),
            ];
            let expected = [n * (1 + count), n + 1, (1 + count + n) * outputs, reservoir.sources.len()];
            let ordered = reservoir.starts.is_sorted()
                && reservoir.starts.last().map(|end| *end as usize) == Some(reservoir.sources.len());
            let sources = reservoir.sources.iter().all(|source| (*source as usize) < n);
            require(lengths == expected && ordered && sources, "a reservoir is cut")?;
        }
        let support = &self.support;
        let rows = support.rows.len().checked_rem(support.lags.len()) == Some(0) && !support.rows.is_empty();
        require(
            rows && known(&support.lags) && support.reach > 0.0 && support.extent > 0.0,
            "its support is cut",
        )?;
        let is_output = |output: &u32| (*output as usize) < outputs;
        require(self.markers.iter().flatten().all(is_output), "a marker has an output that is missing")?;
        require(self.drifts.len() == outputs, "its drifts are cut")
    }

    /// Evaluates the map, with offsets where measured values are followed up to a time (ns). Writes the outputs into `values` and their
    /// half-widths into `half_widths`.
    pub(crate) fn answer(
        &self,
        past: &mut LearnedState,
        following: Option<(&OffsetFilter, u64)>,
        values: &mut Vec<f64>,
        half_widths: &mut Vec<f64>,
    ) -> LearnedReach {
        let outputs = self.outputs();
        self.members(past);
        let distance = self.distance(&past.lags);
        let beyond = (distance - self.support.reach).max(0.0);
        let x = (beyond / ((BASE_ALONE - 1.0) * self.support.reach)).min(1.0);
        let gate = 1.0 - x * x * (3.0 - 2.0 * x);
        let (mut base, mut mean, mut variance) = ([0.0; MAX_OUTPUTS], [0.0; MAX_OUTPUTS], [0.0; MAX_OUTPUTS]);
        self.base.add_to(&past.lags, &mut base[..outputs]);
        let members = || self.shares().zip(past.members.chunks_exact(outputs));
        members().for_each(|(share, values)| add(&mut mean[..outputs], share, values));
        for (share, values) in members() {
            variance
                .iter_mut()
                .zip(&mean)
                .zip(values)
                .for_each(|((sum, mean), v)| *sum += share * (v - mean).powi(2));
        }
        values.clear();
        half_widths.clear();
        let far = distance.min(BASE_ALONE * self.support.reach);
        for (k, width) in self.widths.iter().enumerate() {
            let offset = following.map_or(0.0, |(filter, _)| filter.offset(k));
            values.push(base[k] + gate * (mean[k] - base[k]) + offset);
            let squares = width.noise + width.spread * variance[k] * gate * gate + width.distance * far * far;
            let squares = match following {
                Some((following, t_ns)) => following.squared_half_width(k, t_ns, squares),
                None => squares + width.allowance,
            };
            let unknown = past.unknown * width.past;
            let half_width =
                (squares + unknown * unknown).sqrt() + (1.0 - gate) * width.base + width.growth * beyond;
            half_widths.push(if half_width < width.range { half_width } else { f64::NAN });
        }
        let of_marker =
            |outputs: &Vec<u32>| outputs.iter().map(|k| half_widths[*k as usize].powi(2)).sum::<f64>().sqrt();
        let widest =
            self.markers.iter().map(of_marker).reduce(|a, b| if b > a || b.is_nan() { b } else { a });
        LearnedReach {
            distance: beyond / self.support.extent,
            marker_half_width_mm: widest.unwrap_or(f64::NAN),
        }
    }

    fn shares(&self) -> impl Iterator<Item = f64> + '_ {
        let polynomials = self.polynomials.iter().map(|polynomial| polynomial.share);
        let kernels = self.kernels.iter().flat_map(|kernels| &kernels.maps).map(|map| map.share);
        polynomials.chain(kernels).chain(self.reservoirs.iter().map(|reservoir| reservoir.share))
    }

    /// Values of all members.
    fn members(&self, past: &mut LearnedState) {
        let outputs = self.outputs();
        past.members.fill(0.0);
        let mut places = past.members.chunks_exact_mut(outputs);
        for (terms, out) in self.polynomials.iter().zip(&mut places) {
            let mut rows = terms.weights.chunks_exact(outputs);
            let value = |lag: usize| past.lags[terms.lags[lag] as usize];
            polynomial(terms.lags.len(), terms.degree, value, |term| {
                rows.by_ref().take(1).for_each(|row| add(out, term, row))
            });
        }
        for kernels in &self.kernels {
            let width = kernels.lags.len();
            let square = |centre: &[f64]| -> f64 {
                kernels.lags.iter().zip(centre).map(|(lag, c)| (past.lags[*lag as usize] - c).powi(2)).sum()
            };
            for (map, out) in kernels.maps.iter().zip(&mut places) {
                let (first, rows) = map.weights.split_at((1 + width) * outputs);
                add(out, 1.0, &first[..outputs]);
                for (lag, row) in kernels.lags.iter().zip(first[outputs..].chunks_exact(outputs)) {
                    add(out, past.lags[*lag as usize], row);
                }
                let scale = 1.0 / (map.radius * (width as f64).sqrt());
                for (centre, row) in kernels.centres.chunks_exact(width).zip(rows.chunks_exact(outputs)) {
                    let value = kernel(scale * square(centre).sqrt());
                    if value > 0.0 {
                        add(out, value, row);
                    }
                }
            }
        }
        let mut begin = 0;
        for (reservoir, out) in self.reservoirs.iter().zip(places) {
            let neurons = &past.neurons[begin..begin + reservoir.neurons()];
            begin += reservoir.neurons();
            let features = [1.0].iter().chain(&past.last[..self.inputs.len()]).chain(neurons);
            features
                .zip(reservoir.weights.chunks_exact(outputs))
                .for_each(|(value, row)| add(out, *value, row));
        }
    }

    /// Distance of lags from the nearest row of the training.
    fn distance(&self, lags: &[f64]) -> f64 {
        let support = &self.support;
        let square = |row: &[f64]| -> f64 {
            support.lags.iter().zip(row).map(|(lag, r)| (lags[*lag as usize] - r).powi(2)).sum()
        };
        support.rows.chunks_exact(support.lags.len()).map(square).fold(f64::INFINITY, f64::min).sqrt()
    }
}

impl LearnedState {
    /// Forgets: the next reading begins settled.
    pub fn restart(&mut self) {
        self.last_ns = None;
    }

    /// Values behind the lags.
    pub fn lags(&self) -> &[f64] {
        &self.lags
    }

    /// Neurons at the last reading, one reservoir after the other.
    pub fn neurons(&self) -> &[f64] {
        &self.neurons
    }

    /// Settles under inputs.
    pub fn settle(&mut self, map: &LearnedMap, inputs: &Inputs) {
        self.last = map.scaled(inputs);
        self.lags.iter_mut().zip(&map.lags).for_each(|(value, lag)| *value = self.last[lag.input as usize]);
        self.stepped.fill(0.0);
        let mut begin = 0;
        for reservoir in &map.reservoirs {
            let neurons = &mut self.stepped[begin..begin + reservoir.neurons()];
            (0..SETTLING).for_each(|_| reservoir.step(&self.last[..map.inputs.len()], |_| 0.5, neurons));
            begin += reservoir.neurons();
        }
        self.neurons.copy_from_slice(&self.stepped);
        (self.since_ns, self.unknown) = (0, 0.0);
    }

    /// Moves to a reading at `t_ns`, later than the last one. The inputs are held over a gap longer than `max_gap_s`.
    pub fn advance(&mut self, map: &LearnedMap, t_ns: u64, inputs: &Inputs, max_gap_s: f64) -> Advance {
        let Some(last_ns) = self.last_ns.replace(t_ns) else {
            self.settle(map, inputs);
            self.unknown = if map.fading_s() > 0.0 { 1.0 } else { 0.0 };
            return Advance::Started;
        };
        let (from, to, passed_ns) = (self.last, map.scaled(inputs), t_ns.saturating_sub(last_ns));
        let passed_s = 1e-9 * passed_ns as f64;
        let is_gap = passed_s > max_gap_s;
        let end = if is_gap { from } else { to };
        for (value, lag) in self.lags.iter_mut().zip(&map.lags) {
            let input = lag.input as usize;
            *value = match lag.line {
                Some(line) if passed_ns > 0 => line.step(*value, from[input], end[input], passed_s).0,
                Some(_) => *value,
                None => to[input],
            };
        }
        let due = (self.since_ns + passed_ns) / map.step_ns;
        let count = due.min(MAX_STEPS);
        let between = |at_ns: f64| -> [f64; MAX_INPUTS] {
            let fraction = at_ns / (passed_ns.max(1)) as f64;
            std::array::from_fn(|k| from[k] + fraction * (end[k] - from[k]))
        };
        let length_ns = (due * map.step_ns) as f64 / count.max(1) as f64;
        for k in 1..=count {
            let inputs = between(k as f64 * length_ns - self.since_ns as f64);
            self.step(map, &inputs, (due > count).then_some(1e-9 * length_ns));
        }
        self.since_ns = (self.since_ns + passed_ns) % map.step_ns;
        self.last = to;
        self.neurons.copy_from_slice(&self.stepped);
        if self.since_ns > 0 {
            std::mem::swap(&mut self.neurons, &mut self.stepped);
            self.step(map, &to, Some(1e-9 * self.since_ns as f64));
            std::mem::swap(&mut self.neurons, &mut self.stepped);
        }
        let fading_s = map.fading_s();
        self.unknown = match is_gap {
            true if fading_s > 0.0 => 1.0,
            _ => self.unknown * (-passed_s / fading_s.max(1e-9)).exp(),
        };
        if self.unknown < FADED {
            self.unknown = 0.0;
        }
        if is_gap { Advance::Gap } else { Advance::Advanced }
    }

    /// One step of all neurons; `None` for the map's own step.
    fn step(&mut self, map: &LearnedMap, inputs: &[f64; MAX_INPUTS], length_s: Option<f64>) {
        let mut begin = 0;
        for reservoir in &map.reservoirs {
            let range = begin..begin + reservoir.neurons();
            begin = range.end;
            let (inputs, neurons, rates) =
                (&inputs[..map.inputs.len()], &mut self.stepped[range.clone()], &self.rates[range]);
            match length_s {
                None => reservoir.step(inputs, |k| rates[k], neurons),
                Some(length_s) => {
                    reservoir.step(inputs, |k| -(-length_s / reservoir.times_s[k]).exp_m1(), neurons)
                }
            }
        }
    }
}

/// An offset by output as a random walk, estimated from measured values: a Kalman filter of one state each. In the half-width the offset's
/// variance takes the place of the allowance for a further run. Where errors scatter by more than those of the training, a measured value
/// counts for less, and the half-width is at least that scatter.
#[derive(Clone, Debug)]
pub struct OffsetFilter {
    offsets: Vec<OutputOffset>,
}

#[derive(Clone, Debug)]
struct OutputOffset {
    drift: Drift,
    /// Variance of the error beside the offset, in the training.
    noise: f64,
    value: f64,
    variance: f64,
    /// When it was measured last, ns.
    last_ns: Option<u64>,
    /// Mean error over the time in which an offset wanders, mean square about it, and number of values.
    mean: f64,
    seen: f64,
    count: f64,
}

impl OffsetFilter {
    /// Without a measured value the offsets are 0.
    pub fn new(map: &LearnedMap) -> Self {
        let initial = |(drift, width): (&Drift, &OutputWidth)| OutputOffset {
            drift: *drift,
            noise: width.noise / SQUARED_SIGMAS,
            value: 0.0,
            variance: drift.start,
            last_ns: None,
            mean: 0.0,
            seen: 0.0,
            count: 0.0,
        };
        Self { offsets: map.drifts.iter().zip(&map.widths).map(initial).collect() }
    }

    /// Values were measured.
    pub fn has_begun(&self) -> bool {
        self.offsets.iter().any(|offset| offset.count > 0.0)
    }

    /// Forgets what was measured.
    pub fn restart(&mut self) {
        for offset in &mut self.offsets {
            (offset.value, offset.variance, offset.last_ns) = (0.0, offset.drift.start, None);
            (offset.mean, offset.seen, offset.count) = (0.0, 0.0, 0.0);
        }
    }

    /// Takes measured minus freely predicted values at a time, ns. A value that is no number, or not later than the last one of its output,
    /// changes nothing; outputs need not be measured together.
    pub fn take(&mut self, t_ns: u64, errors: &[f64]) {
        self.offsets.iter_mut().zip(errors).for_each(|(offset, error)| offset.take(t_ns, *error));
    }

    /// What is added to the predicted value of an output.
    pub fn offset(&self, output: usize) -> f64 {
        self.offsets[output].value
    }

    /// Square of an output's half-width at a time (ns), from `without`, the square without the allowance for a further run.
    pub fn squared_half_width(&self, output: usize, t_ns: u64, without: f64) -> f64 {
        let offset = &self.offsets[output];
        (without + SQUARED_SIGMAS * offset.later(offset.passed_s(t_ns))).max(SQUARED_SIGMAS * offset.seen)
    }
}

impl OutputOffset {
    /// Time since it was measured last, s; 0 before.
    fn passed_s(&self, t_ns: u64) -> f64 {
        self.last_ns.map_or(0.0, |last_ns| 1e-9 * t_ns.saturating_sub(last_ns) as f64)
    }

    /// Variance after some time: it grows, up to that of the difference between two runs.
    fn later(&self, passed_s: f64) -> f64 {
        (self.variance + self.drift.per_s * passed_s).min(2.0 * self.drift.start)
    }

    fn take(&mut self, t_ns: u64, error: f64) {
        if !error.is_finite() {
            return;
        }
        let passed_s = self.passed_s(t_ns);
        if passed_s <= 0.0 {
            // The first value tells nothing yet: nobody knows how much time it stands for.
            self.last_ns.get_or_insert(t_ns);
            return;
        }
        self.last_ns = Some(t_ns);
        self.variance = self.later(passed_s);
        self.count += 1.0;
        let share = (self.drift.per_s * passed_s / self.drift.start).max(1.0 / self.count).min(1.0);
        self.mean += share * (error - self.mean);
        self.seen += share * ((error - self.mean).powi(2) - self.seen);
        // Values closer in time than their errors agree tell less.
        let noise = (self.seen / self.noise).max(1.0) * self.drift.noise_s / passed_s;
        let gain = self.variance / (self.variance + noise);
        if gain.is_finite() {
            self.value += gain * (error - self.value);
            self.variance *= 1.0 - gain;
        }
    }
}
