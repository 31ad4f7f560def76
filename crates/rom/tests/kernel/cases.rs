//! A body of arbitrary size with the five fields of the model.

use std::ops::Range;

use rom::kernel::{Affine, Field, FieldSource, Isa, Modes, Precision, Role, Shift, Spec};

/// Data that a [`Spec`] can borrow from.
#[derive(Debug, Clone)]
pub struct Body {
    pub nodes: usize,
    pub modes: usize,
    pub rest: [Vec<f32>; 3],
    pub means: [Vec<f32>; 4],
    pub bases: [Modes; 4],
    /// Modal coefficients, behind them two that move the undeformed coordinates.
    pub coefficients: Vec<f64>,
    /// Shifts of the undeformed coordinates: x and y by the first, z by the second.
    pub moves: [Vec<f32>; 3],
}

/// A small generator, so that a case is its seed.
pub struct Lcg(pub u64);

impl Lcg {
    /// Uniform in -1 ... 1.
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    pub fn vector(&mut self, len: usize, scale: f64) -> Vec<f64> {
        (0..len).map(|_| scale * self.next()).collect()
    }

    pub fn floats(&mut self, len: usize, scale: f64) -> Vec<f32> {
        (0..len).map(|_| (scale * self.next()) as f32).collect()
    }
}

impl Body {
    pub fn new(nodes: usize, modes: usize, seed: u64, precision: Precision) -> Self {
        Self::with_bits(nodes, seed, &vec![precision.bits(); modes])
    }

    /// Modes of so many bits each.
    pub fn with_bits(nodes: usize, seed: u64, bits: &[u8]) -> Self {
        let modes = bits.len();
        let mut random = Lcg(seed);
        let rest = std::array::from_fn(|_| random.floats(nodes, 115.0));
        let means = std::array::from_fn(|field: usize| match rest.get(field) {
            Some(rest) => {
                let rest: &Vec<f32> = rest;
                rest.iter().map(|x| x + (10.0 * random.next()) as f32).collect()
            }
            None => random.floats(nodes, 0.1),
        });
        let bases = std::array::from_fn(|_| {
            let values = random.floats(nodes * modes, 0.02);
            Modes::with_bits(nodes, bits.to_vec(), |mode, node| f64::from(values[mode * nodes + node]))
                .unwrap()
        });
        let mut coefficients = random.vector(4 * modes, 500.0);
        coefficients.extend(random.vector(2, 0.4));
        let moves = std::array::from_fn(|_| random.floats(nodes, 5.0));
        Self { nodes, modes, rest, means, bases, coefficients, moves }
    }

    fn range(&self, field: usize) -> Range<usize> {
        field * self.modes..(field + 1) * self.modes
    }

    /// X, Y, Z, U, S; `published` says which are written.
    pub fn spec<'a>(&'a self, published: [bool; 5], nodes: Option<&'a [u32]>) -> Spec<'a> {
        let affine = |field: usize, role: Role, published: bool| Field {
            source: FieldSource::Affine(Affine {
                mean: Some(&self.means[field]),
                modes: &self.bases[field],
                coefficients: self.range(field),
            }),
            role,
            published,
        };
        let rest = [0, 1, 2].map(|axis| &self.rest[axis][..]);
        let [x, y, z] = [0, 1, 2].map(|axis| Some(&self.moves[axis][..]));
        let shift = |at: usize, axes| Shift { coefficient: 4 * self.modes + at, axes };
        let shifts = vec![shift(0, [x, y, None]), shift(1, [None, None, z])];
        let fields = vec![
            affine(0, Role::Plain, published[0]),
            affine(1, Role::Plain, published[1]),
            affine(2, Role::Plain, published[2]),
            Field {
                source: FieldSource::Magnitude { coordinates: [0, 1, 2], rest, shifts },
                role: Role::Displacement,
                published: published[3],
            },
            affine(3, Role::Stress, published[4]),
        ];
        Spec { node_count: self.nodes, nodes, fields }
    }
}

/// The instruction sets of this machine.
pub fn available() -> Vec<Isa> {
    Isa::ALL.into_iter().filter(|isa| isa.is_available()).collect()
}
