//! Memory of a model's inputs: what lies between a measured or commanded input and the one that the static map takes.
//!
//! ```text
//! command -> line -> play -> creep -> x(P, gap, ...)
//! c' = (u - c) / tau, tau of filling or emptying        Line, Orifice
//! y_k = max(c - r_k, min(c + r_k, y_k)),  v = c + sum w_k (y_k - c)        Play
//! z_k' = (v - z_k) / tau_k,  output = v + sum w_k (z_k - v)        Creep
//! P = P^ + sum r_k h_k,  h_k' = P^' - h_k / tau_k: as creep        PronyTerm, filter
//! ```
//!
//! The blocks step by the sensor's time. Line and play are exact for an input that is straight between readings, so results do not depend on
//! how readings were cut. All blocks preserve order: of two pasts, the one with larger inputs stays above. Two further states, one that
//! comes from the smallest and one from the largest input, therefore enclose the effect of an unknown past, and their distance fades.

use crate::halfwidths::HalfWidths;
pub use crate::inputs::Advance;
use crate::inputs::{Inputs, MAX_INPUTS};
pub use crate::line::Line;
use crate::model::{BlockKind, Model, ModelFileError};
use serde::{Deserialize, Serialize};

/// Blocks with their states. Allocates nothing after its construction.
#[derive(Clone, Debug, PartialEq)]
pub struct Memory {
    spec: MemorySpec,
    /// State taken for true, and those from the smallest and the largest past, by input with memory.
    channels: Vec<[Channel; 3]>,
    /// Largest error of each creep state from an unknown past.
    open_creeps: Vec<[f64; MAX_CREEPS]>,
    last_ns: Option<u64>,
}

/// Largest size of an input that is a number: sums over the blocks stay finite.
const LARGEST: f64 = 1e100;
const NOMINAL: usize = 0;
const LOW: usize = 1;
const HIGH: usize = 2;

impl InputMemory {
    /// Output at each of a run's readings, from equilibrium with the first; times in s, increasing. Between any two readings of a run the
    /// input is a straight line, however long that takes.
    pub fn responses(&self, t_s: &[f64], values: &[f64]) -> Vec<f64> {
        let mut channel: Option<Channel> = None;
        let mut last_s = f64::NAN;
        let output = |(t_s, value): (&f64, &f64)| {
            match &mut channel {
                None => channel = Some(Channel::at_rest(self, *value, *value)),
                Some(channel) => channel.advance(self, *value, t_s - last_s, f64::INFINITY),
            }
            last_s = *t_s;
            channel.map_or(f64::NAN, |channel| channel.output())
        };
        t_s.iter().zip(values).map(output).collect()
    }
}

/// Largest distances of the creep states after the smallest and the largest past from those taken for true.
fn farthest_creeps(channels: &[Channel; 3]) -> [f64; MAX_CREEPS] {
    let [nominal, low, high] = channels.each_ref().map(Channel::creeps);
    std::array::from_fn(|k| (high[k] - nominal[k]).max(nominal[k] - low[k]).max(0.0))
}

impl Memory {
    /// Memory without a past.
    ///
    /// # Errors
    /// As [`MemorySpec::check`].
    pub fn new(spec: MemorySpec) -> Result<Self, String> {
        spec.check(MAX_INPUTS)?;
        let rest = |spec: &InputMemory| [Channel::at_rest(spec, spec.range[0], spec.range[0]); 3];
        let channels: Vec<[Channel; 3]> = spec.inputs.iter().map(rest).collect();
        Ok(Self { open_creeps: vec![[0.0; MAX_CREEPS]; channels.len()], channels, spec, last_ns: None })
    }

    /// Memory of a model without a past; `None` for a static model.
    ///
    /// # Errors
    /// As [`MemorySpec::of`].
    pub fn of(model: &Model) -> Result<Option<Self>, ModelFileError> {
        let made = MemorySpec::of(model)?.map(Self::new).transpose();
        made.map_err(|reason| ModelFileError::Header(format!("memory: {reason}")))
    }

    /// The blocks without their states.
    pub fn spec(&self) -> &MemorySpec {
        &self.spec
    }

    /// Bridges any time between two readings by a straight line.
    pub fn hold_never(&mut self) {
        self.spec.max_gap_s = f64::INFINITY;
    }

    /// Time of the last reading, ns; `None` before the first.
    pub fn last_ns(&self) -> Option<u64> {
        self.last_ns
    }

    /// Forgets: the next reading starts at equilibrium.
    pub fn restart(&mut self) {
        self.last_ns = None;
    }

    /// True if all inputs with memory are numbers.
    pub fn takes(&self, inputs: &Inputs) -> bool {
        self.spec.inputs.iter().all(|spec| inputs.values()[spec.input].abs() <= LARGEST)
    }

    /// Advances to a reading of the time `t_ns`. `O(blocks)`.
    pub fn advance(&mut self, t_ns: u64, inputs: &Inputs) -> Advance {
        let value = |spec: &InputMemory| inputs.values()[spec.input];
        if !self.takes(inputs) {
            return Advance::NotFinite;
        }
        let both = self.spec.inputs.iter().zip(&mut self.channels).zip(&mut self.open_creeps);
        let Some(last_ns) = self.last_ns else {
            for ((spec, channels), open) in both {
                let input = value(spec);
                let pasts = [input, spec.range[0].min(input), spec.range[1].max(input)];
                *channels = pasts.map(|past| Channel::at_rest(spec, past, input));
                *open = farthest_creeps(channels);
            }
            self.last_ns = Some(t_ns);
            return Advance::Started;
        };
        if t_ns <= last_ns {
            return Advance::Late;
        }
        self.last_ns = Some(t_ns);
        let dt_s = (t_ns - last_ns) as f64 * 1e-9;
        let is_gap = dt_s > self.spec.max_gap_s;
        for ((spec, channels), open) in both {
            let input = value(spec);
            if is_gap {
                // What the input was meanwhile is unknown.
                let held = channels[NOMINAL].input();
                channels[LOW].jump(spec, spec.range[0].min(held));
                channels[HIGH].jump(spec, spec.range[1].max(held));
            }
            for channel in channels.iter_mut() {
                channel.advance(spec, input, dt_s, self.spec.max_gap_s);
            }
            open.iter_mut().zip(&spec.creep).for_each(|(open, creep)| *open *= (-dt_s / creep.time_s).exp());
            if is_gap {
                *open = farthest_creeps(channels);
            }
        }
        if is_gap { Advance::Gap } else { Advance::Advanced }
    }

    /// Inputs of the static map at the last reading: those with memory replaced.
    pub fn effective(&self, inputs: &Inputs) -> Inputs {
        let both = self.spec.inputs.iter().zip(&self.channels);
        both.fold(*inputs, |inputs, (spec, channels)| inputs.with(spec.input, channels[NOMINAL].output()))
    }

    /// Largest error of each input of the static map by an unknown past, in its unit; 0 without memory.
    pub fn spread(&self) -> [f64; MAX_INPUTS] {
        let mut spread = [0.0; MAX_INPUTS];
        for (spec, channels) in self.spec.inputs.iter().zip(&self.channels) {
            let [nominal, low, high] = channels.each_ref().map(Channel::output);
            spread[spec.input] = (high - nominal).max(nominal - low).max(0.0);
        }
        spread
    }

    /// [`Self::spread`] by its parts: past of line and play with what follows it, past of the creep alone. Without line and play all of it
    /// is the first.
    pub fn spreads(&self) -> [[f64; 2]; MAX_INPUTS] {
        let mut spreads = self.spread().map(|all| [all, 0.0]);
        for (spec, open) in
            self.spec.inputs.iter().zip(&self.open_creeps).filter(|(spec, _)| spec.has_two_pasts())
        {
            let of_creep: f64 = spec.creep.iter().zip(open).map(|(creep, open)| creep.weight * open).sum();
            let [first, second] = &mut spreads[spec.input];
            *second = of_creep.min(*first);
            *first -= *second;
        }
        spreads
    }

    /// Half-widths of the answers from an unknown past alone; see [`HalfWidths::with`].
    pub fn half_widths(&self) -> HalfWidths {
        let spread = self.spread();
        let sum = |slope: &dyn Fn(&Slopes) -> f64| -> f64 {
            self.spec.inputs.iter().map(|input| slope(&input.slopes) * spread[input.input]).sum()
        };
        HalfWidths {
            coverage: 1.0,
            displacement_mm: sum(&|slopes| slopes.displacement_mm),
            stress_mpa: sum(&|slopes| slopes.stress_mpa),
            force_n: sum(&|slopes| slopes.force_n),
        }
    }
}

/// Blocks of a model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MemorySpec {
    /// Inputs with memory; the others act at once.
    pub inputs: Vec<InputMemory>,
    /// Longest time between two readings that is bridged by a straight line, s. Over a longer one the last input is held, and the input
    /// counts as unknown.
    pub max_gap_s: f64,
}

/// Blocks of one input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputMemory {
    /// Position in the model's inputs.
    pub input: usize,
    /// Smallest and largest value that an unknown past may have had.
    pub range: [f64; 2],
    /// Lag of the pressure in the cavity, with its own times of filling and emptying.
    pub line: Option<Line>,
    /// Line with an orifice in place of `line`; the input is a gauge pressure, MPa.
    pub orifice: Option<Orifice>,
    /// Play operators, whose weighted sum is the hysteresis; empty: none.
    pub play: Vec<Play>,
    /// Slow states after the play; empty: none.
    pub creep: Vec<Creep>,
    /// Largest slopes of the answers, by which an unknown past widens the half-widths.
    pub slopes: Slopes,
}

/// Largest change of a model's answers per unit of an input; 0 where there is none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Slopes {
    /// Largest slope of the displacement of any node, mm per unit.
    pub displacement_mm: f64,
    /// Slope of the stress, MPa per unit.
    pub stress_mpa: f64,
    /// Slope of the contact force, N per unit.
    pub force_n: f64,
}

impl InputMemory {
    /// True if the pressure of the cavity lags behind the input.
    fn has_lag(&self) -> bool {
        self.line.is_some() || self.orifice.is_some()
    }

    /// True if the past of the creep is another one than that of line and play.
    pub fn has_two_pasts(&self) -> bool {
        !self.creep.is_empty() && (self.has_lag() || !self.play.is_empty())
    }

    fn check(&self, inputs: usize) -> Result<(), String> {
        let positive = |value: f64| value > 0.0 && value.is_finite();
        let require = |sound: bool, what: &str| if sound { Ok(()) } else { Err(what.to_owned()) };
        require(self.input < inputs, "memory of a missing input")?;
        require(
            self.range.iter().all(|v| v.is_finite()) && self.range[0] <= self.range[1],
            "the range of an input's past is empty",
        )?;
        let line = self.line.is_none_or(|line| positive(line.fill_s) && positive(line.empty_s));
        require(line, "a line's time constant is not above 0 s")?;
        let orifice =
            self.orifice.is_none_or(|o| positive(o.time_s) && (0.0..1.0).contains(&o.critical_ratio));
        require(orifice, "an orifice's time is not above 0 s or its critical ratio not within 0 and 1")?;
        require(self.line.is_none() || self.orifice.is_none(), "a line and an orifice of one input")?;
        require(self.play.len() <= MAX_PLAYS, "more than six play operators")?;
        require(self.play.iter().all(|p| positive(p.threshold)), "a threshold of play is not above 0")?;
        require(self.creep.len() <= MAX_CREEPS, "more than four creep terms")?;
        require(self.creep.iter().all(|c| positive(c.time_s)), "a creep time is not above 0 s")?;
        let Slopes { displacement_mm, stress_mpa, force_n } = self.slopes;
        let slopes = [displacement_mm, stress_mpa, force_n];
        require(slopes.iter().all(|s| *s >= 0.0 && s.is_finite()), "a slope of memory is not valid")?;
        let plays = self.play.iter().map(|play| play.weight);
        require(are_shares(plays), "weights of play are not within 0 and 1")?;
        require(are_shares(self.creep.iter().map(|c| c.weight)), "weights of creep are not within 0 and 1")
    }
}

/// True if the weights are not negative and leave the rest of 1 to the input.
fn are_shares(mut weights: impl Iterator<Item = f64>) -> bool {
    weights.try_fold(0.0, |sum, w| (w >= 0.0).then_some(sum + w)).is_some_and(|sum| sum <= 1.0)
}

impl MemorySpec {
    /// Memory of a model; `None` for a static model.
    ///
    /// # Errors
    /// [`ModelFileError::Header`] for blocks that are not valid.
    pub fn of(model: &Model) -> Result<Option<Self>, ModelFileError> {
        let found: Option<Self> = model.record(BlockKind::Memory)?;
        if let Some(spec) = &found {
            let refused = |reason| ModelFileError::Header(format!("memory: {reason}"));
            spec.check(model.header.inputs.len()).map_err(refused)?;
        }
        Ok(found)
    }

    /// Checks the blocks for a model with this number of inputs.
    ///
    /// # Errors
    /// A sentence on the first block that is not valid.
    pub fn check(&self, inputs: usize) -> Result<(), String> {
        if self.inputs.is_empty() || self.inputs.windows(2).any(|pair| pair[0].input >= pair[1].input) {
            return Err("inputs with memory are missing or out of order".into());
        }
        if !(self.max_gap_s > 0.0 && self.max_gap_s.is_finite()) {
            return Err("the longest gap is not above 0 s".into());
        }
        self.inputs.iter().try_for_each(|input| input.check(inputs.min(MAX_INPUTS)))
    }
}

/// Pressure of the atmosphere, MPa: inputs are gauge pressures.
pub const ATMOSPHERE_MPA: f64 = 0.101_325;
/// Pressure ratio from which the flow is laminar, in proportion to the difference.
const LAMINAR: f64 = 0.99;

/// Pneumatic line with an orifice by ISO 6358, choked and subsonic flow into a volume at constant temperature:
/// `c' = +-(p_up / T) psi(p_down / p_up)` of absolute pressures, with `psi = 1` up to the critical ratio `b` and
/// `psi = sqrt(1 - ((r - b) / (1 - b))^2)` above it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Orifice {
    /// `T = V / (C p_0)`, s, of the volume `V`, the sonic conductance `C` and the reference pressure `p_0` of 0.1 MPa.
    pub time_s: f64,
    /// Critical pressure ratio `b`.
    pub critical_ratio: f64,
}

impl Orifice {
    /// Lag with the orifice's flow at these gauge pressures, MPa.
    fn lag(&self, cavity_mpa: f64, input_mpa: f64) -> Line {
        let (up, down) =
            (cavity_mpa.max(input_mpa) + ATMOSPHERE_MPA, cavity_mpa.min(input_mpa) + ATMOSPHERE_MPA);
        let laminar_s = self.time_s * (1.0 - LAMINAR) / self.flow(LAMINAR);
        let is_laminar = up <= 0.0 || down >= LAMINAR * up;
        let lag_s =
            if is_laminar { laminar_s } else { self.time_s * (up - down) / (up * self.flow(down / up)) };
        Line { fill_s: lag_s, empty_s: lag_s }
    }

    /// `psi`.
    fn flow(&self, ratio: f64) -> f64 {
        let subsonic = (ratio - self.critical_ratio).max(0.0) / (1.0 - self.critical_ratio);
        (1.0 - subsonic * subsonic).sqrt()
    }

    /// Lag of a step in which the input goes straight from `from` to `to`: that of its middle. Second order; stable at any step.
    fn within(&self, output: f64, from: f64, to: f64, dt_s: f64) -> Line {
        let middle = 0.5 * (from + to);
        let half = self.lag(output, from).step(output, from, middle, 0.5 * dt_s).0;
        self.lag(half, middle)
    }
}

/// Largest number of play operators of an input.
pub const MAX_PLAYS: usize = 6;

/// Rate-independent loops, a Prandtl-Ishlinskii sum of play operators: one operator `y = max(u - r, min(u + r, y))` and its weight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Play {
    /// Threshold `r`: half of the play, in the unit of the input.
    pub threshold: f64,
    /// Weight `w` in `(1 - sum w) u + sum w y`.
    pub weight: f64,
}

impl Play {
    /// State after the input went to `input` without turning: depends on turning points, not on time.
    pub fn follow(&self, state: f64, input: f64) -> f64 {
        (input - self.threshold).max((input + self.threshold).min(state))
    }
}

/// Largest number of creep terms of an input.
pub const MAX_CREEPS: usize = 4;

/// Creep, a slow part of the response: state `z' = (u - z) / tau` and its weight in `(1 - sum w) u + sum w z`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Creep {
    /// Time constant, s.
    pub time_s: f64,
    /// Weight: share of the response that comes late.
    pub weight: f64,
}

impl Creep {
    /// State after a step of `dt_s`, in which the input goes straight from `from` to `to`. Exact.
    fn step(&self, state: f64, from: f64, to: f64, dt_s: f64) -> f64 {
        let slope = (to - from) / dt_s;
        let decay = (-dt_s / self.time_s).exp();
        to + (state - from) * decay + slope * self.time_s * (-dt_s / self.time_s).exp_m1()
    }
}

/// Largest number of terms.
pub const MAX_PRONY: usize = 4;
/// Halvings of an interval that contains a pole.
const HALVINGS: usize = 200;

/// Term of a Prony series, by which a material relaxes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PronyTerm {
    /// Ratio of the relaxing modulus to the long-term modulus, `w / (1 - sum w)` of weights `w` of the instantaneous modulus.
    pub ratio: f64,
    /// Relaxation time, s.
    pub time_s: f64,
}

impl PronyTerm {
    /// Checks a series.
    ///
    /// # Errors
    /// A sentence if there are more than [`MAX_PRONY`] terms, or a ratio or time is not positive and finite.
    pub fn check(terms: &[Self]) -> Result<(), String> {
        if terms.len() > MAX_PRONY {
            return Err(format!("expected at most {MAX_PRONY} Prony terms, found {}", terms.len()));
        }
        let positive = |value: f64| value > 0.0 && value.is_finite();
        match terms.iter().find(|term| !positive(term.ratio) || !positive(term.time_s)) {
            Some(PronyTerm { ratio, time_s }) => {
                Err(format!("expected Prony ratios and times above 0, found {ratio} and {time_s} s"))
            }
            None => Ok(()),
        }
    }

    /// Factors `e`, `a` of `h_1 = e h_0 + a (u_1 - u_0)` for a quantity `u` that is straight within a step.
    pub fn within(&self, step_s: f64) -> (f64, f64) {
        let x = step_s / self.time_s;
        let lost = -(-x).exp_m1();
        (1.0 - lost, if x > 0.0 { lost / x } else { 1.0 })
    }
}

/// Creep terms of the load filter of a series, by decreasing time.
///
/// A static family at the long-term modulus is driven by the load `P^` with `P = P^ + sum r_k h_k`, `h_k' = P^' - h_k / tau_k`: the relaxing
/// part of the stress takes `r_k h_k` of the load. `P^ / P = 1 / (1 + sum r_k tau_k s / (1 + tau_k s))` has as many real poles as terms, so
/// that the filter is a sum of creep terms with the same poles and residues.
///
/// # Errors
/// As [`PronyTerm::check`].
pub fn filter(terms: &[PronyTerm]) -> Result<Vec<Creep>, String> {
    PronyTerm::check(terms)?;
    let mut times: Vec<f64> = terms.iter().map(|term| term.time_s).collect();
    times.sort_by(|a, b| b.total_cmp(a));
    times.dedup();
    // Denominator at s = -x, which falls from 1 or infinity to minus infinity between two rates of the series.
    let denominator =
        |x: f64| 1.0 - terms.iter().map(|t| t.ratio * t.time_s * x / (1.0 - t.time_s * x)).sum::<f64>();
    let mut low = 0.0;
    let mut creeps = Vec::new();
    for time_s in times {
        let (mut from, mut to) = (low, 1.0 / time_s);
        low = to;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (from + to);
            if denominator(middle) > 0.0 { from = middle } else { to = middle }
        }
        let x = 0.5 * (from + to);
        let slope: f64 = terms.iter().map(|t| t.ratio * t.time_s / (1.0 - t.time_s * x).powi(2)).sum();
        creeps.push(Creep { time_s: 1.0 / x, weight: 1.0 / (x * slope) });
    }
    Ok(creeps)
}

/// Longest inner step as a fraction of the shortest creep time.
const INNER: f64 = 0.25;
/// Time of an orifice's flow that counts as a time constant for the inner steps.
const FLOW: f64 = 0.2;
/// Most inner steps.
const MAX_INNER: f64 = 64.0;

/// Line, play and creep of an input at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Channel {
    input: f64,
    line: f64,
    plays: [f64; MAX_PLAYS],
    after_play: f64,
    creeps: [f64; MAX_CREEPS],
    output: f64,
}

impl Channel {
    /// All states in equilibrium with `past`, the input now being `input`.
    fn at_rest(spec: &InputMemory, past: f64, input: f64) -> Self {
        let mut channel = Self {
            input,
            line: if spec.has_lag() { past } else { input },
            plays: [past; MAX_PLAYS],
            after_play: past,
            creeps: [past; MAX_CREEPS],
            output: past,
        };
        channel.follow(spec);
        channel.read(spec);
        channel
    }

    fn output(&self) -> f64 {
        self.output
    }

    fn input(&self) -> f64 {
        self.input
    }

    /// States of the creep terms.
    fn creeps(&self) -> &[f64; MAX_CREEPS] {
        &self.creeps
    }

    /// The input jumps.
    fn jump(&mut self, spec: &InputMemory, to: f64) {
        self.input = to;
        if !spec.has_lag() {
            self.line = to;
        }
        self.follow(spec);
        self.read(spec);
    }

    /// The input goes to `to` within `dt_s`: straight, or after a gap by a jump at its end. Nothing happens within no time.
    fn advance(&mut self, spec: &InputMemory, to: f64, dt_s: f64, max_gap_s: f64) {
        if dt_s > max_gap_s {
            self.step(spec, self.input, dt_s);
            self.jump(spec, to);
        } else if dt_s > 0.0 {
            self.step(spec, to, dt_s);
        }
    }

    /// The input goes straight to `to` within `dt_s`, which is above 0.
    fn step(&mut self, spec: &InputMemory, to: f64, dt_s: f64) {
        let shortest = spec.creep.iter().map(|creep| creep.time_s).fold(f64::INFINITY, f64::min);
        let shortest = spec.orifice.map_or(shortest, |orifice| shortest.min(FLOW * orifice.time_s));
        let count = (dt_s / (INNER * shortest)).ceil().clamp(1.0, MAX_INNER);
        let (from, inner_s) = (self.input, dt_s / count);
        for k in 1..=count as u32 {
            let next = from + (to - from) * f64::from(k) / count;
            let of_orifice = spec.orifice.map(|orifice| orifice.within(self.line, self.input, next, inner_s));
            match spec.line.or(of_orifice).map(|line| line.step(self.line, self.input, next, inner_s)) {
                Some((end, turn)) => {
                    let mut rest_s = inner_s;
                    if let Some(turn) = turn {
                        self.line = turn.value;
                        self.drive(spec, turn.after_s);
                        rest_s -= turn.after_s;
                    }
                    self.line = end;
                    self.drive(spec, rest_s);
                }
                None => {
                    self.line = next;
                    self.drive(spec, inner_s);
                }
            }
            self.input = next;
        }
        self.read(spec);
    }

    /// Play and creep follow the line, which has not turned for `dt_s`.
    fn drive(&mut self, spec: &InputMemory, dt_s: f64) {
        let before = self.after_play;
        self.follow(spec);
        if dt_s > 0.0 {
            for (creep, state) in spec.creep.iter().zip(&mut self.creeps) {
                *state = creep.step(*state, before, self.after_play, dt_s);
            }
        }
    }

    fn follow(&mut self, spec: &InputMemory) {
        let mut sum = self.line;
        for (play, state) in spec.play.iter().zip(&mut self.plays) {
            *state = play.follow(*state, self.line);
            sum += play.weight * (*state - self.line);
        }
        self.after_play = sum;
    }

    fn read(&mut self, spec: &InputMemory) {
        let late = spec.creep.iter().zip(&self.creeps);
        self.output =
            self.after_play + late.map(|(c, state)| c.weight * (state - self.after_play)).sum::<f64>();
    }
}
