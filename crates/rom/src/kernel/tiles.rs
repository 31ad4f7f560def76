//! The basis in the order of use.
//!
//! A tile holds, for [`TILE_NODES`] nodes and for each affine field in turn: the mean row, the mode rows, the rest row.
//!
//! ```text
//! F32   rows of 16 f32                                              64 bytes a row
//! I16   header: (scale, offset) as f32 for each mean and rest row   padded to 32 bytes
//!       rows of 16 i16                                              32 bytes a row
//! ```
//!
//! In I16 a mode row is `q * scale_j`, with one scale a mode that is multiplied into the coefficient, so the sweep never
//! sees it. Mean and rest rows are `q * scale + offset` per tile: neighbouring nodes lie together, so their range is
//! some millimetres and the step some 1e-5 mm, where one scale for the whole actuator would cost 1e-3 mm.

use super::TILE_NODES;
use super::plan::{Op, Plan};
use super::spec::{BasisError, Source, Spec, Values};

/// How the basis is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Precision {
    /// 4 bytes an entry: the rounding of f32.
    F32,
    /// 2 bytes an entry: see [`Basis::error_bound`](super::Basis::error_bound).
    I16,
}

const LINE: usize = 64;
/// Largest magnitude of a stored i16; -32768 stays unused so that the range is symmetric.
const I16_MAX: f64 = 32767.0;

/// One cache line, so that the storage is aligned to one.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Line(pub [u8; LINE]);

/// The tiles of a basis and what is needed to read them.
#[derive(Debug, Clone)]
pub(super) struct Tiles {
    /// The bytes, aligned to cache lines; the last line may be padding in part.
    lines: Vec<Line>,
    /// Bytes a tile: a multiple of 64 (F32) or 32 (I16).
    pub tile_bytes: usize,
    /// Factor of each coefficient, in the order of the mode rows: 1 for F32.
    pub scales: Vec<f64>,
    /// Half the largest step of any mean or rest row, per op: 0 for F32.
    pub constant_error: Vec<f64>,
}

/// A row of a tile in f64.
type Row = [f64; TILE_NODES];

impl Tiles {
    /// Gathers and converts every row.
    pub(super) fn build(spec: &Spec<'_>, plan: &Plan, precision: Precision) -> Result<Self, BasisError> {
        let tile_bytes = tile_bytes(plan, precision);
        let total = tile_bytes * plan.tiles();
        let mut tiles = Self {
            lines: vec![Line([0; LINE]); total.div_ceil(LINE)],
            tile_bytes,
            scales: mode_scales(spec, plan, precision),
            constant_error: vec![0.0; plan.ops.len()],
        };
        let mut bytes = vec![0u8; tile_bytes];
        for tile in 0..plan.tiles() {
            tiles.fill_tile(spec, plan, precision, tile, &mut bytes)?;
            tiles.write(tile * tile_bytes, &bytes);
        }
        Ok(tiles)
    }

    /// First byte, aligned to 64.
    pub(super) fn as_ptr(&self) -> *const u8 {
        self.lines.as_ptr().cast()
    }

    /// Whole cache lines.
    pub(super) fn lines(&self) -> &[Line] {
        &self.lines
    }

    fn fill_tile(
        &mut self,
        spec: &Spec<'_>,
        plan: &Plan,
        precision: Precision,
        tile: usize,
        bytes: &mut [u8],
    ) -> Result<(), BasisError> {
        let mut writer = TileWriter::new(bytes, plan, precision);
        let mut mode = 0;
        for (index, op) in plan.ops.iter().enumerate() {
            let Source::Affine(affine) = &spec.fields[op.field].source else { continue };
            let gather = |values: &dyn Fn(usize) -> f64| gather(spec, op.field, tile, values);
            let rest = rest_of(spec, op);
            let mut step: f64 = 0.0;
            if op.has_mean {
                let mean = |i| affine.mean.map_or(0.0, |m| m.get(i)) - folded_rest(op, rest, i);
                step = step.max(writer.constant(&gather(&mean)?));
            }
            for j in 0..op.modes {
                let row = gather(&|i| affine.modes.get(j * affine.stride + i))?;
                writer.mode(&row, self.scales[mode]);
                mode += 1;
            }
            if let (true, Some(rest)) = (op.has_rest, rest) {
                step = step.max(writer.constant(&gather(&|i| rest.get(i))?));
            }
            self.constant_error[index] = self.constant_error[index].max(step / 2.0);
        }
        Ok(())
    }

    fn write(&mut self, start: usize, bytes: &[u8]) {
        for (k, &byte) in bytes.iter().enumerate() {
            self.lines[(start + k) / LINE].0[(start + k) % LINE] = byte;
        }
    }
}

/// The undeformed coordinate that belongs to a component of the displacement.
fn rest_of<'a>(spec: &Spec<'a>, op: &Op) -> Option<Values<'a>> {
    spec.fields.iter().find_map(|field| match &field.source {
        Source::Magnitude { coordinates, rest } if op.in_magnitude => {
            coordinates.iter().position(|&c| c == op.field).map(|axis| rest[axis])
        }
        _ => None,
    })
}

/// What to take off the mean of a coordinate that is computed for the displacement alone.
fn folded_rest(op: &Op, rest: Option<Values<'_>>, node: usize) -> f64 {
    match rest {
        Some(rest) if !op.has_rest => rest.get(node),
        _ => 0.0,
    }
}

fn tile_bytes(plan: &Plan, precision: Precision) -> usize {
    let rows = plan.constant_rows + plan.mode_rows;
    match precision {
        Precision::F32 => rows * TILE_NODES * 4,
        Precision::I16 => header_bytes(plan.constant_rows) + rows * TILE_NODES * 2,
    }
}

/// Bytes of the I16 header, padded so that rows stay aligned to 32.
pub(super) fn header_bytes(constant_rows: usize) -> usize {
    (constant_rows * 8).next_multiple_of(32)
}

/// One tile's row of values; lanes beyond the last node repeat it, so that padding never wins a maximum.
fn gather(
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

/// One scale a mode over the node set, so that its largest entry is the largest i16.
fn mode_scales(spec: &Spec<'_>, plan: &Plan, precision: Precision) -> Vec<f64> {
    let mut scales = Vec::with_capacity(plan.mode_rows);
    for op in &plan.ops {
        let Source::Affine(affine) = &spec.fields[op.field].source else { continue };
        for j in 0..op.modes {
            scales.push(match precision {
                Precision::F32 => 1.0,
                Precision::I16 => {
                    let entry = |i| affine.modes.get(j * affine.stride + spec.source_node(i)).abs();
                    (0..spec.output_nodes()).map(entry).fold(0.0, f64::max) / I16_MAX
                }
            });
        }
    }
    scales
}

/// Writes the rows of one tile in order.
struct TileWriter<'a> {
    header: &'a mut [u8],
    rows: &'a mut [u8],
    precision: Precision,
    constants: usize,
    position: usize,
}

impl<'a> TileWriter<'a> {
    fn new(bytes: &'a mut [u8], plan: &Plan, precision: Precision) -> Self {
        let header = match precision {
            Precision::F32 => 0,
            Precision::I16 => header_bytes(plan.constant_rows),
        };
        let (header, rows) = bytes.split_at_mut(header);
        Self { header, rows, precision, constants: 0, position: 0 }
    }

    /// A mean or rest row; returns its step (0 for F32).
    fn constant(&mut self, row: &Row) -> f64 {
        if self.precision == Precision::F32 {
            self.floats(row);
            return 0.0;
        }
        let (low, high) = row.iter().fold((f64::MAX, f64::MIN), |(l, h), &v| (l.min(v), h.max(v)));
        let offset = ((low + high) / 2.0) as f32;
        let scale = ((high - low) / (2.0 * I16_MAX)) as f32;
        let head = &mut self.header[self.constants * 8..][..8];
        head[..4].copy_from_slice(&scale.to_ne_bytes());
        head[4..].copy_from_slice(&offset.to_ne_bytes());
        self.constants += 1;
        self.integers(row, f64::from(offset), f64::from(scale));
        f64::from(scale)
    }

    fn mode(&mut self, row: &Row, scale: f64) {
        match self.precision {
            Precision::F32 => self.floats(row),
            Precision::I16 => self.integers(row, 0.0, scale),
        }
    }

    fn floats(&mut self, row: &Row) {
        for &value in row {
            self.push(&(value as f32).to_ne_bytes());
        }
    }

    fn integers(&mut self, row: &Row, offset: f64, scale: f64) {
        for &value in row {
            let steps = if scale > 0.0 { ((value - offset) / scale).round() } else { 0.0 };
            self.push(&(steps.clamp(-I16_MAX, I16_MAX) as i16).to_ne_bytes());
        }
    }

    fn push(&mut self, bytes: &[u8]) {
        self.rows[self.position..][..bytes.len()].copy_from_slice(bytes);
        self.position += bytes.len();
    }
}
