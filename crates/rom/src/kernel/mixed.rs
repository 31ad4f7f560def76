//! A basis whose rows are as wide as an accepted error lets them be, tile by tile.
//!
//! Every row has one step, from [`budget`](super::budget). In a tile its values are whole numbers of steps, stored in the
//! fewest bits that hold the largest of them there:
//!
//! ```text
//! none    no bytes         all values round to 0
//! i8      64 bytes a row   up to 127 steps
//! i16     128 bytes a row  up to 32767 steps
//! f32     256 bytes a row  more, where the value itself is stored
//! ```
//!
//! Rows that are added up in a row (mean and modes; what moves the rest shape; the rest shape) are one list: first the wide
//! ones, then i16, then i8. Four i8 share a 32-bit word as two i16 do (see [`tiles`](super::tiles)): node `i` in the lowest
//! byte, `i + 16`, `i + 32` and `i + 48` above it, and each is rounded with the bytes below it as its fraction.

use super::plan::Plan;
use super::spec::{BasisError, Spec};
use super::tiles::{HALF_WORD, I16_MAX, LINE, Line, Row, RowOf, gather, pairs, rows};
use super::{MAX_ROWS, TILE_NODES};

/// Rows of a list in f32, i16 and i8.
pub(super) type Counts = [u16; 3];

/// Largest magnitude of an i8 before the fraction below it is taken off.
pub(super) const I8_MAX: f64 = 127.0;
/// What the sweep's conversion multiplies an i8 by.
const THREE_BYTES: f64 = 16_777_216.0;
/// Bytes of a row by width.
const ROW_BYTES: [usize; 3] = [4 * TILE_NODES, 2 * TILE_NODES, TILE_NODES];

/// The tiles of such a basis and what is needed to read them.
#[derive(Debug, Clone)]
pub(super) struct Mixed {
    lines: Vec<Line>,
    /// By stored row in the order of the bytes: where its factor is.
    entries: Vec<u16>,
    /// By list in the order of the bytes.
    counts: Vec<Counts>,
    /// Step of each row of the plan.
    steps: Vec<f64>,
}

/// In which width a row of a tile is stored, by its largest magnitude there; none when nothing is left of it.
pub(super) fn width(largest: f64, step: f64) -> Option<usize> {
    match largest / step {
        steps if steps <= 0.5 => None,
        steps if steps <= I8_MAX => Some(2),
        steps if steps <= I16_MAX => Some(1),
        _ => Some(0),
    }
}

/// Bytes of a row of a tile.
pub(super) fn bytes(width: Option<usize>) -> usize {
    width.map_or(0, |width| ROW_BYTES[width] + size_of::<u16>())
}

impl Mixed {
    /// Factors of a reconstruction: one a row and width.
    pub const FACTORS: usize = 3 * MAX_ROWS;

    /// Gathers and converts every row with its step.
    pub fn build(spec: &Spec<'_>, plan: &Plan, steps: Vec<f64>) -> Result<Self, BasisError> {
        let rows: Vec<_> = plan.ops.iter().map(|op| (op, rows(spec, op))).collect();
        let mut mixed = Self { lines: Vec::new(), entries: Vec::new(), counts: Vec::new(), steps };
        for tile in 0..plan.tiles() {
            let mut first = 0;
            for (op, rows) in &rows {
                for list in op.lists() {
                    let (from, to) = (first, first + list.len());
                    mixed.push_list(spec, op.field, tile, &rows[list], from..to)?;
                    first = to;
                }
            }
        }
        Ok(mixed)
    }

    /// Rows `numbers` of the plan in one tile.
    fn push_list(
        &mut self,
        spec: &Spec<'_>,
        field: usize,
        tile: usize,
        rows: &[RowOf<'_>],
        numbers: std::ops::Range<usize>,
    ) -> Result<(), BasisError> {
        let mut by_width: [Vec<(usize, Row)>; 3] = Default::default();
        for (row, number) in rows.iter().zip(numbers) {
            let values = gather(spec, field, tile, &|node| row.value(node))?;
            let largest = values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
            if let Some(width) = width(largest, self.steps[number]) {
                by_width[width].push((number, values));
            }
        }
        self.counts.push(by_width.each_ref().map(|rows| rows.len() as u16));
        for (width, rows) in by_width.iter().enumerate() {
            for (number, values) in rows {
                self.entries.push((width * MAX_ROWS + number) as u16);
                self.push_row(width, values, self.steps[*number]);
            }
        }
        Ok(())
    }

    fn push_row(&mut self, width: usize, values: &Row, step: f64) {
        let words: Vec<u32> = match width {
            0 => values.iter().map(|&value| (value as f32).to_bits()).collect(),
            1 => pairs(values, step).collect(),
            _ => quads(values, step).collect(),
        };
        for line in words.chunks_exact(LINE / 4) {
            let mut bytes = [0; LINE];
            bytes
                .chunks_exact_mut(4)
                .zip(line)
                .for_each(|(to, word)| to.copy_from_slice(&word.to_ne_bytes()));
            self.lines.push(Line(bytes));
        }
    }

    /// Writes what the values of row `row` are multiplied by for a coefficient, in each width.
    pub fn set_factors(&self, row: usize, coefficient: f64, factors: &mut [f32; Self::FACTORS]) {
        let stepped = coefficient * self.steps[row];
        factors[row] = coefficient as f32;
        factors[MAX_ROWS + row] = (stepped / HALF_WORD) as f32;
        factors[2 * MAX_ROWS + row] = (stepped / THREE_BYTES) as f32;
    }

    /// Half a step of row `row`: the most that rounding moves a value of it.
    pub fn half_step(&self, row: usize) -> f64 {
        self.steps[row] / 2.0
    }

    /// Whole cache lines.
    pub fn lines(&self) -> &[Line] {
        &self.lines
    }

    /// Where each stored row has its factor, and how many rows of each width every list has.
    pub fn lists(&self) -> (&[u16], &[Counts]) {
        (&self.entries, &self.counts)
    }

    /// Bytes that a reconstruction reads.
    pub fn bytes(&self) -> usize {
        self.lines.len() * LINE + size_of_val(&self.entries[..]) + size_of_val(&self.counts[..])
    }

    /// Rows of tiles by width: f32, i16, i8.
    pub fn stored(&self) -> [usize; 3] {
        let sum = |sums: [usize; 3], counts: &Counts| {
            [0, 1, 2].map(|width| sums[width] + usize::from(counts[width]))
        };
        self.counts.iter().fold([0; 3], sum)
    }
}

/// Four values a word, each less the fraction that the bytes below it are to the sweep.
fn quads(values: &Row, step: f64) -> impl Iterator<Item = u32> {
    const WORDS: usize = TILE_NODES / 4;
    (0..WORDS).map(move |at| {
        (0..4).fold(0_u32, |word, byte| {
            let fraction = f64::from(word) / f64::from(1_u32 << (8 * byte).min(31));
            let steps = (values[byte * WORDS + at] / step - fraction).round();
            word | u32::from(steps.clamp(-I8_MAX - 1.0, I8_MAX) as i8 as u8) << (8 * byte)
        })
    })
}
