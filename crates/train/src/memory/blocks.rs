//! Constants of the blocks as unknowns of the search.

use rom::memory::{Creep, InputMemory, Line, MemorySpec, Orifice, Play, Slopes};
use serde::Serialize;

/// Play operators of an input: thresholds evenly spaced up to the largest, equal weights.
const PLAYS: usize = 4;

/// Critical pressure ratios of valves and tubes.
const CRITICAL_RATIOS: [f64; 2] = [0.05, 0.6];

/// Kind of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Block {
    /// Lag with two time constants.
    Line,
    /// Flow through an orifice into a volume: an alternative to the former, of pressures in MPa.
    Orifice,
    /// Play operators of thresholds up to the largest, a loop that rounds its turning points.
    Play,
    /// One play operator, as a mechanical play: an alternative to the former.
    #[serde(rename = "single play")]
    SinglePlay,
    /// Second lag behind the line: a cavity at the end of a tube, which begins to fill late.
    #[serde(rename = "second lag")]
    SecondLag,
    /// Slow state.
    Creep,
}

impl Block {
    /// In the order from the source to the fields.
    pub const ALL: [Self; 6] =
        [Self::Line, Self::Orifice, Self::Play, Self::SinglePlay, Self::SecondLag, Self::Creep];

    /// Word for it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Line => "line",
            Self::Orifice => "orifice",
            Self::Play => "play",
            Self::SinglePlay => "single play",
            Self::SecondLag => "second lag",
            Self::Creep => "creep",
        }
    }

    /// Names and units of its two constants.
    #[must_use]
    pub fn constants(self) -> [(&'static str, &'static str); 2] {
        match self {
            Self::Line => [("filling", "s"), ("emptying", "s")],
            Self::Orifice => [("volume over conductance", "s"), ("critical ratio", "")],
            Self::Play => [("largest threshold", "of the range"), ("weight", "")],
            Self::SinglePlay => [("threshold", "of the range"), ("weight", "")],
            Self::SecondLag | Self::Creep => [("time", "s"), ("weight", "")],
        }
    }

    /// True if a set of blocks has this one, or its alternative.
    pub(super) fn is_in(self, blocks: &[Self]) -> bool {
        let kind = |block: Self| match block {
            Self::Line | Self::Orifice => Self::Line,
            Self::Play | Self::SinglePlay => Self::Play,
            other => other,
        };
        blocks.iter().any(|other| kind(*other) == kind(self))
    }

    /// True if a constant is a time.
    pub(super) fn is_time(self, constant: usize) -> bool {
        self.constants()[constant].1 == "s"
    }

    /// True if the search takes the logarithm.
    pub(super) fn is_log(self, constant: usize) -> bool {
        constant == 0 || self == Self::Line
    }
}

/// Times that a recording can show.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Median time between readings, s.
    pub interval_s: f64,
    /// Duration of the longest run, s.
    pub duration_s: f64,
}

impl Limits {
    /// Smallest and largest value of a block's unknowns.
    pub(super) fn of(&self, block: Block) -> [[f64; 2]; 2] {
        let Self { interval_s, duration_s } = *self;
        let time = [(0.3 * interval_s).ln(), (0.25 * duration_s).max(interval_s).ln()];
        match block {
            Block::Line => [time, time],
            Block::Orifice => [time, CRITICAL_RATIOS],
            Block::Play | Block::SinglePlay => [[0.005_f64.ln(), 0.5_f64.ln()], [0.0, 1.0]],
            Block::SecondLag => [time, [0.0, 1.0]],
            Block::Creep => {
                [[(3.0 * interval_s).max(0.02 * duration_s).ln().min(time[1]), time[1]], [0.0, 0.6]]
            }
        }
    }

    /// Starting points of a block's unknowns.
    pub(super) fn starts(&self, block: Block) -> Vec<[f64; 2]> {
        let [first, second] = self.of(block);
        let within = |range: [f64; 2], share: f64| range[0] + share * (range[1] - range[0]);
        let shares = [0.1, 0.3, 0.5, 0.7, 0.9];
        let grid = |a: &[f64], b: &[f64]| -> Vec<[f64; 2]> {
            a.iter().flat_map(|a| b.iter().map(|b| [within(first, *a), within(second, *b)])).collect()
        };
        match block {
            Block::Line => grid(&shares, &shares),
            Block::Orifice => grid(&shares, &[0.4]),
            Block::Play | Block::SinglePlay => grid(&[0.3, 0.5, 0.7, 0.85], &[0.3, 0.8]),
            Block::SecondLag => grid(&shares[..3], &[0.5, 0.9]),
            Block::Creep => grid(&[0.2, 0.5, 0.8], &[0.1, 0.4]),
        }
    }
}

/// Blocks of a set in the order of the chain, two unknowns each.
pub(super) fn spec(blocks: &[Block], unknowns: &[f64], ranges: &[[f64; 2]], max_gap_s: f64) -> MemorySpec {
    let inputs = ranges.iter().enumerate().map(|(input, range)| {
        let (play, creep, slopes) = (Vec::new(), Vec::new(), Slopes::default());
        let (line, orifice) = (None, None);
        let mut memory = InputMemory { input, range: *range, line, orifice, play, creep, slopes };
        for (block, u) in blocks.iter().zip(unknowns.chunks_exact(2)) {
            match block {
                Block::Line => memory.line = Some(Line { fill_s: u[0].exp(), empty_s: u[1].exp() }),
                Block::Orifice => {
                    memory.orifice = Some(Orifice { time_s: u[0].exp(), critical_ratio: u[1] });
                }
                Block::Play => {
                    let largest = u[0].exp() * (range[1] - range[0]);
                    let play = |k: usize| Play {
                        threshold: largest * k as f64 / PLAYS as f64,
                        weight: u[1] / PLAYS as f64,
                    };
                    memory.play = (1..=PLAYS).map(play).collect();
                }
                Block::SinglePlay => {
                    memory.play = vec![Play { threshold: u[0].exp() * (range[1] - range[0]), weight: u[1] }];
                }
                Block::SecondLag | Block::Creep => {
                    memory.creep.push(Creep { time_s: u[0].exp(), weight: u[1] })
                }
            }
        }
        // The second lag has what the creep leaves.
        if let [lag, creep] = &mut memory.creep[..] {
            lag.weight *= 1.0 - creep.weight;
        }
        memory
    });
    MemorySpec { inputs: inputs.collect(), max_gap_s }
}
