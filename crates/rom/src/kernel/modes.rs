//! Modes of one field in the order in which the sweep reads them, in memory as in a model file.
//!
//! ```text
//! tile after tile of 64 nodes, the last one padded with its last node; in a tile mode after mode, each with its own number of bits:
//! 32     64 f32                 256 bytes per row
//! 16     integers of 16 bits    128 bytes per row, value = q step
//! 8      of 8 bits               64
//! 4      of 4 bits               32; always two such modes in a row, so that every other row begins on a cache line
//! ```
//! A mode whose amplitude is small needs few bits: what counts is its step times its coefficient. Integers share words of 32 bits (4-bit
//! ones of 16), the first nodes of a row in the lowest bits. The sweep shifts the wanted integer to the top of its word and converts the
//! word to f32: no widening, no mask. The integers below it stay as a fraction below one step; the rounding of the upper ones allows for
//! it, so no error exceeds half a step. A prefix of the modes is the first rows of every tile.

use super::TILE_NODES;
use super::pages::{LINE, Line, Lines};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

const _: () = assert!(cfg!(target_endian = "little"), "model files are read into place");

/// Number format of stored modes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Integers with one step per mode.
    #[default]
    Integers,
    /// 32-bit floats.
    F32,
}

impl Precision {
    /// Bits of a mode of which nothing else is known.
    pub const fn bits(self) -> u8 {
        match self {
            Self::Integers => 16,
            Self::F32 => 32,
        }
    }
}

/// Bytes of a row in a tile.
#[inline(always)]
pub(super) const fn row_bytes(bits: u8) -> usize {
    TILE_NODES * bits as usize / 8
}

/// Largest integer of so many bits before the fraction below it is taken off.
fn largest_integer(bits: u8) -> f64 {
    f64::from((1_u32 << (bits - 1)) - 1)
}

/// Factor of the sweep's conversion of an integer of so many bits.
fn converted(bits: u8) -> f64 {
    f64::from(1_u32 << (32 - bits))
}

/// Modes of one field, shared between the model and its reconstructors.
#[derive(Clone, Debug)]
pub struct Modes {
    lines: Arc<Lines>,
    /// First line of these modes.
    lines_from: usize,
    nodes: usize,
    /// Bits of each mode.
    bits: Vec<u8>,
    /// Step of each mode; 1 for f32.
    steps: Vec<f64>,
    /// First byte of each row in a tile, then the bytes of a tile.
    rows: Vec<usize>,
}

/// Description of stored modes.
#[derive(Debug, Clone, Copy)]
pub struct Shape<'a> {
    /// Number of nodes.
    pub nodes: usize,
    /// Bits of each mode.
    pub bits: &'a [u8],
    /// Step of each mode.
    pub steps: &'a [f64],
}

impl Shape<'_> {
    /// Bytes of the modes.
    pub fn bytes(&self) -> usize {
        Modes::bytes_of(self.nodes, self.bits)
    }

    /// True if the sweep can read the rows and their steps belong to them.
    pub fn is_sound(&self) -> bool {
        let known = |(bits, step): (&u8, &f64)| match bits {
            32 => *step == 1.0,
            4 | 8 | 16 => (0.0..=f64::from(f32::MAX) / converted(*bits)).contains(step),
            _ => false,
        };
        self.steps.len() == self.bits.len()
            && self.bits.iter().zip(self.steps).all(known)
            && runs(self.bits).all(|(bits, count)| bits != 4 || count.is_multiple_of(2))
    }
}

/// Neighbouring modes of as many bits: the bits and their number.
pub(super) fn runs(bits: &[u8]) -> impl Iterator<Item = (u8, usize)> {
    bits.chunk_by(|a, b| a == b).map(|run| (run[0], run.len()))
}

/// A value that f32 cannot hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NotFinite {
    /// Number of the node where it is.
    pub node: usize,
    /// The value as f64.
    pub value: f64,
}

impl Modes {
    /// Stores `count` modes over `nodes` nodes, all of them in 16 or 32 bits; `value` takes mode and node. Cost `O(nodes count)`.
    ///
    /// # Errors
    /// The first value that is NaN, infinite or beyond f32.
    pub fn new(
        precision: Precision,
        nodes: usize,
        count: usize,
        value: impl Fn(usize, usize) -> f64,
    ) -> Result<Self, NotFinite> {
        Self::with_bits(nodes, vec![precision.bits(); count], value)
    }

    /// Stores modes in 4, 8, 16 or 32 bits each. One of 4 that has no neighbour for its cache line gets 8.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_bits(
        nodes: usize,
        mut bits: Vec<u8>,
        value: impl Fn(usize, usize) -> f64,
    ) -> Result<Self, NotFinite> {
        for run in bits.chunk_by_mut(|a, b| a == b).filter(|run| run[0] == 4 && !run.len().is_multiple_of(2))
        {
            run[0] = 8;
        }
        let mut steps = Vec::new();
        for (mode, &bits) in bits.iter().enumerate() {
            let mut largest = 0.0_f64;
            for node in 0..nodes {
                let value = value(mode, node);
                if !(value as f32).is_finite() {
                    return Err(NotFinite { node, value });
                }
                largest = largest.max(value.abs());
            }
            steps.push(if bits == 32 { 1.0 } else { largest / largest_integer(bits) });
        }
        Ok(Self::with_steps(nodes, bits, steps, value))
    }

    /// These modes at some nodes, in this order, with the same steps. Integers of neighbours share a word, so each value is rounded once more, by
    /// at most half a step. Cost `O(nodes count)`.
    ///
    /// # Panics
    /// For a node that is not there.
    pub fn at_nodes(&self, nodes: &[u32]) -> Self {
        let value = |mode, at: usize| self.value(mode, nodes[at] as usize);
        Self::with_steps(nodes.len(), self.bits.clone(), self.steps.clone(), value)
    }

    fn with_steps(nodes: usize, bits: Vec<u8>, steps: Vec<f64>, value: impl Fn(usize, usize) -> f64) -> Self {
        let mut bytes = Vec::with_capacity(Self::bytes_of(nodes, &bits));
        for tile in 0..nodes.div_ceil(TILE_NODES) {
            for (mode, (&bits, &step)) in bits.iter().zip(&steps).enumerate() {
                let row: [f64; TILE_NODES] =
                    std::array::from_fn(|lane| value(mode, (tile * TILE_NODES + lane).min(nodes - 1)));
                if bits == 32 {
                    row.iter().for_each(|v| bytes.extend((*v as f32).to_le_bytes()));
                } else {
                    let word_bytes = if bits == 4 { 2 } else { 4 };
                    packed(&row, bits, step).for_each(|word| bytes.extend(&word.to_le_bytes()[..word_bytes]));
                }
            }
        }
        let mut lines = Lines::zeroed(bytes.len() / LINE);
        lines.bytes_mut().copy_from_slice(&bytes);
        Self::of_lines(Arc::new(lines), 0, nodes, bits, steps)
    }

    fn of_lines(lines: Arc<Lines>, lines_from: usize, nodes: usize, bits: Vec<u8>, steps: Vec<f64>) -> Self {
        let rows = (0..=bits.len()).map(|mode| tile_bytes(&bits[..mode])).collect();
        Self { lines, lines_from, nodes, bits, steps, rows }
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
        assert!(shapes.iter().all(Shape::is_sound), "bits that the sweep reads and one finite step per mode");
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
            let Shape { nodes, bits, steps } = *shape;
            Self::of_lines(Arc::clone(&lines), from, nodes, bits.to_vec(), steps.to_vec())
        };
        Ok(shapes.iter().map(modes).collect())
    }

    /// Bytes of modes of so many bits over `nodes` nodes.
    pub fn bytes_of(nodes: usize, bits: &[u8]) -> usize {
        nodes.div_ceil(TILE_NODES).saturating_mul(tile_bytes(bits))
    }

    /// Rows as stored.
    pub fn bytes(&self) -> &[u8] {
        &self.lines.bytes()[self.lines_from * LINE..][..self.nodes.div_ceil(TILE_NODES) * self.tile_bytes()]
    }

    /// Number of modes.
    pub fn count(&self) -> usize {
        self.bits.len()
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Bits of each mode.
    pub fn bits(&self) -> &[u8] {
        &self.bits
    }

    /// Step of each mode; 1 for f32.
    pub fn steps(&self) -> &[f64] {
        &self.steps
    }

    /// Number format: f32 if all modes have it.
    pub fn precision(&self) -> Precision {
        if !self.bits.is_empty() && self.bits.iter().all(|bits| *bits == 32) {
            Precision::F32
        } else {
            Precision::Integers
        }
    }

    /// Value of a mode at a node, as the sweep reads it.
    ///
    /// # Panics
    /// If mode or node is out of range.
    pub fn value(&self, mode: usize, node: usize) -> f64 {
        assert!(mode < self.count() && node < self.nodes);
        let (tile, lane) = (node / TILE_NODES, node % TILE_NODES);
        let row = tile * self.tile_bytes() + self.rows[mode];
        let bits = self.bits[mode];
        if bits == 32 {
            return f64::from(f32::from_bits(self.word(row + 4 * lane, 4)));
        }
        let words = words(bits);
        let bytes = if bits == 4 { 2 } else { 4 };
        let shift = 32 - u32::from(bits) * (lane / words + 1) as u32;
        let top = self.word(row + bytes * (lane % words), bytes) << shift;
        f64::from(top as i32) / converted(bits) * self.steps[mode]
    }

    /// The word of 2 or 4 bytes at a byte of the rows.
    fn word(&self, at: usize, bytes: usize) -> u32 {
        let mut word = [0; 4];
        word[..bytes].copy_from_slice(&self.bytes()[at..at + bytes]);
        u32::from_le_bytes(word)
    }

    /// First node whose value is not finite, of modes in f32.
    pub fn not_finite(&self) -> Option<NotFinite> {
        let floats = (0..self.count()).filter(|mode| self.bits[*mode] == 32);
        let values = floats.flat_map(|mode| (0..self.nodes).map(move |node| (node, mode)));
        let mut values = values.map(|(node, mode)| NotFinite { node, value: self.value(mode, node) });
        values.find(|found| !found.value.is_finite())
    }

    /// Factor of a coefficient for the stored rows of this mode.
    pub(super) fn factor(&self, mode: usize) -> f64 {
        if self.bits[mode] == 32 { 1.0 } else { self.steps[mode] / converted(self.bits[mode]) }
    }

    /// Bytes of a tile.
    #[inline(always)]
    pub(super) fn tile_bytes(&self) -> usize {
        self.rows[self.count()]
    }

    /// Stored rows.
    #[inline(always)]
    pub(super) fn lines(&self) -> &[Line] {
        &self.lines[self.lines_from..]
    }
}

impl PartialEq for Modes {
    fn eq(&self, other: &Self) -> bool {
        self.nodes == other.nodes
            && self.bits == other.bits
            && self.steps == other.steps
            && self.bytes() == other.bytes()
    }
}

/// Bytes of a tile with modes of so many bits.
fn tile_bytes(bits: &[u8]) -> usize {
    bits.iter().map(|bits| row_bytes(*bits)).sum()
}

/// Words of a row: nodes `i`, `i + words`, ... share word `i`.
const fn words(bits: u8) -> usize {
    if bits == 16 { TILE_NODES / 2 } else { TILE_NODES / 4 }
}

/// The words of a row; every integer less the fraction that those below it are to the sweep.
fn packed(row: &[f64; TILE_NODES], bits: u8, step: f64) -> impl Iterator<Item = u32> {
    let (words, most) = (words(bits), largest_integer(bits));
    let steps = move |value: f64| if step > 0.0 { value / step } else { 0.0 };
    (0..words).map(move |word| {
        let mut packed = 0_u32;
        for (index, value) in row.iter().skip(word).step_by(words).enumerate() {
            let below = u32::from(bits) * index as u32;
            let fraction = f64::from(packed) / (below as f64).exp2();
            let lowest = if index == 0 { -most } else { -most - 1.0 };
            let integer = (steps(*value) - fraction).round().clamp(lowest, most) as i32;
            packed |= (integer as u32 & ((1 << bits) - 1)) << below;
        }
        packed
    })
}
