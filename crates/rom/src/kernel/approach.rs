//! RBF kernel values, derivatives and difference vectors between a state and all centres. Results are bit-identical on all
//! instruction sets.

use super::isa::with_widest_vectors;
use super::weigh::{BLOCK, Near};
use crate::inputs::Point;
use crate::radial::KernelKind;

with_widest_vectors! {
    /// Evaluates all centres at the state `u = M x`. `centres` holds their inputs per group and input, eight centres per row.
    pub(crate) fn approach(
        kernel: KernelKind,
        u: &Point,
        dimensions: usize,
        centres: &[[f64; BLOCK]],
        near: &mut [Near],
    ) = approach_groups;
}

#[inline(always)]
fn approach_groups(
    kernel: KernelKind,
    u: &Point,
    dimensions: usize,
    centres: &[[f64; BLOCK]],
    near: &mut [Near],
) {
    // Of a kernel that is known where the loop stands, not asked for at every centre.
    macro_rules! known {
        ($($kind:pat => $same:expr),*) => {
            match kernel {
                $($kind => {
                    for (centres, near) in centres.chunks_exact(dimensions.max(1)).zip(near) {
                        approach_one($same, u, centres, near);
                    }
                })*
            }
        };
    }
    known!(
        KernelKind::Linear => KernelKind::Linear,
        KernelKind::ThinPlate => KernelKind::ThinPlate,
        KernelKind::Cubic => KernelKind::Cubic,
        KernelKind::Quintic => KernelKind::Quintic,
        KernelKind::Gaussian { shape } => KernelKind::Gaussian { shape },
        KernelKind::Matern72 { length } => KernelKind::Matern72 { length },
        KernelKind::CubicQuintic { crossover } => KernelKind::CubicQuintic { crossover }
    );
}

#[inline(always)]
fn approach_one(kernel: KernelKind, u: &Point, centres: &[[f64; BLOCK]], near: &mut Near) {
    let mut square = [0.0; BLOCK];
    for ((centres, u), d) in centres.iter().zip(u).zip(&mut near[3..]) {
        for k in 0..BLOCK {
            d[k] = u - centres[k];
            square[k] += d[k] * d[k];
        }
    }
    for k in 0..BLOCK {
        let [g, a, b] = kernel.derivatives(square[k]);
        (near[0][k], near[1][k], near[2][k]) = (g, a, b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inputs::MAX_INPUTS;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn centres_are_approached_alike_by_every_instruction_set(
            u in proptest::array::uniform8(-2.0..2.0_f64),
            places in proptest::collection::vec(proptest::array::uniform8(-2.0..2.0_f64), 1..12),
            dimensions in 1..=MAX_INPUTS,
            kernel in 0..7_usize,
        ) {
            let kernel = [
                KernelKind::Linear,
                KernelKind::ThinPlate,
                KernelKind::Cubic,
                KernelKind::Quintic,
                KernelKind::Gaussian { shape: 1.5 },
                KernelKind::Matern72 { length: 0.7 },
                KernelKind::CubicQuintic { crossover: 0.4 },
            ][kernel];
            let group = |of: &[[f64; 8]]| -> Vec<[f64; BLOCK]> {
                // The state itself in the rows that are left.
                (0..dimensions).map(|j| std::array::from_fn(|k| of.get(k).map_or(u[j], |at| at[j]))).collect()
            };
            let centres: Vec<[f64; BLOCK]> = places.chunks(BLOCK).flat_map(group).collect();
            let mut near = vec![[[f64::NAN; BLOCK]; 3 + MAX_INPUTS]; places.len().div_ceil(BLOCK)];
            approach(kernel, &u, dimensions, &centres, &mut near);
            for k in 0..near.len() * BLOCK {
                let (of, lane) = (&near[k / BLOCK], k % BLOCK);
                let mut square = 0.0;
                for j in 0..dimensions {
                    let d = u[j] - places.get(k).map_or(u[j], |at| at[j]);
                    prop_assert_eq!(of[3 + j][lane].to_bits(), d.to_bits());
                    square += d * d;
                }
                for (row, wanted) in kernel.derivatives(square).into_iter().enumerate() {
                    prop_assert_eq!(of[row][lane].to_bits(), wanted.to_bits());
                }
            }
        }
    }
}
