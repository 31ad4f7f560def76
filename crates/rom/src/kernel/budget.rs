//! How coarse the rows of a basis may be, so that it is as small as an accepted error lets it be.
//!
//! In a group of nodes a field is a sum of [`Component`]s, each a row of values times a coefficient whose root mean square in use is
//! known. Rounding a row to steps `d` adds `d^2/12` times the mean square of its coefficient to the mean square error of a value, and
//! leaving it out adds its own mean square. The coefficients of local modes do not correlate, so these squares add up. With the same
//! error for every row, the bits go where they are needed (reverse water-filling): one step `s` for a whole field, and a row has
//!
//! ```text
//! nothing   below s / sqrt(3) in root mean square, twice what rounding it would add
//! i8        up to 127 s, in steps of s
//! i16       up to 32767 s, in as fine steps as its largest value allows
//! f32       beyond
//! ```
//! The coarsest `s` is taken whose errors add up to no more than is accepted. The largest error of any value is a different matter:
//! [`Basis::error_bound`](super::Basis::error_bound).

use super::tiles::I16_MAX;

/// The error that storing a basis may add.
#[derive(Debug, Clone, Copy)]
pub struct Budget<'a> {
    /// Coefficient vectors as they come in use, at least one. Their mean squares and products say how much a row counts.
    pub typical: &'a [Vec<f64>],
    /// By field of the spec: root mean square over the nodes and over `typical` of what storage may add to its values, in its unit.
    /// Of a magnitude nothing is asked: its coordinates have theirs.
    pub accepted: &'a [f64],
    /// A field of which f32 adds more than is accepted stays in f32; otherwise it is an error.
    pub or_f32: bool,
}

/// Largest magnitude of an i8.
pub(super) const I8_MAX: f64 = 127.0;
/// Mean square of the rounding of an f32 by that of the value: half of 2^-23, evenly spread.
pub(super) const F32_ROUNDING: f64 = 1.0 / (3.0 * (1_u64 << 48) as f64);
/// Steps tried: an eighth of an octave apart, so many octaves around the accepted error.
const EIGHTHS: i32 = 8 * 24;

/// In which way a row is stored. Rows of a list lie in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Width {
    F32,
    I16,
    I8,
}

impl Width {
    /// All of them, in their order.
    pub const ALL: [Self; 3] = [Self::F32, Self::I16, Self::I8];
}

/// A row of values over the nodes of a group, and the coefficient that it is multiplied by.
#[derive(Debug, Clone)]
pub(super) struct Component {
    /// By node of the group.
    pub values: Vec<f64>,
    /// Root mean square of its coefficient.
    pub rms: f64,
    /// The coefficient, as a sum over the rows of its list.
    pub of_rows: Vec<f64>,
}

impl Component {
    fn largest(&self) -> f64 {
        self.values.iter().fold(0.0, |most: f64, value| most.max(value.abs()))
    }

    /// Sum over the nodes of the mean squares of what it adds.
    pub fn energy(&self) -> f64 {
        self.rms * self.rms * self.values.iter().map(|value| value * value).sum::<f64>()
    }

    /// How it is stored and in which steps, for the step `s` of its field; none when it is left out.
    pub fn stored(&self, s: f64) -> Option<(Width, f64)> {
        Size::of(self)
            .stored(s)
            .map(|(width, step)| (width, if width == Width::I8 { step / self.rms } else { step }))
    }
}

/// What decides about a component.
struct Size {
    nodes: f64,
    energy: f64,
    /// Largest magnitude of a value, and of what it adds.
    largest: [f64; 2],
}

impl Size {
    fn of(component: &Component) -> Self {
        let largest = component.largest();
        let nodes = component.values.len() as f64;
        Self { nodes, energy: component.energy(), largest: [largest, largest * component.rms] }
    }

    /// The step of an i8 is that of what it adds, not of its values.
    fn stored(&self, s: f64) -> Option<(Width, f64)> {
        let [value, adds] = self.largest;
        if self.energy <= self.nodes * s * s / 3.0 {
            None
        } else if adds <= I8_MAX * s {
            Some((Width::I8, s))
        } else if adds <= I16_MAX * s {
            Some((Width::I16, value / I16_MAX))
        } else {
            Some((Width::F32, 1.0))
        }
    }

    /// What it adds to the sum over the nodes of the mean square errors.
    fn adds(&self, s: f64) -> f64 {
        let rounding = |step: f64| self.nodes * step * step / 12.0;
        match self.stored(s) {
            None => self.energy,
            Some((Width::F32, _)) => self.energy * F32_ROUNDING,
            Some((Width::I16, _)) => rounding(self.largest[1] / I16_MAX),
            Some((Width::I8, _)) => rounding(s),
        }
    }
}

/// The coarsest step with which these components add up to no more than `accepted` squared, of `nodes` values, with `left_out` gone
/// already; none where no step does.
pub(super) fn step<'a>(
    components: impl Iterator<Item = &'a Component>,
    [accepted, nodes, left_out]: [f64; 3],
) -> Option<f64> {
    let sizes: Vec<Size> = components.map(Size::of).collect();
    let allowed = accepted * accepted * nodes - left_out;
    let tried = (-EIGHTHS..EIGHTHS).rev().map(|eighths| accepted * (f64::from(eighths) / 8.0).exp2());
    tried.into_iter().find(|s| sizes.iter().map(|size| size.adds(*s)).sum::<f64>() <= allowed)
}
