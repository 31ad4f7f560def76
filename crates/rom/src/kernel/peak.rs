//! The largest value of one field without computing all of it: value and node are those of a sweep over all nodes, to the bit.
//!
//! Nodes with similar rows share a tile. Of every tile the middle `c` of its rows and their largest distance `d` from it are known, and of
//! the modes beyond the first few, whose coefficients are small, the largest length `t` over its nodes. So no value of it exceeds
//!
//! ```text
//! c_0 + d_0 + sum_j (c_j a_j + d_j |a_j|) + t |a / w|        j over the first modes; t = max |m w|, and |a / w|, over the others
//! ```
//!
//! with any weights `w`: the usual magnitudes of the coefficients. The bounds of all tiles are two sums like those of a field, with a node a
//! tile. Tiles whose bound is below the largest value found are left out; all others are swept as they are in a [`Basis`] of all nodes: the
//! same rows in the same order, hence the same bits.

use super::TILE_NODES;
use super::basis::{Basis, Peak, ReconstructError};
use super::isa::Isa;
use super::plan::Plan;
use super::spec::{Affine, BasisError, Field, Role, Source, Spec, Values};
use super::tiles::Precision;
use std::ops::Range;

/// Unit roundoff of f32.
const ROUNDOFF: f64 = 1.0 / (1u64 << 24) as f64;
/// More than all roundings of numbers near zero add up to, also where the processor takes the smallest ones for zero.
const NEAR_ZERO: f64 = f32::MIN_POSITIVE as f64 * 4096.0;
/// Modes that are bounded one by one.
const FIRST_MODES: usize = 12;
/// Weights are kept from where their products would leave f32.
const WEIGHTS: [f64; 2] = [1e-9, 1e9];

/// A field whose largest value is searched for. Fields as of [`Role::Stress`]: not below 0.
#[derive(Debug, Clone)]
pub struct PeakSearch {
    /// `c` of every tile, over all coefficients.
    centres: Basis,
    /// `d` and `t` of every tile, over what they are multiplied by.
    reaches: Basis,
    tiles: Vec<Basis>,
    coefficients: Range<usize>,
    /// Weights of the modes beyond the first.
    weights: Vec<f64>,
    bounds: Vec<f32>,
    reach: Vec<f32>,
    swept: usize,
}

impl PeakSearch {
    /// Sorts the nodes into tiles and lays them out. `largest` is the usual magnitude of every coefficient of the vector: it says
    /// which nodes are similar, and has no part in what is found. Cost: some ten passes over the modes.
    ///
    /// # Errors
    /// As [`Basis::build`].
    pub fn build(field: &Affine<'_>, node_count: usize, largest: &[f64]) -> Result<Self, BasisError> {
        Self::build_for(field, node_count, largest, Isa::detect())
    }

    /// The same for a chosen instruction set: for tests and comparisons.
    ///
    /// # Errors
    /// As [`Self::build`], and [`BasisError::IsaMissing`].
    pub fn build_for(
        field: &Affine<'_>,
        node_count: usize,
        largest: &[f64],
        isa: Isa,
    ) -> Result<Self, BasisError> {
        let whole = Spec { node_count, nodes: None, fields: vec![described(field.clone(), Role::Stress)] };
        Plan::new(&whole)?; // the slices have their lengths
        let rows = Rows::new(field, largest);
        let mut order: Vec<u32> = (0..node_count as u32).collect();
        rows.sort(&mut order);
        // Of equal values the lowest node is reported.
        order.chunks_mut(TILE_NODES).for_each(<[u32]>::sort_unstable);
        let tiles: Vec<&[u32]> = order.chunks(TILE_NODES).collect();
        let tile = |nodes: &&[u32]| {
            Basis::build_for(&Spec { nodes: Some(nodes), ..whole.clone() }, Precision::F32, isa)
        };
        let bases: Vec<Basis> = tiles.iter().map(tile).collect::<Result<_, _>>()?;
        let (centres, reaches) = rows.bounds(&tiles);
        let (from, first) = (field.coefficients.start, rows.first - 1);
        Ok(Self {
            centres: basis_of(&centres, from..from + first, tiles.len(), isa)?,
            reaches: basis_of(&reaches, 0..first + 1, tiles.len(), isa)?,
            weights: rows.weights[rows.first..].to_vec(),
            bounds: vec![0.0; tiles.len()],
            reach: vec![0.0; tiles.len()],
            tiles: bases,
            coefficients: field.coefficients.clone(),
            swept: 0,
        })
    }

    /// The largest value and its node, as [`Basis::reconstruct`] of all nodes finds them. Nothing is allocated.
    ///
    /// # Errors
    /// [`ReconstructError`] when there are fewer coefficients than the modes refer to.
    pub fn find(&mut self, coefficients: &[f64]) -> Result<Peak, ReconstructError> {
        let Some(own) = coefficients.get(self.coefficients.clone()) else {
            let (found, expected) = (coefficients.len(), self.coefficients.end);
            return Err(ReconstructError::Coefficients { found, expected });
        };
        self.centres.reconstruct(coefficients, &mut self.bounds)?;
        let (first, others) = own.split_at(own.len() - self.weights.len());
        let mut sizes = [0.0; FIRST_MODES + 1];
        sizes.iter_mut().zip(first).for_each(|(size, coefficient)| *size = coefficient.abs());
        // As the sweep takes them: in f32.
        let square = |(a, weight): (&f64, &f64)| (f64::from(*a as f32) / weight).powi(2);
        let length = others.iter().zip(&self.weights).map(square).sum::<f64>().sqrt();
        sizes[first.len()] = length + f64::from(f32::MIN_POSITIVE);
        self.reaches.reconstruct(&sizes[..=first.len()], &mut self.reach)?;
        for (bound, reach) in self.bounds.iter_mut().zip(&self.reach) {
            let sum = *bound + reach;
            // What is no number bounds nothing, and nothing is below 0.
            *bound = if sum.is_finite() { sum.max(0.0) } else { f32::INFINITY };
        }
        let mut first = 0;
        for tile in 1..self.bounds.len() {
            if self.bounds[tile] > self.bounds[first] {
                first = tile;
            }
        }
        let mut best = self.sweep(first, coefficients)?;
        self.swept = 1;
        for tile in 0..self.bounds.len() {
            // Not below: of equal values the lowest node is found.
            if self.bounds[tile] < best.value || tile == first {
                continue;
            }
            self.swept += 1;
            let found = self.sweep(tile, coefficients)?;
            if found.value > best.value || found.value == best.value && found.node < best.node {
                best = found;
            }
        }
        Ok(best)
    }

    fn sweep(&self, tile: usize, coefficients: &[f64]) -> Result<Peak, ReconstructError> {
        let (basis, mut values) = (&self.tiles[tile], [0.0; TILE_NODES]);
        let peaks = basis.reconstruct(coefficients, &mut values[..basis.nodes()])?;
        Ok(peaks.stress_mpa.unwrap_or(Peak { value: f32::NEG_INFINITY, node: 0 }))
    }

    /// How many tiles the last search swept, and how many there are.
    pub fn swept(&self) -> (usize, usize) {
        (self.swept, self.tiles.len())
    }
}

fn described(affine: Affine<'_>, role: Role) -> Field<'_> {
    Field { source: Source::Affine(affine), role, published: true }
}

/// A basis with a node a tile, of its rows one after the other, the mean's first.
fn basis_of(rows: &[f32], coefficients: Range<usize>, tiles: usize, isa: Isa) -> Result<Basis, BasisError> {
    let (mean, modes) = rows.split_at(tiles);
    let (mean, modes) = (Some(Values::F32(mean)), Values::F32(modes));
    let affine = Affine { mean, modes, stride: tiles, coefficients };
    let spec = Spec { node_count: tiles, nodes: None, fields: vec![described(affine, Role::Plain)] };
    Basis::build_for(&spec, Precision::F32, isa)
}

/// Mean and modes of the field, as the sweep reads them.
struct Rows<'a> {
    field: &'a Affine<'a>,
    /// What each is usually multiplied by.
    weights: Vec<f64>,
    /// Mean and first modes.
    first: usize,
}

impl<'a> Rows<'a> {
    fn new(field: &'a Affine<'a>, largest: &[f64]) -> Self {
        let [least, most] = WEIGHTS;
        let own = field.coefficients.clone().map(|at| largest.get(at).copied().unwrap_or(1.0));
        let weights: Vec<f64> =
            std::iter::once(1.0).chain(own.map(|size| size.max(least).min(most))).collect();
        Self { field, first: weights.len().min(1 + FIRST_MODES), weights }
    }

    /// In f32, as it is stored.
    fn value(&self, row: usize, node: u32) -> f64 {
        let node = node as usize;
        let value = match row.checked_sub(1) {
            None => self.field.mean.map_or(0.0, |mean| mean.get(node)),
            Some(mode) => self.field.modes.get(mode * self.field.stride + node),
        };
        f64::from(value as f32)
    }

    /// Smallest and largest value of a row.
    fn span(&self, row: usize, nodes: &[u32]) -> (f64, f64) {
        nodes.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), node| {
            let value = self.value(row, *node);
            (low.min(value), high.max(value))
        })
    }

    /// Halves the nodes again and again along the row over which they differ most, down to whole tiles.
    fn sort(&self, nodes: &mut [u32]) {
        if nodes.len() <= TILE_NODES {
            return;
        }
        let width = |row: usize| {
            let (low, high) = self.span(row, nodes);
            (high - low) * self.weights[row]
        };
        let widths: Vec<f64> = (0..self.weights.len()).map(width).collect();
        let widest = (0..widths.len()).max_by(|a, b| widths[*a].total_cmp(&widths[*b])).unwrap_or(0);
        let middle = (nodes.len() / 2).next_multiple_of(TILE_NODES);
        nodes.select_nth_unstable_by(middle, |a, b| {
            self.value(widest, *a).total_cmp(&self.value(widest, *b)).then(a.cmp(b))
        });
        let (low, high) = nodes.split_at_mut(middle);
        self.sort(low);
        self.sort(high);
    }

    /// Rows of centres and of reaches, a value a tile.
    fn bounds(&self, tiles: &[&[u32]]) -> (Vec<f32>, Vec<f32>) {
        let one = |row: usize| tiles.iter().map(move |nodes| self.bound(row, nodes));
        let (centres, mut reaches): (Vec<f32>, Vec<f32>) = (0..self.first).flat_map(one).unzip();
        reaches.extend(tiles.iter().map(|nodes| self.others(nodes)));
        (centres, reaches)
    }

    /// Middle and reach of a row in a tile.
    fn bound(&self, row: usize, nodes: &[u32]) -> (f32, f32) {
        let (low, high) = self.span(row, nodes);
        let centre = (0.5 * (low + high)) as f32;
        let middle = f64::from(centre);
        let reach = (high - middle).max(middle - low);
        let near_zero = if row == 0 { NEAR_ZERO } else { 0.0 };
        (centre, ((reach + self.roundings() * (middle.abs() + reach) + near_zero) as f32).next_up())
    }

    /// Largest length, over the nodes, of the weighted modes beyond the first.
    fn others(&self, nodes: &[u32]) -> f32 {
        let square = |node: u32| move |row: usize| (self.value(row, node) * self.weights[row]).powi(2);
        let squares =
            nodes.iter().map(|node| (self.first..self.weights.len()).map(square(*node)).sum::<f64>());
        let length = squares.fold(0.0, f64::max).sqrt();
        ((length * (1.0 + self.roundings())) as f32).next_up()
    }

    /// With `n` modes in f32 a value is off by at most `(n + 2) u` times the sum of the magnitudes of its terms. So are both parts of the
    /// bound, which have no more terms; factor and sum are rounded once more. More than all of these together.
    fn roundings(&self) -> f64 {
        (4 * self.weights.len() + 16) as f64 * ROUNDOFF
    }
}
