//! Memory of a model's inputs: what lies between a measured or commanded input and the one that the static map takes.
//!
//! ```text
//! command -> line -> play -> creep -> x(P, gap, ...)
//! c' = (u - c) / tau, tau of filling or emptying        line.rs, orifice.rs
//! y_k = max(c - r_k, min(c + r_k, y_k)),  v = c + sum w_k (y_k - c)        play.rs
//! z_k' = (v - z_k) / tau_k,  output = v + sum w_k (z_k - v)        creep.rs
//! P = P^ + sum r_k h_k,  h_k' = P^' - h_k / tau_k: as creep        prony.rs
//! ```
//!
//! The blocks step by the sensor's time. Line and play are exact for an input that is straight between readings, so results do not depend on
//! how readings were cut. All blocks preserve order: of two pasts, the one with larger inputs stays above. Two further states, one that
//! comes from the smallest and one from the largest input, therefore enclose the effect of an unknown past, and their distance fades.

mod channel;
mod creep;
mod line;
mod orifice;
mod play;
mod prony;
mod spec;

pub use creep::{Creep, MAX_CREEPS};
pub use line::Line;
pub use orifice::Orifice;
pub use play::{MAX_PLAYS, Play};
pub use prony::{MAX_PRONY, PronyTerm, filter};
pub use spec::{InputMemory, MemorySpec, Slopes};

use crate::halfwidths::HalfWidths;
use crate::inputs::{Inputs, MAX_INPUTS};
use crate::model::{Model, ModelFileError};
use channel::Channel;

/// Outcome of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Advance {
    /// The first reading: memory in equilibrium with it, the past unknown.
    Started,
    /// Advanced to the reading's time.
    Advanced,
    /// Advanced over more than [`MemorySpec::max_gap_s`]: the last input was held, the past is less known.
    Gap,
    /// Stamp not after the last one: nothing changed.
    Late,
    /// An input with memory is not finite: nothing changed. The next reading spans the time.
    NotFinite,
}

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
        let rest = |of: &InputMemory| [Channel::at_rest(of, of.range[0], of.range[0]); 3];
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

    /// Its blocks.
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
        self.spec.inputs.iter().all(|of| inputs.values()[of.input].abs() <= LARGEST)
    }

    /// Advances to a reading of the time `t_ns`. `O(blocks)`.
    pub fn advance(&mut self, t_ns: u64, inputs: &Inputs) -> Advance {
        let value = |of: &InputMemory| inputs.values()[of.input];
        if !self.takes(inputs) {
            return Advance::NotFinite;
        }
        let both = self.spec.inputs.iter().zip(&mut self.channels).zip(&mut self.open_creeps);
        let Some(last_ns) = self.last_ns else {
            for ((of, channels), open) in both {
                let input = value(of);
                let pasts = [input, of.range[0].min(input), of.range[1].max(input)];
                *channels = pasts.map(|past| Channel::at_rest(of, past, input));
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
        for ((of, channels), open) in both {
            let input = value(of);
            if is_gap {
                // What the input was meanwhile is unknown.
                let held = channels[NOMINAL].input();
                channels[LOW].jump(of, of.range[0].min(held));
                channels[HIGH].jump(of, of.range[1].max(held));
            }
            for channel in channels.iter_mut() {
                channel.advance(of, input, dt_s, self.spec.max_gap_s);
            }
            open.iter_mut().zip(&of.creep).for_each(|(open, creep)| *open *= (-dt_s / creep.time_s).exp());
            if is_gap {
                *open = farthest_creeps(channels);
            }
        }
        if is_gap { Advance::Gap } else { Advance::Advanced }
    }

    /// Inputs of the static map at the last reading: those with memory replaced.
    pub fn effective(&self, inputs: &Inputs) -> Inputs {
        self.replaced(inputs, NOMINAL)
    }

    /// Inputs of the static map after the smallest and the largest past: they enclose those after any past.
    pub fn enclosing(&self, inputs: &Inputs) -> [Inputs; 2] {
        [self.replaced(inputs, LOW), self.replaced(inputs, HIGH)]
    }

    /// Largest error of each input of the static map by an unknown past, in its unit; 0 without memory.
    pub fn spread(&self) -> [f64; MAX_INPUTS] {
        let mut spread = [0.0; MAX_INPUTS];
        for (of, channels) in self.spec.inputs.iter().zip(&self.channels) {
            let [nominal, low, high] = channels.each_ref().map(Channel::output);
            spread[of.input] = (high - nominal).max(nominal - low).max(0.0);
        }
        spread
    }

    /// [`Self::spread`] by its parts: past of line and play with what follows it, past of the creep alone. Without line and play all of it
    /// is the first.
    pub fn spreads(&self) -> [[f64; 2]; MAX_INPUTS] {
        let mut spreads = self.spread().map(|all| [all, 0.0]);
        for (of, open) in self.spec.inputs.iter().zip(&self.open_creeps).filter(|(of, _)| of.has_two_pasts())
        {
            let of_creep: f64 = of.creep.iter().zip(open).map(|(creep, open)| creep.weight * open).sum();
            let [first, second] = &mut spreads[of.input];
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

    /// Values behind the lines (pressures in the cavities), by input; NaN for inputs without memory.
    pub fn behind_lines(&self) -> [f64; MAX_INPUTS] {
        let mut values = [f64::NAN; MAX_INPUTS];
        for (of, channels) in self.spec.inputs.iter().zip(&self.channels) {
            values[of.input] = channels[NOMINAL].behind_line();
        }
        values
    }

    fn replaced(&self, inputs: &Inputs, which: usize) -> Inputs {
        let both = self.spec.inputs.iter().zip(&self.channels);
        both.fold(*inputs, |inputs, (of, channels)| inputs.with(of.input, channels[which].output()))
    }
}
