//! Modes of one field in the order in which the sweep reads them, in memory as in a model file.
//!
//! ```text
//! tile after tile of 64 nodes, the last one padded with its last node; in a tile mode after mode:
//! F32    64 f32    256 bytes per row
//! I16    64 i16    128 bytes per row, and one step per mode: value = q step
//! ```
//! Two i16 share a 32-bit word, node `i` in the low half and node `i + 32` in the high half. The sweep converts
//! `word << 16` and `word` itself to f32, which is 65536 times either value: no widening, no mask. The low half stays in
//! the second as a fraction below one step; the rounding of the high half allows for it, so neither error exceeds half a step.
//! A prefix of the modes is the first rows of every tile.

use super::TILE_NODES;
use super::pages::{LINE, Line, Lines};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

const _: () = assert!(cfg!(target_endian = "little"), "model files are read into place");

/// Number format of stored modes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// 16-bit integers with one step per mode.
    #[default]
    I16,
    /// 32-bit floats.
    F32,
}

impl Precision {
    /// Bytes of one mode in one tile.
    pub(super) const fn row_bytes(self) -> usize {
        match self {
            Self::I16 => 2 * TILE_NODES,
            Self::F32 => 4 * TILE_NODES,
        }
    }
}

/// Largest magnitude of an i16 before the fraction below it is taken off.
const I16_MAX: f64 = 32767.0;
/// Factor of the sweep's conversion of an i16.
pub(super) const HALF_WORD: f64 = 65536.0;

/// Modes of one field, shared between the model and its reconstructors.
#[derive(Clone, Debug)]
pub struct Modes {
    lines: Arc<Lines>,
    /// First line of these modes.
    lines_from: usize,
    precision: Precision,
    nodes: usize,
    count: usize,
    /// One per mode for I16.
    steps: Vec<f64>,
}

/// Description of stored modes.
#[derive(Debug, Clone, Copy)]
pub struct Shape<'a> {
    /// Number format.
    pub precision: Precision,
    /// Number of nodes.
    pub nodes: usize,
    /// Number of modes.
    pub count: usize,
    /// Step of each mode; empty for f32.
    pub steps: &'a [f64],
}

impl Shape<'_> {
    /// Bytes of the modes.
    pub fn bytes(&self) -> usize {
        Modes::bytes_of(self.precision, self.nodes, self.count)
    }

    /// True if the steps belong to the modes.
    pub fn is_sound(&self) -> bool {
        let expected = if self.precision == Precision::I16 { self.count } else { 0 };
        // The largest entry of a mode is 32767 steps.
        let most = f64::from(f32::MAX) / HALF_WORD;
        self.steps.len() == expected && self.steps.iter().all(|step| (0.0..=most).contains(step))
    }
}

/// A value that f32 cannot hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NotFinite {
    /// Node.
    pub node: usize,
    /// Value.
    pub value: f64,
}

impl Modes {
    /// Stores `count` modes over `nodes` nodes; `value` takes mode and node. Cost `O(nodes count)`.
    ///
    /// # Errors
    /// The first value that is NaN, infinite or beyond f32.
    pub fn new(
        precision: Precision,
        nodes: usize,
        count: usize,
        value: impl Fn(usize, usize) -> f64,
    ) -> Result<Self, NotFinite> {
        let mut steps = Vec::new();
        for mode in 0..count {
            let mut largest = 0.0_f64;
            for node in 0..nodes {
                let value = value(mode, node);
                if !(value as f32).is_finite() {
                    return Err(NotFinite { node, value });
                }
                largest = largest.max(value.abs());
            }
            if precision == Precision::I16 {
                steps.push(largest / I16_MAX);
            }
        }
        let mut bytes = Vec::with_capacity(Self::bytes_of(precision, nodes, count));
        for tile in 0..nodes.div_ceil(TILE_NODES) {
            for mode in 0..count {
                let row: [f64; TILE_NODES] =
                    std::array::from_fn(|lane| value(mode, (tile * TILE_NODES + lane).min(nodes - 1)));
                match steps.get(mode) {
                    None => row.iter().for_each(|v| bytes.extend((*v as f32).to_le_bytes())),
                    Some(&step) => pairs(&row, step).for_each(|word| bytes.extend(word.to_le_bytes())),
                }
            }
        }
        let mut lines = Lines::zeroed(bytes.len() / LINE);
        lines.bytes_mut().copy_from_slice(&bytes);
        Ok(Self { lines: Arc::new(lines), lines_from: 0, precision, nodes, count, steps })
    }

    /// Modes of several fields in one piece of memory, whose bytes `fill` writes in place: it takes the index of the field.
    /// Cost: their bytes once.
    ///
    /// # Errors
    /// The error of `fill`.
    ///
    /// # Panics
    /// If steps are not those of their modes ([`Shape::is_sound`]).
    pub fn filled<E>(
        shapes: &[Shape<'_>],
        mut fill: impl FnMut(usize, &mut [u8]) -> Result<(), E>,
    ) -> Result<Vec<Self>, E> {
        assert!(shapes.iter().all(Shape::is_sound), "one finite step per mode");
        let mut lines = Lines::zeroed(shapes.iter().map(Shape::bytes).sum::<usize>() / LINE);
        let mut rest = lines.bytes_mut();
        for (field, shape) in shapes.iter().enumerate() {
            let (own, others) = rest.split_at_mut(shape.bytes());
            fill(field, own)?;
            rest = others;
        }
        let lines = Arc::new(lines);
        let mut first = 0;
        let modes = |shape: &Shape<'_>| {
            let from = first;
            first += shape.bytes() / LINE;
            let Shape { precision, nodes, count, steps } = *shape;
            Self {
                lines: Arc::clone(&lines),
                lines_from: from,
                precision,
                nodes,
                count,
                steps: steps.to_vec(),
            }
        };
        Ok(shapes.iter().map(modes).collect())
    }

    /// Bytes of `count` modes over `nodes` nodes.
    pub fn bytes_of(precision: Precision, nodes: usize, count: usize) -> usize {
        nodes.div_ceil(TILE_NODES).saturating_mul(count).saturating_mul(precision.row_bytes())
    }

    /// Rows as stored.
    pub fn bytes(&self) -> &[u8] {
        &self.lines.bytes()[self.lines_from * LINE..]
            [..Self::bytes_of(self.precision, self.nodes, self.count)]
    }

    /// Number of modes.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Number format.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// Step of each mode; empty for f32.
    pub fn steps(&self) -> &[f64] {
        &self.steps
    }

    /// Value of a mode at a node, as the sweep reads it.
    ///
    /// # Panics
    /// If mode or node is out of range.
    pub fn value(&self, mode: usize, node: usize) -> f64 {
        assert!(mode < self.count && node < self.nodes);
        let (tile, lane) = (node / TILE_NODES, node % TILE_NODES);
        let row = (tile * self.count + mode) * self.precision.row_bytes();
        let word = |at: usize| {
            let bytes = &self.bytes()[row + 4 * at..][..4];
            u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
        };
        match self.precision {
            Precision::F32 => f64::from(f32::from_bits(word(lane))),
            Precision::I16 if lane < TILE_NODES / 2 => f64::from(word(lane) as i16) * self.steps[mode],
            Precision::I16 => f64::from(word(lane - TILE_NODES / 2) as i32) / HALF_WORD * self.steps[mode],
        }
    }

    /// First node whose value is not finite, of modes in f32.
    pub fn not_finite(&self) -> Option<NotFinite> {
        let is_finite =
            |chunk: &[u8]| f32::from_le_bytes([chunk[0], chunk[1], chunk[2], chunk[3]]).is_finite();
        if self.precision == Precision::I16 || self.bytes().chunks_exact(4).all(is_finite) {
            return None;
        }
        let all = (0..self.count).flat_map(|mode| (0..self.nodes).map(move |node| (mode, node)));
        let values = all.map(|(mode, node)| NotFinite { node, value: self.value(mode, node) });
        values.into_iter().find(|found| !found.value.is_finite())
    }

    /// Factor of a coefficient for the stored rows of this mode.
    pub(super) fn factor(&self, mode: usize) -> f64 {
        match self.precision {
            Precision::F32 => 1.0,
            Precision::I16 => self.steps[mode] / HALF_WORD,
        }
    }

    /// Stored rows.
    pub(super) fn lines(&self) -> &[Line] {
        &self.lines[self.lines_from..][..self.bytes().len() / LINE]
    }
}

impl PartialEq for Modes {
    fn eq(&self, other: &Self) -> bool {
        let shape = |of: &Self| (of.precision, of.nodes, of.count);
        shape(self) == shape(other) && self.steps == other.steps && self.bytes() == other.bytes()
    }
}

/// Two values per word, the high one less the fraction that the low one is to the sweep.
fn pairs(row: &[f64; TILE_NODES], step: f64) -> impl Iterator<Item = u32> {
    let steps = move |value: f64| if step > 0.0 { value / step } else { 0.0 };
    let (low, high) = row.split_at(TILE_NODES / 2);
    low.iter().zip(high).map(move |(&low, &high)| {
        let low = steps(low).round().clamp(-I16_MAX, I16_MAX) as i16;
        let fraction = f64::from(low as u16) / HALF_WORD;
        let high = (steps(high) - fraction).round().clamp(-I16_MAX - 1.0, I16_MAX) as i16;
        u32::from(low as u16) | u32::from(high as u16) << 16
    })
}
