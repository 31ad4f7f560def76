//! The basis in the order of use.
//!
//! A tile holds, for [`TILE_NODES`] nodes and for each affine field in turn: the mean row, the mode rows, the rows of what
//! moves the rest shape, the rest row.
//!
//! ```text
//! F32    64 f32    256 bytes a row
//! I16    64 i16    128 bytes a row
//! ```
//!
//! A row of I16 is `q * step`, with one step a row that is multiplied into its factor, so the sweep never sees it. The
//! mean of a coordinate is stored less the rest shape: the displacement then has the small steps of a displacement, and
//! only the published coordinate carries those of the body's size.
//!
//! Two i16 share a 32-bit word, node `i` in the low half and node `i + 32` in the high half. The sweep converts
//! `word << 16` and `word` itself to f32, which is 65536 times either value: no widening, no mask. The low half stays in
//! the second as a fraction below one step; the rounding of the high half allows for it, so neither is off by more than
//! half a step.

use super::TILE_NODES;
use super::pages::{LINE, Line, Lines};
use super::plan::{Op, Plan};
use super::spec::{BasisError, Source, Spec, Values};

/// How a basis of one precision is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Precision {
    /// 4 bytes an entry: the rounding of f32.
    F32,
    /// 2 bytes an entry: see [`Basis::error_bound`](super::Basis::error_bound).
    I16,
}

/// Largest magnitude of an i16 before the fraction below it is taken off.
pub(super) const I16_MAX: f64 = 32767.0;
/// What the sweep's conversion multiplies an i16 by.
pub(super) const HALF_WORD: f64 = 65536.0;

/// The tiles of a basis and what is needed to read them.
#[derive(Debug, Clone)]
pub(super) struct Tiles {
    /// The bytes, aligned to cache lines.
    lines: Lines,
    /// Step of each row; 1 for F32, which has none.
    steps: Vec<f64>,
    precision: Precision,
}

/// A row of a tile in f64.
pub(super) type Row = [f64; TILE_NODES];

impl Tiles {
    /// Gathers and converts every row.
    pub(super) fn build(spec: &Spec<'_>, plan: &Plan, precision: Precision) -> Result<Self, BasisError> {
        let tile_bytes = tile_bytes(plan, precision);
        let total = tile_bytes * plan.tiles();
        let rows: Vec<_> = plan
            .ops
            .iter()
            .flat_map(|op| rows(spec, op).into_iter().map(move |row| (op.field, row)))
            .collect();
        let mut tiles = Self {
            lines: Lines::zeroed(total / LINE),
            precision,
            steps: rows.iter().map(|(_, row)| step(spec, row, precision)).collect(),
        };
        let mut bytes = vec![0u8; tile_bytes];
        for tile in 0..plan.tiles() {
            tiles.fill_tile(spec, &rows, tile, &mut bytes)?;
            tiles.write(tile * tile_bytes, &bytes);
        }
        Ok(tiles)
    }

    /// What the coefficient of row `row` is multiplied by.
    pub(super) fn factor(&self, row: usize) -> f64 {
        match self.precision {
            Precision::F32 => 1.0,
            Precision::I16 => self.steps[row] / HALF_WORD,
        }
    }

    /// Half a step of row `row`: the most that rounding moves a value of it.
    pub(super) fn half_step(&self, row: usize) -> f64 {
        match self.precision {
            Precision::F32 => 0.0,
            Precision::I16 => self.steps[row] / 2.0,
        }
    }

    /// How all rows are stored.
    pub(super) fn precision(&self) -> Precision {
        self.precision
    }

    /// Whole cache lines.
    pub(super) fn lines(&self) -> &[Line] {
        &self.lines
    }

    fn fill_tile(
        &self,
        spec: &Spec<'_>,
        rows: &[(usize, RowOf<'_>)],
        tile: usize,
        bytes: &mut [u8],
    ) -> Result<(), BasisError> {
        let mut writer = TileWriter { bytes, position: 0 };
        for ((field, row), &step) in rows.iter().zip(&self.steps) {
            let row = gather(spec, *field, tile, &|node| row.value(node))?;
            match self.precision {
                Precision::F32 => writer.floats(&row),
                Precision::I16 => writer.integers(&row, step),
            }
        }
        Ok(())
    }

    fn write(&mut self, start: usize, bytes: &[u8]) {
        for (k, &byte) in bytes.iter().enumerate() {
            self.lines[(start + k) / LINE].0[(start + k) % LINE] = byte;
        }
    }
}

/// What one row of a tile holds.
pub(super) enum RowOf<'a> {
    /// The mean, less the undeformed coordinate for a component of the displacement.
    Mean { mean: Option<Values<'a>>, rest: Option<Values<'a>> },
    /// A mode, from its first entry in the mode matrix.
    Mode { modes: Values<'a>, first: usize },
    /// The undeformed coordinate, or its change per unit of a coefficient.
    Rest(Values<'a>),
}

impl RowOf<'_> {
    pub(super) fn value(&self, node: usize) -> f64 {
        let at = |values: &Option<Values<'_>>| values.map_or(0.0, |values| values.get(node));
        match self {
            Self::Mean { mean, rest } => at(mean) - at(rest),
            Self::Mode { modes, first } => modes.get(first + node),
            Self::Rest(rest) => rest.get(node),
        }
    }
}

/// The rows of one field in their order.
pub(super) fn rows<'a>(spec: &Spec<'a>, op: &Op) -> Vec<RowOf<'a>> {
    let Source::Affine(affine) = &spec.fields[op.field].source else { return Vec::new() };
    let (rest, shifts) = spec.rest_of(op.field).filter(|_| op.in_magnitude).unzip();
    let mean = op.has_mean.then_some(RowOf::Mean { mean: affine.mean, rest });
    let modes = (0..op.modes).map(|j| RowOf::Mode { modes: affine.modes, first: j * affine.stride });
    let rest = rest.filter(|_| op.has_rest).map(RowOf::Rest);
    let shifts = shifts.into_iter().flatten().map(|(_, by)| RowOf::Rest(by));
    mean.into_iter().chain(modes).chain(shifts).chain(rest).collect()
}

fn tile_bytes(plan: &Plan, precision: Precision) -> usize {
    let entry = match precision {
        Precision::F32 => size_of::<f32>(),
        Precision::I16 => size_of::<i16>(),
    };
    TILE_NODES * plan.rows * entry
}

/// One tile's row of values; lanes beyond the last node repeat it.
pub(super) fn gather(
    spec: &Spec<'_>,
    field: usize,
    tile: usize,
    value: &dyn Fn(usize) -> f64,
) -> Result<Row, BasisError> {
    let last = spec.output_nodes() - 1;
    let mut row = [0.0; TILE_NODES];
    for (lane, slot) in row.iter_mut().enumerate() {
        let node = spec.source_node((tile * TILE_NODES + lane).min(last));
        let value = value(node);
        if !(value as f32).is_finite() {
            return Err(BasisError::NotFinite { field, node, value });
        }
        *slot = value;
    }
    Ok(row)
}

/// The step of a row over the node set, so that its largest entry is the largest i16.
fn step(spec: &Spec<'_>, row: &RowOf<'_>, precision: Precision) -> f64 {
    match precision {
        Precision::F32 => 1.0,
        Precision::I16 => {
            let entry = |i| row.value(spec.source_node(i)).abs();
            (0..spec.output_nodes()).map(entry).fold(0.0, f64::max) / I16_MAX
        }
    }
}

/// Two values a word, the high one less the fraction that the low one is to the sweep.
pub(super) fn pairs(row: &Row, step: f64) -> impl Iterator<Item = u32> {
    let steps = move |value: f64| if step > 0.0 { value / step } else { 0.0 };
    let (low, high) = row.split_at(TILE_NODES / 2);
    low.iter().zip(high).map(move |(&low, &high)| {
        let low = steps(low).round().clamp(-I16_MAX, I16_MAX) as i16;
        let fraction = f64::from(low as u16) / HALF_WORD;
        let high = (steps(high) - fraction).round().clamp(-I16_MAX - 1.0, I16_MAX) as i16;
        u32::from(low as u16) | u32::from(high as u16) << 16
    })
}

/// Writes the rows of one tile in order.
struct TileWriter<'a> {
    bytes: &'a mut [u8],
    position: usize,
}

impl TileWriter<'_> {
    fn floats(&mut self, row: &Row) {
        for &value in row {
            self.push((value as f32).to_ne_bytes());
        }
    }

    fn integers(&mut self, row: &Row, step: f64) {
        pairs(row, step).for_each(|word| self.push(word.to_ne_bytes()));
    }

    fn push(&mut self, word: [u8; 4]) {
        self.bytes[self.position..][..4].copy_from_slice(&word);
        self.position += 4;
    }
}
